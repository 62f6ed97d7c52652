"""Round parts: knobs and wheels, whose turning about their own axis hardly shows."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from articulate.reconstruct.actors.geometric.candidates import Motion, sample
from articulate.reconstruct.actors.geometric.surface import Surface
from articulate.transforms import Array, axis_angle_to_matrix

TURNS_RAD = (0.7, 1.9, 2.8, 4.3)
"""Turns after which a round part looks as before."""
ROUND = 0.12
"""Largest distance from the turned to the original surface that still is round, as a share of the
part's radius."""


def round_axis(part: Surface, axes: list[tuple[str, Array]]) -> Motion | None:
    """The turn about the axis about which ``part`` is round; None if it is about none.

    Args:
        part: Its surface.
        axes: Directions to try, with their source.
    """
    points = sample(part, 1500)
    low, high = points.min(axis=0), points.max(axis=0)
    best, best_off = None, ROUND
    tree = cKDTree(points)
    for name, axis in axes:
        for where, middle in (("middle", 0.5 * (low + high)), ("weight", points.mean(axis=0))):
            off = off_round(points, tree, axis, middle)
            if off < best_off:
                best, best_off = Motion("turn", axis, middle, f"{name}, round, {where}"), off
    return best


def off_round(points: Array, tree: cKDTree, axis: Array, middle: Array) -> float:
    """How far the surface is from itself after turns, in radii: the 80th percentile."""
    arm = points - middle
    across = arm - np.outer(arm @ axis, axis)
    radius = float(np.percentile(np.linalg.norm(across, axis=1), 90)) + 1e-12
    offs = []
    for turn in TURNS_RAD:
        turned = arm @ axis_angle_to_matrix(axis, turn).T + middle
        distance, _ = tree.query(turned)
        offs.append(float(np.percentile(distance, 80)))
    own, _ = tree.query(points, k=2)  # what sampling alone makes of it
    return (max(offs) - float(np.percentile(own[:, 1], 80))) / radius
