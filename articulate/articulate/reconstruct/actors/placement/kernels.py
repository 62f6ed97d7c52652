"""Machine code of the search: a part at thousands of places a second, compared with a picture.

Parts keep their rotation, so that only a shift in the camera's frame is left: x right, y down, z
ahead. The middle of the first pixel is (0, 0).
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
def colour_of(points_c: Any, face: Any, albedo: Any, light: Any, view: Any, out: Any) -> None:
    """Colour of one face, 0 to 255, into ``out`` (3,)."""
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
    rest: Any,
    frame: Any,
    cap: float,
    out: Any,
    shown: Any,
) -> None:
    """Change of the cost of a picture when a part is drawn at each of some places.

    Args:
        surface: Corners of the part about its middle, turned into the camera's frame (V, 3) [m],
            its faces (F, 3) and their albedo (F, 3), 0 to 255.
        light: (LIGHT_ROWS, 3), in the camera's frame.
        shifts_c: Where the middle is (Q, 3) [m].
        pinhole: fx, fy, cx, cy [px].
        rest: 1 / depth of everything else (H, W), and the cost of each pixel of it (H, W).
        frame: The picture (H, W, 3), 0 to 255.
        cap: Largest cost of a pixel.
        out: Changed: what is added to the cost (Q,).
        shown: Changed: pixels in which the part is seen (Q,).
    """
    points, faces, albedo = surface
    near_rest, base = rest
    height, width = near_rest.shape
    nearness = np.zeros((height, width), dtype=np.float32)
    face_ids = np.full((height, width), -1, dtype=np.int32)
    drawn = np.ones(len(faces), dtype=np.bool_)
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
        fill(points_c, faces, drawn, pinhole, nearness, face_ids)
        total = 0.0
        count = 0
        for v in range(box[2], box[3] + 1):
            for u in range(box[0], box[1] + 1):
                f = face_ids[v, u]
                if f >= 0:
                    if nearness[v, u] * DEPTH_TOLERANCE >= near_rest[v, u]:
                        if fresh[f] != q:
                            colour_of(points_c, faces[f], albedo[f], light, view, colours[f])
                            fresh[f] = q
                        cost = 0.0
                        for k in range(3):
                            cost += abs(frame[v, u, k] - colours[f, k])
                        total += min(cost, cap) - base[v, u]
                        count += 1
                    nearness[v, u] = 0.0
                    face_ids[v, u] = -1
        out[q] = total
        shown[q] = count


@njit(cache=True, nogil=True)
def draw_part(
    surface: Any,
    light: Any,
    shift_c: Any,
    pinhole: Any,
    part: int,
    nearness: Any,
    picture: Any,
    part_ids: Any,
) -> None:
    """Draw a part over what is drawn: ``nearness``, ``picture`` and ``part_ids`` are changed."""
    points, faces, albedo = surface
    height, width = nearness.shape
    mine = np.zeros((height, width), dtype=np.float32)
    face_ids = np.full((height, width), -1, dtype=np.int32)
    drawn = np.ones(len(faces), dtype=np.bool_)
    points_c = np.empty_like(points)
    for i in range(len(points)):
        for k in range(3):
            points_c[i, k] = points[i, k] + shift_c[k]
    box = np.empty(4, dtype=np.int64)
    pixel_bounds(points_c, pinhole, height, width, box)
    fill(points_c, faces, drawn, pinhole, mine, face_ids)
    view, colour = np.zeros(4), np.zeros(3)
    for v in range(box[2], box[3] + 1):
        for u in range(box[0], box[1] + 1):
            f = face_ids[v, u]
            if f >= 0 and mine[v, u] * DEPTH_TOLERANCE >= nearness[v, u]:
                colour_of(points_c, faces[f], albedo[f], light, view, colour)
                nearness[v, u] = max(mine[v, u], nearness[v, u])
                part_ids[v, u] = part
                for k in range(3):
                    picture[v, u, k] = colour[k]
