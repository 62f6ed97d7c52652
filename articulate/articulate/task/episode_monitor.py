"""Judgement: what accumulates over an episode and how it ends.

The same functions judge an episode in every engine and on the robot. They see samples (one
per physics or control step) and ticks (one per action of the policy). All arrays have a
leading axis of N episodes.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from articulate.robot.arm import Arm
from articulate.task.task import Limits, Task, at_target, beyond_target
from articulate.transforms import Array, Ints, Mask


class FailureReason(IntEnum):
    """Reason code with which an episode ends; ``SUCCESS`` is 0, codes 1 to 6 are violated limits."""

    SUCCESS = 0
    FORBIDDEN_CONTACT = 1
    SPEED = 2
    TORQUE = 3
    TORQUE_RATE = 4
    FORCE = 5
    MOMENT = 6
    GOAL_NOT_REACHED = 7
    NOT_AT_REST = 8
    DIVERGED = 9

    def __str__(self) -> str:
        return self.name.lower()


REASONS = tuple(str(reason) for reason in FailureReason)
"""Names of the reason codes in files and reports, in order of their codes."""

FIELDS = (
    "fx", "fy", "fz", "mx", "my", "mz",
    "sx", "sy", "sz",
    "force", "force_short", "force_raw", "moment", "speed_share", "torque_share", "torque_rate",
    "code", "time", "violation_time",
)  # fmt: skip
"""Columns of a judgement's samples.

``fx`` to ``mz`` the filtered wrench, ``sx`` to ``sz`` the force under the short filter; then the
peaks so far of force, short-filtered and raw force [N], moment [Nm], speed and torque as
shares of the arm's tables, torque rate [Nm/s]; the first violation's code (0: none), the time
judged so far and the time of that violation [s].
"""
COLUMN = {name: i for i, name in enumerate(FIELDS)}
WIDTH = len(FIELDS)


@dataclass(frozen=True)
class EpisodeMonitor:
    """What N episodes have shown so far."""

    samples: Array
    """One row per episode with the columns :data:`FIELDS` (N, WIDTH)."""
    rest_s: Array
    """Time for which the part has rested at or beyond the target without a break (N,) [s]."""
    opened: Mask
    """Whether the part is at or beyond the target at the last tick (N,)."""
    diverged: Mask
    """Whether a state was not finite (N,)."""

    def peak(self, field: str) -> Array:
        """Column ``field`` of :data:`FIELDS` (N,)."""
        return np.asarray(self.samples[:, COLUMN[field]])


def new_monitor(n: int) -> EpisodeMonitor:
    """Judgement of N episodes that have not begun."""
    none = np.zeros(n, dtype=bool)
    return EpisodeMonitor(np.zeros((n, WIDTH)), np.zeros(n), none, none.copy())


def judge_sample(
    samples: Array,
    *,
    dq: Array,
    torque: Array,
    torque_before: Array,
    wrench: Array,
    touch: Mask,
    dt: float,
    arm: Arm,
    limits: Limits,
) -> Array:
    """The rows of :class:`EpisodeMonitor` after one more sample.

    Args:
        samples: Rows so far (N, WIDTH).
        dq: Joint speeds (N, 7) [rad/s].
        torque: Joint torques, gravity included (N, 7) [Nm].
        torque_before: Those of the sample before (N, 7) [Nm].
        wrench: Force [N] and moment about the tool frame [Nm] of the surroundings on hand and
            fingers, world axes (N, 6).
        touch: Whether anything but hand and fingers touches the object (N,).
        dt: Time since the sample before [s].
        arm: Limit tables.
        limits: Shares and bounds.
    """
    out = samples.copy()
    c = COLUMN
    gain = 1.0 - np.exp(-dt / limits.filter_s)
    out[:, 0:6] += gain * (wrench - out[:, 0:6])
    out[:, 6:9] += (1.0 - np.exp(-dt / limits.short_filter_s)) * (wrench[:, :3] - out[:, 6:9])
    force = np.linalg.norm(out[:, 0:3], axis=1)
    moment = np.linalg.norm(out[:, 3:6], axis=1)
    speed = np.max(np.abs(dq) / arm.dq_max, axis=1)
    share = np.max(np.abs(torque) / arm.tau_max, axis=1)
    rate = np.max(np.abs(torque - torque_before), axis=1) / dt
    first = samples[:, c["time"]] == 0.0
    rate = np.where(first, 0.0, rate)
    values = {
        "force": force,
        "force_short": np.linalg.norm(out[:, 6:9], axis=1),
        "force_raw": np.linalg.norm(wrench[:, :3], axis=1),
        "moment": moment,
        "speed_share": speed,
        "torque_share": share,
        "torque_rate": rate,
    }
    for name, value in values.items():
        out[:, c[name]] = np.maximum(out[:, c[name]], value)
    out[:, c["time"]] += dt
    broken = np.stack(
        [
            touch,
            speed > limits.speed_share,
            share >= limits.torque_share,
            rate > arm.dtau_max,
            force > limits.force_n,
            moment > limits.moment_nm,
        ],
        axis=1,
    )
    new = (out[:, c["code"]] == 0.0) & broken.any(axis=1)
    out[new, c["code"]] = 1.0 + np.argmax(broken[new], axis=1)
    out[new, c["violation_time"]] = out[new, c["time"]]
    return out


def judge_tick(
    judgement: EpisodeMonitor,
    samples: Array,
    task: Task,
    *,
    opened: Array,
    speed: Array,
    step_s: float,
) -> EpisodeMonitor:
    """The judgement after one more tick.

    Args:
        judgement: What was shown so far.
        samples: Rows of :func:`judge_sample` at the end of the tick (N, WIDTH).
        task: Target, speed bound.
        opened: Fraction open (N,).
        speed: Speed of the part (N,) [m/s or rad/s].
        tick_s: Length of the tick [s].
    """
    finite = np.isfinite(samples).all(axis=1) & np.isfinite(opened) & np.isfinite(speed)
    rests = at_target(task, opened, speed)
    return EpisodeMonitor(
        samples=samples,
        rest_s=np.where(rests, judgement.rest_s + step_s, 0.0),
        opened=beyond_target(task, opened),
        diverged=judgement.diverged | ~finite,
    )


def goal_held(judgement: EpisodeMonitor, task: Task) -> Mask:
    """Whether the part rested at or beyond the target for the whole hold time (N,)."""
    return np.asarray((judgement.rest_s >= task.hold_s - 1e-9) & ~judgement.diverged)


def failure_reason(judgement: EpisodeMonitor, task: Task) -> Ints:
    """Code of :data:`REASONS` for N episodes that have ended (N,) of int."""
    held = goal_held(judgement, task)
    code = np.where(held, FailureReason.SUCCESS, FailureReason.GOAL_NOT_REACHED)
    code = np.where(~held & judgement.opened, FailureReason.NOT_AT_REST, code)
    violation = judgement.peak("code")
    code = np.where(violation > 0.0, np.nan_to_num(violation).astype(int), code)
    return np.where(judgement.diverged, FailureReason.DIVERGED, code).astype(np.int64)
