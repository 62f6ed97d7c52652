"""Collision shapes of the engine as solids, for point queries."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from articulate.checks.model import Model, ObjectModel
from articulate.checks.surface import is_near, sample
from articulate.simulator import mujoco
from articulate.transforms import (
    Array,
    Ints,
    Mask,
    apply,
    inverse,
    normalised,
    pose,
    quat_to_matrix,
)

Kind = Literal["box", "sphere", "ellipsoid", "capsule", "cylinder", "hull"]
KINDS: dict[int, Kind] = {
    int(mujoco.mjtGeom.mjGEOM_BOX): "box",
    int(mujoco.mjtGeom.mjGEOM_SPHERE): "sphere",
    int(mujoco.mjtGeom.mjGEOM_ELLIPSOID): "ellipsoid",
    int(mujoco.mjtGeom.mjGEOM_CAPSULE): "capsule",
    int(mujoco.mjtGeom.mjGEOM_CYLINDER): "cylinder",
    int(mujoco.mjtGeom.mjGEOM_MESH): "hull",
}
CORNERS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)
BOX = np.array(
    [
        [0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1],
        [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3],
    ]
)  # fmt: skip
"""Triangles of ``CORNERS``, counter-clockwise from outside."""
SEAM_M = 0.0005
"""Solids nearer than this to each other hide the faces between them [m]."""
ROUND = 32
"""Corners of the polygon that approximates a circle for sampling a surface."""
NEWTON_STEPS = 30
"""Steps to the point of an ellipsoid next to another; a handful settles all but needles."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Solid:
    """One convex collision geom in the frame of its link."""

    geom: int
    kind: Kind
    T_lg: Array
    """Pose of the geom in its link (4, 4)."""
    size: Array
    """MuJoCo's three numbers [m]; not used by hulls."""
    triangles: Array
    """Its surface in the frame of the link (F, 3, 3) [m]; round ones by their polygons."""
    planes: Array
    """Half-spaces of a hull in the frame of the link (M, 4), inside where n x + d <= 0."""

    def outside_m(self, points: Array) -> Array:
        """Return the distances (N,) of ``points`` (N, 3) outside [m]; at most 0 inside.

        A lower bound for hulls, and an upper bound inside an ellipsoid.
        """
        if self.kind == "hull":
            return np.asarray((points @ self.planes[:, :3].T + self.planes[:, 3]).max(axis=1))
        local = apply(inverse(self.T_lg), points)
        if self.kind == "box":
            return _rounded(np.abs(local) - self.size)
        if self.kind == "sphere":
            return np.asarray(np.linalg.norm(local, axis=1) - self.size[0])
        if self.kind == "ellipsoid":
            return _outside_ellipsoid_m(local, self.size)
        if self.kind == "capsule":
            beyond = np.maximum(np.abs(local[:, 2]) - self.size[1], 0.0)
            return np.asarray(np.hypot(np.hypot(local[:, 0], local[:, 1]), beyond) - self.size[0])
        radial = np.hypot(local[:, 0], local[:, 1]) - self.size[0]
        return _rounded(np.stack([radial, np.abs(local[:, 2]) - self.size[1]], axis=1))

    def is_within(self, points: Array, distance_m: float) -> Mask:
        """Return a mask (N,) of ``points`` (N, 3) inside it or at most ``distance_m`` away [m]."""
        away = self.outside_m(points)
        near = away <= distance_m
        if self.kind != "hull":
            return np.asarray(near)
        doubtful = np.flatnonzero(near & (away > 0.0))  # near planes, not near the hull for sure
        near[doubtful] = is_near(points[doubtful], self.triangles, distance_m)
        return np.asarray(near)


def solids_of(model: ObjectModel, link: str) -> tuple[Solid, ...]:
    """Return the collision shapes of ``link``, hulls with the corners that the engine keeps.

    Types reported by ``unknown_shape`` and hulls without volume are omitted.
    """
    return tuple(
        solid
        for geom in model.collision_geoms(link).tolist()
        if (solid := _solid(model.model, geom)) is not None
    )


def unknown_shape(model: ObjectModel, link: str) -> str:
    """Return why a collision shape of ``link`` cannot be measured; empty if all can."""
    m = model.model
    for geom in model.collision_geoms(link).tolist():
        kind = int(m.geom_type[geom])
        if kind not in KINDS:
            name = m.geom(geom).name or f"number {geom}"
            word = mujoco.mjtGeom(kind).name.removeprefix("mjGEOM_").lower()
            known = ", ".join(k if k != "hull" else "mesh" for k in KINDS.values())
            return (
                f"collision shape {name} of {link} is of type {word}, which cannot be measured; "
                f"use {known}"
            )
    return ""


def inside_any(solids: tuple[Solid, ...], points: Array) -> Mask:
    """Return a mask (N,) of ``points`` (N, 3) [m] in at least one of ``solids``."""
    found = np.zeros(len(points), dtype=bool)
    for solid in solids:
        left = np.flatnonzero(~found)
        found[left] = solid.outside_m(points[left]) <= 0.0
    return found


def within_any(solids: tuple[Solid, ...], points: Array, distance_m: float) -> Mask:
    """Return a mask (N,) of ``points`` (N, 3) at most ``distance_m`` from ``solids`` [m]."""
    found = np.zeros(len(points), dtype=bool)
    for solid in solids:
        left = np.flatnonzero(~found)
        found[left] = solid.is_within(points[left], distance_m)
    return found


def union_surface(solids: tuple[Solid, ...], count: int) -> Array:
    """Up to ``count`` points (N, 3) on the surface of the union of ``solids``, by area.

    Faces with which two solids lie against each other are no part of it.
    """
    if not solids:
        return np.zeros((0, 3))
    triangles = np.concatenate([s.triangles for s in solids])
    points, owners = sample(triangles, count)
    ends = np.cumsum([len(s.triangles) for s in solids])
    owner = np.searchsorted(ends, owners, side="right")
    centres = np.stack([s.triangles.reshape(-1, 3).mean(axis=0) for s in solids])
    above = points + SEAM_M * _outwards(triangles[owners], centres[owner])
    hidden = np.zeros(len(points), dtype=bool)
    for k, solid in enumerate(solids):
        others = np.flatnonzero((owner != k) & ~hidden)
        hidden[others] = solid.outside_m(above[others]) < 0.0
    return np.asarray(points[~hidden])


def _outwards(triangles: Array, centres: Array) -> Array:
    """Return unit normals (N, 3) of triangles (N, 3, 3) of convex solids, pointing outwards."""
    edges = triangles[:, 1:] - triangles[:, :1]
    normals = np.cross(edges[:, 0], edges[:, 1])
    inwards = np.einsum("ni,ni->n", normals, triangles[:, 0] - centres) < 0.0
    return normalised(np.where(inwards[:, None], -normals, normals))


def _rounded(over: Array) -> Array:
    """Distance to a box from how far each coordinate is over its side (N, k) -> (N,)."""
    away = np.linalg.norm(np.maximum(over, 0.0), axis=1)
    return np.asarray(away + np.minimum(over.max(axis=1), 0.0))


def _outside_ellipsoid_m(points: Array, radii: Array) -> Array:
    """Distance of ``points`` (N, 3) to an ellipsoid at the origin; inside at most minus it (N,).

    The next point is ``r^2 y / (t + r^2)`` with the t at which it is on the surface: the root
    of a convex falling function, which Newton's method reaches from its left (Eberly, Distance
    from a Point to an Ellipse, an Ellipsoid, or a Hyperellipsoid).
    """
    radial = np.linalg.norm(points / radii, axis=1)
    away = (radial - 1.0) * radii.min()  # a ball of so much around a point inside is inside, too
    outer = np.flatnonzero(radial > 1.0)
    y = np.abs(points[outer])
    t = np.maximum((radii * y - radii**2).max(axis=1, initial=0.0), 0.0)
    for _ in range(NEWTON_STEPS):
        share = radii * y / (t[:, None] + radii**2)
        value = (share**2).sum(axis=1) - 1.0
        slope = 2.0 * (share**2 / (t[:, None] + radii**2)).sum(axis=1)
        t += np.maximum(value / slope, 0.0)
    away[outer] = np.linalg.norm(y - radii**2 * y / (t[:, None] + radii**2), axis=1)
    return np.asarray(away)


def _solid(m: Model, geom: int) -> Solid | None:
    kind = KINDS.get(int(m.geom_type[geom]))
    if kind is None:
        return None
    T_lg = pose(m.geom_pos[geom], quat_to_matrix(m.geom_quat[geom]))
    size = np.array(m.geom_size[geom], dtype=np.float64)
    planes = np.zeros((0, 4))
    if kind == "hull":
        hull = _hull(apply(T_lg, _hull_corners(m, int(m.geom_dataid[geom]))))
        if hull is None:
            return None
        triangles, planes = hull.points[hull.simplices], hull.equations
    else:
        triangles = apply(T_lg, _primitive(kind, size))
    return Solid(geom=geom, kind=kind, T_lg=T_lg, size=size, triangles=triangles, planes=planes)


def _hull_corners(m: Model, mesh: int) -> Array:
    """Corners (V, 3) of the hull that MuJoCo collides, in the frame of the geom."""
    first, number = int(m.mesh_vertadr[mesh]), int(m.mesh_vertnum[mesh])
    corners = np.asarray(m.mesh_vert[first : first + number], dtype=np.float64)
    graph = int(m.mesh_graphadr[mesh])
    if graph < 0:
        return corners
    count = int(m.mesh_graph[graph])
    kept: Ints = np.asarray(m.mesh_graph[graph + 2 + count : graph + 2 + 2 * count])
    return np.asarray(corners[kept])


def _hull(corners: Array) -> ConvexHull | None:
    for options in (None, "QJ"):  # joggled where corners are coplanar to rounding
        try:
            return ConvexHull(corners, qhull_options=options)
        except (QhullError, ValueError):
            continue
    return None


def _primitive(kind: Kind, size: Array) -> Array:
    """Triangles (F, 3, 3) of a primitive in its own frame."""
    if kind == "box":
        return np.asarray((CORNERS * size)[BOX])
    if kind == "ellipsoid":
        return _primitive("sphere", np.ones(3)) * size
    angle = np.linspace(0.0, 2.0 * np.pi, ROUND, endpoint=False)
    ring = np.stack([np.cos(angle), np.sin(angle), np.zeros(ROUND)], axis=1) * size[0]
    if kind == "cylinder":
        up = np.array([0.0, 0.0, size[1]])
        corners = np.vstack([ring + up, ring - up])
    else:
        half = size[1] if kind == "capsule" else 0.0
        heights = np.linspace(0.0, np.pi / 2.0, ROUND // 4)
        rings = [
            ring * np.cos(a) + np.array([0.0, 0.0, half + size[0] * np.sin(a)]) for a in heights
        ]
        corners = np.vstack([*rings, *(r * np.array([1.0, 1.0, -1.0]) for r in rings)])
    hull = ConvexHull(corners, qhull_options="QJ")
    return np.asarray(hull.points[hull.simplices])
