"""Triangles without order: samples on them, what is near them, how often they wind round points.

Meshes of data sets are open, made of many shells and turned inside out in places. The
generalised winding number (A. Jacobson et al., "Robust inside-outside segmentation using
generalized winding numbers", 2013) needs none of them to be closed. Far groups of triangles are
taken together as one dipole (G. Barill et al., "Fast winding numbers for soups and clouds",
2018).
"""

from __future__ import annotations

import numpy as np

from articulate.transforms import Array, Ints, Mask

PAIRS = 2_000_000
"""Largest number of pairs of a point and a triangle that are looked at together."""
FEW = 8
"""So few points are compared with every box near them ..."""
FEW_PAIRS = 4096
"""... and more of them if there are no more pairs than this."""
FAR = 2.0
"""A group of triangles this many of its radii away counts as one dipole."""
LEAST_GROUP = 24
"""Fewest triangles of a group."""
TURNED = np.array([[2.0, 1.0, 2.0], [-2.0, 2.0, 1.0], [-1.0, -2.0, 2.0]]) / 3.0
"""A rotation that brings no axis near another one."""


def sample(triangles: Array, count: int) -> tuple[Array, Ints]:
    """Sample points (N, 3) on ``triangles`` (F, 3, 3) [m] by area, with the triangle of each (N,).

    The points are the same on each call.
    """
    rng = np.random.default_rng(0)
    edges = triangles[:, 1:] - triangles[:, :1]
    area = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1) / 2.0
    total = float(area.sum())
    if total <= 0.0:
        return np.zeros((0, 3)), np.zeros(0, dtype=np.int64)
    share = (np.arange(count) + rng.random(count)) / count
    index = np.minimum(np.searchsorted(np.cumsum(area) / total, share), len(area) - 1)
    a, b = rng.random((2, count, 1))
    turned = a + b > 1.0
    a, b = np.where(turned, 1.0 - a, a), np.where(turned, 1.0 - b, b)
    return triangles[index, 0] + a * edges[index, 0] + b * edges[index, 1], index.astype(np.int64)


def is_near(points: Array, triangles: Array, distance_m: float) -> Mask:
    """Return a mask (N,) of ``points`` (N, 3) within ``distance_m`` of ``triangles`` [m]."""
    found = np.zeros(len(points), dtype=bool)
    if not len(triangles) or not len(points):
        return found
    low, high = triangles.min(axis=1) - distance_m, triangles.max(axis=1) + distance_m
    point, triangle = _boxes_with(points, low, high)
    for start in range(0, len(point), PAIRS):
        some, tested = point[start : start + PAIRS], triangle[start : start + PAIRS]
        found[some[distances(points[some], triangles[tested]) <= distance_m]] = True
    return found


def _boxes_with(points: Array, low: Array, high: Array) -> tuple[Ints, Ints]:
    """Pairs of a point (N, k) and a box, from ``low`` to ``high`` (B, k), that holds it.

    The points are halved along their longest side until few pairs are left to be looked at.
    """
    found: list[tuple[Ints, Ints]] = [(np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64))]
    waiting = [(np.arange(len(points)), np.arange(len(low)))]
    while waiting:
        some, boxes = waiting.pop()
        if not len(some) or not len(boxes):
            continue
        own = points[some]
        least, most = own.min(axis=0), own.max(axis=0)
        boxes = boxes[((low[boxes] <= most) & (high[boxes] >= least)).all(axis=1)]
        if len(some) <= FEW or len(some) * len(boxes) <= FEW_PAIRS:
            holds = (own[:, None] >= low[boxes]) & (own[:, None] <= high[boxes])
            point, box = np.nonzero(holds.all(axis=-1))
            found.append((some[point], boxes[box]))
        else:
            order = np.argsort(own[:, int(np.argmax(most - least))], kind="stable")
            half = len(order) // 2
            waiting += [(some[order[:half]], boxes), (some[order[half:]], boxes)]
    return np.concatenate([p for p, _ in found]), np.concatenate([b for _, b in found])


def distances(points: Array, triangles: Array) -> Array:
    """Return the distances (N,) of ``points`` (N, 3) from their triangles (N, 3, 3) [m]."""
    normal = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    length = np.linalg.norm(normal, axis=1)
    flat = length <= 1e-18
    normal = normal / np.where(flat, 1.0, length)[:, None]
    above = np.ones(len(points), dtype=bool) & ~flat
    edge = np.full(len(points), np.inf)
    for k in range(3):
        start, end = triangles[:, k], triangles[:, (k + 1) % 3]
        side, off = end - start, points - start
        above &= np.einsum("ni,ni->n", np.cross(side, off), normal) >= 0.0
        square = np.einsum("ni,ni->n", side, side)
        share = np.einsum("ni,ni->n", off, side) / np.where(square > 0.0, square, 1.0)
        nearest = start + np.clip(share, 0.0, 1.0)[:, None] * side
        edge = np.minimum(edge, np.linalg.norm(points - nearest, axis=1))
    height = np.abs(np.einsum("ni,ni->n", points - triangles[:, 0], normal))
    return np.where(above, height, edge)


def winding_numbers(points: Array, triangles: Array) -> Array:
    """Return the winding numbers (N,) of ``triangles`` (F, 3, 3) [m] around ``points`` (N, 3) [m].

    1 inside a closed surface that is oriented outwards, 0 outside, between the two near holes.
    """
    total = np.zeros(len(points))
    if not len(triangles):
        return total
    size = max(LEAST_GROUP, int(np.sqrt(len(triangles))))
    ordered = triangles[_curve_order(triangles.mean(axis=1))]
    for start in range(0, len(ordered), size):
        group = ordered[start : start + size]
        centre = group.reshape(-1, 3).mean(axis=0)
        radius = float(np.linalg.norm(group.reshape(-1, 3) - centre, axis=1).max())
        off = centre - points
        away = np.linalg.norm(off, axis=1)
        far = away > FAR * radius
        edges = group[:, 1:] - group[:, :1]
        dipole = np.cross(edges[:, 0], edges[:, 1]).sum(axis=0) / 2.0
        total[far] += off[far] @ dipole / (4.0 * np.pi * away[far] ** 3)
        total[~far] += _solid_angles(points[~far], group) / (4.0 * np.pi)
    return total


def _curve_order(centres: Array) -> Ints:
    """Order along a curve that keeps neighbours together: interleaved bits of coordinates."""
    span = np.ptp(centres, axis=0)
    cells = ((centres - centres.min(axis=0)) / np.where(span > 0.0, span, 1.0) * 1023).astype(int)
    code = np.zeros(len(centres), dtype=np.int64)
    for bit in range(10):
        for axis in range(3):
            code |= ((cells[:, axis] >> bit) & 1) << (3 * bit + axis)
    return np.argsort(code, kind="stable")


def _solid_angles(points: Array, triangles: Array) -> Array:
    """Return the sum (N,) of the signed solid angles of ``triangles`` seen from ``points`` [sr].

    A. van Oosterom and J. Strackee, "The solid angle of a plane triangle", 1983.
    """
    if not len(points):
        return np.zeros(0)
    a, b, c = (triangles[None, :, k] - points[:, None] for k in range(3))
    la, lb, lc = (np.sqrt(np.einsum("nfi,nfi->nf", v, v)) for v in (a, b, c))
    volume = np.einsum("nfi,nfi->nf", a, np.cross(b, c))
    below = (
        la * lb * lc
        + np.einsum("nfi,nfi->nf", a, b) * lc
        + np.einsum("nfi,nfi->nf", b, c) * la
        + np.einsum("nfi,nfi->nf", c, a) * lb
    )
    angles: Array = 2.0 * np.arctan2(volume, below)
    return np.asarray(angles.sum(axis=1))


def escapes(points: Array, triangles: Array) -> Mask:
    """Return a mask (N,) of ``points`` (N, 3) [m] from which one of twelve rays hits no triangle.

    The rays go both ways along the axes of two frames, one upright and one turned.
    """
    found = np.zeros(len(points), dtype=bool)
    for frame in (np.eye(3), TURNED):
        turned = triangles @ frame.T
        for axis in range(3):
            left = np.flatnonzero(~found)
            if not len(left):
                return found
            found[left] = _sees_out(points[left] @ frame.T, turned, axis)
    return found


def _sees_out(points: Array, triangles: Array, axis: int) -> Mask:
    """Return a mask of points whose ray up or down ``axis`` hits no triangle."""
    flat = [k for k in range(3) if k != axis]
    low, high = triangles[:, :, flat].min(axis=1), triangles[:, :, flat].max(axis=1)
    above, below = np.zeros((2, len(points)), dtype=bool)
    pairs = _boxes_with(points[:, flat], low, high)
    for start in range(0, len(pairs[0]), PAIRS):
        point, triangle = (index[start : start + PAIRS] for index in pairs)
        height = _crossing(points[point][:, flat], triangles[triangle], axis, flat)
        above[point[height > points[point, axis]]] = True
        below[point[height < points[point, axis]]] = True
    return np.asarray(~(above & below))


def _crossing(points: Array, triangles: Array, axis: int, flat: list[int]) -> Array:
    """Return the crossings (N,) of lines along ``axis`` with triangles [m], NaN without one."""
    a, b, c = (triangles[:, k][:, flat] for k in range(3))
    ab, ac, ap = b - a, c - a, points - a
    area = ab[:, 0] * ac[:, 1] - ab[:, 1] * ac[:, 0]
    upright = area == 0.0  # seen edge-on: never hit
    area = np.where(upright, 1.0, area)
    u = (ap[:, 0] * ac[:, 1] - ap[:, 1] * ac[:, 0]) / area
    v = (ab[:, 0] * ap[:, 1] - ab[:, 1] * ap[:, 0]) / area
    hit = ~upright & (u >= 0.0) & (v >= 0.0) & (u + v <= 1.0)
    u, v = np.where(hit, u, 0.0), np.where(hit, v, 0.0)
    z = triangles[:, :, axis]
    height = z[:, 0] + u * (z[:, 1] - z[:, 0]) + v * (z[:, 2] - z[:, 0])
    return np.where(hit, height, np.nan)
