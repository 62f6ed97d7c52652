"""Reward: one function per term over a batch of states; the same for every asset."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from articulate.asset import Handle
from articulate.judgement import COLUMN
from articulate.task import Task, at_target
from articulate.transforms import Array, Mask, rotation_angle
from articulate_envs.engine import State
from articulate_envs.settings import RewardConfig

TERMS = (
    "approach", "reach", "align", "grip", "early", "aside", "open", "progress", "rest",
    "force", "speed", "action", "violation", "success",
)  # fmt: skip
"""Names of the terms, in the order of :func:`reward_terms`; the last is :func:`at_end`'s."""


FINGER_M = 0.022
"""Width of a finger along the handle that it holds [m]: 21 mm in franka's finger.stl, and one."""
PAD_M = 0.008
"""How far the pads reach to either side of the tool along the approach [m]."""
HELD_SHARE = 0.6
"""Fingers at the handle that are at least this share of its thickness apart have it between them,
or are still open; closer ones have closed on nothing."""
TOUCH_M = 0.008
"""Fingers farther apart than a handle's thickness and this do not both touch it [m]."""
MOST_ALONG_M = 0.05
"""Largest distance from a handle's middle that counts as its middle [m]."""


@dataclass(frozen=True, kw_only=True)
class Grasp:
    """What a handle asks of a hand."""

    along_m: float = 0.0
    """Distance from the handle's middle along its long axis at which fingers hold it [m]."""
    thick_m: float = 0.0
    """What has to fit between the fingers [m]."""


NO_GRASP = Grasp()
"""Of a part without a handle: its point is to be reached."""


def grasp_of(handle: Handle | None) -> Grasp:
    """What ``handle`` asks of a hand; None asks for a point."""
    if handle is None:
        return NO_GRASP
    along_m = min(max(0.0, 0.9 * (handle.extent[0] - FINGER_M) / 2.0), MOST_ALONG_M)
    return Grasp(along_m=along_m, thick_m=handle.extent[1])


def grip_offset(T_wt: Array, T_wh: Array, along_m: float) -> Array:
    """Place (N, 3) [m] of tools in the axes of handles, from the nearest point as good to grip.

    Args:
        T_wt: Poses of the tools (N, 4, 4).
        T_wh: Poses of the handles (N, 4, 4); their x axis is the long one.
        along_m: Half the length of the segment about the handle's middle that counts as one.
    """
    offset = np.einsum("nij,ni->nj", T_wh[:, :3, :3], T_wt[:, :3, 3] - T_wh[:, :3, 3])
    offset[:, 0] -= np.clip(offset[:, 0], -along_m, along_m)
    return np.asarray(offset)


def aside(
    config: RewardConfig,
    T_wt: Array,
    T_wh: Array,
    width: Array,
    grasp: Grasp,
    progress: float = 1.0,
) -> Array:
    """By how much tools have left the way that leads to handles (N,) [m]; see ``aside``.

    Args:
        config: How wide that way is.
        T_wt: Poses of the tools (N, 4, 4).
        T_wh: Poses of the handles (N, 4, 4).
        width: Distance between the fingers as they are (N,) [m].
        grasp: What the handle asks of a hand.
        progress: Share of the way that the weights have made to their last values, in [0, 1].
    """
    offset_w = np.einsum("nij,nj->ni", T_wh[:, :3, :3], grip_offset(T_wt, T_wh, grasp.along_m))
    across, ahead = -np.einsum("nij,ni->jn", T_wt[:, :3, 1:3], offset_w)
    room = np.maximum(width - grasp.thick_m, 0.0) / 2.0
    allowed = config.aside_share * room + np.maximum(ahead - config.aside_from_m, 0.0)
    held = _not_empty(width, grasp) & (ahead <= PAD_M)
    held &= np.abs(across) <= grasp.thick_m / 2.0
    untouched = np.where(width <= grasp.thick_m + TOUCH_M, 0.0, max(2.0 * progress - 1.0, 0.0))
    beside = np.where(held, untouched, 1.0) * np.maximum(np.abs(across) - allowed, 0.0)
    return np.asarray(beside + np.maximum(-ahead - config.beyond_m, 0.0))


def _not_empty(width: Array, grasp: Grasp) -> Mask:
    """Whether a handle can be between fingers that are ``width`` (N,) [m] apart."""
    return np.asarray((width >= HELD_SHARE * grasp.thick_m) | (grasp.thick_m <= 0.0))


def away_from(config: RewardConfig, T_wt: Array, T_wh: Array, along_m: float) -> Array:
    """How far tools are from handles, place and turn in one (N,) [m]; see ``approach``."""
    return _away(config, grip_offset(T_wt, T_wh, along_m), _turned(T_wt, T_wh))


def _turned(T_wt: Array, T_wh: Array) -> Array:
    """Angles between tools and handles (N,) [rad]."""
    return rotation_angle(np.swapaxes(T_wt[:, :3, :3], -1, -2) @ T_wh[:, :3, :3])


def _away(config: RewardConfig, offset: Array, turned: Array) -> Array:
    """:func:`away_from` of the places (N, 3) and angles (N,) of tools in handles."""
    weighted = offset * np.array([1.0, config.approach_across, 1.0])
    return np.asarray(np.linalg.norm(weighted, axis=1) + config.approach_turn_m * turned)


def _goal(config: RewardConfig, task: Task) -> float:
    """The opening up to which the way is paid for: the target, and a margin beyond it."""
    first = task.begin[1]
    goal = first + (task.target - first) * (1.0 + config.margin)
    if task.closes:
        return max(goal, task.target / 2.0)
    return goal if task.stop is None else min(goal, (task.target + task.stop) / 2.0)


def _paid(config: RewardConfig, task: Task, opened: Array) -> Array:
    """Share (N,) of the way to the target that is paid for, at most 1.

    It counts from where the part may begin farthest from its target.
    """
    first, goal = task.begin[1], _goal(config, task)
    opened = _measured(task, opened)
    way = np.clip((opened - first) / (goal - first), 0.0, 1.0)
    if task.stop is None:
        return np.asarray(way)
    sign = -1.0 if task.closes else 1.0
    room = max(sign * (task.stop - goal), config.over_room)
    over = np.clip(sign * (opened - goal) / room, 0.0, 1.0)
    return np.asarray(way - config.over * over)


def _measured(task: Task, opened: Array) -> Array:
    """Openings (N,); of what closes, from either side: one without a stop can pass its end."""
    return np.abs(opened) if task.closes else opened


def _beyond(config: RewardConfig, task: Task, opened: Array) -> Array:
    """Share (N,) of the margin beyond the target that is made, in [0, 1]."""
    margin = _goal(config, task) - task.target
    if margin == 0.0:  # the target is the end of the way
        return np.ones(len(opened))
    return np.asarray(np.clip((_measured(task, opened) - task.target) / margin, 0.0, 1.0))


def reward_terms(
    config: RewardConfig,
    task: Task,
    before: State,
    after: State,
    action: Array,
    progress: float = 0.0,
    grasp: Grasp = NO_GRASP,
) -> Array:
    """Weighted terms (N, len(TERMS)) of one tick, all but those of :func:`at_end`.

    Args:
        config: Weights.
        task: Target and speeds.
        before: State before the tick.
        after: State after it.
        action: What the policy said (N, 8).
        progress: Share of the training that is done, in [0, 1].
        grasp: What the handle asks of a hand.
    """
    progress = min(progress / config.until, 1.0)
    T_wt, turned = after.T_wt, _turned(after.T_wt, after.T_wh)
    offset = grip_offset(T_wt, after.T_wh, grasp.along_m)
    nearer = away_from(config, before.T_wt, before.T_wh, grasp.along_m)
    nearer -= _away(config, offset, turned)
    distance = np.linalg.norm(offset, axis=1)
    near, at = (1.0 / (1.0 + (distance / scale) ** 2) for scale in config.reach_m)
    aligned = np.exp(-((turned / config.align_rad) ** 2))
    way = _paid(config, task, after.opened)
    change = way - _paid(config, task, before.opened)
    still = at_target(task, after.opened, after.speed)
    grip_m = config.grip_m + progress * (config.grip_last_m - config.grip_m)
    close = np.exp(-((distance / grip_m) ** 2))
    told = (
        0.125 * (1.0 + np.clip(action[:, 7], -1.0, 1.0))
        + 0.125 * (1.0 + after.hand.smooth)
        + 0.5 * (after.hand.closing > 0.0)
    )
    empty = ~_not_empty(after.hand_width, grasp)
    away = 1.0 - np.exp(-((distance / (2.2 * config.grip_m)) ** 2))
    away = np.where(empty & (after.hand.closing > 0.0), 1.0, away)
    length = 1.0 if task.kind == "slide" else 0.2
    part_speed = np.abs(after.speed) * length
    force = np.linalg.norm(after.samples[:, 0:3], axis=1)
    code = COLUMN["code"]
    done = after.samples[:, code] > 0.0
    broken = (after.samples[:, code] > 0.0) & (before.samples[:, code] == 0.0)
    left = np.where(done, 1.0 + progress * (config.spoiled - 1.0), 1.0)
    early = config.early + progress * (config.early_last - config.early)
    dear = config.force + progress * (config.force_last - config.force)
    left_way = aside(config, T_wt, after.T_wh, after.hand_width, grasp, progress)
    terms = (
        config.approach * nearer,
        config.reach * 0.5 * (near + at),
        config.align * near * aligned,
        config.grip * close * told * ~empty,
        early * away * told,
        config.aside * progress * left_way,
        config.open * left * way,
        config.progress * left * change,
        config.rest * left * still * _beyond(config, task, after.opened),
        dear * np.maximum(force - config.force_free_n, 0.0),
        config.speed * np.maximum(part_speed - config.speed_free, 0.0),
        config.action * np.mean(action[:, :7] ** 2, axis=1),
        config.violation * progress * broken,
        np.zeros(len(way)),
    )
    return np.stack(terms, axis=1)


def at_end(config: RewardConfig, succeeded: Mask) -> Array:
    """Weighted terms (M, len(TERMS)) of how M episodes ended that ran their full length."""
    terms = np.zeros((len(succeeded), len(TERMS)))
    terms[:, TERMS.index("success")] = config.success * succeeded
    return terms
