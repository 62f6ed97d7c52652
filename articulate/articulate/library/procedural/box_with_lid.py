"""A box of boards with a lid that turns about its rear edge."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from articulate.library.procedural.build import Piece, around, hinge, linked, shape, shrunk, tray
from articulate.library.procedural.dimensions import Dimensions, between, one_of
from articulate.library.procedural.urdf import Part

GAP_M = 0.002
"""Gap between box and lid [m]."""
LIP_SHARE = 0.65
"""Distance of the lips from the hinge over the depth."""
OPEN_RAD = 1.745
"""Widest opening of the lid [rad], 100 degrees."""


@dataclass(frozen=True, kw_only=True)
class BoxWithLid(Dimensions):
    """A wooden box; the lid has a lip on both sides that fingers hold from above and below.

    A gripper that comes from the side follows the lid by turning about its own approach.
    """

    category: ClassVar[str] = "Box"

    width_m: float = between(0.30, 0.50, accepted=(0.15, 1.0))
    """Width along y without lips [m]."""
    depth_m: float = between(0.25, 0.38, accepted=(0.15, 0.5))
    """Depth along x [m]."""
    height_m: float = between(0.20, 0.34, accepted=(0.1, 0.8))
    """Height of the closed box [m]."""
    board_m: float = between(0.009, 0.014)
    """Thickness of the boards [m]."""
    lid: str = one_of("flat", "deep")
    """A flat lid is one board, a deep one has a rim all round."""
    rim_m: float = between(0.035, 0.060)
    """Height of the rim of a deep lid [m]."""
    lip_m: float = between(0.030, 0.040)
    """Overhang of the lips [m]."""
    lip_length_m: float = between(0.10, 0.14, accepted=(0.04, 0.14))
    """Length of the lips along x [m]."""
    wood: str = one_of("oak", "birch", "walnut")
    """Material of the boards."""

    def parts(self) -> list[Part]:
        """Build the box, and its lid."""
        x, y = (-self.depth_m / 2, self.depth_m / 2), (-self.width_m / 2, self.width_m / 2)
        rim = self.rim_m if self.lid == "deep" else 0.0
        split = self.height_m - self.board_m - rim
        lid: dict[str, Piece] = {"top": (x, y, (split + rim, self.height_m))}
        if rim:
            inner, z = shrunk(y, self.board_m), (split, split + rim)
            lid |= {
                "front": ((x[0], x[0] + self.board_m), inner, z),
                "rear": ((x[1] - self.board_m, x[1]), inner, z),
                "left": (x, (inner[1], y[1]), z),
                "right": (x, (y[0], inner[0]), z),
            }
        lip_x = around(x[1] - LIP_SHARE * self.depth_m, self.lip_length_m)
        lip_z = (split, split + 0.012) if rim else (split, self.height_m)
        lips: dict[str, Piece] = {
            "left": (lip_x, (y[1], y[1] + self.lip_m), lip_z),
            "right": (lip_x, (y[0] - self.lip_m, y[0]), lip_z),
        }
        walls = tray((x, y, (0.0, split - GAP_M)), self.board_m)
        motion = hinge("box", "lid", (x[1], 0.0, split), (0.0, 1.0, 0.0), OPEN_RAD, stiff=0.1)
        shapes = (
            shape("lid_board", self.wood, lid),
            shape("lid_handle", "dark_steel", lips, 1200.0),
        )
        box = Part(name="box", shapes=(shape("box_walls", self.wood, walls),))
        return linked([box, Part(name="lid", shapes=shapes, motion=motion)])
