"""A chair on wheels whose seat turns and whose back leans."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

from articulate.library.procedural.build import (
    Piece,
    around,
    crown,
    hinge,
    linked,
    shape,
    shrunk,
    turning,
)
from articulate.library.procedural.dimensions import Dimensions, between, one_of
from articulate.library.procedural.solids import Rod
from articulate.library.procedural.urdf import Part


@dataclass(frozen=True, kw_only=True)
class OfficeChair(Dimensions):
    """Five legs, a column, a seat with arms, a back."""

    category: ClassVar[str] = "Chair"

    seat_m: float = between(0.43, 0.50, accepted=(0.38, 0.6))
    """Height of the seat [m]."""
    width_m: float = between(0.44, 0.52, accepted=(0.38, 0.65))
    """Width of the seat along y [m]."""
    depth_m: float = between(0.42, 0.50, accepted=(0.38, 0.6))
    """Depth of the seat along x [m]."""
    cushion_m: float = between(0.06, 0.09)
    """Thickness of the cushion [m]."""
    back_m: float = between(0.45, 0.65, accepted=(0.25, 0.9))
    """Height of the back [m]."""
    base_m: float = between(0.28, 0.33)
    """Length of the legs [m]."""
    lean_rad: float = between(0.30, 0.45)
    """Range of the back [rad]."""
    cover: str = one_of("fabric", "black_plastic", "grey_plastic")
    """Material of seat and back."""

    def parts(self) -> list[Part]:
        """Build base, seat and back."""
        low = self.seat_m - self.cushion_m - 0.02
        return linked([self._base(low), self._seat(low), self._back()])

    def _base(self, top: float) -> Part:
        legs: dict[str, Piece] = {}
        wheels: dict[str, Piece] = {}
        for k in range(5):
            turn = 2.0 * math.pi * k / 5
            c, s = math.cos(turn), math.sin(turn)
            end = (self.base_m * c, self.base_m * s, 0.075)
            legs[f"leg_{k}"] = Rod(start=(0.03 * c, 0.03 * s, 0.11), end=end, radius_m=0.017)
            legs[f"pin_{k}"] = Rod(start=(*end[:2], 0.05), end=(*end[:2], 0.08), radius_m=0.008)
            a, b = 0.016 * s, -0.016 * c
            at = (end[0], end[1], 0.028)
            wheels[f"wheel_{k}"] = Rod(
                start=(at[0] - a, at[1] - b, at[2]),
                end=(at[0] + a, at[1] + b, at[2]),
                radius_m=0.028,
            )
        legs["hub"] = Rod(start=(0.0, 0.0, 0.07), end=(0.0, 0.0, 0.16), radius_m=0.035)
        column = Rod(start=(0.0, 0.0, 0.16), end=(0.0, 0.0, top - 0.002), radius_m=0.025)
        return Part(
            name="base",
            shapes=(
                shape("base_legs", "black_plastic", legs),
                shape("base_wheels", "rubber", wheels),
                shape("base_column", "chrome", {"column": column}),
            ),
        )

    def _seat(self, low: float) -> Part:
        x, y = around(0.0, self.depth_m), around(0.0, self.width_m)
        top, bevel = self.seat_m, 0.02
        under = low + 0.02
        cushion: dict[str, Piece] = {
            "body": (x, y, (under, top - bevel)),
            "crown": crown(x, y, (top - bevel, top), bevel),
        }
        plate = {"plate": (shrunk(x, 0.06), shrunk(y, 0.06), (low, under))}
        arms: dict[str, Piece] = {}
        pads: dict[str, Piece] = {}
        for name, s in (("left", 1.0), ("right", -1.0)):
            at = s * (self.width_m / 2 + 0.035)
            arms[f"{name}_foot"] = (
                around(0.0, 0.05),
                around(s * (self.width_m / 2 - 0.01), 0.12),
                (low, under - 0.001),
            )
            arms[f"{name}_post"] = (
                around(0.0, 0.05),
                around(at, 0.022),
                (under - 0.001, top + 0.20),
            )
            pads[f"{name}_pad"] = (around(0.0, 0.26), around(at, 0.05), (top + 0.20, top + 0.225))
        return Part(
            name="seat",
            shapes=(
                shape("seat_cushion", self.cover, cushion, 150.0),
                shape("seat_plate", "black_plastic", plate | arms),
                shape("seat_pads", "rubber", pads, 500.0),
            ),
            motion=turning("base", "seat", (0.0, 0.0, low), (0.0, 0.0, 1.0), stiff=0.5),
        )

    def _back(self) -> Part:
        rear, foot = self.depth_m / 2 + 0.012, self.seat_m - self.cushion_m
        x = (rear, rear + 0.055)
        z = (self.seat_m + 0.08, self.seat_m + 0.08 + self.back_m)
        board = (x, around(0.0, 0.9 * self.width_m), z)
        stem = (around(rear + 0.045, 0.02), around(0.0, 0.07), (foot, z[0] + 0.1))
        upper = (around(rear + 0.065, 0.02), around(0.0, 0.07), (z[0] - 0.02, z[0] + 0.15))
        top, at = z[1] + 0.035, rear + 0.0275
        bar: dict[str, Piece] = {
            "bar": Rod(start=(at, -0.10, top), end=(at, 0.10, top), radius_m=0.009),
            "post_a": Rod(start=(at, -0.088, z[1]), end=(at, -0.088, top), radius_m=0.008),
            "post_b": Rod(start=(at, 0.088, z[1]), end=(at, 0.088, top), radius_m=0.008),
        }
        axle = (self.depth_m / 2 + 0.035, 0.0, foot)
        return Part(
            name="back",
            shapes=(
                shape("back_board", self.cover, {"board": board}, 120.0),
                shape("back_stem", "black_plastic", {"stem": stem, "upper": upper}),
                shape("back_handle", "chrome", bar, 1500.0),
            ),
            motion=hinge("seat", "back", axle, (0.0, 1.0, 0.0), self.lean_rad, stiff=2.0),
        )
