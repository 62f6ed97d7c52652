"""A pot with a lid that is lifted."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

from articulate.library.procedural.build import Piece, arc, bow, knob, linked, shape, slide
from articulate.library.procedural.dimensions import Dimensions, between, one_of
from articulate.library.procedural.solids import Ring, cone
from articulate.library.procedural.urdf import Part

GAP_M = 0.001
"""Gap between rim and lid [m]."""


@dataclass(frozen=True, kw_only=True)
class KitchenPot(Dimensions):
    """A hollow pot with two loops on its sides; its lid has a knob."""

    category: ClassVar[str] = "KitchenPot"

    radius_m: float = between(0.09, 0.14, accepted=(0.06, 0.25))
    """Radius [m]."""
    height_m: float = between(0.09, 0.18, accepted=(0.06, 0.35))
    """Height of the rim [m]."""
    wall_m: float = between(0.003, 0.005)
    """Thickness of the wall [m]."""
    dome_m: float = between(0.015, 0.030)
    """Height of the lid [m]."""
    lift_m: float = between(0.10, 0.20)
    """Travel of the lid [m]."""
    finish: str = one_of("chrome", "dark_steel", "red_plastic")
    """Material of pot and lid."""

    def parts(self) -> list[Part]:
        """Build the pot and its lid."""
        r, h = self.radius_m, self.height_m
        pieces: dict[str, Piece] = {
            "floor": cone(2, (0.0, 0.0, 0.0), (0.0, 0.97 * r), (0.007, r)),
            "wall": Ring(low=(0.007, r - self.wall_m, r), high=(h, r - self.wall_m, r)),
        }
        loops: dict[str, Piece] = {}
        for name, s in (("left", 1.0), ("right", -1.0)):
            middle, out = (0.0, s * (r - 0.008), 0.78 * h), (0.0, s, 0.0)
            points = arc(middle, (1.0, 0.0, 0.0), out, 0.042, (0.0, math.pi), 8)
            loops |= bow(points, 0.0055, name=name)
        density = None if self.finish == "red_plastic" else 2700.0
        pot = Part(
            name="pot",
            shapes=(
                shape("pot_wall", self.finish, pieces, density),
                shape("pot_loops", "dark_steel", loops, 2700.0),
            ),
        )
        z = h + GAP_M
        lid: dict[str, Piece] = {
            "rim": cone(2, (0.0, 0.0, z), (0.0, r), (0.005, r)),
            "dome": cone(2, (0.0, 0.0, z), (0.005, 0.96 * r), (self.dome_m, 0.45 * r)),
        }
        at = (0.0, 0.0, z + self.dome_m)
        motion = slide("pot", "lid", (0.0, 0.0, z), (0.0, 0.0, 1.0), self.lift_m)
        shapes = (
            shape("lid_dome", self.finish, lid, 700.0),
            knob("lid_knob", at, 0.017, 0.034, axis=2, material="black_plastic"),
        )
        return linked([pot, Part(name="lid", shapes=shapes, motion=motion)])
