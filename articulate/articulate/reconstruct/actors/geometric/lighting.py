"""Light: how an object is lit, learned from the pictures of it."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls

from articulate.reconstruct.actors.geometric.compositing import draw
from articulate.reconstruct.actors.geometric.crop import Shot
from articulate.reconstruct.actors.geometric.kernels import LIGHT_ROWS, all_views
from articulate.reconstruct.actors.geometric.surface import Surface
from articulate.transforms import Array, normalised

FIRST = (0.5, 0.3, 0.2)
"""What is thought of ambient, camera and lamp light before anything is seen."""
BELIEF = 0.004
"""Weight of that thought against all pixels together."""
FEWEST = 30
"""Fewer pixels say nothing of the light."""
REST_FRAMES = 8
"""Frames that may show the object at 0."""
AT_REST = 0.01
"""Largest mean residual, of 1, of a frame that shows it so: of a cabinet that does it is 0.003, of
a laptop that is open by another angle 0.017."""
MOST = 1500
"""Pixels that are looked at."""
SOFT = 0.02
"""Residuals above this count less and less, of 1."""


def plain_light() -> Array:
    """The light that is thought of before anything is seen (LIGHT_ROWS, 3)."""
    light = np.zeros((LIGHT_ROWS, 3))
    light[:3] = np.array(FIRST)[:, None]
    light[3] = normalised([0.3, -0.8, -0.5])
    return light


def fit_light(shot: Shot, everything: Surface, change: NDArray[np.bool_]) -> Array:
    """How the object is lit (LIGHT_ROWS, 3), from what does not change, if anything does not.

    Args:
        shot: The frames.
        everything: All parts at 0.
        change: Pixels that change (H, W).
    """
    views, albedo, colours = still_samples(shot, everything, change)
    if len(views) < FEWEST:
        return _light_at_rest(shot, everything)
    return solve_light(views, albedo, colours)


def _light_at_rest(shot: Shot, everything: Surface) -> Array:
    """The light of the frame that it makes look most like the object with all parts at 0.

    A door that sweeps over all of a cabinet leaves nothing that stands still, and under a light
    that is only thought of it is cheaper to hide the door than to see it. If no frame shows the
    object so well, what is thought of before anything is seen stays.
    """
    nowhere = np.zeros(shot.size, dtype=np.bool_)
    best, best_cost = plain_light(), AT_REST
    for t in np.unique(np.linspace(0, len(shot.frames) - 1, REST_FRAMES).round().astype(int)):
        one = replace(shot, frames=shot.frames[t : t + 1], indices=shot.indices[t : t + 1])
        views, albedo, colours = still_samples(one, everything, nowhere)
        light = solve_light(views, albedo, colours)
        lamp = np.maximum(views[:, :3] @ light[3], 0.0)[:, None]
        shade = light[0] + light[1] * views[:, 3:] + light[2] * lamp
        off = np.abs(albedo * shade - colours) / 255.0
        cost = float(np.minimum(off, 5.0 * SOFT).mean()) if len(views) >= FEWEST else np.inf
        if cost < best_cost:
            best, best_cost = light, cost
    return best


def still_samples(
    shot: Shot, surface: Surface, change: NDArray[np.bool_]
) -> tuple[Array, Array, Array]:
    """Views (N, 4), albedo (N, 3), colours (N, 3) of pixels of ``surface`` that do not change."""
    seen = draw(surface, shot)
    inside = cv2.erode((seen.face_ids >= 0).astype(np.uint8), np.ones((3, 3))).astype(np.bool_)
    mask = inside & ~change
    ids = seen.face_ids[mask]
    views = all_views(seen.points_c, surface.faces)[ids]
    colours = np.median(shot.frames, axis=0)[mask].astype(np.float64)
    return np.asarray(views), surface.albedo[ids], colours


def solve_light(views: Array, albedo: Array, colours: Array) -> Array:
    """The light (LIGHT_ROWS, 3) under which faces have the given colours.

    Args:
        views: Normal and how much it faces the camera (N, 4).
        albedo: (N, 3), 0 to 255.
        colours: (N, 3), 0 to 255.
    """
    if len(views) < FEWEST:
        return plain_light()
    chosen = np.linspace(0, len(views) - 1, min(MOST, len(views))).round().astype(int)
    views, albedo, colours = views[chosen], albedo[chosen] / 255.0, colours[chosen] / 255.0
    best, best_cost = plain_light()[3], np.inf
    for directions in (_sphere(90), None):
        if directions is None:
            directions = normalised(best + 0.25 * _sphere(30))
        costs = _first_costs(views, albedo, colours, directions)
        nearest = int(costs.argmin())
        if costs[nearest] < best_cost:
            best, best_cost = directions[nearest], costs[nearest]
    light = np.empty((LIGHT_ROWS, 3))
    light[:3] = _strengths(views, albedo, colours, best, rounds=4)[:, None]
    light[3] = best
    return light


def _first_costs(views: Array, albedo: Array, colours: Array, directions: Array) -> Array:
    """Sums of the residuals (D,) that the strengths of least squares leave for each direction."""
    lamps = np.maximum(views[:, :3] @ directions.T, 0.0)
    terms = np.empty((len(directions), 3, len(views)))
    terms[:, 0], terms[:, 1], terms[:, 2] = 1.0, views[:, 3], lamps.T
    pull = _pull(albedo)
    normals = (terms * (albedo**2).sum(axis=1)) @ terms.transpose(0, 2, 1) + np.eye(3) * pull
    forces = terms @ (albedo * colours).sum(axis=1) + np.array(FIRST) * pull
    strengths = [_solved(*pair) for pair in zip(normals, forces, strict=True)]
    shades = (np.array(strengths)[:, None] @ terms)[:, 0]
    costs = np.zeros(len(directions))
    for c in range(3):
        costs += np.minimum(np.abs(albedo[:, c] * shades - colours[:, c]), 5 * SOFT).sum(axis=1)
    return costs


def _strengths(
    views: Array, albedo: Array, colours: Array, direction: Array, *, rounds: int
) -> Array:
    """Strengths (3,) of ambient, camera and lamp light of the least absolute residuals."""
    lamp = np.maximum(views[:, :3] @ direction, 0.0)
    terms = np.stack([np.ones(len(views)), views[:, 3], lamp], axis=1)
    rows = (albedo[:, :, None] * terms[:, None, :]).reshape(-1, 3)
    target = colours.reshape(-1)
    pull, weight = _pull(albedo), np.ones(len(rows))
    for _ in range(rounds):
        scaled = rows * weight[:, None]
        normal, force = scaled.T @ rows + np.eye(3) * pull, scaled.T @ target
        strength = _solved(normal, force + np.array(FIRST) * pull)
        weight = SOFT / np.maximum(np.abs(rows @ strength - target), SOFT)
    return strength


def _pull(albedo: Array) -> float:
    """Weight of what is thought at first; what is black tells nothing of light, then it is all."""
    return float(BELIEF * (albedo**2).sum() + np.finfo(np.float64).eps)


def _solved(normal: Array, force: Array) -> Array:
    """The ``x`` >= 0 (3,) of least ``x normal x - 2 force x``."""
    root = np.linalg.cholesky(normal)
    return np.asarray(nnls(root.T, np.linalg.solve(root, force))[0])


def _sphere(n: int) -> Array:
    """``n`` directions spread evenly over the sphere (n, 3)."""
    k = np.arange(n) + 0.5
    height = 1.0 - 2.0 * k / n
    turn = np.pi * (1.0 + np.sqrt(5.0)) * k
    radius = np.sqrt(1.0 - height**2)
    return np.stack([radius * np.cos(turn), radius * np.sin(turn), height], axis=1)
