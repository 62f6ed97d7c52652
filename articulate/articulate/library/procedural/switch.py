"""A plate on a wall with switches or a dial."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

from articulate.library.procedural.build import Piece, around, hinge, knob, linked, shape
from articulate.library.procedural.dimensions import Dimensions, between, integer, one_of
from articulate.library.procedural.solids import Ring, Rod
from articulate.library.procedural.urdf import Part

PITCH_M = 0.052
"""Distance of two switches [m]."""


@dataclass(frozen=True, kw_only=True)
class Switch(Dimensions):
    """Levers that are tipped upwards, numbered from the left, or one dial."""

    category: ClassVar[str] = "Switch"

    kind: str = one_of("lever", "dial")
    """Kind of element on the plate."""
    count: int = integer(1, 3, accepted=(1, 6))
    """Number of levers; a plate with a dial has none."""
    height_m: float = between(0.10, 0.14, accepted=(0.07, 0.25))
    """Height of the plate [m]."""
    lever_m: float = between(0.026, 0.036)
    """Length of a lever [m]."""
    tip_rad: float = between(0.25, 0.40)
    """Angle of a lever downwards, and upwards when it is tipped [rad]."""
    dial_rad: float = between(3.5, 5.2)
    """Range of a dial [rad]."""
    finish: str = one_of("white_plastic", "brass", "grey_plastic")
    """Material of the plate."""

    def parts(self) -> list[Part]:
        """Build the plate and what is on it."""
        count = 1 if self.kind == "dial" else self.count
        width = 0.03 + PITCH_M * count
        plate: dict[str, Piece] = {
            "plate": ((0.0, 0.010), around(0.0, width), (0.0, self.height_m))
        }
        places = [((count - 1) / 2 - k) * PITCH_M for k in range(count)]
        z = self.height_m / 2
        collars: dict[str, Piece] = {
            f"collar_{k}": Ring(
                axis=0,
                centre=(0.0, y, z),
                low=(-0.006, 0.010, 0.013),
                high=(0.0, 0.010, 0.013),
                segments=8,
            )
            for k, y in enumerate(places)
            if self.kind == "lever"
        }
        shapes = [shape("plate_board", self.finish, plate)]
        if collars:
            shapes.append(shape("plate_collars", "chrome", collars))
        parts = [Part(name="plate", shapes=tuple(shapes))]
        if self.kind == "dial":
            motion = hinge(
                "plate", "dial", (0.0, 0.0, z), (-1.0, 0.0, 0.0), self.dial_rad, stiff=0.02
            )
            own = knob("dial_knob", (0.0, 0.0, z), 0.020, 0.026, material="black_plastic")
            return linked([*parts, Part(name="dial", shapes=(own,), motion=motion)])
        c, s = math.cos(self.tip_rad), math.sin(self.tip_rad)
        for k, y in enumerate(places):
            at = (-0.003, y, z)
            end = (at[0] - self.lever_m * c, y, z - self.lever_m * s)
            rod: dict[str, Piece] = {"rod": Rod(start=at, end=end, radius_m=0.0055)}
            name = f"lever_{k}"
            motion = hinge("plate", name, at, (0.0, 1.0, 0.0), 2 * self.tip_rad, stiff=0.02)
            own = shape(f"{name}_handle", "black_plastic", rod)
            parts.append(Part(name=name, shapes=(own,), motion=motion))
        return linked(parts)
