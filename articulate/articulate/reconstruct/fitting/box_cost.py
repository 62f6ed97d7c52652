"""Cost of a box and a camera against a mask and edges, compiled by numba."""

from __future__ import annotations

import numba
import numpy as np

from articulate.transforms import Array, Ints

N_PARAMETERS = 9
"""Logarithms of width and depth over height, azimuth, elevation and roll of the camera [rad],
logarithms of distance and focal length, position of the box's centre in the image; the last three
in units of the longer side of the image, the distance in heights of the box."""
MIN_DEPTH = 0.05
"""Least distance of a corner from the camera, in heights of the box."""
STEP_PX = 2.0
"""Distance of the points at which an edge is compared [px]."""
MAX_SPREADS = 6.0
"""Distance of a corner to the predicted one at which it costs no more, in spreads."""
OUT = 10.0
"""Cost of boxes that are not in the image."""
SIGNS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=np.float64)
"""Corners of the box (8, 3) in half sides along depth, width and height."""
EDGES = np.array(
    [
        (a, b)
        for a in range(8)
        for b in range(a + 1, 8)
        if np.count_nonzero(SIGNS[a] - SIGNS[b]) == 1
    ],
    dtype=np.int64,
)
"""Pairs of corners (12, 2)."""


@numba.njit(cache=True, nogil=True)
def rotation(azimuth: float, elevation: float, roll: float) -> Array:
    """Return the rotation (3, 3) from box axes to camera axes (x right, y down, z forward)."""
    ca, sa, ce, se = np.cos(azimuth), np.sin(azimuth), np.cos(elevation), np.sin(elevation)
    right = np.array([-sa, ca, 0.0])
    ahead = np.array([-ce * ca, -ce * sa, -se])
    down = np.array(
        [
            ahead[1] * right[2] - ahead[2] * right[1],
            ahead[2] * right[0] - ahead[0] * right[2],
            ahead[0] * right[1] - ahead[1] * right[0],
        ]
    )
    cr, sr = np.cos(roll), np.sin(roll)
    out = np.empty((3, 3))
    for k in range(3):
        out[0, k] = cr * right[k] + sr * down[k]
        out[1, k] = cr * down[k] - sr * right[k]
        out[2, k] = ahead[k]
    return out


@numba.njit(cache=True, nogil=True)
def project(p: Array, side_px: float, uv: Array) -> bool:
    """Write the corners in the image (8, 2) [px] to ``uv``; False if one is behind the camera."""
    rot = rotation(p[2], p[3], p[4])
    half = np.array([0.5 * np.exp(p[1]), 0.5 * np.exp(p[0]), 0.5])
    distance, focal = np.exp(p[5]), np.exp(p[6])
    for k in range(8):
        x, y, z = SIGNS[k, 0] * half[0], SIGNS[k, 1] * half[1], SIGNS[k, 2] * half[2]
        depth = rot[2, 0] * x + rot[2, 1] * y + rot[2, 2] * z + distance
        if depth <= MIN_DEPTH:
            return False
        for j in range(2):
            across = rot[j, 0] * x + rot[j, 1] * y + rot[j, 2] * z
            uv[k, j] = (focal * across / depth + p[7 + j]) * side_px
    return True


@numba.njit(cache=True, nogil=True)
def overlap(uv: Array, sums: Ints) -> float:
    """Return the intersection over union of the convex hull of corners and a mask.

    Args:
        uv: Corners in the image (8, 2) [px].
        sums: Cumulative sums of the mask along its rows (H, W + 1).
    """
    height, width = sums.shape[0], sums.shape[1] - 1
    total = 0
    for row in range(height):
        total += sums[row, width]
    both, area = 0.0, 0.0
    top = uv[:, 1].min()
    bottom = uv[:, 1].max()
    for row in range(int(np.ceil(top)), int(np.floor(bottom)) + 1):
        left, right = 1e9, -1e9
        for a in range(8):
            for b in range(a + 1, 8):  # the span of a hull is that of all lines between corners
                y0, y1 = uv[a, 1], uv[b, 1]
                if (y0 - row) * (y1 - row) > 0.0 or y0 == y1:
                    continue
                x = uv[a, 0] + (row - y0) / (y1 - y0) * (uv[b, 0] - uv[a, 0])
                left, right = min(left, x), max(right, x)
        if right < left:
            continue
        area += right - left
        if 0 <= row < height:
            first = min(max(int(np.ceil(left)), 0), width)
            last = min(max(int(np.floor(right)) + 1, first), width)
            both += sums[row, last] - sums[row, first]
    return both / max(total + area - both, 1.0)


@numba.njit(cache=True, nogil=True)
def edge_cost(p: Array, uv: Array, distance_px: Array, inner_weight: float) -> float:
    """Return the mean distance of visible edges to those of the image.

    Args:
        p: Parameters (9,).
        uv: Corners in the image (8, 2) [px].
        distance_px: Distance of each pixel to the next edge (H, W).
        inner_weight: Weight of edges inside the silhouette.
    """
    rot = rotation(p[2], p[3], p[4])
    half = np.array([0.5 * np.exp(p[1]), 0.5 * np.exp(p[0]), 0.5])
    height, width = distance_px.shape
    total, weight = 0.0, 0.0
    for e in range(len(EDGES)):
        a, b = EDGES[e]
        faces = 0
        for axis in range(3):
            if SIGNS[a, axis] == SIGNS[b, axis]:
                eye = -np.exp(p[5]) * rot[2, axis]
                faces += SIGNS[a, axis] * eye > half[axis]
        if faces == 0:
            continue
        w = inner_weight if faces == 2 else 1.0
        dx, dy = uv[b, 0] - uv[a, 0], uv[b, 1] - uv[a, 1]
        count = max(2, int(np.sqrt(dx * dx + dy * dy) / STEP_PX))
        for k in range(count):
            share = 0.08 + 0.84 * k / (count - 1)
            u, v = int(np.rint(uv[a, 0] + share * dx)), int(np.rint(uv[a, 1] + share * dy))
            if 0 <= u < width and 0 <= v < height:
                total += w * distance_px[v, u]
                weight += w
    return total / max(weight, 1.0)


@numba.njit(cache=True, nogil=True)
def corner_cost(uv: Array, corners: Array) -> float:
    """Return the mean distance of corners (8, 2) to predicted ones, in their spreads.

    Args:
        uv: Corners in the image [px].
        corners: Predicted corners and their spread (8, 3) [px].
    """
    total = 0.0
    for k in range(8):
        du, dv = uv[k, 0] - corners[k, 0], uv[k, 1] - corners[k, 1]
        total += min(np.sqrt(du * du + dv * dv) / corners[k, 2], MAX_SPREADS)
    return total / 8.0


@numba.njit(cache=True, nogil=True)
def box_cost(
    p: Array,
    sums: Ints,
    distance_px: Array,
    corners: Array,
    prior: Array,
    weights: Array,
    uv: Array,
) -> float:
    """Return the cost of parameters (9,).

    Args:
        p: Parameters.
        sums: Cumulative sums of the mask along its rows (H, W + 1).
        distance_px: Distance to edges (H, W), as a share of the largest that counts.
        corners: Predicted corners and their spread (8, 3) [px].
        prior: Expected value and spread of each parameter (9, 2); an infinite spread ignores it.
        weights: Weight of the edges, of inner edges, of the prior, and of the corners (4,).
        uv: Buffer of the corners (8, 2).
    """
    side = float(max(sums.shape[0], sums.shape[1] - 1))
    if not project(p, side, uv) or np.abs(uv).max() > 4.0 * side:
        return OUT
    cost = 1.0 - overlap(uv, sums) + weights[0] * edge_cost(p, uv, distance_px, weights[1])
    cost += weights[3] * corner_cost(uv, corners)
    for k in range(len(p)):
        cost += weights[2] * ((p[k] - prior[k, 0]) / prior[k, 1]) ** 2
    return float(cost)
