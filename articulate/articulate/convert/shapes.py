"""Convex collision shapes: boxes, hulls, cylinders and spheres in the frame of a part."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
import trimesh

from articulate.transforms import Array, apply, inverse


@dataclass(frozen=True, kw_only=True, eq=False)
class Shape:
    """One convex collision geom."""

    kind: Literal["box", "cylinder", "sphere", "hull"]
    T_ps: Array
    """Pose in its part (4, 4); identity for a hull."""
    half: tuple[float, float, float]
    """Half sides of a box; radius, radius, half length of a cylinder; radius of a sphere [m]."""
    vertices: Array | None = None
    """Corners of a hull in the part (N, 3)."""
    piece: str = ""
    """Names of the piece it stands for."""

    @cached_property
    def mesh(self) -> trimesh.Trimesh:
        """Its surface as triangles in the part."""
        if self.kind == "hull":
            return trimesh.convex.convex_hull(self.vertices)
        if self.kind == "box":
            mesh = trimesh.creation.box(extents=2.0 * np.array(self.half))
        elif self.kind == "cylinder":
            mesh = trimesh.creation.cylinder(radius=self.half[0], height=2.0 * self.half[2])
        else:
            mesh = trimesh.creation.icosphere(subdivisions=2, radius=self.half[0])
        mesh.apply_transform(self.T_ps)
        return mesh

    @cached_property
    def volume(self) -> float:
        """Volume [m3]."""
        if self.kind == "box":
            return float(8.0 * np.prod(self.half))
        return abs(float(self.mesh.volume))

    @cached_property
    def planes(self) -> Array:
        """Outward half-spaces (M, 4): normal and offset, inside where n x + d <= 0."""
        mesh = self.mesh
        offsets = -np.einsum("ij,ij->i", mesh.face_normals, mesh.triangles[:, 0])
        planes = np.column_stack([mesh.face_normals, offsets])
        return np.unique(planes.round(9), axis=0)

    def outside(self, points: Array) -> Array:
        """How far points (N, 3) lie outside [m], negative inside; a lower bound near corners."""
        if self.kind == "box":
            local = np.abs(apply(inverse(self.T_ps), points)) - np.array(self.half)
            away = np.linalg.norm(np.maximum(local, 0.0), axis=1)
            return np.asarray(away + np.minimum(local.max(axis=1), 0.0))
        planes = self.planes
        return np.asarray((points @ planes[:, :3].T + planes[:, 3]).max(axis=1))

    @cached_property
    def bounds(self) -> Array:
        """Lowest and highest corner in the part (2, 3)."""
        return np.asarray(self.mesh.bounds)


def sample_surface(mesh: trimesh.Trimesh, count: int) -> tuple[Array, Array]:
    """``count`` points on ``mesh`` by area, with their face normals, the same on each call."""
    points, faces = trimesh.sample.sample_surface(mesh, count, seed=0)
    return np.asarray(points), np.asarray(mesh.face_normals[faces])
