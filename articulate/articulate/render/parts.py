"""PartMesh: one rigid part as triangles, and what a picture needs to know of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from articulate.errors import AssetError
from articulate.transforms import Array, Ints, apply

GREY = 0.7
"""Albedo of faces of which no colour is known."""


@dataclass(frozen=True, kw_only=True, eq=False)
class PartMesh:
    """Triangles of one rigid part, in the frame of the scene, every joint at 0."""

    name: str
    """Name of the part, unique among those it is drawn or judged with."""
    vertices: Array
    """Corners (V, 3) [m], or in units of the data set where that knows no metres."""
    faces: Ints
    """Indices of corners (F, 3)."""
    rgb: Array
    """Albedo of each face (F, 3), each value in [0, 1]; times the texture where there is one."""
    uv: Array | None = None
    """Texture coordinates of each corner of each face (F, 3, 2), v up; None without a texture."""
    texture: NDArray[np.uint8] | None = None
    """Picture (H, W, 3) that ``uv`` refers to."""

    def __post_init__(self) -> None:
        """Refuse what cannot be drawn."""
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
        """Lowest and highest corner (2, 3)."""
        return np.stack([self.vertices.min(axis=0), self.vertices.max(axis=0)])

    @property
    def centre(self) -> Array:
        """Middle of the box around the part (3,)."""
        low, high = self.bounds
        return np.asarray(0.5 * (low + high))

    def moved(self, T: Array) -> PartMesh:
        """The same part, its corners taken along by the rigid transform ``T`` (4, 4)."""
        return self.with_vertices(apply(T, self.vertices))

    def with_vertices(self, vertices: Array) -> PartMesh:
        """The same part with other corners (V, 3)."""
        return PartMesh(
            name=self.name,
            vertices=vertices,
            faces=self.faces,
            rgb=self.rgb,
            uv=self.uv,
            texture=self.texture,
        )

    def renamed(self, name: str) -> PartMesh:
        """The same part under another name."""
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
    """A part of one colour."""
    faces = np.asarray(faces, dtype=np.int64)
    colours = np.broadcast_to(np.asarray(rgb, dtype=np.float64), (len(faces), 3)).copy()
    return PartMesh(
        name=name, vertices=np.asarray(vertices, dtype=np.float64), faces=faces, rgb=colours
    )


def joint_bounds(parts: Sequence[PartMesh]) -> Array:
    """Lowest and highest corner of all parts together (2, 3)."""
    boxes = np.stack([part.bounds for part in parts])
    return np.stack([boxes[:, 0].min(axis=0), boxes[:, 1].max(axis=0)])
