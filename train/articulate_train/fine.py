"""Motions are finer near the handle, until the hand has closed on it.

A policy says eight numbers of [-1, 1] whose unit is what the arm may do in one tick. Far from the
object that is right; in the last centimetres, where 5 mm decide a grasp and the link may be two
ticks late, the same number should ask for less. So what a policy says is scaled by where the hand
will be when it has done what was said before (``handle_aimed``), in training and in the network
that is exported alike: no engine and no robot knows of it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from articulate.errors import ConfigError
from articulate.observe import ACTION, HANDLE_UNIT_M, OBSERVATION, SINCE_S


@dataclass(frozen=True, kw_only=True)
class FineConfig:
    """How much finer a hand that holds nothing moves near the handle."""

    share: float = 0.6
    """Share of a motion that is left there; 1 changes nothing."""
    near_m: float = 0.03
    """Distance of the handle up to which all of it counts [m]."""
    far_m: float = 0.10
    """Distance from which nothing of it counts [m]."""
    held_s: tuple[float, float] = (0.5, 1.0)
    """Times after closing was told between which motions become whole again [s]: most hands
    have closed by then."""

    def __post_init__(self) -> None:
        if not 0.0 < self.share <= 1.0:
            raise ConfigError(f"fine.share is {self.share}; it must be above 0 and at most 1")
        if not 0.0 <= self.near_m < self.far_m:
            raise ConfigError(
                f"fine.near_m is {self.near_m} and fine.far_m {self.far_m}; they must grow from 0"
            )
        begin, end = self.held_s
        if not 0.0 <= begin < end <= SINCE_S:
            raise ConfigError(
                f"fine.held_s is {begin} {end}; it must be two growing times of at most {SINCE_S} s"
            )

    def shares(self, observation: Any) -> Any:
        """Shares (N, 1) of the motions that are left at observations (N, size), raw.

        Written for arrays of numpy and for tensors of torch alike.
        """
        handle = observation[:, _HANDLE] * HANDLE_UNIT_M
        distance = (handle * handle).sum(-1, keepdims=True) ** 0.5
        near = ((self.far_m - distance) / (self.far_m - self.near_m)).clip(0.0, 1.0)
        wish, since = observation[:, _WISH], observation[:, _SINCE] * SINCE_S
        begin, end = self.held_s
        held = wish.clip(0.0, 1.0) * ((since - begin) / (end - begin)).clip(0.0, 1.0)
        return 1.0 - (1.0 - self.share) * near * (1.0 - held)


_HANDLE = OBSERVATION.slice("handle_aimed")
_COMMAND = OBSERVATION.slice("hand_command").start
_WISH, _SINCE = slice(_COMMAND + 1, _COMMAND + 2), slice(_COMMAND + 2, _COMMAND + 3)
MOTIONS = ACTION.slice("hand").start
"""So many numbers of an action are motions; the hand's command comes after them."""
