"""What a tick shows of an episode, compiled: :func:`articulate.task.episode_monitor.judge_tick` row by row."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from articulate.task.task import Task


class Asked(NamedTuple):
    """What a task asks of its part."""

    closes: bool
    target: float
    slow: float


def asked_of(task: Task) -> Asked:
    """What ``task`` asks, as numbers."""
    return Asked(task.closes, float(task.target), float(task.slow))


@njit(cache=True, error_model="numpy", boundscheck=False)
def write_judgement(  # type: ignore[no-untyped-def]
    samples, asked, opened, speed, step_s, before, judged
):
    """Write what N episodes have shown after a tick, from what they had shown ``before`` it.

    Both have ``rest_s``, ``opened`` and ``diverged`` (N,), as :mod:`articulate.task.episode_monitor` says.
    """
    for i in range(len(samples)):
        judged.opened[i] = is_there(asked, opened[i])
        rested = rests(asked, opened[i], speed[i])
        judged.rest_s[i] = before.rest_s[i] + step_s if rested else 0.0
        finite = np.isfinite(opened[i]) and np.isfinite(speed[i])
        for k in range(samples.shape[1]):
            finite = finite and np.isfinite(samples[i, k])
        judged.diverged[i] = before.diverged[i] or not finite


@njit(cache=True, error_model="numpy", boundscheck=False, forceinline=True)
def is_there(asked, opened):  # type: ignore[no-untyped-def]
    """:func:`articulate.task.task.beyond_target` of one part."""
    return abs(opened) <= asked.target if asked.closes else opened >= asked.target


@njit(cache=True, error_model="numpy", boundscheck=False, forceinline=True)
def rests(asked, opened, speed):  # type: ignore[no-untyped-def]
    """:func:`articulate.task.task.at_target` of one part."""
    return is_there(asked, opened) and abs(speed) < asked.slow
