"""Surface prepared for ray casting: distance below points."""

from __future__ import annotations

import numpy as np
import trimesh

from articulate.transforms import Array

LIFT_M = 0.002
"""Height above a shape from which rays start [m]: a hull of few corners is below the surface in
places."""

NOTHING = np.zeros((0, 3))
"""No points (0, 3)."""


class Surface:
    """Triangles for repeated ray casting. The mesh must not change.

    Args:
        mesh: Triangles [m].
        hollow: Points of a cavity (H, 3) that shapes must leave free [m].
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
        """Return the depth of the first triangle below each point (N,) [m], inf without one.

        Args:
            points: Points (N, 3) [m]; rays start ``LIFT_M`` above them.
            normals: Unit vectors (N, 3); rays go against them.
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
