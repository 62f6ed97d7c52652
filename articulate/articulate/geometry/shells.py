"""Convex shapes for thin curved walls: the surface is split until each patch is nearly flat.

Buckets, bottles and pots are shells. A decomposition of their volume cuts along fixed axes and
fills cavities; splitting the surface itself gives staves.
"""

from __future__ import annotations

import functools
import heapq
from collections.abc import Iterator
from functools import cached_property

import numpy as np
import trimesh
from scipy.spatial import ConvexHull, QhullError

from articulate.geometry.convex_fit import DIRECTIONS, THIN_M, Fit, hull, spanning, thick, thin_m
from articulate.geometry.rays import NOTHING, Surface
from articulate.geometry.shapes import Shape
from articulate.geometry.time_budget import UNLIMITED, Budget
from articulate.transforms import Array, Ints, Mask

MOST_FACES = 200_000
"""Most triangles; larger meshes are decomposed."""
FEW_DIRECTIONS = DIRECTIONS[::3]
"""Directions whose extreme corners decide the split of a patch."""
FACING = 0.7
"""Cosine between a normal and an axis above which a triangle faces along the axis."""
SAMPLES = 4000
"""Points on the surface that measure the coverage."""
COVERED = 0.6
"""Distance, as a fraction of the tolerance, up to which a point is covered by other shapes."""
SMALL = 3.0
"""Width of a patch, in tolerances, up to which it becomes its hull."""
AHEAD = 3
"""Candidate splits of a patch that are evaluated one split ahead."""
ROUGHLY = 1000
"""Triangles of a patch that are used to estimate the volume of its hull."""
LEAST_FACES = 2
"""Least number of triangles of a patch that is split."""
KEPT = 64
"""Number of surfaces whose splits are cached."""


class Sheet:
    """Surface that is split; equal if its content is equal.

    Args:
        mesh: One connected component.
        hollow: Points (H, 3) that shapes must leave free [m].
    """

    def __init__(self, mesh: trimesh.Trimesh, hollow: Array = NOTHING) -> None:
        self.hollow = hollow
        self.vertices = np.asarray(mesh.vertices, dtype=np.float64)
        self.faces = np.asarray(mesh.faces)
        self._mesh = mesh

    def __hash__(self) -> int:
        return hash((self.vertices.tobytes(), self.faces.tobytes(), self.hollow.tobytes()))

    def __eq__(self, other: object) -> bool:
        return (
            isinstance(other, Sheet)
            and np.array_equal(self.vertices, other.vertices)
            and np.array_equal(self.faces, other.faces)
            and np.array_equal(self.hollow, other.hollow)
        )

    def prepare(self) -> None:
        """Compute the quantities that patches need."""
        mesh = self._mesh
        self.surface = Surface(mesh, self.hollow)
        self.area = np.asarray(mesh.area_faces)
        self.centres = np.asarray(mesh.triangles_center)
        self.normals = np.asarray(mesh.face_normals)
        spread, owners = trimesh.sample.sample_surface(mesh, SAMPLES, seed=0)
        self.spread, self.owners = np.asarray(spread), np.asarray(owners)


class Patch:
    """Subset of the triangles of a sheet, with cached properties.

    Args:
        sheet: The complete surface.
        faces: Indices of the triangles (F,).
    """

    def __init__(self, sheet: Sheet, faces: Ints) -> None:
        self.sheet = sheet
        self.faces = faces
        self._fits: dict[tuple[str, float], Fit] = {}

    @cached_property
    def area(self) -> float:
        """Area of its triangles [m2]."""
        return float(self.sheet.area[self.faces].sum())

    @cached_property
    def corners(self) -> Array:
        """Corners of its triangles (N, 3) [m]."""
        used = np.zeros(len(self.sheet.vertices), dtype=bool)
        used[self.sheet.faces[self.faces]] = True
        return self.sheet.vertices[used]

    @cached_property
    def spread(self) -> Array:
        """Points that measure the coverage: corners and some on the triangles (N, 3) [m]."""
        own = np.zeros(len(self.sheet.faces), dtype=bool)
        own[self.faces] = True
        return np.vstack([self.corners, self.sheet.spread[own[self.sheet.owners]]])

    @cached_property
    def volume(self) -> float:
        """Volume of its convex hull, at least as thick as a shape is [m3]."""
        every = max(1, len(self.faces) // ROUGHLY)
        some = self.corners
        if every > 1:
            some = self.sheet.vertices[self.sheet.faces[self.faces[::every]].reshape(-1)]
        points = spanning(some, FEW_DIRECTIONS)
        flat = self.area * THIN_M
        if len(points) < 4:
            return flat
        try:
            return max(float(ConvexHull(points).volume), flat)
        except QhullError:
            return flat

    @cached_property
    def halves(self) -> tuple[tuple[Patch, Patch], ...]:
        """Candidate splits, by position along its axes and by the direction of the normals."""
        return tuple(self._halves())

    def _halves(self) -> Iterator[tuple[Patch, Patch]]:
        if len(self.faces) < LEAST_FACES:
            return
        area = np.maximum(self.sheet.area[self.faces], 1e-12)
        centres = self.sheet.centres[self.faces]
        normals = self.sheet.normals[self.faces]
        offset = centres - np.average(centres, axis=0, weights=area)
        _, axes = np.linalg.eigh((offset * area[:, None]).T @ offset)
        for axis in axes.T[::-1]:  # longest first
            yield from self._parts(offset @ axis > 0.0)
            yield from self._parts(np.abs(normals @ axis) > FACING)

    def _parts(self, chosen: Mask) -> Iterator[tuple[Patch, Patch]]:
        if chosen.any() and not chosen.all():
            yield Patch(self.sheet, self.faces[chosen]), Patch(self.sheet, self.faces[~chosen])

    @cached_property
    def halved(self) -> float:
        """Least volume of the hulls of both halves over all splits [m3]."""
        return min((one.volume + two.volume for one, two in self.halves), default=np.inf)

    @cached_property
    def split(self) -> tuple[Patch, Patch] | None:
        """The split with the least hull volume after one more split of each half.

        Only the ``AHEAD`` best splits are evaluated that far.
        """
        found = sorted(self.halves, key=lambda parts: parts[0].volume + parts[1].volume)[:AHEAD]
        best: tuple[float, tuple[Patch, Patch]] | None = None
        for parts in found:
            volume = sum(min(part.volume, part.halved) for part in parts)
            if best is None or volume < 0.999 * best[0]:
                best = (volume, parts)
        self.halves = () if best is None else (best[1],)  # the others are not needed again
        return None if best is None else best[1]

    def fit(self, tol: float, piece: str) -> Shape | None:
        """Return the shape that fits the patch within ``tol`` [m], or None."""
        key = (piece, thin_m(tol))
        if key not in self._fits:
            points = thick(self.corners, tol, self.sheet.hollow)
            self._fits[key] = Fit(points, self.sheet.surface, piece)
        return self._fits[key].best(tol)


@functools.lru_cache(maxsize=KEPT)
def _full_patch(sheet: Sheet) -> Patch:
    """All of a sheet, cached: shapes are made more than once for the same surface."""
    sheet.prepare()
    return Patch(sheet, np.arange(len(sheet.faces)))


def shell_shapes(
    mesh: trimesh.Trimesh,
    tol: float,
    piece: str,
    most: int,
    hollow: Array = NOTHING,
    budget: Budget = UNLIMITED,
) -> list[Shape] | None:
    """Approximate ``mesh`` by boxes and hulls of patches within ``tol`` [m].

    Large patches come first; patches that they cover are dropped.

    Args:
        mesh: One connected component [m].
        tol: Largest distance of a shape to it [m].
        piece: Names for the shapes.
        most: Number of shapes above which None is returned.
        hollow: Points (H, 3) that the shapes must leave free [m].
        budget: Processor time.
    """
    if len(mesh.faces) > MOST_FACES:
        return None
    waiting = [(0.0, 0, _full_patch(Sheet(mesh, hollow)))]
    done: list[Shape] = []
    count = 0
    while waiting:
        budget.check()
        if len(done) > most:
            return None
        _, _, patch = heapq.heappop(waiting)
        if _covered(patch.spread, done, COVERED * tol):
            continue
        points = patch.corners
        small = float(np.ptp(points, axis=0).max()) <= SMALL * tol
        shape = hull(thick(points, tol, hollow), piece) if small else patch.fit(tol, piece)
        parts = patch.split if shape is None else None
        if parts is None:
            shape = shape or hull(thick(points, tol, hollow), piece)
            done += [] if shape is None else [shape]
        else:
            for part in parts:
                count += 1
                heapq.heappush(waiting, (-part.area, count, part))
    return done


def staves(
    mesh: trimesh.Trimesh,
    tol: float,
    piece: str,
    most: int,
    hollow: Array = NOTHING,
    budget: Budget = UNLIMITED,
) -> list[Shape] | None:
    """Approximate ``mesh`` by at most ``most`` patches with as little extra volume as possible.

    The patch with the largest hull is split first. Patches left at the limit become their hulls,
    even if these exceed the tolerance.

    Args:
        mesh: One connected component [m].
        tol: Distance up to which a shape is not split [m].
        piece: Names for the shapes.
        most: Largest number of shapes.
        hollow: Points (H, 3) that shapes should leave free [m].
        budget: Processor time.
    """
    if len(mesh.faces) > MOST_FACES:
        return None
    first = _full_patch(Sheet(mesh, hollow))
    waiting = [(-first.volume, 0, first)]
    done: list[Shape] = []
    count = 0
    while waiting:
        budget.check()
        _, _, patch = heapq.heappop(waiting)
        if _covered(patch.spread, done, COVERED * tol):
            continue
        points = patch.corners
        small = float(np.ptp(points, axis=0).max()) <= SMALL * tol
        shape = None if small else patch.fit(tol, piece)
        full = len(done) + len(waiting) + 2 > most
        parts = None if small or full or shape is not None else patch.split
        if parts is None:
            shape = shape or hull(thick(points, tol, hollow), piece)
            done += [] if shape is None else [shape]
        else:
            for part in parts:
                count += 1
                heapq.heappush(waiting, (-part.volume, count, part))
    return done


def _covered(points: Array, shapes: list[Shape], tol: float) -> bool:
    """Return whether each of ``points`` (N, 3) is within ``tol`` [m] of one of ``shapes``."""
    left = points
    for shape in shapes:
        if not len(left):
            return True
        left = left[~shape.covers(left, tol)]
    return not len(left)
