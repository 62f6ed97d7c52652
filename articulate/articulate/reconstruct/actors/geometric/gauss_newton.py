"""Refine: axis, pivot and every position together, by Gauss-Newton on the pictures themselves."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from articulate.reconstruct.actors.geometric.candidates import Motion, plane_of
from articulate.reconstruct.actors.geometric.compositing import CAP, Layers
from articulate.reconstruct.actors.geometric.kernels import (
    Floats,
    draw_over,
    equations,
    pictures_in,
)
from articulate.reconstruct.actors.geometric.search import (
    MOST_BEND,
    NUDGE_PX,
    Fit,
    bending,
    position_unit,
    unevenness,
)
from articulate.transforms import Array, axis_angle_to_matrix, normalised

SOFT = 24.0
"""Differences of a colour above this count less and less."""
CONVERGED = 2e-4
"""Relative fall of the cost below which refining ends."""


@dataclass(frozen=True)
class Freedom:
    """What may change besides the positions."""

    axis: bool = True
    pivot: bool = True

    def size(self, motion: Motion) -> int:
        """Number of parameters."""
        return 2 * int(self.axis) + 2 * int(self.pivot and motion.kind == "turn")


def refine(fit: Fit, layers: Layers, freedom: Freedom, *, rounds: int = 8) -> Fit:
    """A fit near ``fit`` whose price is no higher.

    Args:
        fit: Where to begin; its positions are those of the frames of ``layers``.
        layers: The shot.
        freedom: What may change.
        rounds: Most steps.
    """
    best = replace(fit, cost=float(layers.path_cost(fit.motion.T_o(fit.q)).sum()))
    best, damping = replace(best, bends=unevenness(best, layers)), 1e-2
    most = MOST_BEND * CAP * layers.own_px
    for _ in range(rounds):
        hessian, gradient, scales = _normal_equations(best, layers, freedom)
        n, unit = freedom.size(best.motion), scales[-1]
        bend = bending(best.motion, layers)
        bend = bend[(bend @ best.q) ** 2 < most]
        hessian[n:, n:] += unit**2 * bend.T @ bend
        gradient[n:] -= unit * bend.T @ (bend @ best.q)
        before = best.price
        for _ in range(4):
            lifted = hessian + damping * np.diag(np.diag(hessian) + 1e-9 * np.trace(hessian))
            step = np.linalg.solve(lifted + 1e-6 * np.eye(len(hessian)), gradient)
            step = np.clip(step, -6.0, 6.0) * scales
            trial = _stepped(best, step, freedom)
            cost = float(layers.path_cost(trial.motion.T_o(trial.q)).sum())
            trial = replace(trial, cost=cost, bends=unevenness(trial, layers))
            if trial.price < best.price:
                best, damping = trial, max(damping * 0.3, 1e-4)
                break
            damping *= 5.0
        if before - best.price <= CONVERGED * abs(before):
            break
    return best


def shifted(motion: Motion, change: Array, freedom: Freedom) -> Motion:
    """``motion`` with its axis tilted and its pivot moved across it by ``change``.

    Args:
        motion: Where from.
        change: Tilts about two axes [rad] if the axis is free, then shifts [m] if the pivot is.
        freedom: What may change.
    """
    across = plane_of(motion.axis_o)
    axis, pivot, k = motion.axis_o, motion.pivot_o, 0
    if freedom.axis:
        turn = change[0] * across[0] + change[1] * across[1]
        axis = normalised(
            axis_angle_to_matrix(normalised(turn + 1e-300), np.linalg.norm(turn)) @ axis
        )
        k = 2
    if freedom.pivot and motion.kind == "turn":
        pivot = pivot + change[k] * across[0] + change[k + 1] * across[1]
    return replace(motion, axis_o=axis, pivot_o=pivot)


def _stepped(fit: Fit, step: Array, freedom: Freedom) -> Fit:
    n = freedom.size(fit.motion)
    return replace(fit, motion=shifted(fit.motion, step[:n], freedom), q=fit.q + step[n:])


def _normal_equations(fit: Fit, layers: Layers, freedom: Freedom) -> tuple[Array, Array, Array]:
    """Hessian (D, D), descent direction (D,) and units (D,) of all parameters, positions last."""
    n, n_frames = freedom.size(fit.motion), len(fit.q)
    scales = _units(fit, layers, freedom)
    hessian, gradient = np.zeros((n + n_frames, n + n_frames)), np.zeros(n + n_frames)
    shot, surface = layers.shot, layers.moving
    shapes = (surface.points_o, surface.faces, surface.albedo)
    pictures = np.empty((2 * n + 3, *shot.size, 3), dtype=np.float32)
    box = np.empty(4, dtype=np.int64)
    small, force = np.empty((n + 1, n + 1)), np.empty(n + 1)
    poses_co = np.ascontiguousarray(shot.T_co @ _varied(fit, freedom, scales))
    pinhole, near = shot.pinhole, layers.nearness
    for t in range(n_frames):
        pictures_in(shapes, layers.light, poses_co[t], pinhole, near, layers.still, box, pictures)
        equations(pictures, box, shot.frames[t], SOFT, small, force)
        where = np.array([*range(n), n + t])
        hessian[np.ix_(where, where)] += small
        gradient[where] += force
    return hessian, gradient, scales


def _varied(fit: Fit, freedom: Freedom, scales: Array) -> Array:
    """Poses (T, 2 n + 3, 4, 4): as each frame is, and a step up and down of each parameter."""
    n = freedom.size(fit.motion)
    poses = [fit.motion.T_o(fit.q)]
    for change in np.diag(scales[:n]):
        poses += [shifted(fit.motion, sign * change, freedom).T_o(fit.q) for sign in (1.0, -1.0)]
    poses += [fit.motion.T_o(fit.q + sign * scales[n:]) for sign in (1.0, -1.0)]
    return np.stack(poses, axis=1)


def model_picture(T_o: Array, layers: Layers) -> Floats:
    """The picture (H, W, 3) that is expected with what moves in pose ``T_o`` (4, 4)."""
    picture = layers.still.copy()
    shown = np.zeros(layers.shot.size, dtype=np.bool_)
    surface = layers.moving
    draw_over(
        (surface.points_o, surface.faces, surface.albedo),
        layers.light,
        np.ascontiguousarray(layers.shot.T_co @ T_o),
        layers.shot.pinhole,
        layers.nearness,
        picture,
        shown,
    )
    return picture


def _units(fit: Fit, layers: Layers, freedom: Freedom) -> Array:
    """How much of each parameter moves the part by about a pixel (D,)."""
    points = layers.moving.points_o
    pixel_m = NUDGE_PX * layers.shot.pixel_m(points.mean(axis=0))
    if fit.motion.kind == "slide":
        reach = max(float(np.abs(fit.q).max()), 2.0 * pixel_m)
    else:
        arm = np.linalg.norm(points - fit.motion.pivot_o, axis=1)
        reach = float(np.percentile(arm, 90)) + 1e-9
    units = []
    if freedom.axis:
        units += [min(pixel_m / reach, 0.2)] * 2
    if freedom.pivot and fit.motion.kind == "turn":
        units += [pixel_m] * 2
    return np.array([*units, *([position_unit(fit.motion, layers)] * len(fit.q))])
