"""Reward: one function per term over a batch of states; the same for every asset."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from articulate.arm import Arm
from articulate.judgement import COLUMN
from articulate.kinematics import tool_pose
from articulate.task import Task, at_target
from articulate.transforms import Array, rotation_angle
from articulate_envs.engine import State

TERMS = (
    "reach", "align", "grip", "early", "open", "progress", "rest",
    "force", "speed", "action", "violation",
)  # fmt: skip
"""Names of the terms, in the order of :func:`reward_terms`."""


@dataclass(frozen=True, kw_only=True)
class RewardConfig:
    """Weights. A tick's reward is the sum of the terms."""

    reach: float = 0.8
    """For the tool being at the handle: the mean of 1 / (1 + (d / scale)^2) over two scales."""
    reach_m: tuple[float, float] = (0.08, 0.015)
    """Those scales [m]: one draws the hand near, the other onto the handle."""
    align: float = 0.25
    """For the hand being turned like the handle, cos of the angle, weighted by closeness."""
    grip: float = 0.5
    """For a hand that is told to close, and for one that is closed, at the handle."""
    grip_m: float = 0.018
    """Distance at which that has fallen to 1/e [m]."""
    early: float = -0.75
    """For a hand that is told to close, or is closed, away from the handle."""
    open: float = 2.0
    """For the fraction of the way to the target."""
    margin: float = 0.08
    """Opening is paid for up to the target and this share of it beyond: what is known of the part
    is noisy, and one who aims at the target itself stops short of it."""
    progress: float = 40.0
    """For each change of that fraction."""
    rest: float = 1.5
    """For resting at or beyond the target."""
    force: float = -0.02
    """For each newton of filtered force beyond ``force_free_n``, at the beginning of training."""
    force_last: float = -0.08
    """The same at its end; linear between (dear forces at first keep the hand off the handle)."""
    force_free_n: float = 15.0
    """Force that costs nothing [N]."""
    speed: float = -2.0
    """For the part's speed beyond ``speed_free``, per m/s or 0.2 rad/s."""
    speed_free: float = 0.15
    """Speed of the part that costs nothing [m/s]."""
    action: float = -0.01
    """For the mean square of the joint deltas."""
    violation: float = -20.0
    """Once, when a limit of the task is broken, at the end of training; in proportion before."""
    spoiled: float = 0.3
    """Share of what opening earns that is left after a violation, at the end of training; all of
    it at the beginning, linear between (else too little is learnt of opening)."""


def reward_terms(
    config: RewardConfig,
    task: Task,
    arm: Arm,
    before: State,
    after: State,
    action: Array,
    progress: float = 0.0,
) -> Array:
    """Weighted terms (N, len(TERMS)) of one tick.

    Args:
        config: Weights.
        task: Target and speeds.
        arm: For its forward kinematics.
        before: State before the tick.
        after: State after it.
        action: What the policy said (N, 8).
        progress: Share of the training that is done, in [0, 1].
    """
    T_wt = tool_pose(arm, after.q)
    distance = np.linalg.norm(T_wt[:, :3, 3] - after.T_wh[:, :3, 3], axis=1)
    near, at = (1.0 / (1.0 + (distance / scale) ** 2) for scale in config.reach_m)
    turn = np.swapaxes(T_wt[:, :3, :3], -1, -2) @ after.T_wh[:, :3, :3]
    aligned = np.maximum(np.cos(rotation_angle(turn)), -1.0)
    goal = min(task.target * (1.0 + config.margin), 1.0)
    way = np.clip(after.opened / goal, 0.0, 1.0)
    change = way - np.clip(before.opened / goal, 0.0, 1.0)
    close = np.exp(-((distance / config.grip_m) ** 2))
    told = (
        0.25 * np.maximum(action[:, 7], 0.0)
        + 0.25 * np.maximum(after.hand.smooth, 0.0)
        + 0.5 * (after.hand.closing > 0.0)
    )
    away = 1.0 - np.exp(-((distance / (2.2 * config.grip_m)) ** 2))
    length = 1.0 if task.kind == "slide" else 0.2
    part_speed = np.abs(after.speed) * length
    force = np.linalg.norm(after.samples[:, 0:3], axis=1)
    code = COLUMN["code"]
    done = after.samples[:, code] > 0.0
    broken = (after.samples[:, code] > 0.0) & (before.samples[:, code] == 0.0)
    left = np.where(done, 1.0 + progress * (config.spoiled - 1.0), 1.0)
    dear = config.force + progress * (config.force_last - config.force)
    terms = (
        config.reach * 0.5 * (near + at),
        config.align * near * aligned,
        config.grip * close * told,
        config.early * away * told,
        config.open * left * way,
        config.progress * left * change,
        config.rest * left * at_target(task, after.opened, after.speed),
        dear * np.maximum(force - config.force_free_n, 0.0),
        config.speed * np.maximum(part_speed - config.speed_free, 0.0),
        config.action * np.mean(action[:, :7] ** 2, axis=1),
        config.violation * progress * broken,
    )
    return np.stack(terms, axis=1)
