"""The plant between a policy's tick and the joints: target, follower, hand.

Once a tick (20 Hz) the policy moves a target of the joints: it says how the tool shall move and
turn in its own frame, and how the elbow. Between ticks a linear follower
of third order, three equal poles at ``-omega``, runs open loop towards it::

    x''' = omega^3 (u - x) - 3 omega^2 x' - 3 omega x''

It is discretised exactly for a held target, so that its values at common instants are the
same at 1 ms and at the simulator's step. Its output is the set point of a joint impedance
controller with target velocity 0. Because a target moves by at most so much per tick
(:func:`joint_steps`), speed, acceleration and jerk of the output are bounded for every sequence
of targets (:func:`worst_case`).

A hand that feels more force than it has reason to (:func:`presses`) takes its targets back instead:
an arm that is soft and late goes on for a third of a second after its policy could have felt
anything, and that is 20 to 60 N at what it came to touch.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from articulate.errors import ConfigError
from articulate.robot.arm import Arm, Gripper
from articulate.robot.config import ControlConfig
from articulate.robot.kinematics import resolve_motion, self_motion, tool_jacobian_t
from articulate.transforms import Array, Mask


def response(omega_rad_s: float, t: Array) -> Array:
    """Position, velocity, acceleration, jerk (..., 4) at ``t`` >= 0 after a unit step of target.

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
    """Exact step of the follower: ``state' = A state + B target``.

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
    return A, np.array([1.0, 0.0, 0.0]) - A[:, 0]


def filter_step(state: Array, target: Array, A: Array, B: Array) -> Array:
    """The follower's state (N, 7, 3) one step later, towards targets (N, 7) [rad]."""
    x, v, a = (state[..., k, None] for k in range(3))
    return np.asarray(A[:, 0] * x + A[:, 1] * v + A[:, 2] * a + B * target[..., None])


def joint_steps(config: ControlConfig, arm: Arm) -> Array:
    """Largest change of each joint's target in one tick (7,) [rad].

    ``step_rad`` is that of the joint that accelerates least. Others go further in proportion, as
    acceleration is what binds: a wrist turns two and a half times as fast as the shoulder lifts.
    """
    allowed = np.asarray(arm.ddq_max)
    return np.asarray(config.step_rad * allowed / allowed.min())


def worst_case(config: ControlConfig, *, phases: int = 500, ticks: int = 60) -> Array:
    """Largest speed, acceleration and jerk (3,) over every admissible sequence of targets.

    They are those of a joint whose steps are of ``step_rad``, and grow with the step. The output is
    a sum of step responses, one per tick, each scaled by a change of at most ``step_rad``; the
    worst sequence gives every term the same sign, so that the bound is the sum of absolute values,
    taken at the worst phase within the tick, just before and after each change.
    """
    phase = np.linspace(0.0, config.step_s, phases)[:, None]
    t = phase + config.step_s * np.arange(ticks)
    terms = np.abs(response(config.omega_rad_s, t)[..., 1:])
    return np.asarray(config.step_rad * terms.sum(axis=1).max(axis=0))


def check_control(config: ControlConfig, arm: Arm, episode_s: float = 10.0) -> None:
    """Refuse a follower that some sequence of targets could take beyond the arm's limits.

    Args:
        config: The follower.
        arm: Its tables.
        episode_s: Targets change for so long at most [s]: a slow follower adds up many of them.

    Raises:
        ConfigError: Its worst case is above the arm's speed, acceleration or jerk.
    """
    tables = (arm.dq_max, arm.ddq_max, arm.dddq_max)
    units = ("rad/s", "rad/s^2", "rad/s^3")
    asked = worst_case(config, phases=100, ticks=math.ceil(episode_s * config.rate_hz))
    shares = joint_steps(config, arm) / config.step_rad
    for most, table, unit in zip(asked, tables, units, strict=True):
        worst, allowed = most * shares, np.asarray(table)
        joint = int(np.argmax(np.round(worst / allowed, 9)))
        if not worst[joint] <= allowed[joint]:
            raise ConfigError(
                f"control: targets could ask for {worst[joint]:.4g} {unit} of joint {joint + 1} and "
                f"the arm allows {allowed[joint]:.4g}; lower control.step_rad or control.omega_rad_s"
            )


def joint_step(target: Array, motion: Array, config: ControlConfig, arm: Arm) -> Array:
    """Change of the targets (N, 7) [rad] that a motion asks for, at most :func:`joint_steps`.

    The tool's motion is resolved at the target (not at the measured joints, so that it does not
    depend on forces), the elbow's is what leaves the tool where it is. Where a joint would have
    to go further than its step the whole motion is scaled down, which keeps its direction.

    Args:
        target: Targets of this tick (N, 7) [rad].
        motion: In [-1, 1] (N, 7): three of ``move_m`` and three of ``turn_rad`` along the axes
            of the tool, and one of ``step_rad`` for the elbow.
        config: Steps.
        arm: For its kinematics.
    """
    motion = np.clip(motion, -1.0, 1.0)
    unit = np.repeat([config.move_m, config.turn_rad], 3)
    jacobian = tool_jacobian_t(arm, target)
    step = resolve_motion(jacobian, unit * motion[:, :6])
    step += config.step_rad * motion[:, 6:] * self_motion(jacobian)
    longest = np.max(np.abs(step) / joint_steps(config, arm), axis=1, keepdims=True)
    return np.asarray(step / np.maximum(longest, 1.0))


OPEN_M = 0.07
"""A hand that is wider open than this has not begun to close on anything [m]."""


def presses(force: Array, wish: Array, width: Array, config: ControlConfig) -> Mask:
    """Whether hands press harder than they have reason to (N,).

    An open hand has nothing to press for; one that closes may pull at what it holds. A force that
    is not a number counts as too much.

    Args:
        force: Net forces on the hands as they are felt (N, 3) [N].
        wish: What the hands were told, +1 close, -1 open (N,).
        width: Openings between the fingers (N,) [m].
        config: The two bounds.
    """
    closes = (wish > 0.0) & (width < OPEN_M)
    most = np.where(closes, config.force_limit_holding_n, config.force_limit_n)
    return np.asarray(~(np.sum(force * force, axis=1) <= most * most))


def next_target(
    target: Array, motion: Array, q: Array, config: ControlConfig, arm: Arm, yields: Mask
) -> Array:
    """Targets (N, 7) of the next tick [rad].

    The motion's joint step is added, the lead over the measured joint and the joint limits are
    clipped, and last the change itself, so that it never exceeds a joint's step whatever the
    joints do. Where a hand ``yields``, what is asked for is left out, and the targets go back to
    the measured joints, by no more than that step.

    Args:
        target: Targets of this tick (N, 7) [rad].
        motion: What is asked for (N, 7), see :func:`joint_step`.
        q: Measured joints (N, 7) [rad].
        config: Step, lead and margin.
        arm: Joint limits.
        yields: Hands that press too hard (N,), see :func:`presses`.
    """
    low, high = arm.bounds(config.margin_rad)
    wish = target + joint_step(target, motion, config, arm)
    wish = np.where(yields[:, None], q, wish)
    wish = np.clip(wish, q - config.max_tracking_error_rad, q + config.max_tracking_error_rad)
    wish = np.clip(wish, low, high)
    most = joint_steps(config, arm)
    return target + np.clip(wish - target, -most, most)


def filter_start(q: Array) -> Array:
    """State (N, 7, 3) of a follower at rest at ``q`` (N, 7) [rad]."""
    state = np.zeros((*q.shape, 3))
    state[..., 0] = q
    return state


@dataclass(frozen=True)
class GripperState:
    """What the hand was told and does, for N hands."""

    smooth: Array
    """Smoothed command in [-1, 1] (N,)."""
    wish: Array
    """Command of the thresholds, +1 close, -1 open (N,)."""
    since_s: Array
    """Time since the last command was sent (N,) [s]."""
    wait_s: Array
    """Time until the command sent begins to act (N,) [s]."""
    closing: Array
    """What the fingers do now, +1 close, -1 open (N,)."""


ROUNDING_S = 1e-9
"""Times that were summed tick by tick are compared with this slack [s]."""


def hand_start(n: int) -> GripperState:
    """N open hands that were told nothing yet."""
    minus = -np.ones(n)
    return GripperState(np.zeros(n), minus, np.full(n, 10.0), np.zeros(n), minus.copy())


def finger_command(command: Array, width: Array, closing: Array | float) -> Array:
    """Commands of a finger (N,) [m] from which a tick goes on.

    A closed hand's command is ahead of its fingers by what presses them together. One that opens
    goes on from where they are, as the real hand does, and not from there.

    Args:
        command: Commands at the end of the tick before (N,) [m].
        width: Measured openings between the fingers (N,) [m].
        closing: Above 0 where the hand closes (N,).
    """
    return np.where(np.asarray(closing) > 0.0, command, np.maximum(command, width / 2.0))


def hand_tick(
    state: GripperState, command: Array, latency_s: Array, gripper: Gripper, step_s: float
) -> GripperState:
    """The hand one tick later.

    A real hand takes about a second for each command and must not be told a new one meanwhile
    (libfranka issues 177, 226): the policy's number is smoothed, thresholded with hysteresis,
    sent after a minimum dwell, and acts after a latency.

    Args:
        state: State of N hands.
        command: The policy's number in [-1, 1] (N,): positive closes.
        latency_s: From sending to moving (N,) [s].
        hand: Threshold, smoothing, dwell.
        tick_s: Length of a tick [s].
    """
    keep = gripper.smoothing ** (step_s / 0.05)
    smooth = keep * state.smooth + (1.0 - keep) * np.clip(command, -1.0, 1.0)
    asked = np.where(
        smooth > gripper.on_threshold, 1.0, np.where(smooth < -gripper.on_threshold, -1.0, state.wish)
    )
    send = (asked != state.wish) & (state.since_s >= gripper.dwell_s - ROUNDING_S)
    wait = np.where(send, latency_s, np.maximum(state.wait_s - step_s, 0.0))
    wish = np.where(send, asked, state.wish)
    return GripperState(
        smooth=smooth,
        wish=wish,
        since_s=np.where(send, 0.0, state.since_s + step_s),
        wait_s=wait,
        closing=np.where(wait <= ROUNDING_S, wish, state.closing),
    )
