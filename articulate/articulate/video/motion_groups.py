"""Groups of points that move together: parts of the object, the operator's arm, others."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.cluster.hierarchy import fcluster, linkage
from scipy.spatial.distance import squareform

from articulate.transforms import Array

MOTION_SHARE = 0.012
"""A point moves if it travels farther than this share of the larger side of the image."""
NOISE_FACTOR = 5.0
"""And farther than this multiple of the median travel of all points."""
MIN_LIFE = 4
"""Points that are visible in fewer frames are ignored."""
MOST_POINTS = 500
"""Moving points that are grouped; the longest paths are kept."""
PAIRS = 24
"""Pairs of frames in which models are fitted."""
MIN_INLIERS = 6
"""Fewer points do not support a model."""
MODELS = 6
"""Models fitted in a pair of frames."""
TRIPLES = 80
"""Triples of points tried for a model."""
TOLERANCE_PX = 1.2
"""Residual of an inlier [px], plus ``TOLERANCE_SHARE`` of its motion."""
TOLERANCE_SHARE = 0.06
NEIGHBOURS = 12
"""A triple is taken from a point and this number of its neighbours."""
UNKNOWN = 0.75
"""Distance of two points that were never visible together."""
CUT = 0.65
"""Distance at which clusters are separated."""
MIN_GROUP = 8
"""Fewer points are no group."""


@dataclass(frozen=True, kw_only=True, eq=False)
class MotionGroups:
    """Moving points and the group of each."""

    tracks: NDArray[np.int64]
    """Indices of the moving points (M,)."""
    groups: NDArray[np.int64]
    """Group of each (M,), by decreasing size; -1 for none."""

    def members(self, group: int) -> NDArray[np.int64]:
        """Return the indices of the tracks of a group."""
        return np.asarray(self.tracks[self.groups == group])

    @property
    def count(self) -> int:
        """Number of groups."""
        return int(self.groups.max(initial=-1)) + 1


def travel(uv: Array, visible: NDArray[np.bool_]) -> Array:
    """Return the diagonal (N,) of the box around the path of each point [px]."""
    masked = np.where(visible[..., None], uv, np.nan)
    with np.errstate(all="ignore"):
        low = np.fmin.reduce(masked, axis=0)
        high = np.fmax.reduce(masked, axis=0)
    return np.asarray(np.nan_to_num(np.linalg.norm(high - low, axis=1)))


def group_points(uv: Array, visible: NDArray[np.bool_], side: float, seed: int = 0) -> MotionGroups:
    """Group the moving points of a video whose camera motion is removed.

    In each of several pairs of frames, affine motions are fitted one after the other to the moving
    points (RANSAC). Points that fit the same motions over the video form a group.

    Args:
        uv: Pixels (T, N, 2), stabilised.
        visible: Visibility (T, N).
        side: Larger side of the image [px].
        seed: Seed of the random triples.
    """
    life = visible.sum(axis=0)
    far = travel(uv, visible)
    lasting = life >= MIN_LIFE
    noise = float(np.median(far[lasting])) if lasting.any() else 0.0
    limit = max(MOTION_SHARE * side, min(NOISE_FACTOR * noise, 0.04 * side))
    chosen = np.nonzero(lasting & (far > limit))[0]
    if len(chosen) > MOST_POINTS:
        best = np.argsort(-(far[chosen] * np.sqrt(life[chosen])), kind="stable")[:MOST_POINTS]
        chosen = np.sort(chosen[best])
    if len(chosen) < MIN_GROUP:
        return MotionGroups(tracks=chosen, groups=np.full(len(chosen), -1))
    distance = _distances(uv[:, chosen], visible[:, chosen], limit, seed)
    tree = linkage(squareform(distance, checks=False), method="average")
    return MotionGroups(tracks=chosen, groups=_by_size(fcluster(tree, CUT, criterion="distance")))


def _by_size(labels: NDArray[np.int64]) -> NDArray[np.int64]:
    names, counts = np.unique(labels, return_counts=True)
    out = np.full(len(labels), -1)
    kept = [k for k in np.argsort(-counts, kind="stable") if counts[k] >= MIN_GROUP]
    for new, k in enumerate(kept):
        out[labels == names[k]] = new
    return out


def _distances(uv: Array, visible: NDArray[np.bool_], limit: float, seed: int) -> Array:
    """Return the share of frame pairs in which two points fit no common motion (M, M)."""
    n_frames, m = visible.shape
    same, both = np.zeros((m, m)), np.zeros((m, m))
    rng = np.random.default_rng(seed)
    for t, u in _pairs(n_frames):
        now = np.nonzero(visible[t] & visible[u])[0]
        if len(now) < MIN_INLIERS:
            continue
        here, there = uv[t, now], uv[u, now]
        moved = np.linalg.norm(there - here, axis=1) > 0.5 * limit
        labels = _models(rng, here, there, moved)
        # Two points that both rest, or both fit nothing, give no evidence.
        valid = labels >= 0
        equal = (labels[:, None] == labels[None, :]) & valid[:, None] & valid[None, :]
        known = valid[:, None] | valid[None, :]
        same[np.ix_(now, now)] += equal
        both[np.ix_(now, now)] += known
    with np.errstate(invalid="ignore"):
        distance = np.where(both > 0, 1.0 - same / np.maximum(both, 1.0), UNKNOWN)
    np.fill_diagonal(distance, 0.0)
    return np.asarray(distance)


def _pairs(n_frames: int) -> list[tuple[int, int]]:
    """Return pairs of frames at two distances, spread over the video."""
    found = []
    for gap in (max(2, n_frames // 14), max(3, n_frames // 6)):
        starts = np.linspace(0, n_frames - 1 - gap, PAIRS // 2).round().astype(int)
        found += [(int(t), int(t) + gap) for t in np.unique(starts)]
    return found


def _models(
    rng: np.random.Generator, here: Array, there: Array, moved: NDArray[np.bool_]
) -> NDArray[np.int64]:
    """Return the affine motion that each point fits (N,); -1 for none or no motion."""
    labels = np.full(len(here), -1)
    free = moved.copy()
    tolerance = TOLERANCE_PX + TOLERANCE_SHARE * np.linalg.norm(there - here, axis=1)
    for model in range(MODELS):
        now = np.nonzero(free)[0]
        if len(now) < MIN_INLIERS:
            break
        inliers = _best_affine(rng, here[now], there[now], tolerance[now])
        if inliers.sum() < MIN_INLIERS:
            break
        labels[now[inliers]] = model
        free[now[inliers]] = False
    return labels


def _best_affine(
    rng: np.random.Generator, here: Array, there: Array, tolerance: Array
) -> NDArray[np.bool_]:
    """Return the inliers (N,) of the affine motion with most of them."""
    n = len(here)
    near = np.argsort(((here[:, None] - here[None]) ** 2).sum(axis=2), axis=1, kind="stable")[
        :, 1 : NEIGHBOURS + 1
    ]
    first = rng.integers(n, size=TRIPLES)
    order = np.argsort(rng.random((TRIPLES, near.shape[1])), axis=1)[:, :2]
    triples = np.column_stack([first, np.take_along_axis(near[first], order, axis=1)])
    rows = np.concatenate([here, np.ones((n, 1))], axis=1)
    lefts = rows[triples]
    good = np.abs(np.linalg.det(lefts)) > 20.0
    if not good.any():
        return np.zeros(n, dtype=np.bool_)
    affine = np.linalg.solve(lefts[good], there[triples[good]])
    off = np.linalg.norm(np.einsum("np,kpd->knd", rows, affine) - there[None], axis=2)
    inliers = off < tolerance
    best = inliers[int(np.argmax(inliers.sum(axis=1)))]
    for _ in range(2):
        fit, *_ = np.linalg.lstsq(rows[best], there[best], rcond=None)
        again = np.linalg.norm(rows @ fit - there, axis=1) < tolerance
        if again.sum() < best.sum():
            break
        best = again
    return np.asarray(best)
