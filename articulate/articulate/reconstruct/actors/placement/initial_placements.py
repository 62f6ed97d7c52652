"""Initial placements of a part, before refinement.

Placements are positions of the centre of a part's box in the camera frame [m].
"""

from __future__ import annotations

import cv2
import numpy as np

from articulate.reconstruct.actors.placement.placement_problem import (
    CAP,
    PlacementLevel,
    PlacementProblem,
    Placements,
    RenderedParts,
)
from articulate.transforms import Array, apply

DEPTHS = 16
"""Depths tried for a part without further information."""
NEAREST, FARTHEST = 0.6, 1.7
"""Range of depth, as shares of the distance at which the largest part would fill the outline."""
GROUND_M = 0.06
"""Largest depth below the ground [m]."""
MIN_ON_OBJECT = 0.75
"""Least share of a part within the outline of the object."""
RELATIVE_ON_OBJECT = 0.95
"""If no placement of the first part reaches that, those with this share of the best are used."""
SMALL_PX = 14.0
"""Smaller parts are sought at the second level instead of the coarsest [px]."""
WORST_SHARE = 0.3
"""Share of the image, where it is explained worst, in which small parts are sought."""
THIN = 0.35
"""Parts that fill less than this share of the convex hull of their outline are thin."""
UNEXPLAINED_COST = 0.4
"""Pixels that cost more than this share of the largest cost are unexplained."""
MAX_DISTANCE_PX, THIN_STEP_PX, THIN_CANDIDATES = 8.0, 2.0, 400
"""Thin parts: largest distance from an unexplained pixel that counts [px], step between placements
[px], and placements kept."""
LATTICE = 7
"""Placements per side of the lattice for hidden parts."""


def grid_candidates(
    problem: PlacementProblem, k: int, part: int, placements: Placements, rendered: RenderedParts
) -> Array:
    """Return placements (N, 3) on a grid over the object for level ``k``."""
    level = problem.levels[k]
    size = problem.sizes[part]
    radius = 0.5 * float(np.linalg.norm(size))
    low, high = _depth_range(problem, level, radius, placements)
    focal = float(level.crop.pinhole[0])
    px = focal * float(np.median(size)) / np.sqrt(low * high)
    step = float(np.clip(px / 4.0, 1.0, 3.0)) if k == 0 else 2.0
    height, width = level.crop.size
    u, v = np.meshgrid(np.arange(0.0, width, step), np.arange(0.0, height, step))
    u, v = u.ravel(), v.ravel()
    depths = np.broadcast_to(np.geomspace(low, high, DEPTHS), (len(u), DEPTHS))
    if k > 0:
        keep = _badly_explained(rendered, u, v, px)
        u, v = u[keep], v[keep]
        depths = _near_surface(rendered, u, v, radius, np.geomspace(low, high, DEPTHS // 3))
    found = _backproject(
        level, np.repeat(u, depths.shape[1]), np.repeat(v, depths.shape[1]), depths.ravel()
    )
    found = above_ground(problem, part, found)
    share = problem.share_on_object(k, part, found)
    least = (
        MIN_ON_OBJECT if placements else min(MIN_ON_OBJECT, RELATIVE_ON_OBJECT * float(share.max()))
    )
    return found[share > least]


def thin_part_candidates(
    problem: PlacementProblem, k: int, part: int, placements: Placements, rendered: RenderedParts
) -> Array:
    """Return placements (N, 3) of a thin part along unexplained pixels, best first.

    None for other parts.

    A wire of two pixels that is off by two pixels explains nothing, so that the cost has no
    gradient. The distance of its points to the next unexplained pixel has one (chamfer matching, H.
    G. Barrow et al., 1977).
    """
    level = problem.levels[k]
    unexplained = (rendered.base > UNEXPLAINED_COST * CAP).astype(np.uint8)
    if not placements or not unexplained.any() or problem.filled[part] >= THIN:
        return np.zeros((0, 3))
    far = np.minimum(cv2.distanceTransform(1 - unexplained, cv2.DIST_L2, 5), MAX_DISTANCE_PX)
    far = np.pad(far, 1, constant_values=MAX_DISTANCE_PX)
    low, high = _depth_range(problem, level, problem.radius(part), placements)
    height, width = level.crop.size
    u, v = np.meshgrid(np.arange(0.0, width, THIN_STEP_PX), np.arange(0.0, height, THIN_STEP_PX))
    found, off = [], []
    for depth in np.geomspace(low, high, DEPTHS):
        candidates = above_ground(
            problem, part, _backproject(level, u.ravel(), v.ravel(), np.full(u.size, depth))
        )
        rows, columns = level.pixels(candidates[:, None] + problem.probes[part])
        found.append(candidates)
        off.append(far[rows + 1, columns + 1].mean(axis=1))
    candidates, mean = np.concatenate(found), np.concatenate(off)
    best = np.argsort(mean, kind="stable")[:THIN_CANDIDATES]
    return candidates[best]


def is_small(problem: PlacementProblem, part: int, placements: Placements) -> bool:
    """Return whether a part is too small, or too thin, to be found at the coarsest level."""
    if not placements:
        return False
    if problem.filled[part] < THIN:
        return True
    size = np.sort(problem.sizes[part])
    depth = float(np.median([p[2] for p in placements.values()]))
    level = problem.levels[0]
    return bool(float(level.crop.pinhole[0]) * float(size[1]) / depth < SMALL_PX)


def above_ground(problem: PlacementProblem, part: int, shifts: Array) -> Array:
    """Return the placements ``shifts`` (N, 3) [m] at which a part is not below the ground."""
    heights = apply(problem.camera.T_wc, shifts)[:, 2] - 0.5 * problem.sizes[part, 2]
    kept = shifts[heights > -GROUND_M]
    return kept if len(kept) else shifts


def symmetric_candidates(problem: PlacementProblem, part: int, placements: Placements) -> Array:
    """Return placements (N, 3) opposite to, or in line with, similar parts."""
    is_similar = [i for i in placements if i != part and problem.is_similar(part, i)]
    if not is_similar:
        return np.zeros((0, 3))
    body = max((i for i in placements if i not in is_similar), key=problem.volume, default=None)
    known = np.stack([apply(problem.camera.T_wc, placements[i]) for i in is_similar])
    candidates = []
    if body is not None:
        middle = apply(problem.camera.T_wc, placements[body])
        for flip in ((-1, 1, 1), (1, -1, 1), (-1, -1, 1), (1, 1, -1)):
            candidates.append(middle + (known - middle) * np.array(flip))
    for a in known:
        candidates += [(2.0 * a - b)[None] for b in known if b is not a]
        candidates += [(0.5 * (a + b))[None] for b in known if b is not a]
    for a in known:
        for b in known:
            for c in known:
                if not (a is b or b is c or a is c) and len(known) <= 4:
                    candidates.append((a + b - c)[None])
    found = np.concatenate(candidates)
    far = np.linalg.norm(found[:, None] - known[None], axis=-1).min(axis=1)
    own = 0.3 * float(np.max(problem.sizes[part]))
    return np.asarray(apply(problem.camera.T_cw, found[far > own]))


def hidden_candidates(problem: PlacementProblem, part: int, placements: Placements) -> Array:
    """Return placements (N, 3) on a lattice in the box of the largest part, its centre first."""
    body = max((i for i in placements if i != part), key=problem.volume)
    low, high = problem.parts[body].bounds + apply(problem.camera.T_wc, placements[body])
    own = problem.sizes[part]
    room = np.maximum(high - low - own, 0.0)
    shares = np.linspace(-0.5, 0.5, LATTICE)
    shares = shares[np.argsort(np.abs(shares), kind="stable")]
    lattice = np.stack(np.meshgrid(shares, shares, shares, indexing="ij"), axis=-1).reshape(-1, 3)
    lattice = lattice[np.argsort(np.abs(lattice).sum(axis=1), kind="stable")]
    return np.asarray(apply(problem.camera.T_cw, 0.5 * (low + high) + lattice * room))


def _depth_range(
    problem: PlacementProblem, level: PlacementLevel, radius: float, placements: Placements
) -> tuple[float, float]:
    if placements:
        middle = np.array([p[2] for p in placements.values()])
        reach = np.array([problem.radius(i) for i in placements])
        high = float((middle + reach).max()) + radius
        return max(float((middle - reach).min()) - radius, 0.2 * high), high
    fills = float(level.crop.pinhole[0]) * 2.0 * radius / (0.94 * max(level.crop.size))
    return NEAREST * fills, FARTHEST * fills


def _badly_explained(rendered: RenderedParts, u: Array, v: Array, px: float) -> Array:
    """Return the pixels in regions of the size of a part that are explained worst."""
    window = max(3, round(px))
    blurred = cv2.blur(rendered.base / CAP, (window, window))[v.astype(int), u.astype(int)]
    return np.asarray(blurred >= max(np.quantile(blurred, 1.0 - WORST_SHARE), 0.01))


def _near_surface(
    rendered: RenderedParts, u: Array, v: Array, radius: float, others: Array
) -> Array:
    """Return depths (N, D) to try at pixels: around the rendered surface, and ``others``."""
    near = rendered.nearness[v.astype(int), u.astype(int)]
    depth = np.where(near > 0.0, 1.0 / np.maximum(near, 1e-6), np.median(others))
    about = depth[:, None] + radius * np.array([-1.0, -0.6, -0.3, 0.0, 0.3, 0.6])
    rest_of = np.broadcast_to(others, (len(u), len(others)))
    return np.asarray(np.concatenate([np.maximum(about, 0.2), rest_of], axis=1))


def _backproject(level: PlacementLevel, u: Array, v: Array, depth: Array) -> Array:
    fx, fy, cx, cy = level.crop.pinhole
    return np.stack([(u - cx) / fx * depth, (v - cy) / fy * depth, depth], axis=-1)
