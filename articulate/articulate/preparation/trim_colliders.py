"""Trim convex collision shapes as far as the visible surface of their part stays covered."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import QhullError

from articulate.checks.coverage import ALLOWED_SHARE, NEAR_M, SAMPLES, near_of
from articulate.checks.surface import sample
from articulate.conversion.write_asset import Body
from articulate.geometry.convex_fit import hull
from articulate.geometry.shapes import Shape
from articulate.transforms import Array, Ints, Mask, pose

Levels = NDArray[np.int8]
"""Coverage of points: :data:`NEAR`, 1 or :data:`FAR`."""

MORE = 6000
"""Additional points on the visual surface for detecting bared areas."""
BARE = 3.0
"""A cut bares a covered point that is then farther from all shapes than this multiple of the
distance for coverage: it opens a passage through a wall instead of trimming an edge."""
STOUT_M = 0.003
"""Cuts leave no piece thinner than this [m], as thin slices pass others unnoticed ..."""
STOUT_SHARE = 0.7
"""... or than this fraction of the original thickness, if that is less ..."""
SHEET_SHARE = 0.3
"""... or than this fraction of it for a sheet that is thinner than that."""

MARGIN = 0.005
"""Margin of coverage above the limit of the check that cuts leave."""
THINNEST_M = 0.0005
"""Remainders thinner than this are removed [m]."""
APART_M = 0.0002
"""Distance of shapes after a cut that separates them [m]."""
MAX_PIECES = 4
"""Largest number of pieces of a shape that another one is carved out of."""
MAX_SHAPES = 4
"""Largest number of shapes of a link, as a multiple of the original number plus one."""
ROUNDING_M = 1e-6
"""Tolerance of thicknesses [m]."""
NEAR, FAR = 2, 0
"""Coverage of a point by a shape that is near and by one that is far."""
ALONG = 1.0 - 1e-8
"""A cut whose normal has this cosine with an axis of a box leaves a box."""


def cut_back(shape: Shape, normal: Array, depth_m: float) -> Shape | None:
    """Return ``shape`` without the outermost ``depth_m`` [m] along ``normal``.

    Args:
        shape: Convex shape in its part.
        normal: Unit vector (3,) in the part.
        depth_m: Thickness of the removed layer [m].

    Returns:
        The remainder, or None if it is thinner than :data:`THINNEST_M`.
    """
    corners = shape.corners
    heights = corners @ normal
    limit = float(heights.max()) - depth_m
    if limit - float(heights.min()) < THINNEST_M:
        return None
    if shape.kind == "box":
        axes = shape.T_ps[:3, :3]
        along = np.abs(axes.T @ normal)
        axis = int(np.argmax(along))
        if along[axis] > ALONG:
            half = list(shape.half)
            half[axis] -= depth_m / 2.0
            shift = np.copysign(depth_m / 2.0, axes[:, axis] @ normal) * axes[:, axis]
            T_ps = pose(shape.T_ps[:3, 3] - shift, axes)
            return replace(shape, T_ps=T_ps, half=(half[0], half[1], half[2]))
    try:
        corners, edges = _edges(shape)
    except QhullError:
        return None
    heights = corners @ normal
    high, low = heights[edges].max(axis=1), heights[edges].min(axis=1)
    cut = edges[(high > limit) & (low < limit)]
    start, end = heights[cut[:, 0]], heights[cut[:, 1]]
    share = ((limit - start) / (end - start))[:, None]
    crossings = corners[cut[:, 0]] * (1.0 - share) + corners[cut[:, 1]] * share
    rest = hull(np.vstack([corners[heights <= limit], crossings]), shape.piece)
    if rest is None or _thickness(rest) < THINNEST_M:
        return None
    return rest


def _edges(shape: Shape) -> tuple[Array, Ints]:
    """Return corners (N, 3) [m] of the hull of ``shape`` and end indices of its edges (E, 2)."""
    faces = shape.faces
    index = faces.index
    return faces.corners, np.vstack([index[:, [a, b]] for a, b in ((0, 1), (1, 2), (2, 0))])


def carved(shape: Shape, planes: Array) -> tuple[Shape, ...]:
    """Return the convex pieces of ``shape`` outside another convex shape, largest first.

    Args:
        shape: Convex shape in its part.
        planes: Half-spaces (M, 4) of the other shape in the same frame [m], inside where
            n x + d <= 0.
    """
    out: list[Shape] = []
    rest: Shape | None = shape
    while rest is not None and len(out) < MAX_PIECES:
        best: tuple[Shape, Array, float] | None = None
        for plane in planes:
            normal, limit = plane[:3], APART_M - float(plane[3])
            heights = rest.corners @ normal
            if heights.max() - limit < THINNEST_M:
                continue
            below = limit - float(heights.min())
            piece = rest if below <= 0.0 else cut_back(rest, -normal, below)
            if piece is not None and (best is None or piece.volume > best[0].volume):
                best = piece, normal, float(heights.max()) - limit
        if best is None:
            break
        out.append(best[0])
        rest = None if best[0] is rest else cut_back(rest, best[1], best[2])
    return tuple(out)


def _thickness(shape: Shape) -> float:
    """Return the extent of a shape along the direction of least variance of its corners [m]."""
    if shape.kind == "box":
        return 2.0 * min(shape.half)
    corners = shape.corners
    centred = corners - corners.mean(axis=0)
    _, _, axes = np.linalg.svd(centred, full_matrices=False)
    return float(np.ptp(centred @ axes[-1]))


@dataclass(frozen=True, kw_only=True)
class Cut:
    """Evaluated cut of one shape."""

    index: int
    """Index of the shape in its body."""
    rest: tuple[Shape, ...]
    """Remainder of the shape."""
    lost: float
    """Fraction of the visible surface of the link that loses coverage."""
    removed_m3: float
    """Removed volume [m3]."""
    bared: bool
    """True if an area of the visible surface is bared."""
    allowed: bool
    """True if enough of the surface stays covered."""


class Part:
    """Body with its remaining shapes and their coverage of its visual surface.

    Args:
        body: Converted body.
    """

    def __init__(self, body: Body) -> None:
        self.body = body
        self.shapes = list(body.shapes)
        self.removed_m3 = 0.0
        """Removed volume [m3]."""
        self.cut_count = 0
        """Number of applied cuts."""
        self.cuts: set[int] = set()
        """Indices of trimmed shapes in the converted body."""
        self._order = list(range(len(self.shapes)))
        self._empty: set[int] = set()
        triangles = [piece.mesh.triangles for piece in body.visuals]
        self._points = np.zeros((0, 3))
        near_m = NEAR_M
        if triangles:
            every = np.concatenate(triangles)
            self._points = np.vstack([sample(every, count)[0] for count in (SAMPLES, MORE)])
            near_m = near_of(every.reshape(-1, 3))
        self.near_m = near_m
        """Largest distance of covered points from a shape [m]."""
        self._levels = [self._level(shape) for shape in self.shapes]
        self._covered = (
            np.max([*self._levels, np.zeros(len(self._points), np.int8)], axis=0) == NEAR
        )
        self._min_share = ALLOWED_SHARE + MARGIN
        self._max_shapes = MAX_SHAPES * (len(self.shapes) + 1)

    def _level(self, shape: Shape, among: Mask | None = None) -> Levels:
        """Return the coverage of the points by ``shape`` (N,): 2 near, 1 intermediate, 0 far.

        Points outside the mask ``among`` (N,) are not evaluated.
        """
        chosen = np.arange(len(self._points)) if among is None else np.flatnonzero(among)
        level = np.zeros(len(self._points), dtype=np.int8)
        if not len(chosen):
            return level
        bare_m = BARE * self.near_m
        away = shape.distances(self._points[chosen], max(bare_m, self.near_m))
        level[chosen] = (away <= bare_m).astype(np.int8) + (away <= self.near_m)
        return level

    def evaluate(self, index: int, rest: tuple[Shape, ...]) -> Cut:
        """Evaluate replacing shape ``index`` by ``rest``, without its thin slices."""
        shape = self.shapes[index]
        thickness_m = _thickness(self.body.shapes[self._order[index]])
        share_m = (STOUT_SHARE if thickness_m >= STOUT_M else SHEET_SHARE) * thickness_m
        least_m = min(STOUT_M, share_m) - ROUNDING_M
        rest = tuple(piece for piece in rest if _thickness(piece) >= least_m)
        own = self._levels[index]
        others = [level for k, level in enumerate(self._levels) if k != index]
        kept = np.max(others, axis=0) if others else np.zeros_like(own)
        before = np.maximum(kept, own)
        lone = own > kept  # the remainder is inside the shape: no other point can be lost
        for piece in rest:
            kept = np.maximum(kept, self._level(piece, among=lone & (kept < own)))
        near = kept[:SAMPLES] == NEAR
        lost = float(((before[:SAMPLES] == NEAR) & ~near).mean()) if len(own) else 0.0
        share = float(near.mean()) if len(own) else 1.0
        bared = bool((self._covered & (before > FAR) & (kept == FAR)).any())
        count = len(self.shapes) - len(self._empty) - 1 + len(rest)
        enough = lost == 0.0 or share >= self._min_share
        return Cut(
            index=index,
            rest=rest,
            lost=lost,
            removed_m3=shape.volume - sum(piece.volume for piece in rest),
            bared=bared,
            allowed=0 < count <= self._max_shapes and enough,
        )

    def apply(self, cut: Cut) -> None:
        """Apply a cut. Shapes without remainder are removed by :meth:`remove_empty`."""
        self.cut_count += 1
        original = self._order[cut.index]
        self.cuts.add(original)
        self.removed_m3 += cut.removed_m3
        if not cut.rest:
            self._levels[cut.index] = np.zeros(len(self._points), dtype=np.int8)
            self._empty.add(cut.index)
            return
        self.shapes[cut.index] = cut.rest[0]
        self._levels[cut.index] = self._level(cut.rest[0])
        for piece in cut.rest[1:]:
            self.shapes.append(piece)
            self._levels.append(self._level(piece))
            self._order.append(original)

    def remove_empty(self) -> None:
        """Remove the shapes without remainder."""
        keep = [k for k in range(len(self.shapes)) if k not in self._empty]
        self.shapes = [self.shapes[k] for k in keep]
        self._levels = [self._levels[k] for k in keep]
        self._order = [self._order[k] for k in keep]
        self._empty.clear()

    def state(self) -> tuple[Any, ...]:
        """Return everything that cuts change, for :meth:`restore`."""
        lists = (list(self.shapes), list(self._levels), list(self._order))
        return (*lists, set(self._empty), set(self.cuts), self.cut_count, self.removed_m3)

    def restore(self, state: tuple[Any, ...]) -> None:
        """Restore an earlier ``state``."""
        self.shapes, self._levels, self._order, *rest = state
        self._empty, self.cuts, self.cut_count, self.removed_m3 = rest

    def trimmed_body(self) -> Body:
        """Return the body with the remaining shapes."""
        return replace(self.body, shapes=tuple(self.shapes))
