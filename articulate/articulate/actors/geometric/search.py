"""Search: every candidate motion at every position, against every frame; the cheapest path wins."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from articulate.actors.geometric.candidates import Motion
from articulate.actors.geometric.layers import CAP, Layers
from articulate.actors.geometric.sweep import best_path
from articulate.transforms import Array

TURN_STEPS = 48
"""Positions on a full turn."""
SLIDE_STEP_PX = 1.6
MOST_SLIDE_STEPS = 61
STEP_COST = 0.6 * CAP
"""Cost of moving by one position between two frames."""
LARGEST_STEP = 9
"""Most positions a part moves by between two frames."""


@dataclass(frozen=True, eq=False)
class Fit:
    """A motion and how well it explains a shot."""

    motion: Motion
    q: Array
    """Position in each frame of the shot (T,) [m or rad]."""
    cost: float
    """Sum over pixels and frames."""
    parts: tuple[int, ...]
    """What moves."""


def positions(motion: Motion, layers: Layers, reach_m: float) -> Array:
    """Positions at which a motion is tried (Q,) [m or rad].

    Args:
        motion: What is tried.
        layers: The shot.
        reach_m: Farthest a slide may go [m].
    """
    if motion.kind == "turn":
        return np.arange(TURN_STEPS) * (2.0 * np.pi / TURN_STEPS)
    ends = layers.shot.project(motion.pivot_o + np.outer([-0.1, 0.1], motion.axis_o))
    px_per_m = float(np.linalg.norm(ends[1] - ends[0])) / 0.2
    step = max(SLIDE_STEP_PX / max(px_per_m, 1e-6), 2.0 * reach_m / (MOST_SLIDE_STEPS - 1))
    half = max(1, round(reach_m / step))
    return np.arange(-half, half + 1) * step


def coarse_fit(motion: Motion, layers: Layers, parts: tuple[int, ...], reach_m: float) -> Fit:
    """The cheapest path of ``motion`` through the shot."""
    q = positions(motion, layers, reach_m)
    costs = np.ascontiguousarray(layers.costs(motion.T_o(q)).T)
    turning = motion.kind == "turn"
    path = best_path(costs, STEP_COST, LARGEST_STEP, turning)
    cost = float(costs[np.arange(len(costs)), path % len(q)].sum())
    found = path * (2.0 * np.pi / TURN_STEPS) if turning else q[path]
    return Fit(motion, np.asarray(found, dtype=np.float64), cost, parts)
