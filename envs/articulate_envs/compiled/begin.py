"""What a tick begins with, compiled: delayed motions, the hand, the push.

It repeats :func:`articulate.follow.hand_tick` and :func:`articulate.follow.finger_command`, which a
robot runs, for one environment at a time; tests hold them together.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from articulate.arm import Hand
from articulate.draw import COLUMNS, PUSH_S
from articulate.follow import ROUNDING_S
from articulate.transforms import Array

_LATENCY = COLUMNS.index("hand_latency_s")
_PUSH, _WHEN = COLUMNS.index("push_x_n"), COLUMNS.index("push_time")


class Times(NamedTuple):
    """Numbers that do not change within a run."""

    tick_s: float
    episode_s: float
    keep: float
    """Share of the hand's smoothed command that a tick leaves."""
    on_threshold: float
    dwell_s: float


class Hands(NamedTuple):
    """The arrays of :class:`articulate.follow.HandState`, (N,) each."""

    smooth: Array
    wish: Array
    since_s: Array
    wait_s: Array
    closing: Array


def times_of(hand: Hand, tick_s: float, episode_s: float) -> Times:
    """The hand's and the episode's times as numbers."""
    keep = hand.smoothing ** (tick_s / 0.05)
    return Times(tick_s, episode_s, keep, hand.on_threshold, hand.dwell_s)


@njit(nogil=True, cache=True, error_model="numpy", boundscheck=False)
def begin(  # type: ignore[no-untyped-def]
    action, actions, delay, motion, hands, drawn, tick, times, buffers
):
    """Take in what the policy says (N, 8), and write what acts in this tick.

    ``actions`` (ages, N, 7) are the motions of the last ticks, of which ``motion`` (N, 7) takes the
    one whose ``delay`` (N,) is over; ``drawn`` are the draws (N, columns), ``tick`` (N,) the ticks
    since the episode began.
    """
    for i in range(len(action)):
        for age in range(len(actions) - 1, 0, -1):
            for k in range(7):
                actions[age, i, k] = actions[age - 1, i, k]
        for k in range(7):
            actions[0, i, k] = action[i, k]
        for k in range(7):
            motion[i, k] = actions[delay[i], i, k]
        _hand(i, action[i, 7], drawn[i, _LATENCY], hands, times)
        buffers.closing[i] = hands.closing[i]
        if not hands.closing[i] > 0.0:
            buffers.finger[i] = max(buffers.finger[i], buffers.rest[i, 0] / 2.0)
        now, push_s = tick[i] * times.tick_s, drawn[i, _WHEN] * times.episode_s
        on = push_s <= now < push_s + PUSH_S
        for k in range(3):
            buffers.push[i, k] = drawn[i, _PUSH + k] if on else 0.0


@njit(nogil=True, cache=True, error_model="numpy", boundscheck=False, forceinline=True)
def _hand(i, command, latency_s, hands, times):  # type: ignore[no-untyped-def]
    command = min(max(command, -1.0), 1.0)
    smooth = times.keep * hands.smooth[i] + (1.0 - times.keep) * command
    asked = hands.wish[i]
    if smooth > times.on_threshold:
        asked = 1.0
    elif smooth < -times.on_threshold:
        asked = -1.0
    wait = max(hands.wait_s[i] - times.tick_s, 0.0)
    since = hands.since_s[i] + times.tick_s
    if asked != hands.wish[i] and hands.since_s[i] >= times.dwell_s - ROUNDING_S:
        wait, since = latency_s, 0.0
        hands.wish[i] = asked
    hands.smooth[i], hands.wait_s[i], hands.since_s[i] = smooth, wait, since
    if wait <= ROUNDING_S:
        hands.closing[i] = hands.wish[i]


@njit(nogil=True, cache=True, error_model="numpy", boundscheck=False)
def motions_due(actions, delay):  # type: ignore[no-untyped-def]
    """Sum (N, 7) of the motions (ages, N, 7) that are younger than their ``delay`` (N,)."""
    out = np.zeros(actions.shape[1:])
    for age in range(len(actions)):
        for i in range(len(out)):
            if age < delay[i]:
                for k in range(7):
                    out[i, k] += actions[age, i, k]
    return out
