"""Search: every candidate motion at every position, against every frame; the cheapest path wins."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from articulate.actors.geometric.candidates import Motion
from articulate.actors.geometric.layers import CAP, Layers
from articulate.actors.geometric.sweep import best_path
from articulate.transforms import Array

TURN_STEPS = 48
"""Positions on a full turn."""
FINE_TURN_STEPS = 120
"""The same, when every frame is looked at."""
SLIDE_STEP_PX = 1.6
"""Motion in the picture between two positions of a slide."""
MOST_SLIDE_STEPS = 61
STEP_COST = 0.6 * CAP
"""Cost of moving by one position between two frames, for a part that is not small."""
NOT_SMALL_PX = 800
"""Pixels of a part that is not small."""
STILL_POSES = 13
"""Poses in which a part is thought to rest through the whole shot, for comparison."""
MOST_POSITIONS = 160
"""Most positions when a path is sought again."""
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
    gain: float = 0.0
    """How much less it costs than the best pose in which nothing would move. What the model of
    the object gets wrong costs both alike."""


def positions(motion: Motion, layers: Layers, reach_m: float) -> Array:
    """Positions at which a motion is tried (Q,) [m or rad].

    Args:
        motion: What is tried.
        layers: The shot.
        reach_m: Farthest a slide may go [m].
    """
    if motion.kind == "turn":
        return np.arange(TURN_STEPS, dtype=np.float64) * (2.0 * np.pi / TURN_STEPS)
    ends = layers.shot.project(motion.pivot_o + np.outer([-0.1, 0.1], motion.axis_o))
    px_per_m = float(np.linalg.norm(ends[1] - ends[0])) / 0.2
    step = max(SLIDE_STEP_PX / max(px_per_m, 1e-6), 2.0 * reach_m / (MOST_SLIDE_STEPS - 1))
    half = max(1, round(reach_m / step))
    return np.arange(-half, half + 1, dtype=np.float64) * step


def coarse_fit(motion: Motion, layers: Layers, parts: tuple[int, ...], reach_m: float) -> Fit:
    """The cheapest path of ``motion`` through the shot."""
    q = positions(motion, layers, reach_m)
    costs = np.ascontiguousarray(layers.costs(motion.T_o(q)).T)
    turning = motion.kind == "turn"
    step_cost = STEP_COST * min(1.0, layers.own_px / NOT_SMALL_PX)
    path = best_path(costs, step_cost, LARGEST_STEP, turning)
    cost = float(costs[np.arange(len(costs)), path % len(q)].sum())
    found = path * (2.0 * np.pi / TURN_STEPS) if turning else q[path]
    gain = float(costs.sum(axis=0).min()) - cost
    return Fit(motion, np.asarray(found, dtype=np.float64), cost, parts, gain)


def path_again(fit: Fit, layers: Layers, step: float) -> Fit:
    """``fit`` with the cheapest path through positions a ``step`` apart, around its own.

    Args:
        fit: Where from; its positions are those of the frames of ``layers``.
        layers: The shot.
        step: Between neighbouring positions [m or rad].
    """
    low, high = float(fit.q.min()), float(fit.q.max())
    margin = 0.12 * (high - low) + 4.0 * step
    step = max(step, (high - low + 2.0 * margin) / MOST_POSITIONS)
    q = np.arange(low - margin, high + margin + 0.5 * step, step)
    costs = np.ascontiguousarray(layers.costs(fit.motion.T_o(q)).T)
    step_cost = STEP_COST * min(1.0, layers.own_px / NOT_SMALL_PX) * 0.1
    largest = max(8, len(q) // 2)
    path = best_path(costs, step_cost, largest, False)
    cost = float(costs[np.arange(len(costs)), path].sum())
    return replace(fit, q=q[path], cost=cost)


def turned_path(fit: Fit, layers: Layers) -> Fit:
    """The cheapest path of a turn through all of the circle, in fine steps."""
    q = np.arange(FINE_TURN_STEPS, dtype=np.float64) * (2.0 * np.pi / FINE_TURN_STEPS)
    costs = np.ascontiguousarray(layers.costs(fit.motion.T_o(q)).T)
    step_cost = STEP_COST * min(1.0, layers.own_px / NOT_SMALL_PX) * 0.1
    path = best_path(costs, step_cost, LARGEST_STEP, True)
    cost = float(costs[np.arange(len(costs)), path % len(q)].sum())
    return replace(fit, q=path * (2.0 * np.pi / FINE_TURN_STEPS), cost=cost)


def with_gain(fit: Fit, layers: Layers) -> Fit:
    """``fit`` with its gain in this shot."""
    still = np.unique([0.0, *np.linspace(fit.q.min(), fit.q.max(), STILL_POSES)])
    costs = layers.costs(fit.motion.T_o(still)).sum(axis=1)
    return replace(fit, gain=float(costs.min()) - fit.cost)
