"""A desk with a row of drawers under its top."""

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
class TableWithDrawers(Dimensions):
    """A top on four legs; drawers hang in a flat case under it, numbered from the left."""

    category: ClassVar[str] = "Table"

    width_m: float = between(1.00, 1.60, accepted=(0.4, 2.5))
    """Width along y [m]."""
    depth_m: float = between(0.50, 0.75, accepted=(0.3, 1.2))
    """Depth along x without handles [m]."""
    height_m: float = between(0.72, 0.76, accepted=(0.3, 1.2))
    """Height [m]."""
    drawers: int = integer(1, 3, accepted=(1, 5))
    """Number of drawers."""
    case_m: float = between(0.12, 0.17)
    """Height of the case that they run in [m]."""
    top_m: float = between(0.022, 0.030)
    """Thickness of the top [m]."""
    leg_m: float = between(0.045, 0.065)
    """Side of the legs [m]."""
    handle: str = one_of("bar", "knob")
    """Kind of the handles."""
    wood: str = one_of("oak", "walnut", "birch")
    """Material of the table."""

    def parts(self) -> list[Part]:
        """Build the table and its drawers."""
        board, half = 0.016, self.width_m / 2
        x, y = (-self.depth_m / 2, self.depth_m / 2), (-half, half)
        under = self.height_m - self.top_m
        case_y = shrunk(y, self.leg_m)
        front_x = (x[0] + 0.02, x[0] + 0.02 + board)
        case = ((front_x[1] + GAP_M, x[1] - 0.02), case_y, (under - self.case_m, under))
        pieces = cavity(case, board)
        step = (case_y[1] - case_y[0]) / self.drawers
        for k in range(1, self.drawers):
            span = around(case_y[1] - k * step, board)
            within = (case[0][0], case[0][1] - board)
            pieces[f"divider_{k}"] = (within, span, shrunk(case[2], board))
        legs: dict[str, Piece] = {
            f"leg_{k}": (around(a, self.leg_m), around(b, self.leg_m), (0.0, under))
            for k, (a, b) in enumerate(corners_of(x, y, self.leg_m / 2))
        }
        top: dict[str, Piece] = {"top": (x, y, (under, self.height_m))}
        table = Part(
            name="table",
            shapes=(
                shape("table_top", self.wood, top | legs),
                shape("table_case", self.wood, pieces),
            ),
        )
        out = [table]
        for k in range(self.drawers):
            cell = (case_y[1] - (k + 1) * step, case_y[1] - k * step)
            hole_y = (
                cell[0] + (board if k == self.drawers - 1 else board / 2),
                cell[1] - (board if k == 0 else board / 2),
            )
            front = (front_x, shrunk(cell, GAP_M / 2), (case[2][0], under - GAP_M))
            hole = (hole_y, shrunk(case[2], board))
            out.append(
                drawer(
                    f"drawer_{k}",
                    "table",
                    front,
                    hole,
                    case[0][1] - board - 0.02,
                    material=self.wood,
                    handle=self.handle,
                )
            )
        return linked(out)
