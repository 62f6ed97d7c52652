"""Exact distance that convex pieces can move along an axis until they touch triangles.

Two polyhedra that approach along z touch first where a corner of one meets a face of the other or
where two edges cross, seen along z. The distance to contact is therefore the least difference in
height over all such pairs, also for hollow obstacles. If PyBullet is installed, it checks the
result independently.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from articulate.suppress_output import suppress_output
from articulate.transforms import Array, Ints, Mask

SLIVER = 1e-5
"""Share by which a moving piece is narrowed, so that surfaces beside it do not stop it."""
TOUCH = 1e-6
"""Surfaces that overlap by at most this share of the piece's size touch."""
CHUNK = 64
"""Triangles that are processed together."""
SLICE = 4096
"""Corners, faces or edges of a hull that are processed together: they limit memory, and the time
between two checks of the time limit."""
BULLET_PAD_M = 0.001
"""Margin that PyBullet gives to shapes made of points [m]."""
BULLET_MAX = 40_000
"""Most triangles of an obstacle for PyBullet."""
NEAR_M = 0.01
"""Triangles farther than this from the box of a piece cannot touch it [m]."""
BOX_TRIANGLES = np.array(
    [
        [0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1],
        [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3],
    ]
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class Hull:
    """A convex piece."""

    points: Array
    """Corners (N, 3)."""
    faces: Ints
    """Triangles of corners (F, 3)."""

    @property
    def edges(self) -> Ints:
        """Pairs of corners (E, 2), each once."""
        pairs = np.sort(self.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
        return np.unique(pairs, axis=0)

    def moved(self, T: Array) -> Hull:
        """Return the hull moved by the homogeneous transform ``T`` (4, 4)."""
        return Hull(self.points @ T[:3, :3].T + T[:3, 3], self.faces)


@dataclass(frozen=True)
class Contact:
    """First contact of a motion along an axis."""

    distance_m: float | None
    """Distance to the first contact [m]; None without contact."""
    overlaps: bool
    """True if the piece overlaps something at the start, which does not stop it."""


def hull_of(points: Array) -> Hull:
    """Compute the convex hull of points (N, 3) [m]; their box if they are coplanar."""
    try:
        found = ConvexHull(points)
        kept, faces = np.unique(found.simplices, return_inverse=True)
        return Hull(np.asarray(points[kept]), faces.reshape(-1, 3))
    except (QhullError, ValueError):
        low, high = points.min(axis=0), points.max(axis=0)
        corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)])
        return Hull(np.where(corners == 1, high, low), BOX_TRIANGLES)


def _no_clock() -> None:
    """Do not limit the time."""


def contact_along(
    hulls: Sequence[Hull],
    triangles: Array,
    axis: int,
    sign: int,
    check_time: Callable[[], None] = _no_clock,
) -> Contact:
    """Compute the first contact of hulls that move along an axis.

    Args:
        hulls: The moving piece, in the frame of the triangles.
        triangles: Obstacles (M, 3, 3) [m].
        axis: 0, 1 or 2.
        sign: +1 or -1.
        check_time: Called repeatedly; raises after the time limit.
    """
    order = [(axis + 1) % 3, (axis + 2) % 3, axis]
    turned = triangles[:, :, order] * np.array([1.0, 1.0, sign])
    distances, overlaps = [], False
    for hull in hulls:
        points = hull.points[:, order] * np.array([1.0, 1.0, sign])
        distance, cut = _rise(Hull(points, hull.faces), turned, check_time)
        overlaps = overlaps or cut
        if distance is not None:
            distances.append(distance)
    return Contact(min(distances) if distances else None, overlaps)


def _rise(
    hull: Hull, triangles: Array, check_time: Callable[[], None]
) -> tuple[float | None, bool]:
    """Return the distance along +z to the first contact, and whether the start overlaps."""
    low, high = hull.points.min(axis=0), hull.points.max(axis=0)
    touch = TOUCH * float(np.linalg.norm(high - low))
    middle = (low[:2] + high[:2]) / 2.0
    points = hull.points.copy()
    points[:, :2] = middle + (1.0 - SLIVER) * (points[:, :2] - middle)
    faces, edges = points[hull.faces], points[hull.edges]
    mins, maxs = triangles.min(axis=1), triangles.max(axis=1)
    near: Mask = (
        (mins[:, :2] < high[:2]).all(axis=1)
        & (maxs[:, :2] > low[:2]).all(axis=1)
        & (maxs[:, 2] > low[2])
    )
    triangles, soonest = triangles[near], mins[near, 2] - high[2]
    order = np.argsort(soonest)
    best, cut = np.inf, False
    for at in range(0, len(order), CHUNK):
        chosen = order[at : at + CHUNK]
        if soonest[chosen[0]] > best:
            break
        first, last = _heights(points, faces, edges, triangles[chosen], check_time)
        inside = (first < -touch) & (last > touch)
        cut = cut or bool(inside.any())
        ahead = first[~inside & (last > touch)]
        if len(ahead):
            best = min(best, float(ahead.min()))
    return (None if best == np.inf else max(best, 0.0)), cut


def _heights(
    points: Array, faces: Array, edges: Array, triangles: Array, check_time: Callable[[], None]
) -> tuple[Array, Array]:
    """Return least and largest rise (M,) at which a hull touches each triangle, inf if never.

    Between the two it overlaps the triangle. The hull is given by its corners (N, 3), its faces
    (F, 3, 3) and its edges (E, 2, 3).
    """
    low, high = np.full(len(triangles), np.inf), np.full(len(triangles), -np.inf)
    for gaps in _gaps(points, faces, edges, triangles):
        check_time()
        low = np.minimum(low, np.where(np.isnan(gaps), np.inf, gaps).min(axis=1, initial=np.inf))
        high = np.maximum(
            high, np.where(np.isnan(gaps), -np.inf, gaps).max(axis=1, initial=-np.inf)
        )
    return low, high


def _gaps(points: Array, faces: Array, edges: Array, triangles: Array) -> Iterator[Array]:
    """Yield the heights (M, K) of the triangles over slices of the hull's corners, faces, edges."""
    corners = triangles.reshape(-1, 3)
    sides = triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2, 3)
    for at in range(0, len(points), SLICE):
        yield _over(points[at : at + SLICE], triangles)
    for at in range(0, len(faces), SLICE):
        yield -_over(corners, faces[at : at + SLICE]).T.reshape(len(triangles), -1)
    for at in range(0, len(edges), SLICE):
        yield _crossed(edges[at : at + SLICE], sides).reshape(len(triangles), -1)


def _over(points: Array, triangles: Array) -> Array:
    """Compute the height of each triangle over each point (M, N); NaN if not above it."""
    a, b, c = (triangles[:, None, k] for k in range(3))
    u, v, w = b - a, c - a, points[None] - a
    area = u[..., 0] * v[..., 1] - u[..., 1] * v[..., 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        s = (w[..., 0] * v[..., 1] - w[..., 1] * v[..., 0]) / area
        t = (u[..., 0] * w[..., 1] - u[..., 1] * w[..., 0]) / area
        height = a[..., 2] + s * u[..., 2] + t * v[..., 2] - points[None, :, 2]
        within = (s >= 0.0) & (t >= 0.0) & (s + t <= 1.0) & np.isfinite(height)
    return np.where(within, height, np.nan)


def _crossed(edges: Array, others: Array) -> Array:
    """Compute the height of ``others`` (M, 2, 3) over crossing edges (E, 2, 3), (M, E)."""
    p, r = edges[None, :, 0], edges[None, :, 1] - edges[None, :, 0]
    q, s = others[:, None, 0], others[:, None, 1] - others[:, None, 0]
    cross = r[..., 0] * s[..., 1] - r[..., 1] * s[..., 0]
    d = q - p
    with np.errstate(divide="ignore", invalid="ignore"):
        t = (d[..., 0] * s[..., 1] - d[..., 1] * s[..., 0]) / cross
        u = (d[..., 0] * r[..., 1] - d[..., 1] * r[..., 0]) / cross
        height = q[..., 2] + u * s[..., 2] - p[..., 2] - t * r[..., 2]
        within = (t >= 0) & (t <= 1) & (u >= 0) & (u <= 1) & np.isfinite(height)
    return np.where(within, height, np.nan)


def has_bullet() -> bool:
    """Return whether PyBullet is installed."""
    return importlib.util.find_spec("pybullet") is not None


def bullet_depth(hulls: Sequence[Hull], triangles: Array) -> float:
    """Compute the penetration of hulls into triangles (M, 3, 3) with PyBullet [m].

    PyBullet pads each of both by ``BULLET_PAD_M``, which is subtracted. Triangles far from the
    hulls are omitted, as at most ``BULLET_MAX`` are accepted.
    """
    reach = np.concatenate([hull.points for hull in hulls])
    near = (triangles.min(axis=1) <= reach.max(axis=0) + NEAR_M).all(axis=1)
    near &= (triangles.max(axis=1) >= reach.min(axis=0) - NEAR_M).all(axis=1)
    triangles = triangles[near][:BULLET_MAX]
    if not len(triangles):
        return 0.0
    with suppress_output():
        import pybullet  # prints a message below Python

        client = pybullet.connect(pybullet.DIRECT)
    try:
        points = triangles.reshape(-1, 3)
        still = pybullet.createCollisionShape(
            pybullet.GEOM_MESH,
            vertices=points.tolist(),
            indices=list(range(len(points))),
            flags=pybullet.GEOM_FORCE_CONCAVE_TRIMESH,
            physicsClientId=client,
        )
        obstacle = pybullet.createMultiBody(0.0, still, physicsClientId=client)
        depth = 2.0 * BULLET_PAD_M
        for hull in hulls:
            middle = hull.points.mean(axis=0)
            shape = pybullet.createCollisionShape(
                pybullet.GEOM_MESH, vertices=(hull.points - middle).tolist(), physicsClientId=client
            )
            body = pybullet.createMultiBody(
                1.0, shape, basePosition=middle.tolist(), physicsClientId=client
            )
            found = pybullet.getClosestPoints(body, obstacle, 0.0, physicsClientId=client)
            depth = max([depth, *(-entry[8] for entry in found)])
            pybullet.removeBody(body, physicsClientId=client)
        return float(depth) - 2.0 * BULLET_PAD_M
    finally:
        pybullet.disconnect(client)
