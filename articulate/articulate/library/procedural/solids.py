"""Solids that parts are made of: what is seen of them, and the convex pieces they collide as."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal, Protocol, Self

import numpy as np

from articulate.assets.asset import Vec3
from articulate.transforms import Array, Ints

ROUND = 32
"""Corners of a circle that is seen; every second is one of the circle that is touched."""
COARSE = 2.0 / (1.0 + math.cos(2.0 * math.pi / ROUND))
"""Factor on the latter's radius: it strays by 1 % to both sides."""
Mesh = tuple[Array, Ints]
"""Corners (V, 3) [m] and triangles (F, 3), counter-clockwise seen from outside."""
_CORNERS = ((0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1))
_TRIANGLES = (
    *((0, 2, 1), (0, 3, 2), (4, 5, 6), (4, 6, 7)),  # below, above
    *((0, 1, 5), (0, 5, 4), (2, 3, 7), (2, 7, 6)),  # -y, +y
    *((0, 4, 7), (0, 7, 3), (1, 2, 6), (1, 6, 5)),  # -x, +x
)
"""Two counter-clockwise triangles a side of a box."""
WEDGES = ((0.05, 12), (0.10, 16), (0.20, 24), (math.inf, 32))
"""Largest radius [m] and number of wedges of a ring: they stray by less than 2 mm."""
_CUT = ((0, 1, 2), (0, 2, 3), (1, 0, 3), (1, 3, 2))
"""A flat outline from both sides, along either diagonal: no triangle occurs twice."""
INSET_M = 0.0003
"""Depth of the cuts between wedges below the surface [m], which keeps its shading."""


@dataclass(frozen=True, kw_only=True)
class Collider:
    """A convex piece of a solid."""

    kind: Literal["box", "cylinder", "mesh"]
    """URDF's word."""
    centre: Vec3 = (0.0, 0.0, 0.0)
    """Its middle [m]; the origin for a mesh."""
    rpy: Vec3 = (0.0, 0.0, 0.0)
    """Its rotation in roll, pitch, yaw [rad]."""
    size: tuple[float, ...] = ()
    """Sides of a box; radius and length of a cylinder [m]."""
    mesh: Mesh | None = None
    """Its hull, for a mesh."""


class Solid(Protocol):
    """A body of one density, with a closed surface."""

    @property
    def name(self) -> str:
        """Name, unique within a shape."""
        ...

    @property
    def density_kg_m3(self) -> float:
        """Density [kg/m^3]."""
        ...

    def mesh(self) -> Mesh:
        """Its surface."""
        ...

    def colliders(self) -> tuple[Collider, ...]:
        """Convex pieces that stand for it."""
        ...

    def seen_from(self, origin: Vec3) -> Self:
        """Return the same solid in a parallel frame whose origin is at ``origin`` [m]."""
        ...


@dataclass(frozen=True, kw_only=True)
class Box:
    """A solid box with sides along the axes of its frame."""

    name: str = ""
    low: Vec3
    """Lowest corner [m]."""
    high: Vec3
    """Highest corner [m]."""
    density_kg_m3: float = 0.0

    @property
    def size(self) -> Vec3:
        """Edge lengths [m]."""
        return _sub(self.high, self.low)

    @property
    def centre(self) -> Vec3:
        """Middle of the box [m]."""
        (x0, y0, z0), (x1, y1, z1) = self.low, self.high
        return ((x0 + x1) / 2, (y0 + y1) / 2, (z0 + z1) / 2)

    def mesh(self) -> Mesh:
        """8 corners, 12 triangles."""
        ends = np.array([self.low, self.high])
        corners = np.stack([ends[list(c), range(3)] for c in _CORNERS])
        return corners, np.array(_TRIANGLES)

    def colliders(self) -> tuple[Collider, ...]:
        """Itself."""
        return (Collider(kind="box", centre=self.centre, size=self.size),)

    def seen_from(self, origin: Vec3) -> Box:
        """Return the same box in a parallel frame whose origin is at ``origin`` [m]."""
        return replace(self, low=_sub(self.low, origin), high=_sub(self.high, origin))


@dataclass(frozen=True, kw_only=True)
class Loft:
    """A convex solid between two flat convex outlines with as many corners each."""

    name: str = ""
    low: tuple[Vec3, ...]
    """Corners of one outline in turn [m]."""
    high: tuple[Vec3, ...]
    """Corners of the other, each opposite to its own [m]."""
    density_kg_m3: float = 0.0

    def mesh(self) -> Mesh:
        """Both outlines as fans, two triangles between each pair of edges."""
        n = len(self.low)
        corners = np.array([*self.low, *self.high], dtype=np.float64)
        faces = [(0, k + 1, k) for k in range(1, n - 1)]
        faces += [(n, n + k, n + k + 1) for k in range(1, n - 1)]
        for k in range(n):
            j = (k + 1) % n
            faces += [(k, j, n + j), (k, n + j, n + k)]
        triangles = np.array(faces)
        if volume(corners, triangles) < 0.0:
            triangles = triangles[:, ::-1]
        return corners, triangles

    def colliders(self) -> tuple[Collider, ...]:
        """Its hull, of every second corner where it is round."""
        if len(self.low) < ROUND:
            return (Collider(kind="mesh", mesh=self.mesh()),)
        low, high = (np.array(end)[::2] for end in (self.low, self.high))
        low, high = (end.mean(axis=0) + COARSE * (end - end.mean(axis=0)) for end in (low, high))
        return (Collider(kind="mesh", mesh=Loft(low=_corners(low), high=_corners(high)).mesh()),)

    def seen_from(self, origin: Vec3) -> Loft:
        """Return the same solid in a parallel frame whose origin is at ``origin`` [m]."""
        low = tuple(_sub(corner, origin) for corner in self.low)
        return replace(self, low=low, high=tuple(_sub(corner, origin) for corner in self.high))


@dataclass(frozen=True, kw_only=True)
class Rod:
    """A round bar from one point to another."""

    name: str = ""
    start: Vec3
    """Middle of one end [m]."""
    end: Vec3
    """Middle of the other end [m]."""
    radius_m: float
    """Radius [m]."""
    density_kg_m3: float = 0.0

    def mesh(self) -> Mesh:
        """Build a prism."""
        along = np.subtract(self.end, self.start)
        along = along / np.linalg.norm(along)
        u = np.cross(along, np.eye(3)[int(np.argmin(np.abs(along)))])
        u = u / np.linalg.norm(u)
        turn = 2.0 * math.pi * np.arange(ROUND) / ROUND
        ring = self.radius_m * (
            np.cos(turn)[:, None] * u + np.sin(turn)[:, None] * np.cross(along, u)
        )
        return Loft(low=_corners(ring + self.start), high=_corners(ring + self.end)).mesh()

    def colliders(self) -> tuple[Collider, ...]:
        """Build a cylinder."""
        dx, dy, dz = _sub(self.end, self.start)
        (x0, y0, z0), (x1, y1, z1) = self.start, self.end
        return (
            Collider(
                kind="cylinder",
                centre=((x0 + x1) / 2, (y0 + y1) / 2, (z0 + z1) / 2),
                rpy=(0.0, math.atan2(math.hypot(dx, dy), dz), math.atan2(dy, dx)),
                size=(self.radius_m, math.dist(self.start, self.end)),
            ),
        )

    def seen_from(self, origin: Vec3) -> Rod:
        """Return the same bar in a parallel frame whose origin is at ``origin`` [m]."""
        return replace(self, start=_sub(self.start, origin), end=_sub(self.end, origin))


@dataclass(frozen=True, kw_only=True)
class Ring:
    """A hollow round body: a pipe, a rim, the wall of a bucket. It is made of wedges."""

    name: str = ""
    axis: int = 2
    """Its axis: 0, 1 or 2."""
    centre: Vec3 = (0.0, 0.0, 0.0)
    """A point of the axis from which ``low`` and ``high`` are measured [m]."""
    low: Vec3
    """Begin along the axis, inner and outer radius there [m]."""
    high: Vec3
    """End along the axis, inner and outer radius there [m]."""
    stretch: tuple[float, float] = (1.0, 1.0)
    """Factors on the two coordinates across the axis, in turn: makes it oval."""
    segments: int = 0
    """Number of collision wedges, twice as many visual ones; 0: depends on the radius."""
    density_kg_m3: float = 0.0

    @property
    def wedges(self) -> int:
        """Number of convex pieces."""
        if self.segments:
            return self.segments
        radius = max(self.low[2], self.high[2]) * max(self.stretch)
        return next((count for most, count in WEDGES if radius <= most), WEDGES[-1][1])

    def mesh(self) -> Mesh:
        """Its surface, and both sides of the cuts between its wedges."""
        n = 2 * self.wedges
        rings = self._circles(n)
        faces: list[tuple[int, ...]] = []
        for k in range(n):
            j = (k + 1) % n
            for a, b in ((0, 2), (3, 1), (1, 0), (2, 3)):  # outside, inside, low end, high end
                faces.append((a * n + k, a * n + j, b * n + j))
                faces.append((a * n + k, b * n + j, b * n + k))
        corners = [*rings]
        for k in range(0, n, 2):
            cut = np.array([rings[i][k] for i in (0, 1, 3, 2)])
            middle = cut.mean(axis=0)
            away = np.abs(cut - middle).max()
            first = sum(len(points) for points in corners)
            corners.append(middle + (1.0 - INSET_M / away) * (cut - middle))
            faces += [tuple(first + v for v in face) for face in _CUT]
        points, triangles = np.vstack(corners), np.array(faces)
        if volume(points, triangles) < 0.0:
            triangles = triangles[:, ::-1]
        return points, triangles

    def colliders(self) -> tuple[Collider, ...]:
        """One hull for each wedge."""
        n = self.wedges
        out_low, in_low, out_high, in_high = self._circles(n)
        pieces = []
        for k in range(n):
            j = (k + 1) % n
            low = _corners(np.array([out_low[k], out_low[j], in_low[j], in_low[k]]))
            high = _corners(np.array([out_high[k], out_high[j], in_high[j], in_high[k]]))
            pieces.append(Collider(kind="mesh", mesh=Loft(low=low, high=high).mesh()))
        return tuple(pieces)

    def seen_from(self, origin: Vec3) -> Ring:
        """Return the same ring in a parallel frame whose origin is at ``origin`` [m]."""
        return replace(self, centre=_sub(self.centre, origin))

    def _circles(self, count: int) -> list[Array]:
        """Outer and inner circle of the low end, then of the high end, each (count, 3)."""
        return [
            circle(self.axis, self.centre, end[0], end[k], count, self.stretch)
            for end in (self.low, self.high)
            for k in (2, 1)
        ]


def tube(
    axis: int, centre: Vec3, span: tuple[float, float], inner_m: float, outer_m: float
) -> Ring:
    """Build a ring of the same radii all along."""
    low, high = ((at, inner_m, outer_m) for at in span)
    return Ring(axis=axis, centre=centre, low=low, high=high)


def circle(
    axis: int,
    centre: Vec3,
    at_m: float,
    radius_m: float,
    count: int = ROUND,
    stretch: tuple[float, float] = (1.0, 1.0),
) -> Array:
    """Corners (count, 3) of a circle across ``axis``, ``at_m`` along it from ``centre`` [m]."""
    turn = 2.0 * math.pi * np.arange(count) / count
    out = np.tile(np.asarray(centre, dtype=np.float64), (count, 1))
    out[:, axis] += at_m
    out[:, (axis + 1) % 3] += stretch[0] * radius_m * np.cos(turn)
    out[:, (axis + 2) % 3] += stretch[1] * radius_m * np.sin(turn)
    return out


def cone(
    axis: int,
    centre: Vec3,
    low: tuple[float, float],
    high: tuple[float, float],
    stretch: tuple[float, float] = (1.0, 1.0),
) -> Loft:
    """Build a round solid between two coordinates along ``axis``, each with its radius [m]."""
    ends = (circle(axis, centre, at, radius, ROUND, stretch) for at, radius in (low, high))
    first, second = (_corners(end) for end in ends)
    return Loft(low=first, high=second)


def prism(axis: int, outline: Sequence[tuple[float, float]], span: tuple[float, float]) -> Loft:
    """Extrude a convex ``outline`` along ``axis``; its coordinates are the next two axes [m]."""
    ends = []
    for at in span:
        corners = np.zeros((len(outline), 3))
        corners[:, axis] = at
        corners[:, (axis + 1) % 3] = [u for u, _ in outline]
        corners[:, (axis + 2) % 3] = [v for _, v in outline]
        ends.append(_corners(corners))
    return Loft(low=ends[0], high=ends[1])


def volume(corners: Array, triangles: Ints) -> float:
    """Volume in a closed surface [m^3], negative if its triangles look inwards."""
    a, b, c = (corners[triangles[:, k]] - corners.mean(axis=0) for k in range(3))
    return float(np.einsum("ij,ij->", a, np.cross(b, c))) / 6.0


def _corners(points: Array) -> tuple[Vec3, ...]:
    return tuple((float(x), float(y), float(z)) for x, y, z in points)


def _sub(a: Vec3, b: Vec3) -> Vec3:
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])
