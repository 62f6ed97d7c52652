"""An electric kettle with a hinged lid."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

from articulate.library.procedural.build import Piece, arc, around, bow, hinge, knob, linked, shape
from articulate.library.procedural.dimensions import Dimensions, between, one_of
from articulate.library.procedural.solids import Ring, cone, prism
from articulate.library.procedural.urdf import Part

STAND_M = 0.022
"""Height of the stand [m]."""


@dataclass(frozen=True, kw_only=True)
class Kettle(Dimensions):
    """A jug on a stand, its handle behind, its spout in front."""

    category: ClassVar[str] = "Kettle"

    radius_m: float = between(0.070, 0.085, accepted=(0.055, 0.11))
    """Radius of the bottom [m]."""
    height_m: float = between(0.16, 0.21, accepted=(0.13, 0.28))
    """Height of the jug [m]."""
    taper: float = between(0.72, 0.85)
    """Radius of the rim over that of the bottom."""
    lid_m: float = between(0.008, 0.012)
    """Thickness of the lid [m]."""
    open_rad: float = between(1.1, 1.4)
    """Widest opening of the lid [rad]."""
    finish: str = one_of("chrome", "white_plastic", "red_plastic")
    """Material of the jug."""

    def parts(self) -> list[Part]:
        """Build the kettle and its lid."""
        low, top = self.radius_m, self.taper * self.radius_m
        base, rim = STAND_M, STAND_M + self.height_m
        jug: dict[str, Piece] = {
            "floor": cone(2, (0.0, 0.0, 0.0), (base, low), (base + 0.008, low)),
            "wall": Ring(low=(base + 0.008, low - 0.004, low), high=(rim, top - 0.004, top)),
            "spout": prism(
                1,
                [(rim - 0.045, -top - 0.002), (rim, -top + 0.006), (rim, -top - 0.035)],
                (-0.018, 0.018),
            ),
        }
        stand = cone(2, (0.0, 0.0, 0.0), (0.0, 1.08 * low), (base - 0.001, 0.98 * low))
        middle = (0.92 * top, 0.0, rim - 0.085)
        span = (-0.45 * math.pi, 0.42 * math.pi)
        loop = bow(arc(middle, (1.0, 0.0, 0.0), (0.0, 0.0, 1.0), 0.07, span, 8), 0.010)
        body = Part(
            name="kettle",
            shapes=(
                shape("kettle_jug", self.finish, jug, 1500.0),
                shape("kettle_stand", "black_plastic", {"stand": stand}),
                shape("kettle_loop", "black_plastic", loop),
            ),
        )
        z = rim + 0.001
        disc = cone(2, (0.0, 0.0, z), (0.0, top), (self.lid_m, 0.9 * top))
        arm = ((0.85 * top, top + 0.004), around(0.0, 0.03), (z, z + 0.006))
        at = (-0.35 * top, 0.0, z + self.lid_m)
        lid = Part(
            name="lid",
            shapes=(
                shape("lid_disc", self.finish, {"disc": disc}, 900.0),
                shape("lid_arm", "black_plastic", {"arm": arm}),
                knob("lid_knob", at, 0.012, 0.024, axis=2, material="black_plastic"),
            ),
            motion=hinge(
                "kettle", "lid", (top + 0.004, 0.0, z), (0.0, 1.0, 0.0), self.open_rad, stiff=0.02
            ),
        )
        return linked([body, lid])
