"""Partitions and front view of one mesh, computed once for all rules."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from articulate.reconstruct.scan.cells import Cells, Edges, components, edges_of, facets
from articulate.reconstruct.scan.front_view import FrontView, front_view
from articulate.reconstruct.scan.scan_mesh import ScanMesh
from articulate.transforms import Array, Ints

NEAR_SHARE = 0.004
"""Tolerance of boxes, as a share of the diagonal."""


@dataclass(frozen=True, eq=False)
class Segmentation:
    """A mesh with its cells."""

    mesh: ScanMesh

    @cached_property
    def edges(self) -> Edges:
        """Manifold edges."""
        return edges_of(self.mesh)

    @cached_property
    def shells(self) -> Cells:
        """Surfaces of consistent winding, of any colour."""
        return components(self.mesh, self.edges, colour=False)

    @cached_property
    def coloured(self) -> Cells:
        """Surfaces of consistent winding and one colour."""
        return components(self.mesh, self.edges)

    @cached_property
    def facets(self) -> Cells:
        """Surfaces of one colour without creases."""
        return facets(self.mesh, self.edges)

    @cached_property
    def view(self) -> FrontView:
        """Front view."""
        return front_view(self.mesh)

    @property
    def near(self) -> float:
        """Tolerance of boxes [m]."""
        return NEAR_SHARE * self.mesh.diagonal

    def inside(self, cells: Cells, low: Array, high: Array) -> Ints:
        """Return the cells whose boxes lie within a box, by :attr:`near`."""
        boxes = cells.boxes
        fits = (boxes[:, 0] >= low - self.near).all(axis=1)
        fits &= (boxes[:, 1] <= high + self.near).all(axis=1)
        return np.flatnonzero(fits)

    def faces_of(self, cells: Cells, which: Ints) -> Ints:
        """Return the faces of several cells, sorted."""
        if len(which) == 0:
            return np.zeros(0, dtype=np.int64)
        return np.sort(np.concatenate([cells.members[k] for k in which]))


def touching(parts: Segmentation, which: Ints) -> list[Ints]:
    """Group shells whose boxes touch."""
    boxes = parts.shells.boxes[which]
    apart = np.asarray((boxes[:, None, 0] > boxes[None, :, 1] + parts.near).any(axis=-1))
    near = ~(apart | apart.T)
    left = set(range(len(which)))
    groups = []
    while left:
        group = {left.pop()}
        rim = set(group)
        while rim:
            reached = {int(j) for k in rim for j in np.flatnonzero(near[k])} & left
            left -= reached
            group |= reached
            rim = reached
        groups.append(which[sorted(group)])
    return sorted(groups, key=lambda group: int(group[0]))
