"""The reward of a tick, compiled: one term after another for each environment.

In numpy it took as long as the physics of four environments.
"""

from __future__ import annotations

from collections import namedtuple
from dataclasses import fields
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numba import njit

from articulate.robot.arm import PAD_M
from articulate.task.episode_monitor import COLUMN
from articulate.task.task import Task
from articulate.transforms import Array
from articulate_envs.compiled.judge import rests
from articulate_envs.config import RewardConfig
from articulate_envs.engine import State

HELD_SHARE = 0.6
"""Fingers at the handle that are at least this share of its thickness apart have it between them,
or are still open; closer ones have closed on nothing."""
AWAY = 2.2
"""A hand counts as away from the handle, to 63 %, at so many times the distance at which ``grip``
has fallen to 1/e; both narrow while training goes on."""
TOUCH_M = 0.008
"""Fingers farther apart than a handle's thickness and this do not both touch it [m]."""

_CODE = COLUMN["code"]

_NAMES = [f.name for f in fields(RewardConfig)]
Weights: Any = namedtuple("Weights", _NAMES)  # type: ignore[misc]  # names are not literal
"""The numbers of :class:`RewardConfig` by their names."""


class Way(NamedTuple):
    """What a task pays for."""

    closes: bool
    """Whether the part is moved towards its closed end."""
    first: float
    """Fraction open at which the part may begin farthest from its target."""
    target: float
    """Fraction open at which the task counts as done."""
    goal: float
    """Fraction up to which the way is paid for: the target, and a margin beyond it."""
    room: float
    """Fractions beyond the goal on which ``overshoot`` is lost; 0 where there is no stop."""
    slow: float
    """Speed below which the part counts as resting [m/s or rad/s]."""
    length_m: float
    """Metres of a unit of the part's speed."""


class View(NamedTuple):
    """Arrays of a :class:`State` that are paid for, first axis N."""

    T_wt: Array
    T_wh: Array
    opened: Array
    speed: Array
    width: Array
    smooth: Array
    closing: Array
    samples: Array


def view_of(state: State) -> View:
    """What is paid for of ``state``."""
    return View(
        state.T_wt,
        state.T_wh,
        state.opened,
        state.speed,
        state.gripper_width,
        state.gripper.smooth,
        state.gripper.closing,
        state.samples,
    )


@cache
def weights_of(config: RewardConfig) -> Any:
    """``config`` as numbers."""
    values = (getattr(config, f.name) for f in fields(config))
    return Weights(*(v if isinstance(v, tuple) else float(v) for v in values))


@cache
def way_of(config: RewardConfig, task: Task) -> Way:
    """What ``task`` pays for."""
    first = task.begin[1]
    goal = first + (task.target - first) * (1.0 + config.margin)
    if task.closes:
        goal = max(goal, task.target / 5.0)
    elif task.stop is not None:
        goal = min(goal, (task.target + task.stop) / 2.0)
    sign, room = (-1.0 if task.closes else 1.0), 0.0
    if task.stop is not None:
        room = max(sign * (task.stop - goal), config.overshoot_room)
    length_m = 1.0 if task.kind == "slide" else 0.2
    return Way(task.closes, first, task.target, goal, room, task.slow, length_m)


@njit(cache=True, error_model="numpy", boundscheck=False)
def grip_offset(T_wt, T_wh, along_m):  # type: ignore[no-untyped-def]
    """Place (3) [m] of a tool in the axes of a handle, from the nearest point as good to grip.

    ``T_wt`` and ``T_wh`` (4, 4) are poses of tool and handle, whose x axis is the long one; half as
    long as the segment about its middle that counts as its middle is ``along_m``.
    """
    dx, dy, dz = T_wt[0, 3] - T_wh[0, 3], T_wt[1, 3] - T_wh[1, 3], T_wt[2, 3] - T_wh[2, 3]
    x = T_wh[0, 0] * dx + T_wh[1, 0] * dy + T_wh[2, 0] * dz
    y = T_wh[0, 1] * dx + T_wh[1, 1] * dy + T_wh[2, 1] * dz
    z = T_wh[0, 2] * dx + T_wh[1, 2] * dy + T_wh[2, 2] * dz
    return x - min(max(x, -along_m), along_m), y, z


@njit(cache=True, error_model="numpy", boundscheck=False)
def _turned(T_wt, T_wh):  # type: ignore[no-untyped-def]
    """Angle between tool and handle [rad]; see :func:`articulate.transforms.rotation_angle`."""
    m = np.empty((3, 3))
    for r in range(3):
        for c in range(3):
            m[r, c] = T_wt[0, r] * T_wh[0, c] + T_wt[1, r] * T_wh[1, c] + T_wt[2, r] * T_wh[2, c]
    x, y, z = m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]
    return np.arctan2(np.sqrt(x * x + y * y + z * z), m[0, 0] + m[1, 1] + m[2, 2] - 1.0)


@njit(cache=True, error_model="numpy", boundscheck=False, forceinline=True)
def _away(w, offset, turned):  # type: ignore[no-untyped-def]
    """How far a tool is from a handle, place and turn in one [m]; see ``approach``."""
    x, y, z = offset
    y *= w.approach_across
    return np.sqrt(x * x + y * y + z * z) + w.approach_turn_m * turned


@njit(cache=True, error_model="numpy", boundscheck=False, forceinline=True)
def _paid(w, way, opened):  # type: ignore[no-untyped-def]
    """Share of the way to the target that is paid for, at most 1.

    Of what closes, from either side: a part without a stop can pass its end.
    """
    sign = -1.0 if way.closes else 1.0
    opened = abs(opened) if way.closes else opened
    share = min(max((opened - way.first) / (way.goal - way.first), 0.0), 1.0)
    if way.room == 0.0:
        return share
    return share - w.overshoot * min(max(sign * (opened - way.goal) / way.room, 0.0), 1.0)


@njit(cache=True, error_model="numpy", boundscheck=False, forceinline=True)
def _beyond(way, opened):  # type: ignore[no-untyped-def]
    """Share of the margin beyond the target that is made, in [0, 1]."""
    margin = way.goal - way.target
    if margin == 0.0:  # the target is the end of the way
        return 1.0
    opened = abs(opened) if way.closes else opened
    return min(max((opened - way.target) / margin, 0.0), 1.0)


@njit(cache=True, error_model="numpy", boundscheck=False)
def _not_empty(width, thick_m):  # type: ignore[no-untyped-def]
    """Whether a handle can be between fingers that are ``width`` [m] apart."""
    return width >= HELD_SHARE * thick_m or thick_m <= 0.0


@njit(cache=True, error_model="numpy", boundscheck=False, forceinline=True)
def _aside(w, offset, T_wt, T_wh, width, thick_m, progress):  # type: ignore[no-untyped-def]
    """By how much a tool has left the way that leads to a handle [m]; see ``lateral_offset``."""
    across = ahead = 0.0
    for r in range(3):
        along_r = T_wh[r, 0] * offset[0] + T_wh[r, 1] * offset[1] + T_wh[r, 2] * offset[2]
        across -= T_wt[r, 1] * along_r
        ahead -= T_wt[r, 2] * along_r
    room = max(width - thick_m, 0.0) / 2.0
    allowed = w.lateral_free_share * room + max(ahead - w.lateral_free_from_m, 0.0)
    beside = min(max(abs(across) - allowed, 0.0), w.lateral_offset_max_m)
    not_empty, touched = _not_empty(width, thick_m), width <= thick_m + TOUCH_M
    if not_empty and ahead <= PAD_M and abs(across) <= thick_m / 2.0:
        beside *= 0.0 if touched else max(2.0 * progress - 1.0, 0.0)
    if not_empty and touched and thick_m > 0.0:  # held
        return beside
    return beside + max(-ahead - w.overreach_m, 0.0)


@njit(cache=True, error_model="numpy", boundscheck=False)
def write_terms(  # type: ignore[no-untyped-def]
    w, way, along_m, thick_m, progress, before, after, action, out
):
    """Write the weighted terms (N, len(TERMS)) of one tick, without those of its end.

    What is not finite is 0.
    ``progress`` is the share of the way that the weights have made to their last values.
    """
    for i in range(len(out)):
        _write_row(i, w, way, along_m, thick_m, progress, before, after, action, out)


@njit(cache=True, error_model="numpy", boundscheck=False, forceinline=True)
def _write_row(  # type: ignore[no-untyped-def]
    i, w, way, along_m, thick_m, progress, before, after, action, out
):
    T_wt, T_wh, width, closing = after.T_wt[i], after.T_wh[i], after.width[i], after.closing[i]
    turned, offset = _turned(T_wt, T_wh), grip_offset(T_wt, T_wh, along_m)
    first = grip_offset(before.T_wt[i], before.T_wh[i], along_m)
    nearer = _away(w, first, _turned(before.T_wt[i], before.T_wh[i])) - _away(w, offset, turned)
    distance = np.sqrt(offset[0] ** 2 + offset[1] ** 2 + offset[2] ** 2)
    near = 1.0 / (1.0 + (distance / w.reach_m[0]) ** 2)
    at = 1.0 / (1.0 + (distance / w.reach_m[1]) ** 2)
    paid = _paid(w, way, after.opened[i])
    change = paid - _paid(w, way, before.opened[i])
    grip_m = w.grip_m + progress * (w.grip_last_m - w.grip_m)
    told = 0.125 * (1.0 + min(max(action[i, 7], -1.0), 1.0)) + 0.125 * (1.0 + after.smooth[i])
    empty, away = not _not_empty(width, thick_m), 1.0
    if closing > 0.0:
        told += 0.5
    if not (empty and closing > 0.0):
        away = 1.0 - np.exp(-((distance / (AWAY * grip_m)) ** 2))
    row = after.samples[i]
    spoiled = row[_CODE] > 0.0
    left = 1.0 + progress * (w.violated_share - 1.0) if spoiled else 1.0
    force = np.sqrt(row[0] ** 2 + row[1] ** 2 + row[2] ** 2)
    motion = 0.0
    for k in range(7):
        motion += action[i, k] ** 2
    to = out[i]
    to[0] = w.approach * nearer
    to[1] = w.reach * 0.5 * (near + at)
    to[2] = w.align * near * np.exp(-((turned / w.align_rad) ** 2))
    to[3] = 0.0 if empty else w.grip * np.exp(-((distance / grip_m) ** 2)) * told
    to[4] = (
        (w.premature_close + progress * (w.premature_close_last - w.premature_close)) * away * told
    )
    to[5] = w.lateral_offset * progress * _aside(w, offset, T_wt, T_wh, width, thick_m, progress)
    to[6] = w.open * left * paid
    to[7] = w.progress * left * change
    to[8] = 0.0
    if rests(way, after.opened[i], after.speed[i]):
        to[8] = w.rest * left * _beyond(way, after.opened[i])
    dear = w.force + progress * (w.force_last - w.force)
    to[9] = dear * max(force - w.force_free_n, 0.0)
    to[10] = w.speed * max(abs(after.speed[i]) * way.length_m - w.speed_free, 0.0)
    to[11] = w.action * motion / 7.0
    broken = spoiled and before.samples[i, _CODE] == 0.0
    to[12] = w.violation * progress if broken else 0.0
    to[13] = 0.0
    for k in range(len(to)):
        if not np.isfinite(to[k]):  # of an environment that diverged
            to[k] = 0.0
