"""Fewer collision shapes: neighbours are joined, what is hidden or spare is left out."""

from __future__ import annotations

import numpy as np
import trimesh

from articulate.formats.repairs import Repairs
from articulate.geometry.convex_fit import box_shares, fills, fitted, hull, is_near
from articulate.geometry.rays import Surface
from articulate.geometry.shapes import Shape, sample_surface
from articulate.transforms import Array, Ints

SPARE_LEAST = 0.97
"""Share of what is seen that stays covered when shapes over the budget are left out."""
SPARE_NEAR = 0.8
"""Share of the distance that the proof calls near within which it counts as covered."""
SPARE_SAMPLES = 2000
"""So many points decide about it ..."""
SPARE_EACH = 100
"""... and so many for each shape where it has to be sure: with few, those that by chance hold least
of them would be left out, and more is lost then than the points say ..."""
SPARE_MOST = 100_000
"""... up to so many."""
MAX_JOINED = 192
"""More shapes than this are not joined."""
MAX_REFUSED = 300
"""After this many pairs that cannot be joined the rest is left as it is."""
OVER_BUDGET = 3.0
"""Shapes that may not stray are so many times as many as wanted, at most."""
HOPEFUL_SHARE = 0.25
"""Two shapes are joined only if this share of their common upright box lies near the surface."""


def surface_tolerance(mesh: trimesh.Trimesh) -> float:
    """How far shapes may lie from what is seen, as the proof judges it [m]."""
    return max(0.003, 0.01 * float(mesh.scale))


def merged(shapes: list[Shape], surface: Surface, tol: float) -> list[Shape]:
    """Fewer shapes: neighbours are joined as long as the result stays near ``surface``."""
    if not 2 <= len(shapes) <= MAX_JOINED:
        return list(shapes)
    pairs = _Pairs(shapes, surface, tol)
    while pairs.refused < MAX_REFUSED and pairs.join_one():
        pass
    return pairs.shapes


class _Pairs:
    """Shapes of which neighbours are to be joined, with what is known of each pair of them."""

    def __init__(self, shapes: list[Shape], surface: Surface, tol: float) -> None:
        self.surface = surface
        self.tol = tol
        self.refused = 0
        """Pairs that cannot be joined."""
        self.shapes: list[Shape] = []
        self._low, self._high = np.zeros((0, 3)), np.zeros((0, 3))
        self._open = np.zeros((0, 0), dtype=bool)  # above the diagonal, not decided yet
        self._hopeful = np.zeros((0, 0), dtype=bool)
        for shape in shapes:
            self._append(shape)
        self._ask(*np.nonzero(self._open))

    def _append(self, shape: Shape) -> None:
        count = len(self.shapes)
        self.shapes.append(shape)
        self._low = np.vstack([self._low, shape.bounds[0]])
        self._high = np.vstack([self._high, shape.bounds[1]])
        self._open = np.pad(self._open, (0, 1))
        self._hopeful = np.pad(self._hopeful, (0, 1))
        gap = np.maximum(self._low - self._high[-1], self._low[-1] - self._high)
        self._open[:count, count] = (gap[:count] <= 2.0 * self.tol).all(axis=1)

    def _ask(self, i: Ints, j: Ints) -> None:
        """Find out of which pairs the common upright box comes near the surface anywhere."""
        if len(i):
            boxes = np.stack([*self._common(i, j)], axis=1)
            self._hopeful[i, j] = box_shares(boxes, self.surface, self.tol) >= HOPEFUL_SHARE

    def _common(self, i: Ints, j: Ints) -> tuple[Array, Array]:
        low, high = self._low, self._high
        return np.minimum(low[i], low[j]), np.maximum(high[i], high[j])

    def join_one(self) -> bool:
        """Join the first pair that can be, smallest common box first; False if there is none."""
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
            self.refused += 1
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
        self._ask(first, np.full(len(first), last))


def without_hidden(shapes: list[Shape]) -> list[Shape]:
    """The shapes that do not lie inside a single other one."""
    kept: list[Shape] = []
    for shape in sorted(shapes, key=lambda s: -s.volume):
        if not any(float(other.outside(shape.corners).max()) < 1e-3 for other in kept):
            kept.append(shape)
    return kept


def without_spare(
    shapes: list[Shape], surface: trimesh.Trimesh, budget: int, *, sure: bool = False
) -> list[Shape]:
    """At most ``budget`` shapes, as long as those left out stand for next to nothing alone.

    Trims and rims lie close to panels: what they cover of ``surface`` is covered twice.

    Args:
        shapes: Those of one part.
        surface: What it shows.
        budget: So many are wanted.
        sure: Ask as many points as it takes to know what many small shapes stand for.
    """
    budget = max(budget, 1)  # handles may have used it up
    if len(shapes) <= budget:
        return shapes
    asked = min(max(SPARE_SAMPLES, SPARE_EACH * len(shapes) * sure), SPARE_MOST)
    points, _ = sample_surface(surface, asked)
    near = SPARE_NEAR * surface_tolerance(surface)
    covered = [_covered_by(shape, points, near) for shape in shapes]
    count = np.zeros(len(points), dtype=np.int64)
    owners = np.zeros(len(points), dtype=np.int64)  # sum of the numbers of all that cover a point
    for k, own in enumerate(covered):
        count[own] += 1
        owners[own] += k
    alone = np.array([(count[own] == 1).sum() for own in covered])
    seen, left = int((count > 0).sum()), len(shapes)
    gone = np.zeros(len(shapes), dtype=bool)
    while left > budget:
        least = int(np.argmin(np.where(gone, len(points) + 1, alone)))
        if seen - alone[least] < SPARE_LEAST * len(points):
            break
        gone[least] = True
        left, seen = left - 1, seen - int(alone[least])
        own = covered[least]
        count[own] -= 1
        owners[own] -= least
        np.add.at(alone, owners[own[count[own] == 1]], 1)
    return [shape for shape, spare in zip(shapes, gone, strict=True) if not spare]


def _covered_by(shape: Shape, points: Array, near_m: float) -> Ints:
    """Which of ``points`` (N, 3) lie in ``shape`` or at most ``near_m`` away; few do."""
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
    """At most ``budget`` shapes: pairs whose common hull adds least volume are joined.

    Args:
        shapes: Those of one part.
        budget: So many are wanted.
        part: Its name.
        repairs: Takes what was changed.
        strict: Surface that joined shapes may not stray from nor fill, even if more than
            ``budget`` shapes are left then, up to ``OVER_BUDGET`` times as many.
        few: So many are enough where they need not stray for it; None: ``budget``.
    """
    shapes = list(shapes)
    before = len(shapes)
    if strict is not None:
        shapes = _strictly_joined(shapes, few or budget, strict)
        budget = round(OVER_BUDGET * budget)
    shapes = _cheaply_joined(shapes, budget)
    if len(shapes) < before:
        repairs.add(f"part {part}: {before} collision shapes joined to {len(shapes)}")
    return tuple(shapes)


def _strictly_joined(shapes: list[Shape], budget: int, surface: Surface) -> list[Shape]:
    """The shapes with pairs joined whose common hull strays nowhere and fills nothing."""
    tol = surface_tolerance(surface.mesh)
    refused = 0
    while len(shapes) > max(budget, 1) and refused < MAX_REFUSED:
        added = _added(shapes)
        order = np.argsort(added, axis=None)[: MAX_REFUSED - refused]
        for place in order:
            i, j = (int(k) for k in np.unravel_index(place, added.shape))
            if not np.isfinite(added[i, j]):
                return shapes
            joint = hull(np.vstack([shapes[i].corners, shapes[j].corners]), shapes[i].piece)
            if joint is None or fills(joint, surface.hollow) or not is_near(joint, surface, tol):
                refused += 1
                continue
            shapes = [*(s for k, s in enumerate(shapes) if k not in (i, j)), joint]
            break
        else:
            return shapes
    return shapes


def _added(shapes: list[Shape]) -> Array:
    """Volume [m3] that the common upright box of each pair adds (N, N), inf up to the diagonal."""
    low = np.array([s.bounds[0] for s in shapes])
    high = np.array([s.bounds[1] for s in shapes])
    size = np.prod(high - low, axis=1)
    common = np.prod(np.maximum(high[:, None], high) - np.minimum(low[:, None], low), axis=-1)
    added = common - size[:, None] - size[None]
    added[np.tril_indices(len(shapes))] = np.inf
    return np.asarray(added)


def _cheaply_joined(shapes: list[Shape], budget: int) -> list[Shape]:
    """At most ``budget`` shapes: pairs whose common upright box adds least volume are joined."""
    if len(shapes) <= max(budget, 1):
        return shapes
    shapes, added = list(shapes), _added(shapes)
    while len(shapes) > max(budget, 1):
        i, j = (int(k) for k in np.unravel_index(np.argmin(added), added.shape))
        joint = hull(np.vstack([shapes[i].corners, shapes[j].corners]), shapes[i].piece)
        keep = [k for k in range(len(shapes)) if k not in (i, j)]
        shapes = [*(shapes[k] for k in keep), joint if joint is not None else shapes[i]]
        added = np.pad(added[np.ix_(keep, keep)], (0, 1), constant_values=np.inf)
        added[:-1, -1] = _added_by(shapes[:-1], shapes[-1])
    return shapes


def _added_by(shapes: list[Shape], last: Shape) -> Array:
    """Volume [m3] that the common upright box of each of ``shapes`` and ``last`` adds (N,)."""
    low = np.array([s.bounds[0] for s in shapes]).reshape(-1, 3)
    high = np.array([s.bounds[1] for s in shapes]).reshape(-1, 3)
    common = np.prod(np.maximum(high, last.bounds[1]) - np.minimum(low, last.bounds[0]), axis=1)
    return np.asarray(common - np.prod(high - low, axis=1) - np.prod(np.ptp(last.bounds, axis=0)))
