"""Triangle rasterizer on one core: face, depth and colour of every pixel.

Compiled by numba on first use. Faces are two-sided, since the winding of meshes in data sets is
arbitrary. Inverse depth is linear in the image, so it is interpolated and compared.
"""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

from articulate.transforms import Array, Ints

Depths = NDArray[np.float32]
Ids = NDArray[np.int32]
Pixels = NDArray[np.uint8]

NEAR_M = 1e-3
"""Distance of the near plane [m]."""
NO_TEXTURE = -1
FLAT = 1e-12
"""Barycentric coordinates with a smaller slope along a row are constant."""
EDGE_PX = 1e-7
"""Tolerance at the end of a row, so that rounding leaves no gap between two faces [px]."""


@numba.njit(cache=True, nogil=True)
def _copy3(values: Array, into: Array) -> None:
    """Copy three numbers; numpy's copy takes longer to compile."""
    for k in range(3):
        into[k] = values[k]


@numba.njit(cache=True, nogil=True)
def _corners(vertices_c: Array, face: Ints, corners: Array) -> None:
    """Write the vertices of ``face`` (3,) to ``corners`` (3, 3)."""
    for k in range(3):
        _copy3(vertices_c[face[k]], corners[k])


@numba.njit(cache=True, nogil=True)
def transform_vertices(vertices: Array, part_of_vertex: Ints, T_cp: Array) -> Array:
    """Transform vertices (V, 3) [m] to the camera frame by the poses of their parts (P, 4, 4)."""
    out = np.empty_like(vertices)
    for i in range(len(vertices)):
        T = T_cp[part_of_vertex[i]]
        x, y, z = vertices[i, 0], vertices[i, 1], vertices[i, 2]
        for k in range(3):
            out[i, k] = T[k, 0] * x + T[k, 1] * y + T[k, 2] * z + T[k, 3]
    return out


@numba.njit(cache=True, nogil=True)
def _fill(
    corners_c: Array, face: int, intrinsics: Array, inverse_depth: Depths, face_ids: Ids
) -> None:
    """Rasterize one triangle (3, 3) that is entirely in front of the near plane."""
    height, width = inverse_depth.shape
    fx, fy, cx, cy = intrinsics[0], intrinsics[1], intrinsics[2], intrinsics[3]
    w0, w1, w2 = 1.0 / corners_c[0, 2], 1.0 / corners_c[1, 2], 1.0 / corners_c[2, 2]
    x0, y0 = fx * corners_c[0, 0] * w0 + cx, fy * corners_c[0, 1] * w0 + cy
    x1, y1 = fx * corners_c[1, 0] * w1 + cx, fy * corners_c[1, 1] * w1 + cy
    x2, y2 = fx * corners_c[2, 0] * w2 + cx, fy * corners_c[2, 1] * w2 + cy
    area = (x1 - x0) * (y2 - y0) - (x2 - x0) * (y1 - y0)
    if abs(area) < 1e-12:
        return
    low_u = max(0, int(np.ceil(min(x0, x1, x2))))
    high_u = min(width - 1, int(np.floor(max(x0, x1, x2))))
    low_v = max(0, int(np.ceil(min(y0, y1, y2))))
    high_v = min(height - 1, int(np.floor(max(y0, y1, y2))))
    if low_u > high_u or low_v > high_v:
        return
    scale = 1.0 / area
    # Barycentric coordinates are linear in the pixel: b1 = b1u * u + b1v * v + b10, b2 likewise.
    b1u, b1v = (y2 - y0) * scale, -(x2 - x0) * scale
    b2u, b2v = -(y1 - y0) * scale, (x1 - x0) * scale
    b0u = -b1u - b2u
    wu = b0u * w0 + b1u * w1 + b2u * w2
    for v in range(low_v, high_v + 1):
        b1 = -b1u * x0 + b1v * (v - y0)  # at u = 0, as b2 and b0
        b2 = -b2u * x0 + b2v * (v - y0)
        b0 = 1.0 - b1 - b2
        left, right = float(low_u), float(high_u)
        for b, slope in ((b0, b0u), (b1, b1u), (b2, b2u)):
            if slope > FLAT:
                left = max(left, -b / slope - EDGE_PX)
            elif slope < -FLAT:
                right = min(right, -b / slope + EDGE_PX)
            elif b < -FLAT:
                right = left - 1.0
        w_row = b0 * w0 + b1 * w1 + b2 * w2
        for u in range(int(np.ceil(left)), int(np.floor(right)) + 1):
            w = np.float32(w_row + wu * u)
            if w > inverse_depth[v, u]:
                inverse_depth[v, u] = w
                face_ids[v, u] = face


@numba.njit(cache=True, nogil=True)
def _before_near(corners_c: Array) -> tuple[Array, int]:
    """Clip a triangle (3, 3) at the near plane; return vertices (4, 3) and their number."""
    cut = np.empty((4, 3))
    n = 0
    for k in range(3):
        a, b = corners_c[k], corners_c[(k + 1) % 3]
        if a[2] >= NEAR_M:
            _copy3(a, cut[n])
            n += 1
        if (a[2] >= NEAR_M) != (b[2] >= NEAR_M):
            share = (NEAR_M - a[2]) / (b[2] - a[2])
            for j in range(3):
                cut[n, j] = a[j] + share * (b[j] - a[j])
            cut[n, 2] = NEAR_M
            n += 1
    return cut, n


@numba.njit(cache=True, nogil=True)
def fill(
    vertices_c: Array,
    faces: Ints,
    enabled: NDArray[np.bool_],
    intrinsics: Array,
    inverse_depth: Depths,
    face_ids: Ids,
) -> None:
    """Rasterize faces into ``inverse_depth`` [1/m] and ``face_ids``, both (H, W), in place.

    Args:
        vertices_c: Vertices in the camera frame (V, 3) [m].
        faces: Indices of vertices (F, 3).
        enabled: Faces to rasterize (F,), boolean.
        intrinsics: fx, fy, cx, cy [px].
        inverse_depth: Depth buffer (H, W); 0 for background.
        face_ids: Face of each pixel (H, W); -1 for background.
    """
    corners = np.empty((3, 3))
    for f in range(len(faces)):
        if not enabled[f]:
            continue
        before = 0
        _corners(vertices_c, faces[f], corners)
        for k in range(3):
            before += corners[k, 2] >= NEAR_M
        if before == 3:
            _fill(corners, f, intrinsics, inverse_depth, face_ids)
        elif before > 0:
            rest, n = _before_near(corners)
            _fill(rest[:3], f, intrinsics, inverse_depth, face_ids)
            if n == 4:
                _copy3(rest[0], rest[1])
                _fill(rest[1:], f, intrinsics, inverse_depth, face_ids)


@numba.njit(cache=True, nogil=True)
def _dot(a: Array, b: Array) -> float:
    """Return the inner product of (3,); numba takes seconds to compile numpy's."""
    return float(a[0] * b[0] + a[1] * b[1] + a[2] * b[2])


@numba.njit(cache=True, nogil=True)
def _texel(
    point: Array, corners: Array, uv: Array, texture: Pixels, size: Ints, albedo: Array
) -> None:
    """Multiply ``albedo`` (3,) by the texture at ``point`` (3,) of a triangle (3, 3)."""
    x, y, z = corners[0, 0], corners[0, 1], corners[0, 2]
    ax, ay, az = corners[1, 0] - x, corners[1, 1] - y, corners[1, 2] - z
    bx, by, bz = corners[2, 0] - x, corners[2, 1] - y, corners[2, 2] - z
    px, py, pz = point[0] - x, point[1] - y, point[2] - z
    aa = ax * ax + ay * ay + az * az  # scalars: this runs for every sample
    ab = ax * bx + ay * by + az * bz
    bb = bx * bx + by * by + bz * bz
    pa = px * ax + py * ay + pz * az
    pb = px * bx + py * by + pz * bz
    det = aa * bb - ab * ab
    if det <= 0.0:
        return
    s, t = (bb * pa - ab * pb) / det, (aa * pb - ab * pa) / det
    u = uv[0, 0] + s * (uv[1, 0] - uv[0, 0]) + t * (uv[2, 0] - uv[0, 0])
    v = uv[0, 1] + s * (uv[1, 1] - uv[0, 1]) + t * (uv[2, 1] - uv[0, 1])
    column = int((u - np.floor(u)) * size[1]) % size[1]
    row = int((1.0 - (v - np.floor(v))) * size[0]) % size[0]
    for k in range(3):
        albedo[k] *= texture[row, column, k] / 255.0


@numba.njit(cache=True, nogil=True)
def _add(colour: Array, light: float, total: Array) -> None:
    """Add ``colour`` (3,) times ``light`` to ``total`` (3,)."""
    for k in range(3):
        total[k] += min(1.0, colour[k] * light)


@numba.njit(cache=True, nogil=True)
def _point(u: int, v: int, inverse_depth: float, intrinsics: Array, point: Array) -> None:
    """Write the point at a pixel in the camera frame to ``point`` (3,) [m]."""
    z = 1.0 / inverse_depth
    point[0] = (u - intrinsics[2]) / intrinsics[0] * z
    point[1] = (v - intrinsics[3]) / intrinsics[1] * z
    point[2] = z


@numba.njit(cache=True, nogil=True)
def _brightness(corners: Array, light: Array) -> float:
    """Return the brightness of a face: ambient, directional and head light, two-sided."""
    a, b, middle, normal = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    for k in range(3):
        a[k], b[k] = corners[1, k] - corners[0, k], corners[2, k] - corners[0, k]
        middle[k] = (corners[0, k] + corners[1, k] + corners[2, k]) / 3.0
    normal[0] = a[1] * b[2] - a[2] * b[1]
    normal[1] = a[2] * b[0] - a[0] * b[2]
    normal[2] = a[0] * b[1] - a[1] * b[0]
    length, distance = np.sqrt(_dot(normal, normal)), np.sqrt(_dot(middle, middle))
    if length <= 0.0 or distance <= 0.0:
        return float(light[3])
    facing = _dot(normal, middle) / (length * distance)
    side = -1.0 if facing > 0.0 else 1.0  # towards the camera
    lit = max(0.0, side * _dot(normal, light) / length)
    return float(light[3] + light[4] * lit + light[5] * abs(facing))


@numba.njit(cache=True, nogil=True)
def shade(
    vertices_c: Array,
    faces: Ints,
    rgb: Array,
    uv: Array,
    texture_of_face: Ints,
    textures: Pixels,
    texture_sizes: Ints,
    intrinsics: Array,
    light: Array,
    background: Array,
    inverse_depth: Depths,
    face_ids: Ids,
    samples: int,
) -> Pixels:
    """Return the image (H / samples, W / samples, 3) of the rasterized faces, with flat shading.

    Args:
        vertices_c: Vertices in the camera frame (V, 3) [m].
        faces: Indices of vertices (F, 3).
        rgb: Albedo of each face (F, 3), in [0, 1].
        uv: Texture coordinates (F, 3, 2).
        texture_of_face: Index of the texture of each face (F,), -1 for none.
        textures: All textures, padded to a common size (K, H, W, 3).
        texture_sizes: Height and width of each texture (K, 2) [px].
        intrinsics: fx, fy, cx, cy [px].
        light: Unit vector towards the light in the camera frame (3,), then ambient, directional and
            head light (3,).
        background: Background colour (3,), in [0, 1].
        inverse_depth: Rasterized depth (H, W) [1/m].
        face_ids: Rasterized faces (H, W).
        samples: Samples per pixel in each direction.
    """
    height, width = face_ids.shape[0] // samples, face_ids.shape[1] // samples
    out = np.empty((height, width, 3), dtype=np.uint8)
    brightness = np.full(len(faces), -1.0)
    corners = np.empty((3, 3))
    point, albedo, total, black = np.empty(3), np.empty(3), np.empty(3), np.zeros(3)
    share = 255.0 / (samples * samples)
    for row in range(height):
        for column in range(width):
            _copy3(black, total)
            for v in range(row * samples, (row + 1) * samples):
                for u in range(column * samples, (column + 1) * samples):
                    f = face_ids[v, u]
                    if f < 0:
                        _add(background, 1.0, total)
                        continue
                    texture = texture_of_face[f]
                    if texture >= 0 or brightness[f] < 0.0:
                        _corners(vertices_c, faces[f], corners)
                    if brightness[f] < 0.0:
                        brightness[f] = _brightness(corners, light)
                    _copy3(rgb[f], albedo)
                    if texture >= 0:
                        _point(u, v, inverse_depth[v, u], intrinsics, point)
                        size = texture_sizes[texture]
                        _texel(point, corners, uv[f], textures[texture], size, albedo)
                    _add(albedo, brightness[f], total)
            for k in range(3):
                out[row, column, k] = np.uint8(share * total[k] + 0.5)
    return out


@numba.njit(cache=True, nogil=True)
def parts_of_faces(face_ids: Ids, part_of_face: Ints) -> Ids:
    """Return the part of each pixel (H, W), -1 for background, from its face (H, W, indices)."""
    out = np.empty_like(face_ids)
    height, width = face_ids.shape
    for v in range(height):
        for u in range(width):
            f = face_ids[v, u]
            out[v, u] = -1 if f < 0 else part_of_face[f]
    return out
