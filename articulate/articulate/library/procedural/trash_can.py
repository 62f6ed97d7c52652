"""A round bin with a lid and a pedal."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from articulate.library.procedural.build import Piece, around, hinge, linked, shape
from articulate.library.procedural.dimensions import Dimensions, between, one_of
from articulate.library.procedural.solids import Ring, Rod, cone
from articulate.library.procedural.urdf import Part

GAP_M = 0.003
"""Gap between rim and lid [m]."""


@dataclass(frozen=True, kw_only=True)
class TrashCan(Dimensions):
    """A hollow bin; lid and pedal turn by themselves, no rod joins them."""

    category: ClassVar[str] = "TrashCan"

    radius_m: float = between(0.13, 0.19, accepted=(0.08, 0.35))
    """Radius of the rim [m]."""
    height_m: float = between(0.32, 0.60, accepted=(0.2, 1.1))
    """Height of the closed bin [m]."""
    taper: float = between(0.80, 1.00)
    """Radius of the bottom over that of the rim."""
    wall_m: float = between(0.004, 0.007)
    """Thickness of the wall [m]."""
    lid_m: float = between(0.012, 0.022)
    """Thickness of the lid [m]."""
    open_rad: float = between(1.3, 1.6)
    """Widest opening of the lid [rad]."""
    finish: str = one_of("steel", "white_plastic", "black_plastic", "red_plastic")
    """Material of wall and lid."""

    def parts(self) -> list[Part]:
        """Build the bin, its lid, its pedal."""
        top, base = self.radius_m, self.taper * self.radius_m
        rim = self.height_m - self.lid_m - GAP_M
        low = (0.012, base - self.wall_m, base)
        wall = Ring(low=low, high=(rim, top - self.wall_m, top))
        floor = cone(2, (0.0, 0.0, 0.0), (0.0, 0.98 * base), (low[0], base))
        rear = top + 0.012
        foot = -base - 0.006
        ears: dict[str, Piece] = {
            f"ear_{k}": ((foot - 0.022, 0.02 - base), around(b, 0.008), (0.030, 0.062))
            for k, b in enumerate((-0.036, 0.036))
        }
        ears["bracket"] = ((top - 0.004, rear), around(0.0, 0.06), (rim - 0.05, rim))
        density = 600.0 if self.finish == "steel" else 950.0
        body = Part(
            name="bin",
            shapes=(
                shape("bin_wall", self.finish, {"wall": wall, "floor": floor}, density),
                shape("bin_bracket", "black_plastic", ears),
            ),
        )
        ends = [(0.0, 0.0, z) for z in (rim + GAP_M, self.height_m)]
        disc = Rod(start=ends[0], end=ends[1], radius_m=top)
        arm = ((0.8 * top, rear), around(0.0, 0.05), (rim + GAP_M, rim + GAP_M + 0.01))
        lip = ((-top - 0.03, 0.03 - top), around(0.0, 0.09), (rim + GAP_M, rim + GAP_M + 0.011))
        lid = Part(
            name="lid",
            shapes=(
                shape("lid_disc", self.finish, {"disc": disc}, 400.0),
                shape("lid_arm", "black_plastic", {"arm": arm}),
                shape("lid_handle", "black_plastic", {"lip": lip}),
            ),
            motion=hinge(
                "bin", "lid", (rear, 0.0, rim + GAP_M), (0.0, 1.0, 0.0), self.open_rad, stiff=0.05
            ),
        )
        plate = ((foot - 0.085, foot - 0.006), around(0.0, 0.06), (0.042, 0.054))
        pedal = Part(
            name="pedal",
            shapes=(shape("pedal_plate", "black_plastic", {"plate": plate}),),
            motion=hinge(
                "bin", "pedal", (foot - 0.012, 0.0, 0.048), (0.0, -1.0, 0.0), 0.30, stiff=0.05
            ),
        )
        return linked([body, lid, pedal])
