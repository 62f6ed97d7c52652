"""Convex collision shapes: boxes, hulls, cylinders and spheres in the frame of a part."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Literal

import numpy as np
import trimesh
from scipy.spatial import ConvexHull

from articulate.transforms import Array, Ints, Mask, apply, inverse, normalised

SAMPLES = 240
"""Points on the surface of a shape."""
EXACT_M = 1e-9
"""Rounding of planes [m]."""
BOX_CORNERS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)
"""Corners of the box of half side 1 (8, 3)."""


def _quasi(count: int) -> Array:
    """Spread points evenly in the unit cube (count, 3): the additive recurrence R3."""
    step = 1.0 / 1.2207440846057596 ** np.arange(1, 4)
    return np.asarray((0.5 + np.outer(np.arange(count), step)) % 1.0)


QUASI = _quasi(SAMPLES)


@dataclass(frozen=True, kw_only=True, eq=False)
class Faces:
    """Surface of a convex hull."""

    corners: Array
    """Its corners (N, 3) [m]."""
    index: Ints
    """Corners of its triangles (F, 3), counter-clockwise from outside."""
    equations: Array
    """Outward half-space of each (F, 4): inside where n x + d <= 0."""
    volume: float
    """Volume [m3]."""

    @cached_property
    def triangles(self) -> Array:
        """Corners of its triangles (F, 3, 3) [m]."""
        return self.corners[self.index]


def faces_of(hull: ConvexHull) -> Faces:
    """Return the surface of a hull of SciPy."""
    number = np.zeros(len(hull.points), dtype=np.int64)
    number[hull.vertices] = np.arange(len(hull.vertices))
    index = number[hull.simplices]
    a, b, c = np.moveaxis(hull.points[hull.simplices], 1, 0)
    inwards = np.einsum("fi,fi->f", np.cross(b - a, c - a), hull.equations[:, :3]) < 0.0
    index[inwards] = index[inwards][:, ::-1]
    return Faces(
        corners=hull.points[hull.vertices],
        index=index,
        equations=hull.equations,
        volume=float(hull.volume),
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class Shape:
    """One convex collision geom."""

    kind: Literal["box", "cylinder", "sphere", "hull"]
    T_ps: Array
    """Pose in its part (4, 4); identity for a hull."""
    half: tuple[float, float, float]
    """Half sides of a box; radius, radius, half length of a cylinder; radius of a sphere [m]."""
    vertices: Array | None = None
    """Corners of a hull in the part (N, 3) [m]."""
    piece: str = ""
    """Names of the piece that it approximates."""
    known: Faces | None = field(default=None, repr=False)
    """Surface of a hull if it was computed before."""

    @cached_property
    def mesh(self) -> trimesh.Trimesh:
        """Surface as triangles in the part [m]."""
        if self.kind == "hull":
            return trimesh.Trimesh(self.faces.corners, self.faces.index, process=False)
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
        if self.kind == "hull":
            return self.faces.volume
        return abs(float(self.mesh.volume))

    @cached_property
    def faces(self) -> Faces:
        """Hull of its corners."""
        return self.known or faces_of(ConvexHull(self.corners))

    @cached_property
    def planes(self) -> Array:
        """Outward half-spaces (M, 4): normal and offset, inside where n x + d <= 0."""
        if self.kind == "hull":
            return np.unique(self.faces.equations.round(9), axis=0)
        mesh = self.mesh
        offsets = -np.einsum("ij,ij->i", mesh.face_normals, mesh.triangles[:, 0])
        return np.unique(np.column_stack([mesh.face_normals, offsets]).round(9), axis=0)

    @cached_property
    def corners(self) -> Array:
        """Points whose hull is the shape (N, 3) [m]."""
        if self.kind == "hull" and self.vertices is not None:
            return self.vertices
        if self.kind == "box":
            return apply(self.T_ps, BOX_CORNERS * np.array(self.half))
        return np.asarray(self.mesh.vertices)

    @cached_property
    def _surface(self) -> tuple[Array, Array, Array]:
        """Triangles (F, 3, 3), outward normals (F, 3) and shares of the area up to each (F,)."""
        if self.kind == "hull":
            triangles, normals = self.faces.triangles, self.faces.equations[:, :3]
        else:
            triangles = np.asarray(self.mesh.triangles)
            edges = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
            normals = normalised(edges)
        area = np.linalg.norm(
            np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]), axis=1
        )
        return triangles, normals, np.cumsum(area) / area.sum()

    def samples(self, every: int = 1) -> tuple[Array, Array]:
        """Sample its surface by area: points (S, 3) [m] and unit outward normals (S, 3).

        Args:
            every: Stride; 1 returns all points.
        """
        quasi = QUASI[::every]
        if self.kind == "box":
            turn, half = self.T_ps[:3, :3], np.array(self.half)
            points, normals = on_boxes(half[None], quasi)
            return points[0] @ turn.T + self.T_ps[:3, 3], normals[0] @ turn.T
        triangles, normals, shares = self._surface
        index = np.minimum(np.searchsorted(shares, quasi[:, 0]), len(shares) - 1)
        a, b = quasi[:, 1], quasi[:, 2]
        flip = a + b > 1.0
        a, b = np.where(flip, 1.0 - a, a), np.where(flip, 1.0 - b, b)
        t = triangles[index]
        points = t[:, 0] + a[:, None] * (t[:, 1] - t[:, 0]) + b[:, None] * (t[:, 2] - t[:, 0])
        return points, normals[index]

    def outside(self, points: Array) -> Array:
        """Signed distance of points (N, 3) to the shape (N,) [m]; a lower bound near corners."""
        if self.kind == "box":
            local = np.abs(apply(inverse(self.T_ps), points)) - np.array(self.half)
            away = np.linalg.norm(np.maximum(local, 0.0), axis=1)
            return np.asarray(away + np.minimum(local.max(axis=1), 0.0))
        planes = self.planes
        return np.asarray((points @ planes[:, :3].T + planes[:, 3]).max(axis=1))

    def covers(self, points: Array, distance_m: float) -> Mask:
        """Return which ``points`` (N, 3) are inside or at most ``distance_m`` [m] away (N,)."""
        return np.asarray(self.distances(points, distance_m) <= distance_m)

    def distances(self, points: Array, most_m: float) -> Array:
        """Return the signed distance of points (N, 3) to the shape (N,) [m], negative inside.

        Values above ``most_m`` are lower bounds of the distance, also above ``most_m``.
        """
        away = self.outside(points)
        if self.kind == "box":
            return away
        left = np.flatnonzero(
            (away > 0.0) & (away <= most_m)
        )  # near planes, perhaps not near the shape
        if not len(left):
            return away
        equations = self.faces.equations
        heights = points[left] @ equations[:, :3].T + equations[:, 3]
        highest = heights.max(axis=1, keepdims=True)
        feet = points[left] - highest * equations[heights.argmax(axis=1), :3]
        beside = (feet @ equations[:, :3].T + equations[:, 3]).max(axis=1) > EXACT_M
        left = left[beside]  # above a face the plane gives the distance
        # The nearest point of a convex shape is on a face whose front is visible from outside.
        row, face = np.nonzero((heights > 0.0)[beside] | (heights == highest)[beside])
        outer = points[left[row]]
        nearest = trimesh.triangles.closest_point(self.faces.triangles[face], outer)
        gap = np.linalg.norm(nearest - outer, axis=1)
        found = np.full(len(left), np.inf)
        np.minimum.at(found, row, gap)
        away[left] = found
        return away

    @cached_property
    def bounds(self) -> Array:
        """Lowest and highest corner in the part (2, 3) [m]."""
        return np.stack([self.corners.min(axis=0), self.corners.max(axis=0)])


def on_boxes(half: Array, quasi: Array) -> tuple[Array, Array]:
    """Sample boxes around the origin by area: points [m] and unit normals (B, S, 3).

    Args:
        half: Half sides (B, 3) [m].
        quasi: Points spread over the unit cube (S, 3).
    """
    area = half[:, [1, 0, 0]] * half[:, [2, 2, 1]]
    edges = np.cumsum(area, axis=1) / area.sum(axis=1, keepdims=True)
    axis = (quasi[None, :, 0, None] > edges[:, None, :2]).sum(axis=-1)
    sign = np.where(np.arange(len(quasi)) % 2 == 0, 1.0, -1.0)
    local, normals = np.empty((2, *axis.shape, 3))
    for k in range(3):
        own, next_ = axis == k, axis == (k + 2) % 3
        across = np.where(next_, 2.0 * quasi[:, 1] - 1.0, 2.0 * quasi[:, 2] - 1.0)
        local[..., k] = np.where(own, sign, across)
        normals[..., k] = np.where(own, sign, 0.0)
    return local * half[:, None], normals


def sample_surface(mesh: trimesh.Trimesh, count: int) -> tuple[Array, Array]:
    """Sample ``mesh`` by area, equally on each call: points [m] and face normals, (count, 3)."""
    points, faces = trimesh.sample.sample_surface(mesh, count, seed=0)
    return np.asarray(points), np.asarray(mesh.face_normals[faces])
