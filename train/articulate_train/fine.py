"""Motions are finer near the handle, and finer still while the hand closes on it.

A policy says eight numbers of [-1, 1] whose unit is what the arm may do in one tick. Far from the
object that is right; in the last centimetres, where 5 mm decide a grasp and the link may be two
ticks late, the same number should ask for less. And a hand acts up to a second after it was told:
who pulls by the clock pulls before the fingers have closed. So what a policy says is scaled by
where the hand will be when it has done what was said before (``handle_aimed``), and by what the
fingers do, in training and in the network that is exported alike: no engine and no robot knows of
it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

from articulate.errors import ConfigError
from articulate.observe import ACTION, HANDLE_UNIT_M, OBSERVATION, SPEED_UNIT_M_S, WIDTH_UNIT_M


@dataclass(frozen=True, kw_only=True)
class FineConfig:
    """How much finer a hand that holds nothing moves near the handle."""

    share: float = 0.6
    """Share of a motion that is left there to an open hand; 1 changes nothing."""
    closing: float = 0.05
    """Share that is left there from when closing is told until the fingers have closed."""
    closing_first: float = 0.25
    """The same at the beginning of training: where a hand is all but still while it closes, it is
    not learnt how to come to stand well."""
    closing_between: tuple[float, float] = (0.5, 0.8)
    """Shares of the training between which it falls from the first to the last, linear."""
    near_m: float = 0.03
    """Distance of the handle up to which all of it counts [m]."""
    far_m: float = 0.10
    """Distance from which nothing of it counts [m]."""
    shut_m: tuple[float, float] = (0.072, 0.078)
    """Openings between which fingers come to count as closed, if they rest [m]: a hand opens to
    0.08 m, and holds what is at most 0.07 m thick."""
    rest_m_s: float = 0.05
    """Change of the opening from which fingers do not rest at all [m/s]; closing, they make 0.1."""

    def __post_init__(self) -> None:
        for name in ("share", "closing", "closing_first"):
            value = getattr(self, name)
            if not 0.0 < value <= 1.0:
                raise ConfigError(f"fine.{name} is {value}; it must be above 0 and at most 1")
        if not 0.0 <= self.near_m < self.far_m:
            raise ConfigError(
                f"fine.near_m is {self.near_m} and fine.far_m {self.far_m}; they must grow from 0"
            )
        begin, end = self.shut_m
        if not 0.0 <= begin < end:
            raise ConfigError(f"fine.shut_m is {begin} {end}; it must be two growing openings")
        begin, end = self.closing_between
        if not 0.0 <= begin < end <= 1.0:
            raise ConfigError(
                f"fine.closing_between is {begin} {end}; it must be two growing shares in [0, 1]"
            )
        if not self.rest_m_s > 0.0:
            raise ConfigError(f"fine.rest_m_s is {self.rest_m_s}; it must be above 0")

    def at(self, progress: float) -> FineConfig:
        """What counts when ``progress`` in [0, 1] of the training is done."""
        begin, end = self.closing_between
        done = min(max((progress - begin) / (end - begin), 0.0), 1.0)
        closing = self.closing_first + done * (self.closing - self.closing_first)
        return replace(self, closing=closing)

    def shares(self, observation: Any) -> Any:
        """Shares (N, 1) of the motions that are left at observations (N, size), raw.

        Written for arrays of numpy and for tensors of torch alike.
        """
        handle = observation[:, _HANDLE] * HANDLE_UNIT_M
        distance = (handle * handle).sum(-1, keepdims=True) ** 0.5
        near = ((self.far_m - distance) / (self.far_m - self.near_m)).clip(0.0, 1.0)
        told = observation[:, _WISH].clip(0.0, 1.0)
        begin, end = self.shut_m
        shut = ((end - observation[:, _WIDTH] * WIDTH_UNIT_M) / (end - begin)).clip(0.0, 1.0)
        change = abs(observation[:, _SPEED]) * SPEED_UNIT_M_S
        closed = shut * (1.0 - change / self.rest_m_s).clip(0.0, 1.0)
        taken = (1.0 - told) * (1.0 - self.share) + told * (1.0 - closed) * (1.0 - self.closing)
        return 1.0 - near * taken


_HANDLE = OBSERVATION.slice("handle_aimed")
_COMMAND = OBSERVATION.slice("hand_command").start
_WISH = slice(_COMMAND + 1, _COMMAND + 2)
_WIDTH, _SPEED = OBSERVATION.slice("hand_width"), OBSERVATION.slice("hand_speed")
MOTIONS = ACTION.slice("hand").start
"""So many numbers of an action are motions; the hand's command comes after them."""
