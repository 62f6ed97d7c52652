"""A surface prepared for rays: how far it lies below points."""

from __future__ import annotations

import numpy as np
import trimesh

from articulate.transforms import Array

LIFT_M = 0.002
"""Rays start this far above a shape: one of few corners lies below what it stands for [m]."""

NOTHING = np.zeros((0, 3))
"""No points."""


class Surface:
    """Triangles that are asked many times. The mesh must not change meanwhile.

    Args:
        mesh: Their mesh.
        hollow: Points (H, 3) of a cavity that shapes must leave free [m].
    """

    def __init__(self, mesh: trimesh.Trimesh, hollow: Array = NOTHING) -> None:
        self.mesh = mesh
        self.hollow = hollow
        triangles = np.asarray(mesh.triangles, dtype=np.float64)
        self._starts = triangles[:, 0]
        self._normals = np.cross(
            triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
        )

    def depths(self, points: Array, normals: Array) -> Array:
        """How far below each point the first triangle lies (N,) [m], inf where there is none.

        Args:
            points: Where rays start (N, 3) [m], from ``LIFT_M`` above.
            normals: Unit vectors (N, 3) against which they go.
        """
        origins = points + LIFT_M * normals
        hit = np.asarray(self.mesh.ray.intersects_first(origins, -normals))
        found = np.flatnonzero(hit >= 0)
        plane = self._normals[hit[found]]
        height = np.einsum("ni,ni->n", plane, origins[found] - self._starts[hit[found]])
        slope = np.einsum("ni,ni->n", plane, normals[found])
        depth = np.full(len(points), np.inf)
        level = slope == 0.0
        depth[found] = np.where(
            level, np.inf, np.abs(height / np.where(level, 1.0, slope)) - LIFT_M
        )
        return depth
