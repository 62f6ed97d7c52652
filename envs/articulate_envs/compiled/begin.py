"""What a tick begins with, compiled: delayed motions, the hand, what it feels, the push.

It repeats :func:`articulate.robot.control.hand_tick`, :func:`articulate.robot.control.presses` and
:func:`articulate.robot.control.finger_command`, which a robot runs, for one environment at a time; tests
hold them together. A hand feels its force with the constant error that was drawn, and without
noise.
"""

from __future__ import annotations

from typing import NamedTuple

from numba import njit

from articulate.robot.arm import Gripper
from articulate.robot.config import ControlConfig
from articulate.robot.control import OPEN_M, ROUNDING_S
from articulate.task.randomization import COLUMNS, PUSH_S
from articulate.transforms import Array

_LATENCY = COLUMNS.index("gripper_latency_s")
_FORCE = COLUMNS.index("force_bias_x_n")
_PUSH, _WHEN = COLUMNS.index("push_x_n"), COLUMNS.index("push_time")


class Times(NamedTuple):
    """Numbers that do not change within a run."""

    step_s: float
    episode_s: float
    keep: float
    """Share of the hand's smoothed command that a tick leaves."""
    on_threshold: float
    dwell_s: float
    force_limit_n: float
    force_limit_holding_n: float


class Hands(NamedTuple):
    """The arrays of :class:`articulate.robot.control.GripperState`, (N,) each."""

    smooth: Array
    wish: Array
    since_s: Array
    wait_s: Array
    closing: Array


def times_of(gripper: Gripper, control: ControlConfig, episode_s: float) -> Times:
    """The hand's, the plant's and the episode's numbers."""
    return Times(
        step_s=control.step_s,
        episode_s=episode_s,
        keep=gripper.smoothing ** (control.step_s / 0.05),
        on_threshold=gripper.on_threshold,
        dwell_s=gripper.dwell_s,
        force_limit_n=control.force_limit_n,
        force_limit_holding_n=control.force_limit_holding_n,
    )


@njit(nogil=True, cache=True, error_model="numpy", boundscheck=False)
def begin(  # type: ignore[no-untyped-def]
    action, actions, delay, motion, yields, due, hands, drawn, tick, times, buffers
):
    """Take in what the policy says (N, 8), and write what acts in this tick.

    ``actions`` (ages, N, 7) are the motions of the last ticks, of which ``motion`` (N, 7) takes the
    one whose ``delay`` (N,) is over, and ``due`` (N, 7) the sum of the younger ones; ``drawn`` are
    the draws (N, columns), ``tick`` (N,) the ticks since the episode began. ``yields`` (N,) takes
    whose hand presses.
    """
    for i in range(len(action)):
        for age in range(len(actions) - 1, 0, -1):
            for k in range(7):
                actions[age, i, k] = actions[age - 1, i, k]
        for k in range(7):
            actions[0, i, k] = action[i, k]
        for k in range(7):
            motion[i, k] = actions[delay[i], i, k]
        _write_due(i, actions, delay, due)
        _hand(i, action[i, 7], drawn[i, _LATENCY], hands, times)
        yields[i] = _presses(buffers.samples[i], drawn[i], hands.wish[i], buffers.rest[i, 0], times)
        buffers.closing[i] = hands.closing[i]
        if not hands.closing[i] > 0.0:
            buffers.finger[i] = max(buffers.finger[i], buffers.rest[i, 0] / 2.0)
        now, push_s = tick[i] * times.step_s, drawn[i, _WHEN] * times.episode_s
        on = push_s <= now < push_s + PUSH_S
        for k in range(3):
            buffers.push[i, k] = drawn[i, _PUSH + k] if on else 0.0


@njit(nogil=True, cache=True, error_model="numpy", boundscheck=False, forceinline=True)
def _presses(samples, drawn, wish, width, times):  # type: ignore[no-untyped-def]
    force = 0.0
    for k in range(3):
        force += (samples[k] + drawn[_FORCE + k]) ** 2
    most = times.force_limit_holding_n if wish > 0.0 and width < OPEN_M else times.force_limit_n
    return not force <= most * most


@njit(nogil=True, cache=True, error_model="numpy", boundscheck=False, forceinline=True)
def _hand(i, command, latency_s, hands, times):  # type: ignore[no-untyped-def]
    command = min(max(command, -1.0), 1.0)
    smooth = times.keep * hands.smooth[i] + (1.0 - times.keep) * command
    asked = hands.wish[i]
    if smooth > times.on_threshold:
        asked = 1.0
    elif smooth < -times.on_threshold:
        asked = -1.0
    wait = max(hands.wait_s[i] - times.step_s, 0.0)
    since = hands.since_s[i] + times.step_s
    if asked != hands.wish[i] and hands.since_s[i] >= times.dwell_s - ROUNDING_S:
        wait, since = latency_s, 0.0
        hands.wish[i] = asked
    hands.smooth[i], hands.wait_s[i], hands.since_s[i] = smooth, wait, since
    if wait <= ROUNDING_S:
        hands.closing[i] = hands.wish[i]


@njit(nogil=True, cache=True, error_model="numpy", boundscheck=False, forceinline=True)
def _write_due(i, actions, delay, due):  # type: ignore[no-untyped-def]
    for k in range(7):
        due[i, k] = 0.0
    for age in range(min(delay[i], len(actions))):
        for k in range(7):
            due[i, k] += actions[age, i, k]


@njit(nogil=True, cache=True, error_model="numpy", boundscheck=False)
def write_due(rows, actions, delay, due):  # type: ignore[no-untyped-def]
    """Write the sums (N, 7) of the motions that are younger than their delay, of ``rows``."""
    for i in rows:
        _write_due(i, actions, delay, due)
