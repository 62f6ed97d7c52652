"""Convex shapes for thin curved walls: the surface is split until each patch is nearly flat.

Buckets, bottles and pots are shells. A decomposition of their volume cuts along fixed axes and
fills what is hollow; splitting the surface itself gives staves.
"""

from __future__ import annotations

import heapq
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import trimesh
from scipy.spatial import ConvexHull, QhullError

from articulate.convert.fit import THIN_M, fitted, hull, thick
from articulate.convert.shapes import Shape
from articulate.transforms import Array, Ints, Mask

MOST_FACES = 40_000
"""Larger meshes are left to the decomposition."""
MOST_POINTS = 1500
"""So many corners at most decide where a patch is split."""
FACING = 0.7
"""Triangles whose normals have this cosine with an axis count as facing along it."""
SAMPLES = 4000
"""Points on the surface that say what is covered already."""
PLANES = 0.6
"""Distances from planes are too short near edges: what is this share of them away is near."""
SMALL = 3.0
"""Patches up to this many tolerances wide collide as their hull."""
AHEAD = 3
"""So many ways to split a patch are judged by what the next split would gain."""
LEAST_FACES = 2
"""A patch of fewer triangles is not split."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Patch:
    """Some triangles of a mesh."""

    faces: Ints
    """Their numbers (F,)."""


def shell_shapes(mesh: trimesh.Trimesh, tol: float, piece: str, most: int) -> list[Shape] | None:
    """Boxes and hulls of patches of ``mesh`` that stray from it by at most ``tol`` [m].

    Large patches come first; what they cover already needs no shape of its own.

    Args:
        mesh: One connected component.
        tol: How far a shape may stray [m].
        piece: Names for the shapes.
        most: Given up beyond this many patches.
    """
    if len(mesh.faces) > MOST_FACES:
        return None
    spread, owners = trimesh.sample.sample_surface(mesh, SAMPLES, seed=0)
    waiting = [(0.0, 0, Patch(faces=np.arange(len(mesh.faces))))]
    done: list[Shape] = []
    count = 0
    while waiting:
        if len(done) > most:
            return None
        _, _, patch = heapq.heappop(waiting)
        points = _corners(mesh, patch.faces)
        inner = np.asarray(spread)[np.isin(owners, patch.faces)]
        if _covered(np.vstack([points, inner]), done, PLANES * tol):
            continue
        small = float(np.ptp(points, axis=0).max()) <= SMALL * tol
        shape = hull(thick(points, tol), piece) if small else fitted(points, mesh, tol, piece)
        parts = _split(mesh, patch) if shape is None else None
        if parts is None:
            shape = shape or hull(thick(points, tol), piece)
            done += [] if shape is None else [shape]
        else:
            for part in parts:
                count += 1
                heapq.heappush(waiting, (-float(mesh.area_faces[part.faces].sum()), count, part))
    return done


def _covered(points: Array, shapes: list[Shape], tol: float) -> bool:
    """Whether each of ``points`` (N, 3) lies within ``tol`` [m] of one of ``shapes``."""
    left = points
    for shape in shapes:
        if not len(left):
            return True
        left = left[shape.outside(left) > tol]
    return not len(left)


def _corners(mesh: trimesh.Trimesh, faces: Ints) -> Array:
    return np.asarray(mesh.vertices[np.unique(mesh.faces[faces])])


def _split(mesh: trimesh.Trimesh, patch: Patch) -> tuple[Patch, Patch] | None:
    """The two patches that promise the least hull volume after one more split of each.

    Only the splits that are best by themselves are looked at so far ahead.
    """
    found = [(parts, [_volume(mesh, part) for part in parts]) for parts in _halves(mesh, patch)]
    found = sorted(found, key=lambda item: sum(item[1]))[:AHEAD]
    best: tuple[float, tuple[Patch, Patch]] | None = None
    for parts, volumes in found:
        volume = sum(min(v, _halved(mesh, p)) for p, v in zip(parts, volumes, strict=True))
        if best is None or volume < 0.999 * best[0]:
            best = (volume, parts)
    return None if best is None else best[1]


def _halved(mesh: trimesh.Trimesh, patch: Patch) -> float:
    """Volume of the hulls of both halves of ``patch``, as small as a split makes it [m3]."""
    halves = _halves(mesh, patch)
    return min((sum(_volume(mesh, part) for part in parts) for parts in halves), default=np.inf)


def _halves(mesh: trimesh.Trimesh, patch: Patch) -> Iterator[tuple[Patch, Patch]]:
    """Ways to split a patch: by place along its axes, and by which way triangles face."""
    if len(patch.faces) < LEAST_FACES:
        return
    area = np.maximum(mesh.area_faces[patch.faces], 1e-12)
    centres = np.asarray(mesh.triangles_center[patch.faces])
    normals = np.asarray(mesh.face_normals[patch.faces])
    middle = np.average(centres, axis=0, weights=area)
    offset = centres - middle
    _, axes = np.linalg.eigh((offset * area[:, None]).T @ offset)
    for axis in axes.T[::-1]:  # longest first
        yield from _parts(patch, offset @ axis > 0.0)
        yield from _parts(patch, np.abs(normals @ axis) > FACING)


def _parts(patch: Patch, chosen: Mask) -> Iterator[tuple[Patch, Patch]]:
    if chosen.any() and not chosen.all():
        yield Patch(faces=patch.faces[chosen]), Patch(faces=patch.faces[~chosen])


def _volume(mesh: trimesh.Trimesh, patch: Patch) -> float:
    """Volume of the convex hull of a patch at least as thick as a shape is [m3]."""
    points = _corners(mesh, patch.faces)
    points = points[:: max(1, len(points) // MOST_POINTS)]
    flat = float(mesh.area_faces[patch.faces].sum()) * THIN_M
    if len(points) < 4:
        return flat
    try:
        return max(float(ConvexHull(points).volume), flat)
    except QhullError:
        return flat
