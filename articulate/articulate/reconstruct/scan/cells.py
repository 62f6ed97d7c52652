"""Cells: connected surfaces of a mesh, cut where it branches, folds or changes colour."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from articulate.reconstruct.scan.scan_mesh import ScanMesh
from articulate.transforms import Array, Ints

CREASE_RAD = float(np.radians(30.0))
"""Edges that fold by more are creases."""
COLOUR_CHANGE = 0.04
"""Faces whose colours differ by more belong to different cells, per channel."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Edges:
    """Pairs of faces that share an edge with no third face."""

    pairs: Ints
    """Indices of the two faces (E, 2)."""
    consistent: NDArray[np.bool_]
    """True if both faces have the same orientation (E,)."""
    fold_rad: Array
    """Angle between the planes of the two faces (E,)."""
    concave: NDArray[np.bool_]
    """True if the surface folds towards the side of the normals (E,)."""
    length: Array
    """Length of the edge (E,) [m]."""


def edges_of(mesh: ScanMesh) -> Edges:
    """Return the manifold edges of a mesh."""
    n = len(mesh.faces)
    start = mesh.faces[:, [0, 1, 2]].T.ravel()
    end = mesh.faces[:, [1, 2, 0]].T.ravel()
    face = np.tile(np.arange(n), 3)
    forward = start < end
    key = np.where(forward, start, end) * (len(mesh.vertices) + 1) + np.where(forward, end, start)
    order = np.argsort(key, kind="stable")
    key, face, forward = key[order], face[order], forward[order]
    start, end = start[order], end[order]
    new = np.concatenate([[True], key[1:] != key[:-1], [True]])
    first = np.flatnonzero(new)
    two = first[:-1][np.diff(first) == 2]
    pairs = np.stack([face[two], face[two + 1]], axis=1)
    consistent = forward[two] != forward[two + 1]
    a, b = mesh.normals[pairs[:, 0]], mesh.normals[pairs[:, 1]]
    b = np.where(consistent[:, None], b, -b)
    cosine = np.clip((a * b).sum(axis=1), -1.0, 1.0)
    centres = mesh.triangles.mean(axis=1)
    ahead = ((centres[pairs[:, 1]] - mesh.vertices[start[two]]) * a).sum(axis=1)
    length = np.linalg.norm(mesh.vertices[end[two]] - mesh.vertices[start[two]], axis=1)
    return Edges(
        pairs=pairs, consistent=consistent, fold_rad=np.arccos(cosine), concave=ahead > 0.0,
        length=length,
    )  # fmt: skip


@dataclass(frozen=True, kw_only=True, eq=False)
class Cells:
    """A partition of the faces of a mesh."""

    mesh: ScanMesh
    label: Ints
    """Cell of each face (F,), from 0, ordered by the first face."""

    @cached_property
    def count(self) -> int:
        """Number of cells."""
        return int(self.label.max()) + 1 if len(self.label) else 0

    @cached_property
    def area(self) -> Array:
        """Area of each cell (C,) [m2]."""
        return np.asarray(np.bincount(self.label, self.mesh.areas, self.count), dtype=np.float64)

    @cached_property
    def boxes(self) -> Array:
        """Bounding box of each cell (C, 2, 3) [m]."""
        low = np.full((self.count, 3), np.inf)
        high = np.full((self.count, 3), -np.inf)
        np.minimum.at(low, self.label, self.mesh.triangles.min(axis=1))
        np.maximum.at(high, self.label, self.mesh.triangles.max(axis=1))
        return np.stack([low, high], axis=1)

    @cached_property
    def members(self) -> list[Ints]:
        """Faces of each cell."""
        order = np.argsort(self.label, kind="stable")
        return np.split(order, np.cumsum(np.bincount(self.label, minlength=self.count))[:-1])


def components(mesh: ScanMesh, edges: Edges, *, colour: bool = True) -> Cells:
    """Join faces over edges of two faces with consistent winding, and of one colour."""
    keep = edges.consistent & (mesh.group[edges.pairs[:, 0]] == mesh.group[edges.pairs[:, 1]])
    if colour:
        keep &= _same_colour(mesh, edges)
    return _joined(mesh, edges.pairs[keep])


def facets(mesh: ScanMesh, edges: Edges) -> Cells:
    """Join faces as :func:`components` does, except over creases."""
    keep = edges.consistent & _same_colour(mesh, edges) & (edges.fold_rad < CREASE_RAD)
    return _joined(mesh, edges.pairs[keep])


def _same_colour(mesh: ScanMesh, edges: Edges) -> NDArray[np.bool_]:
    change = np.abs(mesh.rgb[edges.pairs[:, 0]] - mesh.rgb[edges.pairs[:, 1]]).max(axis=1)
    return np.asarray(change <= COLOUR_CHANGE)


def _joined(mesh: ScanMesh, pairs: Ints) -> Cells:
    n = len(mesh.faces)
    graph = coo_array((np.ones(len(pairs), dtype=np.int8), (pairs[:, 0], pairs[:, 1])), (n, n))
    _, label = connected_components(graph, directed=False)
    _, first, inverse = np.unique(label, return_index=True, return_inverse=True)
    rank = np.empty(len(first), dtype=np.int64)
    rank[np.argsort(first)] = np.arange(len(first))
    return Cells(mesh=mesh, label=rank[inverse.ravel()])
