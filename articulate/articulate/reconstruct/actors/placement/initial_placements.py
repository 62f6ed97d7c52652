"""Seats: places where a part may be, before it is looked at closely.

All places are those of the middle of a part's box, in the camera's frame.
"""

from __future__ import annotations

import cv2
import numpy as np

from articulate.reconstruct.actors.placement.placement_problem import (
    CAP,
    Level,
    PlacementProblem,
    Places,
    Rest,
)
from articulate.transforms import Array, apply

DEPTHS = 16
"""Depths that are tried of a part of which nothing is known."""
NEAREST, FARTHEST = 0.6, 1.7
"""Between these shares of the distance at which the largest part would fill the outline."""
GROUND_M = 0.06
"""Nothing is farther below the ground than this [m]."""
ON_OBJECT = 0.75
"""At least this share of a part lies within the outline of the object."""
LESS_ON_OBJECT = 0.95
"""Where no place of the first part does, those that have this share of the best."""
SMALL_PX = 14.0
"""Parts smaller than this in the coarsest picture are looked for in the next finer one."""
UNEXPLAINED = 0.3
"""Small parts are looked for in this share of the picture, where it is explained worst."""
THIN = 0.35
"""Parts that fill less than this share of their own outline's hull are thin."""
ODD = 0.4
"""Pixels that cost more than this share of the largest cost are unexplained."""
ASTRAY_PX, THIN_STEP_PX, THIN_SEATS = 8.0, 2.0, 400
"""Points of a thin part that are farther from what is unexplained are not told apart; places are
so far apart; so many are kept [px]."""
LATTICE = 7
"""Places a side at which parts that are not seen are tried."""


def grid(puzzle: PlacementProblem, k: int, part: int, places: Places, rest: Rest) -> Array:
    """Places all over the object (N, 3), for the picture of level ``k``."""
    level = puzzle.levels[k]
    size = puzzle.sizes[part]
    radius = 0.5 * float(np.linalg.norm(size))
    low, high = _depth_range(puzzle, level, radius, places)
    focal = float(level.shot.pinhole[0])
    px = focal * float(np.median(size)) / np.sqrt(low * high)
    step = float(np.clip(px / 4.0, 1.0, 3.0)) if k == 0 else 2.0
    height, width = level.shot.size
    u, v = np.meshgrid(np.arange(0.0, width, step), np.arange(0.0, height, step))
    u, v = u.ravel(), v.ravel()
    depths = np.broadcast_to(np.geomspace(low, high, DEPTHS), (len(u), DEPTHS))
    if k > 0:
        keep = _badly_explained(rest, u, v, px)
        u, v = u[keep], v[keep]
        depths = _near_surface(rest, u, v, radius, np.geomspace(low, high, DEPTHS // 3))
    found = _at(level, np.repeat(u, depths.shape[1]), np.repeat(v, depths.shape[1]), depths.ravel())
    found = above_ground(puzzle, part, found)
    share = puzzle.share_on_object(k, part, found)
    least = ON_OBJECT if places else min(ON_OBJECT, LESS_ON_OBJECT * float(share.max()))
    return found[share > least]


def thin_seats(puzzle: PlacementProblem, k: int, part: int, places: Places, rest: Rest) -> Array:
    """Places (N, 3) where a thin part lies along what is unexplained, best first; none of others.

    A wire of two pixels that is two pixels off explains nothing, so that its cost does not lead
    there. How far its points are from the next unexplained pixel does (chamfer matching,
    H. G. Barrow and others, 1977).
    """
    level = puzzle.levels[k]
    odd = (rest.base > ODD * CAP).astype(np.uint8)
    if not places or not odd.any() or puzzle.filled[part] >= THIN:
        return np.zeros((0, 3))
    far = np.minimum(cv2.distanceTransform(1 - odd, cv2.DIST_L2, 5), ASTRAY_PX)
    far = np.pad(far, 1, constant_values=ASTRAY_PX)
    low, high = _depth_range(puzzle, level, puzzle.radius(part), places)
    height, width = level.shot.size
    u, v = np.meshgrid(np.arange(0.0, width, THIN_STEP_PX), np.arange(0.0, height, THIN_STEP_PX))
    found, off = [], []
    for depth in np.geomspace(low, high, DEPTHS):
        seats = above_ground(puzzle, part, _at(level, u.ravel(), v.ravel(), np.full(u.size, depth)))
        rows, columns = level.pixels(seats[:, None] + puzzle.probes[part])
        found.append(seats)
        off.append(far[rows + 1, columns + 1].mean(axis=1))
    seats, mean = np.concatenate(found), np.concatenate(off)
    best = np.argsort(mean, kind="stable")[:THIN_SEATS]
    return seats[best]


def is_small(puzzle: PlacementProblem, part: int, places: Places) -> bool:
    """Whether a part is too small, or too thin, to be found in the coarsest picture."""
    if not places:
        return False
    if puzzle.filled[part] < THIN:
        return True
    size = np.sort(puzzle.sizes[part])
    depth = float(np.median([p[2] for p in places.values()]))
    level = puzzle.levels[0]
    return bool(float(level.shot.pinhole[0]) * float(size[1]) / depth < SMALL_PX)


def above_ground(puzzle: PlacementProblem, part: int, shifts: Array) -> Array:
    """Those of some places (N, 3) at which a part is not below the ground."""
    heights = apply(puzzle.camera.T_wc, shifts)[:, 2] - 0.5 * puzzle.sizes[part, 2]
    kept = shifts[heights > -GROUND_M]
    return kept if len(kept) else shifts


def sibling_seats(puzzle: PlacementProblem, part: int, places: Places) -> Array:
    """Places opposite to, or in line with, parts that are alike (N, 3)."""
    alike = [i for i in places if i != part and puzzle.alike(part, i)]
    if not alike:
        return np.zeros((0, 3))
    body = max((i for i in places if i not in alike), key=puzzle.volume, default=None)
    known = np.stack([apply(puzzle.camera.T_wc, places[i]) for i in alike])
    seats = []
    if body is not None:
        middle = apply(puzzle.camera.T_wc, places[body])
        for flip in ((-1, 1, 1), (1, -1, 1), (-1, -1, 1), (1, 1, -1)):
            seats.append(middle + (known - middle) * np.array(flip))
    for a in known:
        seats += [(2.0 * a - b)[None] for b in known if b is not a]
        seats += [(0.5 * (a + b))[None] for b in known if b is not a]
    for a in known:
        for b in known:
            for c in known:
                if not (a is b or b is c or a is c) and len(known) <= 4:
                    seats.append((a + b - c)[None])
    found = np.concatenate(seats)
    far = np.linalg.norm(found[:, None] - known[None], axis=-1).min(axis=1)
    own = 0.3 * float(np.max(puzzle.sizes[part]))
    return np.asarray(apply(puzzle.camera.T_cw, found[far > own]))


def hidden_seats(puzzle: PlacementProblem, part: int, places: Places) -> Array:
    """Places all over the box of the largest part (N, 3), its middle first."""
    body = max((i for i in places if i != part), key=puzzle.volume)
    low, high = puzzle.parts[body].bounds + apply(puzzle.camera.T_wc, places[body])
    own = puzzle.sizes[part]
    room = np.maximum(high - low - own, 0.0)
    shares = np.linspace(-0.5, 0.5, LATTICE)
    shares = shares[np.argsort(np.abs(shares), kind="stable")]
    lattice = np.stack(np.meshgrid(shares, shares, shares, indexing="ij"), axis=-1).reshape(-1, 3)
    lattice = lattice[np.argsort(np.abs(lattice).sum(axis=1), kind="stable")]
    return np.asarray(apply(puzzle.camera.T_cw, 0.5 * (low + high) + lattice * room))


def _depth_range(
    puzzle: PlacementProblem, level: Level, radius: float, places: Places
) -> tuple[float, float]:
    if places:
        middle = np.array([p[2] for p in places.values()])
        reach = np.array([puzzle.radius(i) for i in places])
        high = float((middle + reach).max()) + radius
        return max(float((middle - reach).min()) - radius, 0.2 * high), high
    fills = float(level.shot.pinhole[0]) * 2.0 * radius / (0.94 * max(level.shot.size))
    return NEAREST * fills, FARTHEST * fills


def _badly_explained(rest: Rest, u: Array, v: Array, px: float) -> Array:
    """Which of some pixels lie where about as many pixels as a part has are explained worst."""
    window = max(3, round(px))
    blurred = cv2.blur(rest.base / CAP, (window, window))[v.astype(int), u.astype(int)]
    return np.asarray(blurred >= max(np.quantile(blurred, 1.0 - UNEXPLAINED), 0.01))


def _near_surface(rest: Rest, u: Array, v: Array, radius: float, others: Array) -> Array:
    """Depths (N, D) to try at some pixels: about that of what is there, and ``others``."""
    near = rest.nearness[v.astype(int), u.astype(int)]
    depth = np.where(near > 0.0, 1.0 / np.maximum(near, 1e-6), np.median(others))
    about = depth[:, None] + radius * np.array([-1.0, -0.6, -0.3, 0.0, 0.3, 0.6])
    rest_of = np.broadcast_to(others, (len(u), len(others)))
    return np.asarray(np.concatenate([np.maximum(about, 0.2), rest_of], axis=1))


def _at(level: Level, u: Array, v: Array, depth: Array) -> Array:
    fx, fy, cx, cy = level.shot.pinhole
    return np.stack([(u - cx) / fx * depth, (v - cy) / fy * depth, depth], axis=-1)
