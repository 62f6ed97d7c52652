"""A toilet with seat, cover and a lever for flushing."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from articulate.library.procedural.build import Piece, hinge, linked, shape
from articulate.library.procedural.dimensions import Dimensions, between, one_of
from articulate.library.procedural.solids import Ring, Rod, cone
from articulate.library.procedural.urdf import Part

OVAL = 1.25
"""Length of bowl and seat over their width."""
THICK_M = 0.018
"""Thickness of seat and cover [m]."""


@dataclass(frozen=True, kw_only=True)
class Toilet(Dimensions):
    """A close-coupled toilet; the seat opens only with its cover. Both have a lip in front."""

    category: ClassVar[str] = "Toilet"

    width_m: float = between(0.35, 0.40)
    """Width of the bowl along y [m]."""
    height_m: float = between(0.38, 0.43)
    """Height of the bowl [m]."""
    tank_width_m: float = between(0.36, 0.44)
    """Width of the tank along y [m]."""
    tank_height_m: float = between(0.32, 0.40, accepted=(0.2, 0.6))
    """Height of the tank above the bowl [m]."""
    tank_depth_m: float = between(0.16, 0.20)
    """Depth of the tank along x [m]."""
    open_rad: float = between(1.48, 1.56)
    """Widest opening of the cover; the seat stops a little earlier [rad]."""
    seat: str = one_of("white_plastic", "oak", "black_plastic")
    """Material of seat and cover."""

    def parts(self) -> list[Part]:
        """Build the toilet, its seat, its cover, its lever."""
        r, h = self.width_m / 2, self.height_m
        reach = OVAL * r + 0.012  # of the hinge behind the middle of the bowl
        tank_x = (reach + 0.07, reach + 0.07 + self.tank_depth_m)
        y = (-self.tank_width_m / 2, self.tank_width_m / 2)
        tank_z = (h - 0.02, h + self.tank_height_m)
        oval = (OVAL, 1.0)
        top = (h, 0.74 * r, r)
        bowl: dict[str, Piece] = {
            "foot": cone(2, (0.0, 0.0, 0.0), (0.0, 0.62 * r), (0.12, 0.55 * r), oval),
            "floor": cone(2, (0.0, 0.0, 0.0), (0.12, 0.55 * r), (0.16, 0.60 * r), oval),
            "wall": Ring(low=(0.16, 0.40 * r, 0.60 * r), high=top, stretch=oval),
            "rear": ((1.0 * r, tank_x[1] - 0.02), (-0.5 * r, 0.5 * r), (0.0, h - 0.02)),
            "tank": (tank_x, y, tank_z),
            "lid": (
                (tank_x[0] - 0.01, tank_x[1]),
                (y[0] - 0.01, y[1] + 0.01),
                (tank_z[1], tank_z[1] + 0.025),
            ),
        }
        blocks: dict[str, Piece] = {
            f"hinge_{k}": (
                (reach + 0.002, reach + 0.022),
                (b - 0.02, b + 0.02),
                (h - 0.02, h + 0.002),
            )
            for k, b in enumerate((-0.07, 0.07))
        }
        body = Part(
            name="body",
            shapes=(
                shape("body_bowl", "ceramic", bowl, 1000.0),
                shape("body_hinges", "chrome", blocks),
            ),
        )
        low = h + 0.004
        ring = Ring(low=(low, 0.66 * r, r), high=(low + THICK_M, 0.66 * r, r), stretch=oval)
        over = low + THICK_M + 0.004
        disc = cone(2, (0.0, 0.0, 0.0), (over, r), (over + THICK_M, 0.97 * r), oval)
        parts = [
            body,
            self._leaf("seat", ring, low, (reach, low), 0.06),
            self._leaf("cover", disc, over, (reach, low), -0.06),
            self._lever((tank_x[0] + 0.05, y[1], tank_z[1] - 0.06)),
        ]
        return linked(parts)

    def _leaf(self, name: str, leaf: Piece, z: float, pivot: tuple[float, float], y: float) -> Part:
        """Seat or cover with a lip on one side of the front."""
        front = -OVAL * self.width_m / 2
        lip = ((front - 0.03, front + 0.04), (y - 0.035, y + 0.035), (z, z + 0.9 * THICK_M))
        shapes = (
            shape(f"{name}_leaf", self.seat, {"leaf": leaf}),
            shape(f"{name}_handle", self.seat, {"lip": lip}),
        )
        at = (pivot[0], 0.0, pivot[1])
        wide = self.open_rad - (0.06 if name == "seat" else 0.0)
        motion = hinge("body", name, at, (0.0, 1.0, 0.0), round(wide, 3), stiff=0.15)
        return Part(name=name, shapes=shapes, motion=motion)

    def _lever(self, at: tuple[float, float, float]) -> Part:
        """Build a lever beside the tank that points to the front and is pressed down."""
        x, y, z = at
        pieces: dict[str, Piece] = {
            "axle": Rod(start=(x, y, z), end=(x, y + 0.035, z), radius_m=0.009),
            "lever": Rod(start=(x, y + 0.028, z), end=(x - 0.09, y + 0.028, z), radius_m=0.006),
        }
        motion = hinge("body", "lever", at, (0.0, -1.0, 0.0), 0.5, stiff=0.1)
        return Part(name="lever", shapes=(shape("lever_handle", "chrome", pieces),), motion=motion)
