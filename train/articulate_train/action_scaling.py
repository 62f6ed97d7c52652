"""Motions are finer near the handle, and finer still while the hand closes on it.

A policy says eight numbers of [-1, 1] whose unit is what the arm may do in one tick. Far from the
object that is right; in the last centimetres, where 5 mm decide a grasp and the link may be two
ticks late, the same number should ask for less. And a hand acts up to a second after it was told:
who pulls by the clock pulls before the fingers have closed. So what a policy says is scaled by
where the hand will be when it has done what was said before (``handle_aimed``), by what the
fingers do, and by whether the part is where it should be, in training and in the network that is
exported alike: no engine and no robot knows of it.

Where a part is stopped near its target there is something more: what the arm's target is ahead by
more than needed is taken back (:func:`taken_back`). A drawer that comes at 0.16 m/s has 6 cm of
that, which alone would run it shut; and motions add up, so that a hand which says a little without
meaning it, at a drawer that is shut, would press with more each second.
"""

from __future__ import annotations

from functools import reduce
from typing import Any

from articulate.task.observation import (
    ACTION,
    BENT_UNIT_RAD,
    BEYOND_UNIT,
    HANDLE_UNIT_M,
    LEAD_UNIT_M,
    OBSERVATION,
    SPEED_UNIT_M_S,
    WIDTH_UNIT_M,
)
from articulate_train.config import ActionScalingConfig

_HANDLE = OBSERVATION.slice("handle_aimed")
_BENT, JOINTS = OBSERVATION.slice("target_lead"), 7
_LEAD = OBSERVATION.slice("tool_lead")
_BEYOND = OBSERVATION.slice("part_beyond")
_COMMAND = OBSERVATION.slice("hand_command").start
_WISH = slice(_COMMAND + 1, _COMMAND + 2)
_WIDTH, _SPEED = OBSERVATION.slice("hand_width"), OBSERVATION.slice("hand_speed")
SOON = 0.1
"""From this share of the way on which a part counts as done on, all that is too much is taken."""
TINY = 1e-6
"""Of leads [m and rad], that none is divided by."""
ELBOW = ACTION.slice("hand").start - 1
"""Numbers of an action before this one move and turn the tool; this one moves the elbow."""
MOTIONS = ELBOW + 1
"""So many numbers of an action are motions; the hand's command comes after them."""


def shares(fine: ActionScalingConfig, observation: Any) -> Any:
    """Shares (N, 1) of the motions that are left at observations (N, size), raw.

    Written for arrays of numpy and for tensors of torch alike.
    """
    handle = observation[:, _HANDLE] * HANDLE_UNIT_M
    distance = (handle * handle).sum(-1, keepdims=True) ** 0.5
    near = ((fine.far_m - distance) / (fine.far_m - fine.near_m)).clip(0.0, 1.0)
    told = observation[:, _WISH].clip(0.0, 1.0)
    begin, end = fine.shut_m
    shut = ((end - observation[:, _WIDTH] * WIDTH_UNIT_M) / (end - begin)).clip(0.0, 1.0)
    change = abs(observation[:, _SPEED]) * SPEED_UNIT_M_S
    closed = shut * (1.0 - change / fine.rest_m_s).clip(0.0, 1.0)
    taken = (1.0 - told) * (1.0 - fine.share) + told * (1.0 - closed) * (1.0 - fine.closing)
    done = _between(observation, fine.done_between)
    return (1.0 - near * taken) * (1.0 - done * (1.0 - fine.done))


def taken_back(fine: ActionScalingConfig, observation: Any) -> Any:
    """Motions of the tool (N, 6) that are taken off again at observations (N, size), raw."""
    lead, bent = observation[:, _LEAD], observation[:, _BENT]
    done, shut = _between(observation, fine.done_between), _between(observation, fine.shut_between)
    moved = (lead[:, :3] * lead[:, :3]).sum(-1, keepdims=True) ** 0.5 * LEAD_UNIT_M
    turned = reduce(_larger, (abs(bent[:, k : k + 1]) for k in range(JOINTS))) * BENT_UNIT_RAD
    much: Any = 0.0
    for ahead, (first, last) in ((moved, fine.lead_m), (turned, fine.lead_rad)):
        allowed = (first + done * (last - first)) * (1.0 - shut)
        much = _larger(much, (1.0 - allowed / (ahead + TINY)).clip(0.0, 1.0))
    return lead * fine.release * much * (done / SOON).clip(0.0, 1.0)


def _larger(a: Any, b: Any) -> Any:
    """The larger of two numbers, of arrays and of tensors alike."""
    return (a + b + abs(a - b)) / 2.0


def _between(observation: Any, fractions: tuple[float, float]) -> Any:
    """Where the part is between two fractions beyond its target (N, 1), within 0 and 1."""
    first, last = fractions
    beyond = observation[:, _BEYOND] * BEYOND_UNIT
    return ((beyond - first) / (last - first)).clip(0.0, 1.0)
