"""A tap for a sink: a spout that swings, and one lever or two handles."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

from articulate.library.procedural.build import Piece, arc, bow, hinge, linked, shape
from articulate.library.procedural.dimensions import Dimensions, between, one_of
from articulate.library.procedural.solids import Rod, cone
from articulate.library.procedural.urdf import Part

PLATE_M = 0.012
"""Thickness of the base plate [m]."""


@dataclass(frozen=True, kw_only=True)
class Faucet(Dimensions):
    """A bent spout on a column."""

    category: ClassVar[str] = "Faucet"

    column_m: float = between(0.08, 0.14)
    """Height of the column [m]."""
    riser_m: float = between(0.06, 0.14, accepted=(0.03, 0.4))
    """Height of the straight piece of the spout [m]."""
    reach_m: float = between(0.14, 0.22)
    """From the column to the outlet along x [m]."""
    column_radius_m: float = between(0.022, 0.027)
    """Radius of the column [m]."""
    handles: str = one_of("lever", "two")
    """One lever on the right of the column, or a handle on each side."""
    swing_rad: float = between(0.9, 1.57)
    """Swing of the spout to the left [rad]."""
    finish: str = one_of("chrome", "brass", "dark_steel")
    """Material of the tap."""

    def parts(self) -> list[Part]:
        """Build the tap, its spout, its lever or handles."""
        wide, r = self.handles == "two", self.column_radius_m
        top = PLATE_M + self.column_m
        pieces: dict[str, Piece] = {
            "plate": cone(
                2, (0.0, 0.0, 0.0), (0.0, 0.036), (PLATE_M, 0.034), (1.0, 3.4 if wide else 1.0)
            ),
            "column": Rod(start=(0.0, 0.0, PLATE_M), end=(0.0, 0.0, top), radius_m=r),
        }
        if wide:
            pieces |= {
                f"stand_{k}": Rod(
                    start=(0.0, s * 0.095, PLATE_M), end=(0.0, s * 0.095, 0.055), radius_m=0.017
                )
                for k, s in enumerate((1.0, -1.0))
            }
        body = Part(name="body", shapes=(shape("body_column", self.finish, pieces),))
        parts = [body, self._spout(top + 0.001)]
        if wide:
            for name, side, turn in (("hot", 1.0, -1.0), ("cold", -1.0, 1.0)):
                at = (0.0, side * 0.095, 0.057)
                motion = hinge("body", name, at, (0.0, 0.0, turn), math.pi / 2, stiff=0.05)
                over = (0.0, at[1], at[2] + 0.022)
                hub = Rod(start=at, end=(0.0, at[1], at[2] + 0.032), radius_m=0.015)
                rod = Rod(start=over, end=(0.0, at[1] + side * 0.065, over[2]), radius_m=0.006)
                shapes = (
                    shape(f"{name}_hub", self.finish, {"hub": hub}),
                    shape(f"{name}_handle", self.finish, {"rod": rod}),
                )
                parts.append(Part(name=name, shapes=shapes, motion=motion))
        else:
            parts.append(self._lever((0.0, -r - 0.001, PLATE_M + 0.6 * self.column_m)))
        return linked(parts)

    def _spout(self, z: float) -> Part:
        """Build a riser, a half circle and an outlet."""
        radius, high = self.reach_m / 2, z + self.riser_m
        points = arc(
            (-radius, 0.0, high), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0), radius, (0.0, math.pi), 12
        )
        end = (points[-1][0], 0.0, high - 0.03)
        line = [(0.0, 0.0, z), *points, end]
        collar = Rod(
            start=(0.0, 0.0, z), end=(0.0, 0.0, z + 0.02), radius_m=self.column_radius_m - 0.003
        )
        outlet = Rod(
            start=(end[0], 0.0, end[2] - 0.015), end=(*end[:2], end[2] + 0.01), radius_m=0.016
        )
        pieces = {"collar": collar, "outlet": outlet} | bow(line, 0.012)
        motion = hinge("body", "spout", (0.0, 0.0, z), (0.0, 0.0, -1.0), self.swing_rad, stiff=0.1)
        own = shape("spout_pipe", self.finish, pieces)
        return Part(name="spout", shapes=(own,), motion=motion)

    def _lever(self, at: tuple[float, float, float]) -> Part:
        """Upright lever beside the column that tips forward."""
        x, y, z = at
        hub = Rod(start=at, end=(x, y - 0.03, z), radius_m=0.016)
        rod = Rod(start=(x, y - 0.020, z), end=(x, y - 0.020, z + 0.10), radius_m=0.006)
        motion = hinge("body", "lever", at, (0.0, -1.0, 0.0), 0.9, stiff=0.1)
        shapes = (
            shape("lever_hub", self.finish, {"hub": hub}),
            shape("lever_handle", self.finish, {"rod": rod}),
        )
        return Part(name="lever", shapes=shapes, motion=motion)
