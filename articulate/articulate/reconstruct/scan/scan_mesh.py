"""One mesh of an object: welded triangles with a colour and a group each."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from articulate.render.parts import PartMesh
from articulate.transforms import Array, Ints

WELD_SHARE = 1e-5
"""Vertices closer than this share of the diagonal are merged."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ScanMesh:
    """Triangles of one object in the frame ``o``: z up, the front at +x."""

    vertices: Array
    """Vertices (V, 3) [m], or in units of the file before it is scaled."""
    faces: Ints
    """Indices of vertices (F, 3)."""
    rgb: Array
    """Albedo of each face (F, 3), in [0, 1]."""
    group: Ints
    """Index of the named mesh of each face in the file (F,)."""
    names: tuple[str, ...] = ()
    """Name of each mesh of the file."""
    source: Ints | None = None
    """Index of each face in the input (F,); None: the same."""

    @cached_property
    def bounds(self) -> Array:
        """Lowest and highest corner (2, 3) [m]."""
        used = self.vertices[self.faces.ravel()]
        return np.stack([used.min(axis=0), used.max(axis=0)])

    @property
    def size(self) -> Array:
        """Sides of the bounding box (3,) [m]."""
        return np.asarray(self.bounds[1] - self.bounds[0])

    @property
    def diagonal(self) -> float:
        """Diagonal of the bounding box [m]."""
        return float(np.linalg.norm(self.size))

    @cached_property
    def triangles(self) -> Array:
        """Corners of each face (F, 3, 3) [m]."""
        return np.asarray(self.vertices[self.faces])

    @cached_property
    def _cross(self) -> Array:
        t = self.triangles
        return np.cross(t[:, 1] - t[:, 0], t[:, 2] - t[:, 0])

    @cached_property
    def areas(self) -> Array:
        """Area of each face (F,) [m2]."""
        return np.asarray(0.5 * np.linalg.norm(self._cross, axis=1))

    @cached_property
    def normals(self) -> Array:
        """Unit normal of each face (F, 3); zero without area."""
        length = np.linalg.norm(self._cross, axis=1, keepdims=True)
        return np.asarray(self._cross / np.maximum(length, 1e-300))

    def select(self, faces: Ints) -> ScanMesh:
        """Return the mesh of these faces (F,), in this order."""
        source = faces if self.source is None else self.source[faces]
        return replace(
            self, faces=self.faces[faces], rgb=self.rgb[faces], group=self.group[faces],
            source=source,
        )  # fmt: skip

    def transformed(self, rotation: Array, scale: float, shift: Array) -> ScanMesh:
        """Return the mesh with vertices ``scale * rotation @ v + shift``."""
        return replace(self, vertices=scale * self.vertices @ rotation.T + shift)

    def part(self, name: str, faces: Ints) -> PartMesh:
        """Return the faces (F,) as a part."""
        used, corners = np.unique(self.faces[faces], return_inverse=True)
        return PartMesh(
            name=name,
            vertices=self.vertices[used],
            faces=corners.reshape(-1, 3).astype(np.int64),
            rgb=self.rgb[faces],
        )


def weld(mesh: ScanMesh, share: float = WELD_SHARE) -> ScanMesh:
    """Merge near vertices, and drop empty and duplicate faces.

    Args:
        mesh: Triangles, of which vertices may repeat.
        share: Largest distance as a share of the diagonal.
    """
    step = max(share * mesh.diagonal, 1e-300)
    keys = np.round((mesh.vertices - mesh.bounds[0]) / step).astype(np.int64)
    _, first, inverse = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    faces = inverse.ravel()[mesh.faces]
    welded = replace(mesh, vertices=mesh.vertices[first], faces=faces)
    order = np.sort(faces, axis=1)
    empty = (order[:, 0] == order[:, 1]) | (order[:, 1] == order[:, 2])
    _, once = np.unique(order, axis=0, return_index=True)
    keep: NDArray[np.bool_] = np.zeros(len(faces), dtype=bool)
    keep[once] = True
    keep &= ~empty & (welded.areas > 0.0)
    return welded.select(np.flatnonzero(keep))
