"""Surface: the triangles of one or more parts, as coarse as a picture allows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from articulate.render.parts import PartMesh
from articulate.transforms import Array, Ints

SAMPLES = np.array([[1, 1, 1], [4, 1, 1], [1, 4, 1], [1, 1, 4]]) / np.array([[3], [6], [6], [6]])
"""Where in a face its texture is looked up, in barycentric coordinates."""
LARGEST_PX = 12.0
"""A textured face with a longer edge is cut in four."""
CUTS = 4
"""Times a face is cut at most."""


@dataclass(frozen=True, eq=False)
class Surface:
    """Triangles in the object's frame."""

    points_o: Array
    """Corners (V, 3) [m]."""
    faces: Ints
    """Indices of corners (F, 3)."""
    albedo: Array
    """Colour of each face (F, 3), 0 to 255."""
    part_ids: Ints
    """Which part each face belongs to (F,)."""

    @property
    def normals_o(self) -> Array:
        """Unit normals (F, 3); about zero for faces without area."""
        a, b, c = (self.points_o[self.faces[:, k]] for k in range(3))
        normals = np.cross(b - a, c - a)
        size = np.linalg.norm(normals, axis=1, keepdims=True)
        return np.asarray(normals / np.maximum(size, 1e-18), dtype=np.float64)

    @property
    def areas(self) -> Array:
        """Area of each face (F,) [m^2]."""
        a, b, c = (self.points_o[self.faces[:, k]] for k in range(3))
        return np.asarray(0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1))

    def only(self, part_ids: Sequence[int]) -> Surface:
        """The faces of some parts."""
        chosen = np.isin(self.part_ids, list(part_ids))
        used, faces = np.unique(self.faces[chosen], return_inverse=True)
        return Surface(
            self.points_o[used],
            faces.reshape(-1, 3),
            self.albedo[chosen],
            self.part_ids[chosen],
        )


def surface_of(parts: Sequence[PartMesh], *, pixel_m: float) -> Surface:
    """The surface of ``parts``, part k with id k, in which no detail is smaller than a pixel.

    Args:
        parts: In the object's frame.
        pixel_m: Size of a pixel at the object [m].
    """
    pieces = [_piece(part, k, pixel_m) for k, part in enumerate(parts)]
    starts = np.cumsum([0, *(len(p.points_o) for p in pieces[:-1])])
    return Surface(
        np.concatenate([p.points_o for p in pieces]),
        np.concatenate([p.faces + start for p, start in zip(pieces, starts, strict=True)]),
        np.concatenate([p.albedo for p in pieces]),
        np.concatenate([p.part_ids for p in pieces]),
    )


def _piece(part: PartMesh, part_id: int, pixel_m: float) -> Surface:
    points, faces, albedo = part.vertices, part.faces, part.rgb * 255.0
    if part.uv is not None and part.texture is not None and len(faces):
        points, faces, uv = _cut(points, faces, part.uv, LARGEST_PX * pixel_m)
        albedo = _texture_colours(uv, part.texture)
    points, faces, albedo = _clustered(points, faces, albedo, 0.7 * pixel_m)
    ids = np.full(len(faces), part_id, dtype=np.int64)
    return Surface(points, faces, albedo, ids)


def _clustered(
    points: Array, faces: Ints, albedo: Array, cell_m: float
) -> tuple[Array, Ints, Array]:
    """The same surface with corners that share a cell made one, and what has no area left out."""
    if not len(faces):
        return points, faces, albedo
    cells = np.floor(points / cell_m).astype(np.int64)
    _, first, place = np.unique(cells, axis=0, return_index=True, return_inverse=True)
    place = place.reshape(-1)
    middle = np.zeros((len(first), 3))
    np.add.at(middle, place, points)
    middle /= np.bincount(place)[:, None]
    merged = place[faces]
    whole = (
        (merged[:, 0] != merged[:, 1])
        & (merged[:, 1] != merged[:, 2])
        & (merged[:, 2] != merged[:, 0])
    )
    if not whole.any():  # smaller than a pixel: keep it as it is
        return points, faces, albedo
    merged, albedo = merged[whole], albedo[whole]
    key = np.sort(merged, axis=1)
    _, unique = np.unique(key, axis=0, return_index=True)
    return middle, merged[unique], albedo[unique]


def _cut(points: Array, faces: Ints, uv: Array, longest_m: float) -> tuple[Array, Ints, Array]:
    """Faces with an edge longer than ``longest_m`` cut in four, some times over."""
    corners = points[faces]
    done_c, done_uv = [], []
    for _ in range(CUTS):
        edges = np.linalg.norm(corners - np.roll(corners, -1, axis=1), axis=2).max(axis=1)
        long = edges > longest_m
        done_c.append(corners[~long])
        done_uv.append(uv[~long])
        corners, uv = _quartered(corners[long]), _quartered(uv[long])
        if not len(corners):
            break
    done_c.append(corners)
    done_uv.append(uv)
    corners, uv = np.concatenate(done_c), np.concatenate(done_uv)
    return corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3), uv


def _quartered(corners: Array) -> Array:
    """Each triangle (F, 3, D) as four, (4 F, 3, D)."""
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    ab, bc, ca = 0.5 * (a + b), 0.5 * (b + c), 0.5 * (c + a)
    four = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
    return np.concatenate([np.stack(triangle, axis=1) for triangle in four])


def _texture_colours(uv: Array, texture: np.ndarray) -> Array:
    """Mean colour of the texture under each face (F, 3), 0 to 255."""
    height, width = texture.shape[:2]
    spots = np.einsum("sk,fkd->fsd", SAMPLES, uv)
    u = np.floor((spots[..., 0] % 1.0) * width).astype(np.int64).clip(0, width - 1)
    v = np.floor((1.0 - spots[..., 1] % 1.0) * height).astype(np.int64).clip(0, height - 1)
    return np.asarray(texture[v, u, :3].astype(np.float64).mean(axis=1))
