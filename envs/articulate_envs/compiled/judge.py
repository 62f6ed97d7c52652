"""What a tick shows of an episode, compiled: :func:`articulate.judgement.judge_tick` row by row."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from articulate.judgement import Judgement
from articulate.task import Task
from articulate.transforms import Array


class Asked(NamedTuple):
    """What a task asks of its part."""

    closes: bool
    target: float
    slow: float


def asked_of(task: Task) -> Asked:
    """What ``task`` asks, as numbers."""
    return Asked(task.closes, float(task.target), float(task.slow))


def judge_tick(
    judgement: Judgement,
    samples: Array,
    asked: Asked,
    *,
    opened: Array,
    speed: Array,
    tick_s: float,
) -> Judgement:
    """What :func:`articulate.judgement.judge_tick` says."""
    n = len(samples)
    rest_s, there, diverged = np.empty(n), np.empty(n, dtype=bool), judgement.diverged.copy()
    _write(samples, asked, opened, speed, tick_s, judgement.rest_s, rest_s, there, diverged)
    return Judgement(samples=samples, rest_s=rest_s, opened=there, diverged=diverged)


@njit(cache=True, error_model="numpy", boundscheck=False)
def _write(  # type: ignore[no-untyped-def]
    samples, asked, opened, speed, tick_s, rest_before, rest_s, there, diverged
):
    for i in range(len(rest_s)):
        there[i] = is_there(asked, opened[i])
        rest_s[i] = rest_before[i] + tick_s if rests(asked, opened[i], speed[i]) else 0.0
        finite = np.isfinite(opened[i]) and np.isfinite(speed[i])
        for k in range(samples.shape[1]):
            finite = finite and np.isfinite(samples[i, k])
        if not finite:
            diverged[i] = True


@njit(cache=True, error_model="numpy", boundscheck=False, forceinline=True)
def is_there(asked, opened):  # type: ignore[no-untyped-def]
    """:func:`articulate.task.beyond_target` of one part."""
    return abs(opened) <= asked.target if asked.closes else opened >= asked.target


@njit(cache=True, error_model="numpy", boundscheck=False, forceinline=True)
def rests(asked, opened, speed):  # type: ignore[no-untyped-def]
    """:func:`articulate.task.at_target` of one part."""
    return is_there(asked, opened) and abs(speed) < asked.slow
