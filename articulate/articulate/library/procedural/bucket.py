"""A bucket with a bail."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

from articulate.library.procedural.build import Piece, arc, bow, hinge, linked, shape
from articulate.library.procedural.dimensions import Dimensions, between, one_of
from articulate.library.procedural.solids import Ring, Rod, cone
from articulate.library.procedural.urdf import Part

CLEAR_M = 0.022
"""Distance of the bail from the rim [m]."""


@dataclass(frozen=True, kw_only=True)
class Bucket(Dimensions):
    """Bucket; its bail starts in front and swings over to the rear."""

    category: ClassVar[str] = "Bucket"

    radius_m: float = between(0.12, 0.17, accepted=(0.07, 0.25))
    """Radius of the rim [m]."""
    height_m: float = between(0.22, 0.34, accepted=(0.12, 0.5))
    """Height of the rim [m]."""
    taper: float = between(0.70, 0.88)
    """Radius of the bottom over that of the rim."""
    wall_m: float = between(0.003, 0.005)
    """Thickness of the wall [m]."""
    finish: str = one_of("blue_plastic", "red_plastic", "green_plastic", "steel")
    """Material of the bucket."""

    def parts(self) -> list[Part]:
        """Build the bucket and its bail."""
        top, base, h = self.radius_m, self.taper * self.radius_m, self.height_m
        pieces: dict[str, Piece] = {
            "floor": cone(2, (0.0, 0.0, 0.0), (0.0, base), (0.006, base)),
            "wall": Ring(low=(0.006, base - self.wall_m, base), high=(h, top - self.wall_m, top)),
        }
        z, radius = h - 0.025, top + CLEAR_M
        pins: dict[str, Piece] = {
            f"pin_{k}": Rod(
                start=(0.0, s * (top - 0.004), z), end=(0.0, s * radius, z), radius_m=0.007
            )
            for k, s in enumerate((-1.0, 1.0))
        }
        density = 900.0 if self.finish == "steel" else 950.0
        body = Part(
            name="bucket",
            shapes=(
                shape("bucket_wall", self.finish, pieces, density),
                shape("bucket_pins", "dark_steel", pins),
            ),
        )
        points = arc(
            (0.0, 0.0, z), (0.0, 1.0, 0.0), (-1.0, 0.0, 0.0), radius + 0.004, (0.0, math.pi), 12
        )
        x = -radius - 0.003
        grip = Rod(start=(x, -0.05, z), end=(x, 0.05, z), radius_m=0.011)
        bail = Part(
            name="bail",
            shapes=(
                shape("bail_wire", "dark_steel", bow(points, 0.0035), 2700.0),
                shape("bail_handle", "black_plastic", {"grip": grip}),
            ),
            motion=hinge("bucket", "bail", (0.0, 0.0, z), (0.0, 1.0, 0.0), math.pi, stiff=0.02),
        )
        return linked([body, bail])
