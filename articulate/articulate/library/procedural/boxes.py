"""Solids made of boxes: mass, inertia and triangles in closed form."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from articulate.asset import Vec3
from articulate.transforms import Array

_CORNERS = ((0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1))
_TRIANGLES = (
    *((0, 2, 1), (0, 3, 2), (4, 5, 6), (4, 6, 7)),  # below, above
    *((0, 1, 5), (0, 5, 4), (2, 3, 7), (2, 7, 6)),  # -y, +y
    *((0, 4, 7), (0, 7, 3), (1, 2, 6), (1, 6, 5)),  # -x, +x
)
"""Two counter-clockwise triangles a side, seen from outside."""


@dataclass(frozen=True, kw_only=True)
class Box:
    """A solid box with sides along the axes of its frame."""

    name: str
    """Name, unique within a part."""
    low: Vec3
    """Lowest corner [m]."""
    high: Vec3
    """Highest corner [m]."""
    density_kg_m3: float
    """Density [kg/m^3]."""

    @property
    def size(self) -> Vec3:
        """Edge lengths [m]."""
        return _sub(self.high, self.low)

    @property
    def centre(self) -> Vec3:
        """Middle of the box [m]."""
        (x0, y0, z0), (x1, y1, z1) = self.low, self.high
        return ((x0 + x1) / 2, (y0 + y1) / 2, (z0 + z1) / 2)

    def seen_from(self, origin: Vec3) -> Box:
        """The same box in a parallel frame whose origin is at ``origin`` [m]."""
        return Box(
            name=self.name,
            low=_sub(self.low, origin),
            high=_sub(self.high, origin),
            density_kg_m3=self.density_kg_m3,
        )


@dataclass(frozen=True, kw_only=True)
class MassProperties:
    """Mass, centre of mass and inertia of a rigid part."""

    mass_kg: float
    """Mass [kg]."""
    com_l: Array
    """Centre of mass in the part's frame [m], shape (3,)."""
    inertia_l: Array
    """Inertia about the centre of mass, axes of the part's frame [kg m^2], shape (3, 3)."""


def mass_properties(boxes: Sequence[Box]) -> MassProperties:
    """Mass properties of boxes that do not overlap: sum of boxes, parallel axis theorem."""
    size = np.array([box.size for box in boxes])
    centre = np.array([box.centre for box in boxes])
    mass = np.prod(size, axis=1) * np.array([box.density_kg_m3 for box in boxes])
    com = mass @ centre / mass.sum()
    inertia = _about_origin(mass, size**2 / 12.0) + _steiner(mass, centre - com)
    return MassProperties(mass_kg=float(mass.sum()), com_l=com, inertia_l=inertia)


def obj_text(boxes: Sequence[Box]) -> str:
    """The boxes as a Wavefront OBJ, 8 vertices and 12 triangles each.

    All are one object of the file, because MuJoCo draws only the first object.
    """
    lines = []
    for i, box in enumerate(boxes):
        lines.append(f"# {box.name}")
        ends = (box.low, box.high)
        for corner in _CORNERS:
            lines.append("v " + " ".join(number(ends[c][k]) for k, c in enumerate(corner)))
        for triangle in _TRIANGLES:
            lines.append("f " + " ".join(str(8 * i + v + 1) for v in triangle))
    return "\n".join(lines) + "\n"


def number(value: float) -> str:
    """``value`` with at most nine digits, without rounding noise below 1e-12 and without -0."""
    return f"{round(float(value), 12) + 0.0:.9g}"


def _sub(a: Vec3, b: Vec3) -> Vec3:
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])


def _about_origin(mass: Array, second: Array) -> Array:
    """Inertia (3, 3) of masses (B,) with mean squares (B, 3) of the coordinates, no products."""
    moments = mass @ second
    return np.diag(moments.sum() - moments)


def _steiner(mass: Array, offset: Array) -> Array:
    """What point masses (B,) at ``offset`` (B, 3) add to an inertia (3, 3)."""
    squares = np.einsum("b,bi,bj->ij", mass, offset, offset)
    return np.asarray(np.trace(squares) * np.eye(3) - squares)
