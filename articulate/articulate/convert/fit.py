"""The convex shape that fits a set of points, judged against the surface it stands for."""

from __future__ import annotations

import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError

from articulate.convert.shapes import QUASI, Shape
from articulate.transforms import Array, pose

THIN_M = 0.002
"""Least thickness of a collision shape at the usual tolerance, half of it at finer ones [m]."""
NEAR_SHARE = 0.94
"""Share of a shape's surface that must lie near the surface it stands for ..."""
USUAL_TOL_M = 0.003
"""... at this tolerance and above [m]; what strays is less in proportion below it."""
MAX_CORNERS = 32
"""Most corners of a hull."""
LIFT_M = 0.002
"""Rays start this far above a shape: one of few corners lies below what it stands for [m]."""
CLEARLY_NOT = 0.75
"""With less than this among the first rays the rest is not asked."""


def fitted(
    points: Array,
    surface: trimesh.Trimesh,
    tol: float,
    piece: str,
    *,
    turned: bool = True,
    panel_m: float = 0.0,
) -> Shape | None:
    """A box, else a convex hull round ``points`` (N, 3) that is nowhere far from ``surface``.

    Args:
        points: What must lie inside [m].
        surface: Triangles that the shape may not stray from.
        tol: How far its own surface may lie above them [m].
        piece: Names for the shape.
        turned: Also try boxes that are not along the axes of the part.
        panel_m: Boxes up to this thickness may have relief as deep as they are thick [m]; holes
            right through them still count.
    """
    points = thick(points, tol)
    box = aligned_box(points, piece)
    if _is_fit(box, surface, tol, panel_m):
        return box
    tight = hull(points, piece)
    if tight is not None and not _may_be_near(tight, surface, max(tol, panel_m)):
        return None  # no box about it comes nearer
    if turned:
        around = turned_box(points, piece)
        if around is not None and _is_fit(around, surface, tol, panel_m):
            return around
    return tight if tight is not None and _is_fit(tight, surface, tol, panel_m) else None


def _is_fit(shape: Shape, surface: trimesh.Trimesh, tol: float, panel_m: float) -> bool:
    thickness = 2.0 * min(shape.half)
    depth = thickness if 0.0 < thickness <= panel_m else 0.0
    return is_near(shape, surface, max(tol, depth))


def is_near(shape: Shape, surface: trimesh.Trimesh, tol: float) -> bool:
    """Whether nearly all of the shape's surface has triangles at most ``tol`` below it.

    Rays go inwards from points on the shape. The mouth of a drawer, the gap behind a handle or
    the hole of a frame leave their rays without a hit. A few rays decide the clear cases.
    """
    if not _may_be_near(shape, surface, tol):
        return False
    least = 1.0 - (1.0 - NEAR_SHARE) * min(1.0, tol / USUAL_TOL_M)
    return _near_share(*shape.samples(), surface, tol) >= least


def _may_be_near(shape: Shape, surface: trimesh.Trimesh, tol: float) -> bool:
    return _near_share(*shape.samples(every=8), surface, tol) >= CLEARLY_NOT


def box_shares(boxes: Array, surface: trimesh.Trimesh, tol: float) -> Array:
    """For each upright box (B, 2, 3) the share of a few points on it that lie near ``surface``."""
    half = np.maximum((boxes[:, 1] - boxes[:, 0]) / 2.0, THIN_M / 2.0)
    middle = (boxes[:, 0] + boxes[:, 1]) / 2.0
    area = half[:, [1, 0, 0]] * half[:, [2, 2, 1]]
    edges = np.cumsum(area, axis=1) / area.sum(axis=1, keepdims=True)
    count = 32
    quasi = QUASI[:count]
    axis = (quasi[None, :, 0, None] > edges[:, None, :2]).sum(axis=-1)
    sign = np.where(np.arange(count) % 2 == 0, 1.0, -1.0)
    local = np.empty((len(boxes), count, 3))
    normals = np.zeros_like(local)
    b, k = np.meshgrid(np.arange(len(boxes)), np.arange(count), indexing="ij")
    local[b, k, (axis + 1) % 3] = 2.0 * quasi[:, 1] - 1.0
    local[b, k, (axis + 2) % 3] = 2.0 * quasi[:, 2] - 1.0
    local[b, k, axis] = sign
    normals[b, k, axis] = sign
    points = middle[:, None] + local * half[:, None]
    near = _is_close(points.reshape(-1, 3), normals.reshape(-1, 3), surface, tol)
    return np.asarray(near.reshape(len(boxes), count).mean(axis=1))


def _near_share(points: Array, normals: Array, surface: trimesh.Trimesh, tol: float) -> float:
    return float(np.mean(_is_close(points, normals, surface, tol)))


def _is_close(
    points: Array, normals: Array, surface: trimesh.Trimesh, tol: float
) -> NDArray[np.bool_]:
    """Whether a ray inwards from each point meets ``surface`` within ``tol`` (N,)."""
    lift = LIFT_M
    origins = points + lift * normals
    hits, rays, _ = surface.ray.intersects_location(origins, -normals, multiple_hits=False)
    depth = np.full(len(points), np.inf)
    depth[rays] = np.linalg.norm(hits - origins[rays], axis=1)
    return depth <= tol + lift


def thin_m(tol: float) -> float:
    """Least thickness [m] of a shape that may stray by ``tol`` [m]."""
    return THIN_M * min(1.0, max(0.5, tol / USUAL_TOL_M))


def thick(points: Array, tol: float = USUAL_TOL_M) -> Array:
    """``points`` with flat directions padded to the least thickness at a tolerance [m]."""
    least = thin_m(tol)
    points = np.asarray(points, dtype=np.float64)
    centred = points - points.mean(axis=0)
    _, _, axes = np.linalg.svd(centred, full_matrices=len(points) < 3)
    spans = np.ptp(centred @ axes.T, axis=0)
    for axis, span in zip(axes, spans, strict=True):
        if span < least:
            pad = (least - span) / 2.0 * axis
            points = np.concatenate([points + pad, points - pad])
    return points


def aligned_box(points: Array, piece: str) -> Shape:
    """The box along the axes of the part."""
    low, high = points.min(axis=0), points.max(axis=0)
    half = np.maximum((high - low) / 2.0, THIN_M / 4.0)
    return Shape(
        kind="box", T_ps=pose((low + high) / 2.0), half=(half[0], half[1], half[2]), piece=piece
    )


def turned_box(points: Array, piece: str) -> Shape | None:
    """The smallest box in any direction."""
    try:
        T_bp, extents = trimesh.bounds.oriented_bounds(points)
    except (QhullError, ValueError):
        return None
    half = np.maximum(np.asarray(extents) / 2.0, THIN_M / 4.0)
    T_ps = np.linalg.inv(T_bp)
    return Shape(kind="box", T_ps=T_ps, half=(half[0], half[1], half[2]), piece=piece)


def hull(points: Array, piece: str) -> Shape | None:
    """The convex hull, of at most ``MAX_CORNERS`` corners."""
    try:
        corners = points[ConvexHull(points).vertices]
        while len(corners) > MAX_CORNERS:
            corners = _fewer(corners)
    except QhullError:
        return None
    return Shape(kind="hull", T_ps=np.eye(4), half=(0.0, 0.0, 0.0), vertices=corners, piece=piece)


def _fewer(corners: Array) -> Array:
    """Grow a hull from extreme corners, always adding the one that sticks out most."""
    chosen = sorted({int(i) for axis in range(3) for i in _extremes(corners, axis)})
    rest = corners.mean(axis=0)
    while len(chosen) < 5:
        distance = np.min(np.linalg.norm(corners[:, None] - corners[chosen][None], axis=-1), axis=1)
        chosen.append(int(np.argmax(distance)))
    while len(chosen) < MAX_CORNERS:
        planes = ConvexHull(np.vstack([corners[chosen], rest])).equations
        out = (corners @ planes[:, :3].T + planes[:, 3]).max(axis=1)
        out[chosen] = -np.inf
        if out.max() < 1e-5:
            break
        chosen.append(int(np.argmax(out)))
    return corners[chosen]


def _extremes(corners: Array, axis: int) -> tuple[int, int]:
    return int(np.argmin(corners[:, axis])), int(np.argmax(corners[:, axis]))
