"""Cutting convex collision shapes back, as far as what they stand for stays covered."""

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
"""How well points are covered."""

MORE = 6000
"""So many points on what a part shows say what a cut bares, besides those that judge coverage."""
BARE = 3.0
"""A cut bares what is seen where a point that was covered comes to lie more than so many times as
far from all that is left as covered points may: it is a way through a wall then, and no edge."""
STOUT_M = 0.003
"""Cuts leave no piece thinner than this [m]: thin slices go through anything unnoticed ..."""
STOUT_SHARE = 0.7
"""... or than this share of the converted shape's thickness, if that is less ..."""
SHEET_SHARE = 0.3
"""... or than this share of it if that is a sheet, thinner than all that."""

MARGIN = 0.005
"""Cuts leave the coverage of a link above what is allowed by this share."""
THINNEST_M = 0.0005
"""What is left of a shape is left out if it is thinner than this [m]."""
APART_M = 0.0002
"""Shapes that are cut until they do not meet at all are this far apart [m]."""
MOST_PIECES = 4
"""So many pieces at most are left of a shape that another one is carved out of."""
MOST_SHAPES = 4
"""A link has at most this many times the shapes that it had, and as many more."""
ROUNDING_M = 1e-6
"""Thicknesses that differ by less are the same [m]."""
NEAR, FAR = 2, 0
"""How a point lies to a shape that covers it, and to one that does not nearly so."""
ALONG = 1.0 - 1e-8
"""A cut whose normal has this cosine with an axis of a box leaves a box."""


def cut_back(shape: Shape, normal: Array, depth_m: float) -> Shape | None:
    """What is left of ``shape`` without the ``depth_m`` [m] that reach farthest along ``normal``.

    Args:
        shape: Convex shape in its part.
        normal: Unit vector (3,) in the part.
        depth_m: Thickness of what is cut away [m].

    Returns:
        The rest, or None if it is next to nothing.
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
            way = np.copysign(depth_m / 2.0, axes[:, axis] @ normal) * axes[:, axis]
            T_ps = pose(shape.T_ps[:3, 3] - way, axes)
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
    """Corners (N, 3) [m] of the hull of ``shape`` and the ends of its edges (E, 2)."""
    faces = shape.faces
    index = faces.index
    return faces.corners, np.vstack([index[:, [a, b]] for a, b in ((0, 1), (1, 2), (2, 0))])


def carved(shape: Shape, planes: Array) -> tuple[Shape, ...]:
    """Convex pieces of ``shape`` that lie outside another convex shape, largest first.

    Args:
        shape: Convex shape in its part.
        planes: Half-spaces (M, 4) of the other shape in the same frame, inside where
            n x + d <= 0.
    """
    out: list[Shape] = []
    rest: Shape | None = shape
    while rest is not None and len(out) < MOST_PIECES:
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
    """Extent [m] of a shape along the direction in which its corners vary least."""
    if shape.kind == "box":
        return 2.0 * min(shape.half)
    corners = shape.corners
    centred = corners - corners.mean(axis=0)
    _, _, axes = np.linalg.svd(centred, full_matrices=False)
    return float(np.ptp(centred @ axes[-1]))


@dataclass(frozen=True, kw_only=True)
class Offer:
    """A cut that could be made."""

    index: int
    """Which shape of its body."""
    rest: tuple[Shape, ...]
    """What would be left of it."""
    lost: float
    """Share of the link's visible surface that would lose its cover."""
    removed_m3: float
    """Volume that is cut away [m3]."""
    bared: bool
    """Whether what is seen would lie bare somewhere."""
    allowed: bool
    """Whether enough stays covered."""


class Part:
    """One body with the shapes that are left of it, and how well they cover what it shows.

    Args:
        body: As converted.
    """

    def __init__(self, body: Body) -> None:
        self.body = body
        self.shapes = list(body.shapes)
        self.removed_m3 = 0.0
        """Volume that was cut away [m3]."""
        self.cut_count = 0
        """Cuts that were made."""
        self.cuts: set[int] = set()
        """Shapes that were cut, by the order of the converted body."""
        self._order = list(range(len(self.shapes)))
        self._gone: set[int] = set()
        triangles = [piece.mesh.triangles for piece in body.visuals]
        self._points = np.zeros((0, 3))
        near_m = NEAR_M
        if triangles:
            every = np.concatenate(triangles)
            self._points = np.vstack([sample(every, count)[0] for count in (SAMPLES, MORE)])
            near_m = near_of(every.reshape(-1, 3))
        self.near_m = near_m
        """Points of the surface this near to a shape are covered [m]."""
        self._levels = [self._level(shape) for shape in self.shapes]
        self._held = np.max([*self._levels, np.zeros(len(self._points), np.int8)], axis=0) == NEAR
        self._least = ALLOWED_SHARE + MARGIN
        self._most = MOST_SHAPES * (len(self.shapes) + 1)

    def _level(self, shape: Shape, among: Mask | None = None) -> Levels:
        """How well ``shape`` covers the points: 2 where near, 1 where nearly, else 0 (N,).

        The points that are not ``among`` are not asked.
        """
        chosen = np.arange(len(self._points)) if among is None else np.flatnonzero(among)
        level = np.zeros(len(self._points), dtype=np.int8)
        if not len(chosen):
            return level
        bare_m = BARE * self.near_m
        away = shape.distances(self._points[chosen], max(bare_m, self.near_m))
        level[chosen] = (away <= bare_m).astype(np.int8) + (away <= self.near_m)
        return level

    def offer(self, index: int, rest: tuple[Shape, ...]) -> Offer:
        """What leaving only ``rest`` of shape ``index`` would cost, its thin slices gone."""
        shape = self.shapes[index]
        whole_m = _thickness(self.body.shapes[self._order[index]])
        share_m = (STOUT_SHARE if whole_m >= STOUT_M else SHEET_SHARE) * whole_m
        least_m = min(STOUT_M, share_m) - ROUNDING_M
        rest = tuple(piece for piece in rest if _thickness(piece) >= least_m)
        own = self._levels[index]
        others = [level for k, level in enumerate(self._levels) if k != index]
        kept = np.max(others, axis=0) if others else np.zeros_like(own)
        before = np.maximum(kept, own)
        lone = own > kept  # what is left lies in the shape: nothing else can be lost
        for piece in rest:
            kept = np.maximum(kept, self._level(piece, among=lone & (kept < own)))
        near = kept[:SAMPLES] == NEAR
        lost = float(((before[:SAMPLES] == NEAR) & ~near).mean()) if len(own) else 0.0
        share = float(near.mean()) if len(own) else 1.0
        bared = bool((self._held & (before > FAR) & (kept == FAR)).any())
        count = len(self.shapes) - len(self._gone) - 1 + len(rest)
        enough = lost == 0.0 or share >= self._least
        return Offer(
            index=index,
            rest=rest,
            lost=lost,
            removed_m3=shape.volume - sum(piece.volume for piece in rest),
            bared=bared,
            allowed=0 < count <= self._most and enough,
        )

    def take(self, offer: Offer) -> None:
        """Make a cut. Shapes of which nothing is left go with :meth:`tidy`."""
        self.cut_count += 1
        whole = self._order[offer.index]
        self.cuts.add(whole)
        self.removed_m3 += offer.removed_m3
        if not offer.rest:
            self._levels[offer.index] = np.zeros(len(self._points), dtype=np.int8)
            self._gone.add(offer.index)
            return
        self.shapes[offer.index] = offer.rest[0]
        self._levels[offer.index] = self._level(offer.rest[0])
        for piece in offer.rest[1:]:
            self.shapes.append(piece)
            self._levels.append(self._level(piece))
            self._order.append(whole)

    def tidy(self) -> None:
        """Leave out the shapes of which nothing is left."""
        keep = [k for k in range(len(self.shapes)) if k not in self._gone]
        self.shapes = [self.shapes[k] for k in keep]
        self._levels = [self._levels[k] for k in keep]
        self._order = [self._order[k] for k in keep]
        self._gone.clear()

    def state(self) -> tuple[Any, ...]:
        """All that cutting changes, to come back to with :meth:`restore`."""
        lists = (list(self.shapes), list(self._levels), list(self._order))
        return (*lists, set(self._gone), set(self.cuts), self.cut_count, self.removed_m3)

    def restore(self, state: tuple[Any, ...]) -> None:
        """Go back to an earlier ``state``."""
        self.shapes, self._levels, self._order, *rest = state
        self._gone, self.cuts, self.cut_count, self.removed_m3 = rest

    def done(self) -> Body:
        """The body with the shapes that are left."""
        return replace(self.body, shapes=tuple(self.shapes))
