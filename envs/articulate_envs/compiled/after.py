"""What follows a tick, compiled and in one call: its worth, its judgement, what is seen of it.

Between two ticks all threads wait, and a call from Python costs as much as what it computes.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from numba import njit

from articulate.transforms import Array, Mask
from articulate_envs.compiled.judge import Asked, write_judgement
from articulate_envs.compiled.observe import Scales, observations, push
from articulate_envs.compiled.reward import Way, write_terms


class Rules(NamedTuple):
    """What a tick is measured by, the same for all environments of a run."""

    weights: Any
    way: Way
    along_m: float
    thick_m: float
    asked: Asked
    scales: Scales


class Judged(NamedTuple):
    """The arrays of :class:`articulate.task.episode_monitor.EpisodeMonitor` but its samples, (N,) each."""

    rest_s: Array
    opened: Mask
    diverged: Mask


@njit(cache=True, error_model="numpy", boundscheck=False)
def after(  # type: ignore[no-untyped-def]
    rules, progress, before, now, action, judged_before, judged, past, seen, drawn, noise, terms
):
    """Write a tick's terms (N, len(TERMS)) and judgement; observations (N, size).

    The estimator's ``past`` takes in what is true ``now``. The terms of what diverged are 0.
    """
    w, way = rules.weights, rules.way
    write_terms(w, way, rules.along_m, rules.thick_m, progress, before, now, action, terms)
    write_judgement(now.samples, rules.asked, now.opened, now.speed, rules.scales.step_s,
                    judged_before, judged)  # fmt: skip
    for i in range(len(terms)):
        if judged.diverged[i]:
            for k in range(terms.shape[1]):
                terms[i, k] = 0.0
    push(past, now.T_wh, now.opened, now.speed)
    return observations(seen, past, drawn, noise, rules.scales)
