"""Triangle meshes of rigid parts for rendering."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from articulate.errors import AssetError
from articulate.transforms import Array, Ints, apply

GREY = 0.7
"""Albedo of faces without a known colour."""


@dataclass(frozen=True, kw_only=True, eq=False)
class PartMesh:
    """Triangles of one rigid part in the scene frame, all joints at 0."""

    name: str
    """Name of the part, unique in its scene."""
    vertices: Array
    """Vertices (V, 3) [m], or in units of the data set if it has no metric scale."""
    faces: Ints
    """Indices of vertices (F, 3)."""
    rgb: Array
    """Albedo of each face (F, 3), in [0, 1]; multiplied by the texture, if any."""
    uv: Array | None = None
    """Texture coordinates of each corner of each face (F, 3, 2), v up; None without a texture."""
    texture: NDArray[np.uint8] | None = None
    """Texture image (H, W, 3), 0 to 255."""

    def __post_init__(self) -> None:
        """Reject arrays that cannot be rendered."""
        n = len(self.faces)
        if self.vertices.ndim != 2 or self.vertices.shape[1] != 3 or self.faces.shape != (n, 3):
            raise AssetError(
                f"part {self.name}: vertices {self.vertices.shape} and faces {self.faces.shape}; "
                "(V, 3) and (F, 3) were expected"
            )
        if self.rgb.shape != (n, 3):
            raise AssetError(f"part {self.name}: {n} faces, but colours of shape {self.rgb.shape}")
        if n and not 0 <= self.faces.min() <= self.faces.max() < len(self.vertices):
            raise AssetError(f"part {self.name}: a face names a corner that does not exist")

    @property
    def bounds(self) -> Array:
        """Lowest and highest corner (2, 3) [m]."""
        return np.stack([self.vertices.min(axis=0), self.vertices.max(axis=0)])

    @property
    def centre(self) -> Array:
        """Centre of the bounding box (3,) [m]."""
        low, high = self.bounds
        return np.asarray(0.5 * (low + high))

    def moved(self, T: Array) -> PartMesh:
        """Return the part transformed by the rigid transform ``T`` (4, 4, homogeneous)."""
        return self.with_vertices(apply(T, self.vertices))

    def with_vertices(self, vertices: Array) -> PartMesh:
        """Return the part with other vertices (V, 3) [m]."""
        return PartMesh(
            name=self.name,
            vertices=vertices,
            faces=self.faces,
            rgb=self.rgb,
            uv=self.uv,
            texture=self.texture,
        )

    def renamed(self, name: str) -> PartMesh:
        """Return the part under another name."""
        return PartMesh(
            name=name,
            vertices=self.vertices,
            faces=self.faces,
            rgb=self.rgb,
            uv=self.uv,
            texture=self.texture,
        )


def plain_part(
    name: str, vertices: Array, faces: Ints, rgb: Sequence[float] = (GREY, GREY, GREY)
) -> PartMesh:
    """Create a part of one colour.

    Args:
        name: Name of the part.
        vertices: Vertices (V, 3) [m].
        faces: Indices of vertices (F, 3).
        rgb: Albedo (3,), in [0, 1].
    """
    faces = np.asarray(faces, dtype=np.int64)
    colours = np.broadcast_to(np.asarray(rgb, dtype=np.float64), (len(faces), 3)).copy()
    return PartMesh(
        name=name, vertices=np.asarray(vertices, dtype=np.float64), faces=faces, rgb=colours
    )


def joint_bounds(parts: Sequence[PartMesh]) -> Array:
    """Return the lowest and highest corner of all parts together (2, 3) [m]."""
    boxes = np.stack([part.bounds for part in parts])
    return np.stack([boxes[:, 0].min(axis=0), boxes[:, 1].max(axis=0)])
