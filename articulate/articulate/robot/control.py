"""Control stack between a policy and the joints: targets, set-point filter, gripper, force limiter.

Once per control step (20 Hz) the policy moves a target of the joints: motion and rotation of the
tool in its own frame, and motion of the elbow. Between control steps a linear set-point filter of
third order, with three equal poles at ``-omega``, runs open loop towards the target::

    x''' = omega^3 (u - x) - 3 omega^2 x' - 3 omega x''

It is discretised exactly for a constant target, so its values at common instants are equal at 1 ms
and at the simulator's step. Its output is the set point of a joint impedance controller with target
velocity 0. A target changes by a bounded amount per control step (:func:`joint_steps`), so speed,
acceleration and jerk of the output are bounded for every sequence of targets (:func:`worst_case`).

Above a force limit (:func:`exceeds_force_limit`) targets retract instead: the compliant arm would
move on for a third of a second after its policy could react, which is 20 to 60 N at a contact.

Row functions (:mod:`articulate.jit`) run one environment; the engine compiles them.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from articulate.errors import ConfigError
from articulate.jit import row_function
from articulate.robot.arm import Arm, Gripper
from articulate.robot.config import ControlConfig
from articulate.robot.kinematics import (
    ArmGeometry,
    arm_geometry,
    resolve_motion,
    write_frames,
    write_jacobian,
    write_self_motion,
)
from articulate.transforms import Array, Ints

DAMPING = 0.02
"""Singular value of the Jacobian at which a motion of the tool is halved."""
OPEN_M = 0.07
"""Opening above which a gripper has not begun to close on anything [m]."""
FREE_SHARE = 0.7
"""Distance from the middle of a joint's range, as a share of half of it, from which on the elbow
moves away from the limit."""
AVOIDANCE_GAIN, AVOIDANCE_SHARE = 10.0, 0.5
"""Gain of that motion, and its largest size as a share of the elbow's largest motion."""
WIDEST_M = Gripper.max_width_m
"""Opening of an open gripper [m]."""
ROUNDING_S = 1e-9
"""Slack for comparing times that are sums of control steps [s]."""


def response(omega_rad_s: float, t: Array) -> Array:
    """Return position, velocity, acceleration, jerk (..., 4) at ``t`` >= 0 after a unit step.

    Closed form of the triple pole: x = 1 - e^-a (1 + a + a^2/2) with a = omega t.
    """
    w = omega_rad_s
    a = w * np.asarray(t, dtype=np.float64)
    decay = np.exp(-a)
    x = 1.0 - decay * (1.0 + a + a * a / 2.0)
    v = w * decay * a * a / 2.0
    acc = w**2 * decay * (a - a * a / 2.0)
    jerk = w**3 * decay * (1.0 - 2.0 * a + a * a / 2.0)
    return np.stack([x, v, acc, jerk], axis=-1)


def discretize_filter(omega_rad_s: float, dt: float) -> tuple[Array, Array]:
    """Return the exact discrete step of the set-point filter, ``state' = A state + B target``.

    The state is (position, velocity, acceleration). ``A`` is the matrix exponential of the
    companion matrix, in closed form from the triple eigenvalue.

    Args:
        omega_rad_s: Bandwidth [rad/s].
        dt: Length of the step [s].

    Returns:
        A (3, 3) and B (3,).
    """
    w = omega_rad_s
    companion = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [-(w**3), -3 * w**2, -3 * w]])
    nilpotent = companion + w * np.eye(3)
    A = np.exp(-w * dt) * (np.eye(3) + dt * nilpotent + 0.5 * dt**2 * nilpotent @ nilpotent)
    return np.ascontiguousarray(A), np.array([1.0, 0.0, 0.0]) - A[:, 0]


def filter_start(q: Array) -> Array:
    """Return the state (..., 7, 3) of a filter at rest at ``q`` (..., 7) [rad]."""
    state = np.zeros((*q.shape, 3))
    state[..., 0] = q
    return state


@row_function
def filter_step(state: Array, target: Array, A: Array, B: Array) -> None:
    """Advance the filter state (7, 3) in place by one step towards targets (7,) [rad]."""
    for k in range(7):
        x, v, a, u = state[k, 0], state[k, 1], state[k, 2], target[k]
        for r in range(3):
            state[k, r] = A[r, 0] * x + A[r, 1] * v + A[r, 2] * a + B[r] * u


def joint_steps(config: ControlConfig, arm: Arm) -> Array:
    """Return the largest change of each joint's target in one control step (7,) [rad].

    ``step_rad`` is the bound of the joint that accelerates least. The others change more in
    proportion, as acceleration binds: a wrist turns 2.5 times as fast as the shoulder lifts.
    """
    allowed = np.asarray(arm.ddq_max)
    return np.asarray(config.step_rad * allowed / allowed.min())


def worst_case(config: ControlConfig, *, phases: int = 500, steps: int = 60) -> Array:
    """Return the largest speed, acceleration and jerk (3,) over all admissible target sequences.

    They hold for a joint with steps of ``step_rad`` and are proportional to the step. The output is
    a sum of step responses, one per control step, each scaled by a change of at most ``step_rad``;
    the worst sequence gives every term the same sign, so the bound is the sum of absolute values
    at the worst phase within the control step, just before and after each change.
    """
    phase = np.linspace(0.0, config.step_s, phases)[:, None]
    t = phase + config.step_s * np.arange(steps)
    terms = np.abs(response(config.omega_rad_s, t)[..., 1:])
    return np.asarray(config.step_rad * terms.sum(axis=1).max(axis=0))


def check_control(config: ControlConfig, arm: Arm, episode_s: float = 10.0) -> None:
    """Reject a configuration with which some sequence of targets exceeds the arm's limits.

    Args:
        config: Control stack.
        arm: Limit tables.
        episode_s: Longest time over which targets change [s]: a slow filter sums many of them.

    Raises:
        ConfigError: The worst case is above the arm's speed, acceleration or jerk.
    """
    tables = (arm.dq_max, arm.ddq_max, arm.dddq_max)
    units = ("rad/s", "rad/s^2", "rad/s^3")
    peaks = worst_case(config, phases=100, steps=math.ceil(episode_s * config.rate_hz))
    shares = joint_steps(config, arm) / config.step_rad
    for most, table, unit in zip(peaks, tables, units, strict=True):
        worst, allowed = most * shares, np.asarray(table)
        joint = int(np.argmax(np.round(worst / allowed, 9)))
        if not worst[joint] <= allowed[joint]:
            raise ConfigError(
                f"control: targets could reach {worst[joint]:.4g} {unit} at joint {joint + 1} and "
                f"the arm allows {allowed[joint]:.4g}; lower control.step_rad or "
                "control.omega_rad_s"
            )


class TargetParams(NamedTuple):
    """Constants of :func:`update_targets`."""

    geometry: ArmGeometry
    unit: Array
    """Motion of the tool for actions of 1 (6,) [m and rad]."""
    elbow_rad: float
    """Motion of the elbow for an action of 1 [rad]."""
    steps: Array
    """Largest changes of targets in a control step (7,) [rad]."""
    max_tracking_error_rad: float
    low: Array
    """Smallest targets (7,) [rad]."""
    high: Array
    """Largest targets (7,) [rad]."""


def target_params(arm: Arm, config: ControlConfig) -> TargetParams:
    """Return the constants of ``arm`` under ``config``."""
    low, high = arm.bounds(config.margin_rad)
    return TargetParams(
        geometry=arm_geometry(arm),
        unit=np.repeat([config.move_m, config.turn_rad], 3),
        elbow_rad=config.step_rad,
        steps=joint_steps(config, arm),
        max_tracking_error_rad=config.max_tracking_error_rad,
        low=np.asarray(low, dtype=np.float64),
        high=np.asarray(high, dtype=np.float64),
    )


class TargetWorkspace(NamedTuple):
    """Scratch arrays of :func:`update_targets`, one set per thread."""

    frames: Array
    T_wt: Array
    jacobian: Array
    square: Array
    twist: Array
    step: Array
    elbow: Array
    order: Ints


@row_function
def target_workspace() -> TargetWorkspace:
    """Allocate scratch arrays."""
    return TargetWorkspace(
        np.zeros((7, 12)),
        np.zeros((4, 4)),
        np.zeros((6, 7)),
        np.zeros((6, 6)),
        np.zeros(6),
        np.zeros(7),
        np.zeros(7),
        np.zeros(7, dtype=np.int64),
    )


@row_function
def write_target_step(
    target: Array, motion: Array, params: TargetParams, work: TargetWorkspace
) -> None:
    """Write the change of targets that ``motion`` requests into ``work.step`` (7,) [rad].

    The motion of the tool is resolved at the target, not at the measured joints, so it does not
    depend on forces. The motion of the elbow leaves the tool in place; a part of it keeps joints
    away from their limits. If a joint would exceed its step, the motion is scaled down as one,
    which keeps its direction.

    Args:
        target: Targets of this control step (7,) [rad].
        motion: In [-1, 1] (7,): three of ``move_m`` and three of ``turn_rad`` along the axes of
            the tool, and one of ``step_rad`` for the elbow.
        params: Units and steps.
        work: Scratch arrays.
    """
    write_frames(target, params.geometry, work.frames, work.T_wt)
    write_jacobian(work.frames, work.T_wt, work.T_wt, work.jacobian)
    for r in range(6):
        work.twist[r] = params.unit[r] * min(max(motion[r], -1.0), 1.0)
    resolve_motion(work.jacobian, work.twist, DAMPING, work.square, work.step)
    write_self_motion(work.jacobian, work.order, work.elbow)
    elbow = min(max(motion[6], -1.0), 1.0) + _limit_avoidance(target, params, work)
    elbow *= params.elbow_rad
    longest = 1.0
    for k in range(7):
        work.step[k] += elbow * work.elbow[k]
        longest = max(longest, abs(work.step[k]) / params.steps[k])
    for k in range(7):
        work.step[k] /= longest


@row_function
def _limit_avoidance(target: Array, params: TargetParams, work: TargetWorkspace) -> float:
    """Return the motion of the elbow, for steps of ``elbow_rad``, away from joint limits.

    Gradient projection (A. Liegeois, 1977) of a potential that is 0 in the middle of the ranges.
    """
    descent = 0.0
    for k in range(7):
        half = 0.5 * (params.high[k] - params.low[k])
        share = (target[k] - params.low[k]) / half - 1.0
        excess = max(abs(share) - FREE_SHARE, 0.0)
        descent -= math.copysign(excess, share) * work.elbow[k]
    return min(max(AVOIDANCE_GAIN * descent, -AVOIDANCE_SHARE), AVOIDANCE_SHARE)


@row_function
def update_targets(
    target: Array,
    motion: Array,
    q: Array,
    retract: bool,
    params: TargetParams,
    work: TargetWorkspace,
) -> None:
    """Move targets (7,) [rad] in place by one control step.

    The requested step is added, then the distance to the measured joints and the joint limits are
    clipped, and last the change itself, so it never exceeds a joint's step wherever the joints are.
    With ``retract`` the request is ignored and targets return towards the measured joints.

    Args:
        target: Targets of this control step (7,) [rad].
        motion: Request (7,), see :func:`write_target_step`.
        q: Measured joints (7,) [rad].
        retract: True above the force limit, see :func:`exceeds_force_limit`.
        params: Steps, bounds and geometry.
        work: Scratch arrays.
    """
    write_target_step(target, motion, params, work)
    error = params.max_tracking_error_rad
    for k in range(7):
        goal = q[k] if retract else target[k] + work.step[k]
        goal = min(max(goal, q[k] - error), q[k] + error)
        goal = min(max(goal, params.low[k]), params.high[k])
        target[k] += min(max(goal - target[k], -params.steps[k]), params.steps[k])


class ForceLimits(NamedTuple):
    """Constants of :func:`exceeds_force_limit`."""

    open_n: float
    holding_n: float


def force_limits(config: ControlConfig) -> ForceLimits:
    """Return the force limits of ``config``."""
    return ForceLimits(config.force_limit_n, config.force_limit_holding_n)


@row_function
def exceeds_force_limit(
    fx: float, fy: float, fz: float, command: float, width: float, limits: ForceLimits
) -> bool:
    """Return True if the force on the gripper is above its limit.

    An open gripper has no reason to press; a closing one may pull at its object. A force that is
    not a number is above the limit.

    Args:
        fx: Measured net force on the gripper along x [N].
        fy: The same along y.
        fz: The same along z.
        command: Command to the gripper, +1 close, -1 open.
        width: Opening between the fingers [m].
        limits: The two limits.
    """
    most = limits.holding_n if command > 0.0 and width < OPEN_M else limits.open_n
    return not fx * fx + fy * fy + fz * fz <= most * most


class GripperParams(NamedTuple):
    """Constants of the gripper's command."""

    step_s: float
    smoothing: float
    """Share of the old value in the smoothed command, per control step."""
    on_threshold: float
    dwell_s: float


def gripper_params(gripper: Gripper, step_s: float) -> GripperParams:
    """Return the constants of ``gripper`` for control steps of ``step_s`` [s]."""
    smoothing = gripper.smoothing ** (step_s / 0.05)
    return GripperParams(step_s, smoothing, gripper.on_threshold, gripper.dwell_s)


class GripperState(NamedTuple):
    """Command and motion of N grippers."""

    smooth: Array
    """Smoothed command in [-1, 1] (N,)."""
    command: Array
    """Command after the thresholds, +1 close, -1 open (N,)."""
    since_s: Array
    """Time since the last command was sent (N,) [s]."""
    latency_left_s: Array
    """Time until the last command acts (N,) [s]."""
    closing: Array
    """Motion of the fingers, +1 close, -1 open (N,)."""
    release_width: Array
    """Opening at the last command to open, :data:`WIDEST_M` before the first (N,) [m]. It is the
    result of the last grasp."""

    def copy(self) -> GripperState:
        """Return a copy of all arrays."""
        return GripperState(*(array.copy() for array in self))


def new_gripper_state(n: int) -> GripperState:
    """Return the state of N open grippers that have had no command."""
    minus = -np.ones(n)
    since_s, release_width = np.full(n, 10.0), np.full(n, WIDEST_M)
    return GripperState(np.zeros(n), minus, since_s, np.zeros(n), minus.copy(), release_width)


@row_function
def send_gripper_command(
    state: GripperState, i: int, action: float, width: float, params: GripperParams
) -> bool:
    """Update the command of gripper ``i``; return True if a new command is sent.

    A real gripper takes about a second for each command and must not get another one meanwhile
    (libfranka issues 177, 226): the policy's number in [-1, 1] is smoothed, thresholded with
    hysteresis, and sent after a minimum dwell. Positive numbers close.

    Args:
        state: State of N grippers.
        i: Index of the gripper.
        action: Number of the policy.
        width: Opening between the fingers [m].
        params: Constants.
    """
    action = min(max(action, -1.0), 1.0)
    smooth = params.smoothing * state.smooth[i] + (1.0 - params.smoothing) * action
    command = state.command[i]
    if smooth > params.on_threshold:
        command = 1.0
    elif smooth < -params.on_threshold:
        command = -1.0
    sent = command != state.command[i] and state.since_s[i] >= params.dwell_s - ROUNDING_S
    state.smooth[i] = smooth
    state.since_s[i] = 0.0 if sent else state.since_s[i] + params.step_s
    if sent:
        state.command[i] = command
    if sent and command < 0.0:
        state.release_width[i] = width
    return bool(sent)


@row_function
def apply_gripper_latency(
    state: GripperState, i: int, sent: bool, latency_s: float, step_s: float
) -> None:
    """Let the last command of gripper ``i`` act once its latency has passed.

    Args:
        state: State of N grippers.
        i: Index of the gripper.
        sent: True if a new command was sent in this control step.
        latency_s: Time from sending to motion [s].
        step_s: Length of a control step [s].
    """
    left = latency_s if sent else max(state.latency_left_s[i] - step_s, 0.0)
    state.latency_left_s[i] = left
    if left <= ROUNDING_S:
        state.closing[i] = state.command[i]


class FingerParams(NamedTuple):
    """Constants of the fingers' motion in a physics step."""

    step_m: float
    closed_m: float
    open_m: float


def finger_params(gripper: Gripper, dt: float) -> FingerParams:
    """Return the constants of ``gripper`` for physics steps of ``dt`` [s]."""
    return FingerParams(gripper.finger_speed_m_s * dt, *gripper.finger_m)


@row_function
def finger_start(set_point: float, width: float, closing: float) -> float:
    """Return the finger set point [m] from which a control step continues.

    The set point of a closed gripper is ahead of its fingers by the grasp force. An opening gripper
    continues from the position of the fingers, as the real one does.

    Args:
        set_point: Set point at the end of the last control step [m].
        width: Measured opening between the fingers [m].
        closing: Above 0 while the gripper closes.
    """
    return set_point if closing > 0.0 else max(set_point, width / 2.0)


@row_function
def finger_step(set_point: float, closing: float, params: FingerParams) -> float:
    """Return the finger set point [m] after one physics step."""
    step = -params.step_m if closing > 0.0 else params.step_m
    return min(max(set_point + step, params.closed_m), params.open_m)


class ActionDelay(NamedTuple):
    """Motions that have been requested and act later, for N environments."""

    requests: Array
    """Motions of the last control steps (ages, N, 7), the latest first."""
    steps: Ints
    """Delay of each environment (N,) [control steps]."""
    motion: Array
    """Motion that acts in this control step (N, 7)."""
    pending: Array
    """Sum of the motions that have not acted yet (N, 7)."""


def new_action_delay(n: int, ages: int) -> ActionDelay:
    """Return an empty delay line for N environments and delays below ``ages``."""
    requests, steps = np.zeros((ages, n, 7)), np.zeros(n, dtype=np.int64)
    return ActionDelay(requests, steps, np.zeros((n, 7)), np.zeros((n, 7)))


@row_function
def delay_action(delay: ActionDelay, i: int, action: Array) -> None:
    """Store the motion of ``action`` (8,); write the motion of environment ``i`` that acts now."""
    for age in range(len(delay.requests) - 1, 0, -1):
        for k in range(7):
            delay.requests[age, i, k] = delay.requests[age - 1, i, k]
    for k in range(7):
        delay.requests[0, i, k] = action[k]
        delay.motion[i, k] = delay.requests[delay.steps[i], i, k]
    sum_pending(delay, i)


@row_function
def sum_pending(delay: ActionDelay, i: int) -> None:
    """Write the sum of the motions of environment ``i`` that have not acted yet."""
    for k in range(7):
        delay.pending[i, k] = 0.0
    for age in range(min(delay.steps[i], len(delay.requests))):
        for k in range(7):
            delay.pending[i, k] += delay.requests[age, i, k]
