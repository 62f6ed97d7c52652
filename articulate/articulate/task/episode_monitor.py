"""Episode monitor: limits that an episode violates, and the reason with which it ends.

The same row functions (:mod:`articulate.jit`) run in every engine and on the robot. They get
samples (one per physics or controller step) and control steps (one per action of the policy).
"""

from __future__ import annotations

from enum import IntEnum
from typing import NamedTuple

import numpy as np

from articulate.jit import row_function
from articulate.robot.arm import Arm
from articulate.task.task import GoalParams, Limits, Task, is_at_goal, is_at_rest
from articulate.transforms import Array, Ints, Mask


class FailureReason(IntEnum):
    """Reason code of an ended episode; ``SUCCESS`` is 0, codes 1 to 6 are violated limits."""

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

    @property
    def meaning(self) -> str:
        """One sentence for people."""
        return _MEANINGS[self]


_MEANINGS = {
    FailureReason.SUCCESS: "The part is at rest at the target and no limit was violated.",
    FailureReason.FORBIDDEN_CONTACT: "Something other than the gripper touched the object.",
    FailureReason.SPEED: "A joint exceeded its allowed share of the arm's speed table.",
    FailureReason.TORQUE: "A joint required the torque of the arm's table or more.",
    FailureReason.TORQUE_RATE: "A torque changed faster than the arm's controller allows.",
    FailureReason.FORCE: "The filtered net contact force on the gripper exceeded the limit.",
    FailureReason.MOMENT: "The filtered net contact moment about the tool exceeded the limit.",
    FailureReason.GOAL_NOT_REACHED: "The part was not at the target at the end of the episode.",
    FailureReason.NOT_AT_REST: "The part was at the target, but not at rest for long enough.",
    FailureReason.DIVERGED: "A state was not finite.",
}

REASONS = tuple(str(reason) for reason in FailureReason)
"""Names of the reason codes in files and reports, in order of their codes."""

FIELDS = (
    "fx", "fy", "fz", "mx", "my", "mz",
    "sx", "sy", "sz",
    "force", "force_short", "force_raw", "moment", "speed_share", "torque_share", "torque_rate",
    "code", "time", "violation_time",
)  # fmt: skip
"""Columns of a monitor's samples.

``fx`` to ``mz`` the filtered wrench, ``sx`` to ``sz`` the force under the short filter; then the
peaks so far of force, short-filtered and raw force [N], moment [Nm], speed and torque as
shares of the arm's tables, torque rate [Nm/s]; the first violation's code (0: none), the time
monitored so far and the time of that violation [s].
"""
COLUMN = {name: i for i, name in enumerate(FIELDS)}
WIDTH = len(FIELDS)
_FORCE, _SHORT, _RAW = COLUMN["force"], COLUMN["force_short"], COLUMN["force_raw"]
_MOMENT, _SPEED, _SHARE = COLUMN["moment"], COLUMN["speed_share"], COLUMN["torque_share"]
_RATE, _CODE = COLUMN["torque_rate"], COLUMN["code"]
_TIME, _WHEN = COLUMN["time"], COLUMN["violation_time"]


class EpisodeMonitor(NamedTuple):
    """Record of N episodes so far."""

    samples: Array
    """One row per episode with the columns :data:`FIELDS` (N, WIDTH)."""
    rest_s: Array
    """Time for which the part has been at rest at its goal without a break (N,) [s]."""
    at_goal: Mask
    """True where the part is at or beyond the target at the last control step (N,)."""
    diverged: Mask
    """True where a state was not finite (N,)."""

    def peak(self, field: str) -> Array:
        """Return column ``field`` of :data:`FIELDS` (N,)."""
        return np.asarray(self.samples[:, COLUMN[field]])

    def copy(self) -> EpisodeMonitor:
        """Return a copy of all arrays."""
        return EpisodeMonitor(
            self.samples.copy(), self.rest_s.copy(), self.at_goal.copy(), self.diverged.copy()
        )


def new_monitor(n: int) -> EpisodeMonitor:
    """Return the monitor of N episodes that have not begun."""
    none = np.zeros(n, dtype=bool)
    return EpisodeMonitor(np.zeros((n, WIDTH)), np.zeros(n), none, none.copy())


class MonitorParams(NamedTuple):
    """Constants of :func:`monitor_sample`."""

    dt: float
    """Time between samples [s]."""
    gain: float
    """Share of a new value in the filtered wrench."""
    short_gain: float
    """The same for the short filter."""
    dq_max: Array
    tau_max: Array
    dtau_max: float
    speed_share: float
    torque_share: float
    force_n: float
    moment_nm: float


def filter_gain(dt: float, time_constant_s: float) -> float:
    """Return the share of a new value in a first-order filter with steps of ``dt`` [s]."""
    return 1.0 - float(np.exp(-dt / time_constant_s))


def monitor_params(arm: Arm, limits: Limits, dt: float) -> MonitorParams:
    """Return the constants for ``arm`` under ``limits``, with samples every ``dt`` [s]."""
    return MonitorParams(
        dt=float(dt),
        gain=filter_gain(dt, limits.filter_s),
        short_gain=filter_gain(dt, limits.short_filter_s),
        dq_max=np.asarray(arm.dq_max),
        tau_max=np.asarray(arm.tau_max),
        dtau_max=arm.dtau_max,
        speed_share=limits.speed_share,
        torque_share=limits.torque_share,
        force_n=limits.force_n,
        moment_nm=limits.moment_nm,
    )


@row_function
def low_pass(filtered: Array, first: int, values: Array, count: int, gain: float) -> None:
    """Move ``count`` numbers of ``filtered``, from index ``first`` on, towards ``values``."""
    for k in range(count):
        filtered[first + k] += gain * (values[k] - filtered[first + k])


@row_function
def _norm(values: Array, first: int) -> float:
    return float(np.sqrt(values[first] ** 2 + values[first + 1] ** 2 + values[first + 2] ** 2))


@row_function
def monitor_sample(
    row: Array,
    dq: Array,
    torque: Array,
    last_torque: Array,
    wrench: Array,
    forbidden_contact: bool,
    params: MonitorParams,
) -> None:
    """Update the row of one episode with one more sample.

    Args:
        row: Columns :data:`FIELDS` (WIDTH,), updated in place.
        dq: Joint speeds (7,) [rad/s].
        torque: Joint torques, gravity included (7,) [Nm].
        last_torque: Torques of the last sample (7,) [Nm]; overwritten with ``torque``.
        wrench: Force [N] and moment about the tool [Nm] of the surroundings on the gripper, world
            axes (6,).
        forbidden_contact: True if anything but the gripper touches the object.
        params: Filters and limits.
    """
    low_pass(row, 0, wrench, 6, params.gain)
    low_pass(row, 6, wrench, 3, params.short_gain)
    force, moment = _norm(row, 0), _norm(row, 3)
    speed = share = rate = 0.0
    for k in range(7):
        speed = max(speed, abs(dq[k]) / params.dq_max[k])
        share = max(share, abs(torque[k]) / params.tau_max[k])
        rate = max(rate, abs(torque[k] - last_torque[k]) / params.dt)
        last_torque[k] = torque[k]
    if row[_TIME] == 0.0:
        rate = 0.0
    row[_FORCE] = max(row[_FORCE], force)
    row[_SHORT] = max(row[_SHORT], _norm(row, 6))
    row[_RAW] = max(row[_RAW], _norm(wrench, 0))
    row[_MOMENT] = max(row[_MOMENT], moment)
    row[_SPEED] = max(row[_SPEED], speed)
    row[_SHARE] = max(row[_SHARE], share)
    row[_RATE] = max(row[_RATE], rate)
    row[_TIME] += params.dt
    if row[_CODE] == 0.0:
        code = 0.0
        if forbidden_contact:
            code = 1.0
        elif speed > params.speed_share:
            code = 2.0
        elif share >= params.torque_share:
            code = 3.0
        elif rate > params.dtau_max:
            code = 4.0
        elif force > params.force_n:
            code = 5.0
        elif moment > params.moment_nm:
            code = 6.0
        if code > 0.0:
            row[_CODE] = code
            row[_WHEN] = row[_TIME]


@row_function
def monitor_step(
    monitor: EpisodeMonitor, i: int, opened: float, speed: float, goal: GoalParams, step_s: float
) -> None:
    """Update episode ``i`` in place at the end of a control step.

    Args:
        monitor: Record so far; its samples are those at the end of the step.
        i: Index of the episode.
        opened: Fraction open.
        speed: Speed of the part [m/s or rad/s].
        goal: Target and speed bound.
        step_s: Length of the control step [s].
    """
    finite = bool(np.isfinite(opened) and np.isfinite(speed))
    for k in range(monitor.samples.shape[1]):
        finite = finite and bool(np.isfinite(monitor.samples[i, k]))
    monitor.at_goal[i] = is_at_goal(goal, opened)
    monitor.rest_s[i] = monitor.rest_s[i] + step_s if is_at_rest(goal, opened, speed) else 0.0
    monitor.diverged[i] = monitor.diverged[i] or not finite


def goal_held(monitor: EpisodeMonitor, task: Task) -> Mask:
    """Return True where the part has been at rest at its goal for the full hold time (N,)."""
    return np.asarray((monitor.rest_s >= task.hold_s - 1e-9) & ~monitor.diverged)


def failure_reason(monitor: EpisodeMonitor, task: Task) -> Ints:
    """Return the :class:`FailureReason` of N episodes that have ended (N,) of int."""
    held = goal_held(monitor, task)
    code = np.where(held, FailureReason.SUCCESS, FailureReason.GOAL_NOT_REACHED)
    code = np.where(~held & monitor.at_goal, FailureReason.NOT_AT_REST, code)
    violation = monitor.peak("code")
    code = np.where(violation > 0.0, np.nan_to_num(violation).astype(int), code)
    return np.where(monitor.diverged, FailureReason.DIVERGED, code).astype(np.int64)
