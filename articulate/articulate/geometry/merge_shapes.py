"""Reduce the number of collision shapes: merge neighbours, drop hidden and redundant ones."""

from __future__ import annotations

import numpy as np
import trimesh

from articulate.formats.repairs import Repairs
from articulate.geometry.convex_fit import box_shares, fills, fitted, hull, is_near
from articulate.geometry.rays import Surface
from articulate.geometry.shapes import Shape, sample_surface
from articulate.transforms import Array, Ints

SPARE_LEAST = 0.97
"""Least fraction of the visual surface that stays covered when shapes are dropped."""
SPARE_NEAR = 0.8
"""Distance within which a point is covered, as a fraction of the tolerance of the checks."""
SPARE_SAMPLES = 2000
"""Points on the visual surface that measure the coverage."""
SPARE_EACH = 100
"""Points for each shape where the measure must be reliable: with fewer, shapes that contain few of
them by chance would be dropped, and more surface would be lost than measured."""
SPARE_MOST = 100_000
"""Largest number of points."""
MAX_JOINED = 192
"""Largest number of shapes that are merged."""
MAX_FAILED = 300
"""Failed pairs after which merging stops."""
OVER_BUDGET = 3.0
"""Largest number of strict shapes, as a multiple of the budget."""
HOPEFUL_SHARE = 0.25
"""Least fraction of the common upright box near the surface for a pair to be tried."""


def surface_tolerance(mesh: trimesh.Trimesh) -> float:
    """Return the distance of shapes to the visual surface that the checks accept [m]."""
    return max(0.003, 0.01 * float(mesh.scale))


def merged(shapes: list[Shape], surface: Surface, tol: float) -> list[Shape]:
    """Merge neighbours as long as the result stays within ``tol`` [m] of ``surface``."""
    if not 2 <= len(shapes) <= MAX_JOINED:
        return list(shapes)
    pairs = _Pairs(shapes, surface, tol)
    while pairs.failed < MAX_FAILED and pairs.join_one():
        pass
    return pairs.shapes


class _Pairs:
    """Shapes to be merged and the state of each pair of them."""

    def __init__(self, shapes: list[Shape], surface: Surface, tol: float) -> None:
        self.surface = surface
        self.tol = tol
        self.failed = 0
        """Number of pairs that cannot be merged."""
        self.shapes: list[Shape] = []
        self._low, self._high = np.zeros((0, 3)), np.zeros((0, 3))
        self._open = np.zeros((0, 0), dtype=bool)  # above the diagonal, not decided yet
        self._hopeful = np.zeros((0, 0), dtype=bool)
        for shape in shapes:
            self._append(shape)
        self._find_hopeful(*np.nonzero(self._open))

    def _append(self, shape: Shape) -> None:
        count = len(self.shapes)
        self.shapes.append(shape)
        self._low = np.vstack([self._low, shape.bounds[0]])
        self._high = np.vstack([self._high, shape.bounds[1]])
        self._open = np.pad(self._open, (0, 1))
        self._hopeful = np.pad(self._hopeful, (0, 1))
        gap = np.maximum(self._low - self._high[-1], self._low[-1] - self._high)
        self._open[:count, count] = (gap[:count] <= 2.0 * self.tol).all(axis=1)

    def _find_hopeful(self, i: Ints, j: Ints) -> None:
        """Mark the pairs (P,) whose common upright box is near the surface somewhere."""
        if len(i):
            boxes = np.stack([*self._common(i, j)], axis=1)
            self._hopeful[i, j] = box_shares(boxes, self.surface, self.tol) >= HOPEFUL_SHARE

    def _common(self, i: Ints, j: Ints) -> tuple[Array, Array]:
        low, high = self._low, self._high
        return np.minimum(low[i], low[j]), np.maximum(high[i], high[j])

    def join_one(self) -> bool:
        """Merge one pair, smallest common box first; return False if none can be merged."""
        i, j = np.nonzero(self._open)
        low, high = self._common(i, j)
        for k in np.argsort(np.prod(high - low, axis=1), kind="stable"):
            a, b = int(i[k]), int(j[k])
            if self._hopeful[a, b]:
                one, two = self.shapes[a], self.shapes[b]
                points = np.vstack([one.corners, two.corners])
                shape = fitted(points, self.surface, self.tol, one.piece, turned=False)
                if shape is not None:
                    self._replace(a, b, shape)
                    return True
            self._open[a, b] = False
            self.failed += 1
        return False

    def _replace(self, a: int, b: int, shape: Shape) -> None:
        keep = np.setdiff1d(np.arange(len(self.shapes)), [a, b])
        self.shapes = [self.shapes[k] for k in keep]
        self._low, self._high = self._low[keep], self._high[keep]
        self._open = self._open[np.ix_(keep, keep)]
        self._hopeful = self._hopeful[np.ix_(keep, keep)]
        self._append(shape)
        last = len(self.shapes) - 1
        first = np.flatnonzero(self._open[:, last])
        self._find_hopeful(first, np.full(len(first), last))


def without_hidden(shapes: list[Shape]) -> list[Shape]:
    """Drop shapes that are inside another one."""
    kept: list[Shape] = []
    for shape in sorted(shapes, key=lambda s: -s.volume):
        if not any(float(other.outside(shape.corners).max()) < 1e-3 for other in kept):
            kept.append(shape)
    return kept


def without_spare(
    shapes: list[Shape], surface: trimesh.Trimesh, budget: int, *, sure: bool = False
) -> list[Shape]:
    """Drop shapes down to ``budget`` as long as nearly all of the surface stays covered.

    Trims and rims are close to panels: the surface that they cover is covered twice.

    Args:
        shapes: Shapes of one part.
        surface: Visual surface of the part [m].
        budget: Number of shapes to reach.
        sure: Use as many points as many small shapes need.
    """
    budget = max(budget, 1)  # handles may have used it up
    if len(shapes) <= budget:
        return shapes
    samples = min(max(SPARE_SAMPLES, SPARE_EACH * len(shapes) * sure), SPARE_MOST)
    points, _ = sample_surface(surface, samples)
    near = SPARE_NEAR * surface_tolerance(surface)
    covered = [_covered_by(shape, points, near) for shape in shapes]
    count = np.zeros(len(points), dtype=np.int64)
    owners = np.zeros(
        len(points), dtype=np.int64
    )  # sum of the indices of the shapes that cover a point
    for k, own in enumerate(covered):
        count[own] += 1
        owners[own] += k
    unique = np.array([(count[own] == 1).sum() for own in covered])
    seen, left = int((count > 0).sum()), len(shapes)
    dropped = np.zeros(len(shapes), dtype=bool)
    while left > budget:
        least = int(np.argmin(np.where(dropped, len(points) + 1, unique)))
        if seen - unique[least] < SPARE_LEAST * len(points):
            break
        dropped[least] = True
        left, seen = left - 1, seen - int(unique[least])
        own = covered[least]
        count[own] -= 1
        owners[own] -= least
        np.add.at(unique, owners[own[count[own] == 1]], 1)
    return [shape for shape, drop in zip(shapes, dropped, strict=True) if not drop]


def _covered_by(shape: Shape, points: Array, near_m: float) -> Ints:
    """Return the indices of ``points`` (N, 3) in ``shape`` or at most ``near_m`` away."""
    low, high = shape.bounds
    some = np.flatnonzero(((points >= low - near_m) & (points <= high + near_m)).all(axis=1))
    return np.asarray(some[shape.covers(points[some], near_m)])


def within_budget(
    shapes: list[Shape],
    budget: int,
    part: str,
    repairs: Repairs,
    strict: Surface | None = None,
    few: int | None = None,
) -> tuple[Shape, ...]:
    """Merge pairs whose common hull adds least volume until at most ``budget`` shapes are left.

    Args:
        shapes: Shapes of one part.
        budget: Number of shapes to reach.
        part: Name of the part.
        repairs: Receives the changes.
        strict: Surface that merged shapes must follow and whose cavities they must not fill,
            even if up to ``OVER_BUDGET`` times ``budget`` shapes are left.
        few: Number of shapes to reach where ``strict`` permits it; None: ``budget``.
    """
    shapes = list(shapes)
    before = len(shapes)
    if strict is not None:
        shapes = _strictly_merged(shapes, few or budget, strict)
        budget = round(OVER_BUDGET * budget)
    shapes = _cheaply_merged(shapes, budget)
    if len(shapes) < before:
        repairs.add(f"part {part}: {before} collision shapes merged into {len(shapes)}")
    return tuple(shapes)


def _strictly_merged(shapes: list[Shape], budget: int, surface: Surface) -> list[Shape]:
    """Merge pairs whose common hull stays near the surface and fills no cavity."""
    tol = surface_tolerance(surface.mesh)
    failed = 0
    while len(shapes) > max(budget, 1) and failed < MAX_FAILED:
        added = _added(shapes)
        order = np.argsort(added, axis=None)[: MAX_FAILED - failed]
        for place in order:
            i, j = (int(k) for k in np.unravel_index(place, added.shape))
            if not np.isfinite(added[i, j]):
                return shapes
            both = hull(np.vstack([shapes[i].corners, shapes[j].corners]), shapes[i].piece)
            if both is None or fills(both, surface.hollow) or not is_near(both, surface, tol):
                failed += 1
                continue
            shapes = [*(s for k, s in enumerate(shapes) if k not in (i, j)), both]
            break
        else:
            return shapes
    return shapes


def _added(shapes: list[Shape]) -> Array:
    """Volume that the common upright box of each pair adds (N, N) [m3], inf up to the diagonal."""
    low = np.array([s.bounds[0] for s in shapes])
    high = np.array([s.bounds[1] for s in shapes])
    size = np.prod(high - low, axis=1)
    common = np.prod(np.maximum(high[:, None], high) - np.minimum(low[:, None], low), axis=-1)
    added = common - size[:, None] - size[None]
    added[np.tril_indices(len(shapes))] = np.inf
    return np.asarray(added)


def _cheaply_merged(shapes: list[Shape], budget: int) -> list[Shape]:
    """Merge pairs whose common upright box adds least volume down to ``budget`` shapes."""
    if len(shapes) <= max(budget, 1):
        return shapes
    shapes, added = list(shapes), _added(shapes)
    while len(shapes) > max(budget, 1):
        i, j = (int(k) for k in np.unravel_index(np.argmin(added), added.shape))
        both = hull(np.vstack([shapes[i].corners, shapes[j].corners]), shapes[i].piece)
        keep = [k for k in range(len(shapes)) if k not in (i, j)]
        shapes = [*(shapes[k] for k in keep), both if both is not None else shapes[i]]
        added = np.pad(added[np.ix_(keep, keep)], (0, 1), constant_values=np.inf)
        added[:-1, -1] = _added_by(shapes[:-1], shapes[-1])
    return shapes


def _added_by(shapes: list[Shape], last: Shape) -> Array:
    """Volume that the common upright box of each of ``shapes`` with ``last`` adds (N,) [m3]."""
    low = np.array([s.bounds[0] for s in shapes]).reshape(-1, 3)
    high = np.array([s.bounds[1] for s in shapes]).reshape(-1, 3)
    common = np.prod(np.maximum(high, last.bounds[1]) - np.minimum(low, last.bounds[0]), axis=1)
    return np.asarray(common - np.prod(high - low, axis=1) - np.prod(np.ptp(last.bounds, axis=0)))
