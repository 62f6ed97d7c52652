"""Fit a box or a convex hull to points, and measure its distance to the visual surface."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from articulate.geometry.rays import NOTHING, Surface
from articulate.geometry.shapes import QUASI, Shape, faces_of, on_boxes
from articulate.transforms import Array, pose

THIN_M = 0.002
"""Least thickness of a collision shape at the usual tolerance, half of it at finer ones [m]."""
NEAR_SHARE = 0.94
"""Fraction of a shape's surface that must be near the visual surface at ``USUAL_TOL_M``."""
SURE_SHARE = 0.96
"""Fraction near the surface below which a box is replaced by the hull if that is nearer."""
USUAL_TOL_M = 0.003
"""Tolerance from which ``NEAR_SHARE`` applies [m]; below it the rest shrinks in proportion."""
MAX_CORNERS = 32
"""Most corners of a hull."""
CLEARLY_NOT = 0.75
"""Fraction of the first rays below which the other rays are not cast."""
FIRST_EVERY = 8
"""Stride of the first rays among all."""
FEW_RAYS = 32
"""Rays for each of many boxes."""
SAME_DIRECTION = 3
"""Decimals to which equal directions agree when boxes are turned."""
MANY = 128
"""Points above which a set is thinned out before its hull is computed."""
FILLED_SHARE = 0.002
"""Fraction of the points of a cavity that a shape may contain, or one of them."""
FACING_M = 0.02
"""Height above a sheet up to which points of a cavity count as facing it [m]."""
BESIDE_M = 0.003
"""Distance beside a sheet up to which points of a cavity count as facing it [m]."""
ONE_SIDE = 4.0
"""Ratio of the points on both sides above which a sheet faces a cavity on one side."""
ADDED = 0.34
"""Fraction of the missing corners by which a hull of few corners grows at once."""


def _half_sphere(count: int) -> Array:
    """Return unit vectors spread evenly over half of the sphere (count, 3): a Fibonacci spiral."""
    k = np.arange(count) + 0.5
    height, turn = 1.0 - k / count, np.pi * (1.0 + np.sqrt(5.0)) * k
    flat = np.sqrt(1.0 - height**2)
    return np.column_stack([flat * np.cos(turn), flat * np.sin(turn), height])


DIRECTIONS = _half_sphere(MANY // 2)


def fitted(
    points: Array,
    surface: Surface,
    tol: float,
    piece: str,
    *,
    turned: bool = True,
    panel_m: float = 0.0,
) -> Shape | None:
    """Return a box, else a convex hull around ``points`` (N, 3) that is near ``surface``.

    Args:
        points: Points inside the shape (N, 3) [m].
        surface: Triangles that the shape must follow.
        tol: Largest distance of the shape above them [m].
        piece: Names for the shape.
        turned: Also try boxes that are not along the axes of the part.
        panel_m: Thickness up to which boxes may have relief as deep as they are thick [m]; holes
            through them still count.
    """
    return Fit(thick(points, tol, surface.hollow), surface, piece).best(
        tol, turned=turned, panel_m=panel_m
    )


class Fit:
    """Shapes around the same points, measured once for all tolerances.

    Args:
        points: Points inside the shapes (N, 3), nowhere too thin [m].
        surface: Triangles that a shape must follow.
        piece: Names for the shape.
    """

    def __init__(self, points: Array, surface: Surface, piece: str) -> None:
        self.points = points
        self.surface = surface
        self.piece = piece

    def best(self, tol: float, *, turned: bool = True, panel_m: float = 0.0) -> Shape | None:
        """Return the shape of :func:`fitted`."""
        if self._upright.is_fit(tol, panel_m):
            return self._nearer(self._upright, tol, panel_m)
        if self._round is not None and not self._round.may_be_near(max(tol, panel_m)):
            return None  # no box about it comes nearer
        tight = self._tight
        if turned:
            around = self._around
            if around is not None and around.is_fit(tol, panel_m):
                return self._nearer(around, tol, panel_m)
        return tight.shape if tight is not None and tight.is_fit(tol, panel_m) else None

    def _nearer(self, box: ShapeDistance, tol: float, panel_m: float) -> Shape:
        """Return a box that fits, or the hull if that is nearer and the box barely fits."""
        share = box.share(box.allowed_m(tol, panel_m))
        tight = self._tight if share < SURE_SHARE else None
        return tight.shape if tight is not None and tight.share(tol) > share else box.shape

    @cached_property
    def _upright(self) -> ShapeDistance:
        return ShapeDistance(aligned_box(self.points, self.piece), self.surface)

    @cached_property
    def _round(self) -> ShapeDistance | None:
        shape = _full_hull(spanning(self.points), self.piece)
        return None if shape is None else ShapeDistance(shape, self.surface)

    @cached_property
    def _tight(self) -> ShapeDistance | None:
        if self._round is None:
            return None
        shape = _of_few(self._round.shape)
        if shape is None or shape is self._round.shape:
            return None if shape is None else self._round
        return ShapeDistance(shape, self.surface)

    @cached_property
    def _around(self) -> ShapeDistance | None:
        shape = None if self._tight is None else turned_box(self.points, self._tight.shape)
        return None if shape is None else ShapeDistance(shape, self.surface)


class ShapeDistance:
    """Distance between a convex shape and the visual surface below it.

    Rays go inwards from points on the shape. Those at the mouth of a drawer, the gap behind a
    handle or the hole of a frame have no hit. A few rays decide the clear cases.

    Args:
        shape: Convex shape.
        surface: Visual surface.
    """

    def __init__(self, shape: Shape, surface: Surface) -> None:
        self.shape = shape
        self.surface = surface

    @cached_property
    def _few(self) -> Array:
        return self.surface.depths(*self.shape.samples(every=FIRST_EVERY))

    @cached_property
    def _all(self) -> Array:
        return self.surface.depths(*self.shape.samples())

    def may_be_near(self, tol: float) -> bool:
        """Return whether the first rays permit that the shape is near, within ``tol`` [m]."""
        return self.first_share(tol) >= CLEARLY_NOT

    def first_share(self, tol: float) -> float:
        """Estimate :meth:`share` from the first rays; ``tol`` in [m]."""
        return float((self._few <= tol).mean())

    def is_near(self, tol: float) -> bool:
        """Return whether nearly all of the shape has triangles at most ``tol`` below it [m]."""
        if not self.may_be_near(tol):
            return False
        least = 1.0 - (1.0 - NEAR_SHARE) * min(1.0, tol / USUAL_TOL_M)
        return self.share(tol) >= least

    def share(self, tol: float) -> float:
        """Fraction of the shape's surface with triangles at most ``tol`` below it [m]."""
        return float((self._all <= tol).mean())

    def is_fit(self, tol: float, panel_m: float) -> bool:
        """Return whether the shape is near, with relief of panels [m], and fills no cavity."""
        return self.is_near(self.allowed_m(tol, panel_m)) and not self.fills

    @cached_property
    def fills(self) -> bool:
        """True if the shape contains more than a negligible part of the cavity."""
        return fills(self.shape, self.surface.hollow)

    def allowed_m(self, tol: float, panel_m: float) -> float:
        """Largest distance of the surface below the shape [m], for panels their thickness."""
        thickness = 2.0 * min(self.shape.half)
        return max(tol, thickness if 0.0 < thickness <= panel_m else 0.0)


def is_near(shape: Shape, surface: Surface, tol: float) -> bool:
    """Return whether nearly all of the shape has triangles at most ``tol`` below it [m]."""
    return ShapeDistance(shape, surface).is_near(tol)


def fills(shape: Shape, hollow: Array) -> bool:
    """Return whether ``shape`` contains a relevant part of the points ``hollow`` (H, 3) [m]."""
    if not len(hollow):
        return False
    low, high = shape.bounds
    some = hollow[((hollow >= low) & (hollow <= high)).all(axis=1)]
    most = max(1.0, FILLED_SHARE * len(hollow))
    return len(some) > most and int((shape.outside(some) <= 0.0).sum()) > most


def box_shares(boxes: Array, surface: Surface, tol: float) -> Array:
    """Fraction of a few points on each upright box (B, 2, 3) [m] that are near ``surface`` (B,)."""
    half = np.maximum((boxes[:, 1] - boxes[:, 0]) / 2.0, THIN_M / 2.0)
    middle = (boxes[:, 0] + boxes[:, 1]) / 2.0
    local, normals = on_boxes(half, QUASI[:FEW_RAYS])
    points = middle[:, None] + local
    near = surface.depths(points.reshape(-1, 3), normals.reshape(-1, 3)) <= tol
    return np.asarray(near.reshape(len(boxes), -1).mean(axis=1))


def thin_m(tol: float) -> float:
    """Return the least thickness [m] of a shape of tolerance ``tol`` [m]."""
    return THIN_M * min(1.0, max(0.5, tol / USUAL_TOL_M))


def thick(points: Array, tol: float = USUAL_TOL_M, hollow: Array = NOTHING) -> Array:
    """Pad flat directions of ``points`` to the least thickness at a tolerance.

    If one side of a sheet faces a cavity, only the other side is padded.

    Args:
        points: Corners (N, 3) [m].
        tol: Tolerance [m].
        hollow: Points of a cavity (H, 3) that must be left free [m].
    """
    least = thin_m(tol)
    points = np.asarray(points, dtype=np.float64)
    middle = points.mean(axis=0)
    centred = points - middle
    _, axes = np.linalg.eigh(centred.T @ centred)
    spans = np.ptp(centred @ axes, axis=0)
    for k in np.flatnonzero(spans < least):
        above = _share_above(centred @ axes, (hollow - middle) @ axes, int(k))
        pad = (least - spans[k]) * axes[:, k]
        points = np.concatenate([points + above * pad, points - (1.0 - above) * pad])
    return points


def _share_above(points: Array, hollow: Array, axis: int) -> float:
    """Fraction of a sheet's padding along ``axis``: half, or all or none beside a cavity.

    Args:
        points: Corners of the sheet about their middle, along its axes (N, 3) [m].
        hollow: Points of the cavity in the same frame (H, 3) [m].
        axis: Axis along which the sheet is flat.
    """
    flat = [k for k in range(3) if k != axis]
    low, high = points[:, flat].min(axis=0) - BESIDE_M, points[:, flat].max(axis=0) + BESIDE_M
    beside = ((hollow[:, flat] >= low) & (hollow[:, flat] <= high)).all(axis=1)
    heights = hollow[beside & (np.abs(hollow[:, axis]) <= FACING_M), axis]
    above, below = int((heights > 0.0).sum()), int((heights < 0.0).sum())
    if above > ONE_SIDE * below:
        return 0.0
    return 1.0 if below > ONE_SIDE * above else 0.5


def aligned_box(points: Array, piece: str) -> Shape:
    """Return the box around ``points`` (N, 3) [m] along the axes of the part."""
    low, high = points.min(axis=0), points.max(axis=0)
    half = np.maximum((high - low) / 2.0, THIN_M / 4.0)
    return Shape(
        kind="box", T_ps=pose((low + high) / 2.0), half=(half[0], half[1], half[2]), piece=piece
    )


def turned_box(points: Array, tight: Shape) -> Shape | None:
    """Return the smallest box with one face and one edge along those of a hull.

    Args:
        points: Points inside the box (N, 3) [m].
        tight: Their hull of few corners.
    """
    triangles = tight.faces.triangles
    normals = _unique_directions(tight.faces.equations[:, :3])
    edges = _unique_directions(
        np.concatenate([triangles[:, k] - triangles[:, k - 1] for k in range(3)])
    )
    across = edges[None] - (normals @ edges.T)[..., None] * normals[:, None]  # (N, E, 3)
    length = np.linalg.norm(across, axis=-1)
    n, e = np.nonzero(length > 0.5)  # an edge normal to the face has no direction in it
    if not len(n):
        return None
    one = across[n, e] / length[n, e][:, None]
    other = np.cross(normals[n], one)
    corners = tight.corners
    height = np.ptp(corners @ normals.T, axis=0)[n]
    size = np.ptp(corners @ one.T, axis=0) * np.ptp(corners @ other.T, axis=0) * height
    best = int(np.argmin(size))
    axes = np.column_stack([one[best], other[best], normals[n[best]]])
    local = points @ axes
    low, high = local.min(axis=0), local.max(axis=0)
    half = np.maximum((high - low) / 2.0, THIN_M / 4.0)
    T_ps = pose(axes @ ((low + high) / 2.0), axes)
    return Shape(kind="box", T_ps=T_ps, half=(half[0], half[1], half[2]), piece=tight.piece)


def _unique_directions(vectors: Array) -> Array:
    """Return unit vectors (M, 3) along ``vectors`` (N, 3), one of each opposite pair."""
    length = np.linalg.norm(vectors, axis=1)
    units = vectors[length > 0.0] / length[length > 0.0][:, None]
    rounded = units.round(SAME_DIRECTION) + 0.0
    first = rounded[np.arange(len(rounded)), (rounded != 0.0).argmax(axis=1)]
    _, index = np.unique(rounded * np.sign(first)[:, None] + 0.0, axis=0, return_index=True)
    return np.asarray(units[np.sort(index)])


def hull(points: Array, piece: str) -> Shape | None:
    """Return the convex hull of ``points`` (N, 3) [m] with at most ``MAX_CORNERS`` corners."""
    shape = _full_hull(spanning(points), piece)
    return None if shape is None else _of_few(shape)


def spanning(points: Array, directions: Array = DIRECTIONS) -> Array:
    """Keep the points that are extreme along some directions, both ways.

    The points are scaled to equal extents before, so that thin sets keep their rims.

    Args:
        points: Points (N, 3) [m]; a small set is returned unchanged.
        directions: Unit vectors (D, 3).
    """
    if len(points) <= 2 * len(directions):
        return points
    centred = points - points.mean(axis=0)
    _, axes = np.linalg.eigh(centred.T @ centred)
    local = centred @ axes
    heights = (local / np.maximum(np.ptp(local, axis=0), 1e-9)) @ directions.T
    chosen = np.unique(np.concatenate([heights.argmax(axis=0), heights.argmin(axis=0)]))
    return np.asarray(points[chosen])


def _full_hull(points: Array, piece: str) -> Shape | None:
    try:
        found = ConvexHull(points)
    except QhullError:
        return None
    return _shape_of(found, piece)


def _of_few(shape: Shape) -> Shape | None:
    """Reduce a hull to at most ``MAX_CORNERS`` of its corners."""
    if len(shape.corners) <= MAX_CORNERS:
        return shape
    try:
        return _shape_of(ConvexHull(_fewer(shape.corners)), shape.piece)
    except QhullError:
        return None


def _shape_of(found: ConvexHull, piece: str) -> Shape:
    known = faces_of(found)
    return Shape(
        kind="hull",
        T_ps=np.eye(4),
        half=(0.0, 0.0, 0.0),
        vertices=known.corners,
        piece=piece,
        known=known,
    )


def _fewer(corners: Array) -> Array:
    """Grow a hull from extreme corners by adding the farthest corner beyond each face."""
    chosen = sorted({int(i) for axis in range(3) for i in _extremes(corners, axis)})
    rest = corners.mean(axis=0)
    while len(chosen) < 5:
        distance = np.min(np.linalg.norm(corners[:, None] - corners[chosen][None], axis=-1), axis=1)
        chosen.append(int(np.argmax(distance)))
    while len(chosen) < MAX_CORNERS:
        planes = ConvexHull(np.vstack([corners[chosen], rest])).equations
        over = corners @ planes[:, :3].T + planes[:, 3]
        over[chosen] = -np.inf
        farthest = np.unique(over.argmax(axis=0))
        out = over[farthest].max(axis=1)
        order = np.argsort(-out, kind="stable")
        order = order[: max(1, round(ADDED * (MAX_CORNERS - len(chosen))))]
        if out[order[0]] < 1e-5:
            break
        chosen += farthest[order[out[order] >= 1e-5]].tolist()
    return np.asarray(corners[chosen])


def _extremes(corners: Array, axis: int) -> tuple[int, int]:
    return int(np.argmin(corners[:, axis])), int(np.argmax(corners[:, axis]))
