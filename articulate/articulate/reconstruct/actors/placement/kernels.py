"""Compiled kernels of the search: compare placements of a part with an image.

Thousands of placements per second on one core.

Parts keep their rotation, so that only a translation in the camera frame remains: x right, y down,
z forward. The centre of the first pixel is (0, 0).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from articulate.reconstruct.actors.geometric.kernels import DEPTH_TOLERANCE, face_view, pixel_bounds
from articulate.render.raster import fill

Floats = NDArray[np.float32]


@njit(cache=True, nogil=True)
def face_colour(points_c: Any, face: Any, albedo: Any, light: Any, view: Any, out: Any) -> None:
    """Write the colour of one face, 0 to 255, to ``out`` (3,)."""
    face_view(points_c, face, view)
    lamp = max(view[0] * light[3, 0] + view[1] * light[3, 1] + view[2] * light[3, 2], 0.0)
    for k in range(3):
        share = light[0, k] + light[1, k] * view[3] + light[2, k] * lamp
        out[k] = min(max(share * albedo[k], 0.0), 255.0)


@njit(cache=True, nogil=True)
def shift_costs(
    surface: Any,
    light: Any,
    shifts_c: Any,
    pinhole: Any,
    rendered: Any,
    frame: Any,
    cap: float,
    out: Any,
    visible_px: Any,
) -> None:
    """Compute the change of the cost of an image when a part is rendered at each placement.

    Args:
        surface: Vertices of the part about its centre, rotated to the camera frame (V, 3) [m], its
            faces (F, 3) and their albedo (F, 3), 0 to 255.
        light: Light (LIGHT_ROWS, 3), in the camera frame.
        shifts_c: Placements of the centre (Q, 3) [m].
        pinhole: fx, fy, cx, cy [px].
        rendered: Inverse depth of all other parts (H, W) [1/m], and their cost of each pixel (H,
            W).
        frame: The image (H, W, 3), 0 to 255.
        cap: Largest cost of a pixel.
        out: Result: change of the cost (Q,).
        visible_px: Result: visible pixels of the part (Q,) [px].
    """
    points, faces, albedo = surface
    near_rest, base = rendered
    height, width = near_rest.shape
    nearness = np.zeros((height, width), dtype=np.float32)
    face_ids = np.full((height, width), -1, dtype=np.int32)
    enabled = np.ones(len(faces), dtype=np.bool_)
    points_c = np.empty_like(points)
    colours = np.empty((len(faces), 3))
    fresh = np.full(len(faces), -1, dtype=np.int64)
    view = np.zeros(4)
    box = np.empty(4, dtype=np.int64)
    for q in range(len(shifts_c)):
        for i in range(len(points)):
            for k in range(3):
                points_c[i, k] = points[i, k] + shifts_c[q, k]
        pixel_bounds(points_c, pinhole, height, width, box)
        fill(points_c, faces, enabled, pinhole, nearness, face_ids)
        total = 0.0
        count = 0
        for v in range(box[2], box[3] + 1):
            for u in range(box[0], box[1] + 1):
                f = face_ids[v, u]
                if f >= 0:
                    if nearness[v, u] * DEPTH_TOLERANCE >= near_rest[v, u]:
                        if fresh[f] != q:
                            face_colour(points_c, faces[f], albedo[f], light, view, colours[f])
                            fresh[f] = q
                        cost = 0.0
                        for k in range(3):
                            cost += abs(frame[v, u, k] - colours[f, k])
                        total += min(cost, cap) - base[v, u]
                        count += 1
                    nearness[v, u] = 0.0
                    face_ids[v, u] = -1
        out[q] = total
        visible_px[q] = count


@njit(cache=True, nogil=True)
def render_part(
    surface: Any,
    light: Any,
    shift_c: Any,
    pinhole: Any,
    part: int,
    nearness: Any,
    image: Any,
    part_ids: Any,
) -> None:
    """Render a part; ``nearness``, ``image`` and ``part_ids`` (H, W) are updated."""
    points, faces, albedo = surface
    height, width = nearness.shape
    mine = np.zeros((height, width), dtype=np.float32)
    face_ids = np.full((height, width), -1, dtype=np.int32)
    enabled = np.ones(len(faces), dtype=np.bool_)
    points_c = np.empty_like(points)
    for i in range(len(points)):
        for k in range(3):
            points_c[i, k] = points[i, k] + shift_c[k]
    box = np.empty(4, dtype=np.int64)
    pixel_bounds(points_c, pinhole, height, width, box)
    fill(points_c, faces, enabled, pinhole, mine, face_ids)
    view, colour = np.zeros(4), np.zeros(3)
    for v in range(box[2], box[3] + 1):
        for u in range(box[0], box[1] + 1):
            f = face_ids[v, u]
            if f >= 0 and mine[v, u] * DEPTH_TOLERANCE >= nearness[v, u]:
                face_colour(points_c, faces[f], albedo[f], light, view, colour)
                nearness[v, u] = max(mine[v, u], nearness[v, u])
                part_ids[v, u] = part
                for k in range(3):
                    image[v, u, k] = colour[k]
