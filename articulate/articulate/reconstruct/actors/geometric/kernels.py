"""Compiled kernels of the search: compare poses of a part with every frame.

Hundreds of poses per second on one core.

Cameras follow OpenCV: x right, y down, z forward; the centre of the first pixel is (0, 0).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from articulate.reconstruct.actors.geometric.parameters import COMPOSITING, REFINE, SEARCH
from articulate.render.raster import fill

DEPTH_TOLERANCE = COMPOSITING.depth_tolerance
MIN_DERIVATIVE = REFINE.min_derivative
MAX_STEP_CHANGE = SEARCH.max_step_change
MOTION_COST_SHARE = SEARCH.motion_cost_share
"""Numba compiles these as constants."""


Floats = NDArray[np.float32]
LIGHT_ROWS = 4
"""Rows of a light: ambient, from the camera, from a distant lamp (each a share of the albedo per
colour), and the unit vector towards that lamp in the camera frame."""


@njit(cache=True, nogil=True)
def transform_points(points_o: Any, T_co: Any, out: Any) -> None:
    """Transform points (V, 3) [m] by ``T_co`` (4, 4) into ``out`` (V, 3)."""
    for i in range(len(points_o)):
        x, y, z = points_o[i, 0], points_o[i, 1], points_o[i, 2]
        for k in range(3):
            out[i, k] = T_co[k, 0] * x + T_co[k, 1] * y + T_co[k, 2] * z + T_co[k, 3]


@njit(cache=True, nogil=True)
def pixel_bounds(points_c: Any, pinhole: Any, height: int, width: int, box: Any) -> None:
    """Write the first and last column and row of the points (V, 3) [m] to ``box`` (4,) [px]."""
    left, right, top, bottom = 1e9, -1e9, 1e9, -1e9
    for i in range(len(points_c)):
        z = points_c[i, 2]
        if z < 0.05:
            left, right, top, bottom = 0.0, width - 1.0, 0.0, height - 1.0
            break
        u = pinhole[0] * points_c[i, 0] / z + pinhole[2]
        v = pinhole[1] * points_c[i, 1] / z + pinhole[3]
        left, right = min(left, u), max(right, u)
        top, bottom = min(top, v), max(bottom, v)
    box[0] = int(min(max(np.floor(left), 0), width))
    box[1] = int(max(min(np.ceil(right), width - 1), -1))
    box[2] = int(min(max(np.floor(top), 0), height))
    box[3] = int(max(min(np.ceil(bottom), height - 1), -1))


@njit(cache=True, nogil=True)
def face_view(points_c: Any, face: Any, view: Any) -> None:
    """Write the unit normal of a face and its cosine to the camera to ``view`` (4,)."""
    a, b, c = points_c[face[0]], points_c[face[1]], points_c[face[2]]
    ex, ey, ez = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    gx, gy, gz = c[0] - a[0], c[1] - a[1], c[2] - a[2]
    x, y, z = ey * gz - ez * gy, ez * gx - ex * gz, ex * gy - ey * gx
    size = np.sqrt(x * x + y * y + z * z)
    view[:] = 0.0
    if size < 1e-18:
        return
    mx, my, mz = a[0] + b[0] + c[0], a[1] + b[1] + c[1], a[2] + b[2] + c[2]
    facing = (x * mx + y * my + z * mz) / (size * np.sqrt(mx * mx + my * my + mz * mz))
    if facing > 0.0:
        size = -size
    view[0], view[1], view[2], view[3] = x / size, y / size, z / size, abs(facing)


@njit(cache=True, nogil=True)
def face_views(points_c: Any, faces: Any) -> Any:
    """Return the unit normal and the cosine to the camera of each face (F, 4)."""
    out = np.zeros((len(faces), 4))
    for f in range(len(faces)):
        face_view(points_c, faces[f], out[f])
    return out


@njit(cache=True, nogil=True)
def face_colours(points_c: Any, faces: Any, albedo: Any, light: Any) -> Any:
    """Return the colour of each face (F, 3), 0 to 255, under ``light`` (LIGHT_ROWS, 3)."""
    colours = np.zeros((len(faces), 3), dtype=np.float32)
    view = np.zeros(4)
    for f in range(len(faces)):
        face_view(points_c, faces[f], view)
        lamp = view[0] * light[3, 0] + view[1] * light[3, 1] + view[2] * light[3, 2]
        lamp = max(lamp, 0.0)
        for k in range(3):
            value = light[0, k] + light[1, k] * view[3] + light[2, k] * lamp
            colours[f, k] = min(max(value * albedo[f, k], 0.0), 255.0)
    return colours


@njit(cache=True, nogil=True)
def pixel_costs(frames: Any, colour: Any, base: Any, cap: float, out: Any) -> None:
    """Add to ``out`` (T,) the cost of a pixel of ``colour`` (3,) less that of ``base`` (T,).

    ``frames`` (3, T) holds the colours contiguous in time, so that the loop is vectorized.
    """
    r, g, b = colour[0], colour[1], colour[2]
    red, green, blue = frames[0], frames[1], frames[2]
    for t in range(len(out)):
        cost = abs(red[t] - r) + abs(green[t] - g) + abs(blue[t] - b)
        out[t] += min(cost, cap) - base[t]


@njit(cache=True, nogil=True)
def sweep_costs(
    surface: Any,
    light: Any,
    poses_co: Any,
    pinhole: Any,
    static_nearness: Any,
    frames: Any,
    base: Any,
    diagonal: bool,
    cap: Any,
    out: Any,
) -> None:
    """Write the change of the cost of each frame when a part is rendered in each pose.

    Args:
        surface: Vertices of the part (V, 3) [m], its faces (F, 3) and their colours (F, 3).
        light: Light (LIGHT_ROWS, 3), in the camera frame.
        poses_co: Part to camera frame, one for each pose (Q, 4, 4).
        pinhole: fx, fy, cx, cy [px].
        static_nearness: Inverse depth of the static parts (H, W) [1/m].
        frames: Observed colours (H, W, 3, T), 0 to 255.
        base: Cost of each pixel without the part (H, W, T).
        diagonal: Compare pose t with frame t only.
        cap: Largest cost of a pixel.
        out: Result (Q, T), or (T, 1) if ``diagonal``.
    """
    points_o, faces, albedo = surface
    height, width = static_nearness.shape
    nearness = np.zeros((height, width), dtype=np.float32)
    face_ids = np.full((height, width), -1, dtype=np.int32)
    enabled = np.ones(len(faces), dtype=np.bool_)
    points_c = np.empty((len(points_o), 3))
    box = np.empty(4, dtype=np.int64)
    total = np.empty(out.shape[1], dtype=np.float32)
    for q in range(len(poses_co)):
        transform_points(points_o, poses_co[q], points_c)
        pixel_bounds(points_c, pinhole, height, width, box)
        fill(points_c, faces, enabled, pinhole, nearness, face_ids)
        colours = face_colours(points_c, faces, albedo, light)
        sum_q = out[q]
        sum_q[:] = 0.0
        for v in range(box[2], box[3] + 1):
            total[:] = 0.0
            for u in range(box[0], box[1] + 1):
                f = face_ids[v, u]
                if f >= 0 and nearness[v, u] * DEPTH_TOLERANCE >= static_nearness[v, u]:
                    if diagonal:
                        one = slice(q, q + 1)
                        pixel_costs(frames[v, u, :, one], colours[f], base[v, u, one], cap, total)
                    else:
                        pixel_costs(frames[v, u], colours[f], base[v, u], cap, total)
                nearness[v, u] = 0.0
                face_ids[v, u] = -1
            for t in range(len(total)):
                sum_q[t] += total[t]


@njit(cache=True, nogil=True)
def render_over(
    surface: Any,
    light: Any,
    T_co: Any,
    pinhole: Any,
    static_nearness: Any,
    image: Any,
    visible: Any,
) -> None:
    """Render a part over ``image`` (H, W, 3); set its mask ``visible`` (H, W)."""
    points_o, faces, albedo = surface
    height, width = static_nearness.shape
    nearness = np.zeros((height, width), dtype=np.float32)
    face_ids = np.full((height, width), -1, dtype=np.int32)
    enabled = np.ones(len(faces), dtype=np.bool_)
    points_c = np.empty((len(points_o), 3))
    box = np.empty(4, dtype=np.int64)
    transform_points(points_o, T_co, points_c)
    pixel_bounds(points_c, pinhole, height, width, box)
    fill(points_c, faces, enabled, pinhole, nearness, face_ids)
    colours = face_colours(points_c, faces, albedo, light)
    for v in range(box[2], box[3] + 1):
        for u in range(box[0], box[1] + 1):
            f = face_ids[v, u]
            visible[v, u] = f >= 0 and nearness[v, u] * DEPTH_TOLERANCE >= static_nearness[v, u]
            if visible[v, u]:
                for k in range(3):
                    image[v, u, k] = colours[f, k]


@njit(cache=True, nogil=True)
def render_poses(
    surface: Any,
    light: Any,
    poses_co: Any,
    pinhole: Any,
    static_nearness: Any,
    still: Any,
    box: Any,
    out: Any,
) -> None:
    """Render a part in poses (K, 4, 4) over ``still`` into ``out`` (K, H, W, 3).

    ``box`` (4,) is set to the columns and rows [px] of the part in any of the poses; only they are
    written. The other arguments are those of :func:`sweep_costs`.
    """
    points_o, faces, albedo = surface
    height, width = static_nearness.shape
    points_c = np.empty((len(poses_co), len(points_o), 3))
    one = np.empty(4, dtype=np.int64)
    box[0], box[1], box[2], box[3] = width, -1, height, -1
    for k in range(len(poses_co)):
        transform_points(points_o, poses_co[k], points_c[k])
        pixel_bounds(points_c[k], pinhole, height, width, one)
        box[0], box[1] = min(box[0], one[0]), max(box[1], one[1])
        box[2], box[3] = min(box[2], one[2]), max(box[3], one[3])
    nearness = np.zeros((height, width), dtype=np.float32)
    face_ids = np.full((height, width), -1, dtype=np.int32)
    enabled = np.ones(len(faces), dtype=np.bool_)
    for k in range(len(poses_co)):
        fill(points_c[k], faces, enabled, pinhole, nearness, face_ids)
        colours = face_colours(points_c[k], faces, albedo, light)
        for v in range(box[2], box[3] + 1):
            for u in range(box[0], box[1] + 1):
                f = face_ids[v, u]
                visible = f >= 0 and nearness[v, u] * DEPTH_TOLERANCE >= static_nearness[v, u]
                for c in range(3):
                    out[k, v, u, c] = colours[f, c] if visible else still[v, u, c]
                nearness[v, u] = 0.0
                face_ids[v, u] = -1


@njit(cache=True, nogil=True)
def normal_equations(
    images: Any, box: Any, frame: Any, soft: float, small: Any, force: Any
) -> None:
    """Write the weighted normal equations of one frame, of pixels that a parameter changes.

    Args:
        images: At the parameters, then with each a step up and a step down (2 M + 1, H, W, 3).
        box: Region in which they may differ (4,) [px], from :func:`render_poses`.
        frame: Observed colours (H, W, 3), 0 to 255.
        soft: Differences above this are down-weighted; above four times this, by another quarter.
        small: Resulting matrix (M, M).
        force: Resulting right side (M,).
    """
    m = len(force)
    small[:], force[:] = 0.0, 0.0
    column = np.empty(m)
    for v in range(box[2], box[3] + 1):
        for u in range(box[0], box[1] + 1):
            for c in range(3):
                most = 0.0
                for j in range(m):
                    up, down = images[2 * j + 1, v, u, c], images[2 * j + 2, v, u, c]
                    column[j] = 0.5 * (up - down)
                    most = max(most, abs(column[j]))
                if most <= MIN_DERIVATIVE:
                    continue
                off = frame[v, u, c] - images[0, v, u, c]
                weight = 1.0 / max(abs(off), soft)
                if abs(off) > 4.0 * soft:
                    weight *= 0.25
                for i in range(m):
                    force[i] += column[i] * weight * off
                    for j in range(m):
                        small[i, j] += column[i] * weight * column[j]


@njit(cache=True, nogil=True)
def best_path(costs: Any, change_cost: float, largest: int, circular: bool) -> Any:
    """Return the cheapest path through ``costs`` (T, Q) as unwrapped column indices (T,).

    Viterbi recursion over columns and steps. A constant step costs nothing, however large: a part
    that is hidden for a while, or looks alike in several columns, continues its motion.

    Args:
        costs: Cost of each column in each row (T, Q).
        change_cost: Cost of a step (columns from row to row) that differs from the one before,
            times the square of the difference, which counts up to :data:`MAX_STEP_CHANGE`.
        largest: Largest step.
        circular: The last column is next to the first.
    """
    n_rows, n_columns = costs.shape
    n_steps = 2 * largest + 1
    total = np.empty((n_columns, n_steps))
    for q in range(n_columns):
        total[q, :] = costs[0, q]
    back = np.zeros((n_rows, n_columns, n_steps), dtype=np.int16)
    for t in range(1, n_rows):
        fresh = np.full((n_columns, n_steps), np.inf)
        for p in range(n_columns):
            jump = int(np.argmin(total[p]))
            jumped = total[p, jump] + change_cost * MAX_STEP_CHANGE**2
            for d in range(n_steps):
                q = p + d - largest
                if circular:
                    q = q % n_columns
                elif q < 0 or q >= n_columns:
                    continue
                value, came = jumped, jump
                first, last = max(0, d - MAX_STEP_CHANGE), min(n_steps - 1, d + MAX_STEP_CHANGE)
                for e in range(first, last + 1):
                    tried = total[p, e] + change_cost * (d - e) ** 2
                    if tried < value:
                        value, came = tried, e
                fresh[q, d] = (
                    value + costs[t, q] + change_cost * MOTION_COST_SHARE * abs(d - largest)
                )
                back[t, q, d] = came
        total = fresh
    end = int(np.argmin(total))
    path = np.zeros(n_rows, dtype=np.int64)
    path[n_rows - 1], step = end // n_steps, end % n_steps
    for t in range(n_rows - 1, 0, -1):
        column = path[t] % n_columns if circular else path[t]
        path[t - 1] = path[t] - (step - largest)
        step = int(back[t, column, step])
    return path


@njit(cache=True, nogil=True)
def best_uniform_path(costs: Any, times: Any, most: int, circular: bool) -> Any:
    """Return the cheapest uniform motion through ``costs`` as columns (T,).

    Columns are unwrapped and fractional.

    Args:
        costs: Cost of each column in each row (T, Q).
        times: Time of each row, from 0 to 1 (T,).
        most: Most columns from the first row to the last.
        circular: The last column is next to the first.
    """
    n_rows, n_columns = costs.shape
    least, first, far = np.inf, 0, 0
    for start in range(n_columns):
        for travel in range(-most, most + 1):
            if not circular and (start + travel < 0 or start + travel >= n_columns):
                continue
            total = 0.0
            for t in range(n_rows):
                total += costs[t, round(start + travel * times[t]) % n_columns]
                if total >= least:
                    break
            if total < least:
                least, first, far = total, start, travel
    return first + far * times
