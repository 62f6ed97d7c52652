"""A chest of drawers on four legs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from articulate.library.procedural.build import (
    Piece,
    around,
    cavity,
    corners_of,
    linked,
    shape,
    shrunk,
)
from articulate.library.procedural.dimensions import Dimensions, between, integer, one_of
from articulate.library.procedural.drawers import GAP_M, drawer
from articulate.library.procedural.urdf import Part


@dataclass(frozen=True, kw_only=True)
class ChestOfDrawers(Dimensions):
    """Rows and columns of drawers before a carcass, numbered from the top left."""

    category: ClassVar[str] = "StorageFurniture"

    width_m: float = between(0.70, 1.10)
    """Width along y [m]."""
    depth_m: float = between(0.40, 0.50)
    """Depth along x without handles [m]."""
    height_m: float = between(0.75, 1.05)
    """Height [m]."""
    rows: int = integer(2, 3)
    """Drawers above each other."""
    columns: int = integer(1, 2)
    """Drawers beside each other."""
    board_m: float = between(0.016, 0.022)
    """Thickness of the boards [m]."""
    leg_m: float = between(0.08, 0.15)
    """Height of the legs [m]."""
    handle: str = one_of("knob", "bar")
    """Kind of the handles."""
    wood: str = one_of("oak", "white_lacquer", "walnut")
    """Material of carcass and fronts."""

    def parts(self) -> list[Part]:
        """Build the chest and its drawers."""
        half, board = self.width_m / 2, self.board_m
        x, y = (-self.depth_m / 2, self.depth_m / 2), (-half, half)
        body_x = (x[0] + board + GAP_M, x[1])
        top = self.height_m - board
        pieces = cavity((body_x, y, (self.leg_m, top)), board)
        pieces["worktop"] = ((x[0] - 0.01, x[1]), (y[0] - 0.01, y[1] + 0.01), (top, self.height_m))
        inner_y = shrunk(y, board)
        if self.columns == 2:
            pieces["divider"] = (
                (body_x[0], x[1] - board),
                around(0.0, board),
                (self.leg_m + board, top - board),
            )
        legs: dict[str, Piece] = {
            f"leg_{k}": (around(a, 0.04), around(b, 0.04), (0.0, self.leg_m))
            for k, (a, b) in enumerate(corners_of(body_x, y, 0.03))
        }
        chest = Part(
            name="chest",
            shapes=(
                shape("chest_carcass", self.wood, pieces),
                shape("chest_legs", "walnut", legs),
            ),
        )
        out = [chest]
        step_y, step_z = self.width_m / self.columns, (top - self.leg_m) / self.rows
        for k in range(self.rows * self.columns):
            row, column = divmod(k, self.columns)
            cell_y = (half - (column + 1) * step_y, half - column * step_y)
            cell_z = (top - (row + 1) * step_z, top - row * step_z)
            hole_y = (
                max(cell_y[0] + board / 2, inner_y[0]),
                min(cell_y[1] - board / 2, inner_y[1]),
            )
            hole_z = (max(cell_z[0], self.leg_m + board), min(cell_z[1], top - board))
            front = ((x[0], x[0] + board), shrunk(cell_y, GAP_M / 2), shrunk(cell_z, GAP_M / 2))
            rear = x[1] - board - 0.02
            out.append(
                drawer(
                    f"drawer_{k}",
                    "chest",
                    front,
                    (hole_y, hole_z),
                    rear,
                    material=self.wood,
                    handle=self.handle,
                )
            )
        return linked(out)
