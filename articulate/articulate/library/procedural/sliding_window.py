"""A window of two panes, one of which slides."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from articulate.library.procedural.build import (
    Piece,
    Span,
    around,
    bar_handle,
    frame,
    linked,
    shape,
    shrunk,
    slide,
)
from articulate.library.procedural.dimensions import Dimensions, between, one_of
from articulate.library.procedural.urdf import Part, Shape

GAP_M = 0.003
"""Gap round the sliding sash [m]."""
SASH_M = 0.028
"""Thickness of a sash [m]."""


@dataclass(frozen=True, kw_only=True)
class SlidingWindow(Dimensions):
    """The left pane is fixed; the right one slides to the left before it."""

    category: ClassVar[str] = "Window"

    width_m: float = between(0.80, 1.40, accepted=(0.5, 2.5))
    """Width along y [m]."""
    height_m: float = between(0.80, 1.20, accepted=(0.4, 2.2))
    """Height [m]."""
    frame_m: float = between(0.04, 0.06)
    """Width of the frame [m]."""
    stile_m: float = between(0.035, 0.050)
    """Width of the sashes' bars [m]."""
    travel_share: float = between(0.80, 0.95)
    """Travel over the width of the sash."""
    finish: str = one_of("white_plastic", "oak", "dark_steel")
    """Material of frame and sashes."""

    def parts(self) -> list[Part]:
        """Build the window and its sliding sash."""
        y = (-self.width_m / 2, self.width_m / 2)
        z = (0.0, self.height_m)
        hole_y, hole_z = shrunk(y, self.frame_m), shrunk(z, self.frame_m)
        x = (-0.04, 0.04)
        half = (hole_y[1] - hole_y[0]) / 2
        sill = {"sill": ((x[0] - 0.03, x[0]), y, (0.0, 0.8 * self.frame_m))}
        fixed_x, moving_x = (0.004, 0.004 + SASH_M), (-0.002 - SASH_M, -0.002)
        fixed_y = (hole_y[1] - half - self.stile_m / 2, hole_y[1])
        fixed, pane = self._sash("fixed", fixed_x, fixed_y, hole_z)
        body = Part(
            name="frame",
            shapes=(
                shape("frame_bars", self.finish, frame((y, z), (hole_y, hole_z), x) | sill, 600.0),
                fixed,
                pane,
            ),
        )
        sash_y = (hole_y[0] + GAP_M, hole_y[0] + half + self.stile_m / 2)
        shapes = self._sash("sash", moving_x, sash_y, shrunk(hole_z, GAP_M))
        at = (moving_x[0], sash_y[0] + self.stile_m / 2, sum(z) / 2)
        sash = Part(
            name="sash",
            shapes=(*shapes, bar_handle("sash_handle", at, 0.14, upright=True)),
            motion=slide(
                "frame",
                "sash",
                at,
                (0.0, 1.0, 0.0),
                self.travel_share * (sash_y[1] - sash_y[0] - 0.08),
            ),
        )
        return linked([body, sash])

    def _sash(self, name: str, x: Span, y: Span, z: Span) -> tuple[Shape, Shape]:
        """Bars round a pane."""
        inner = (shrunk(y, self.stile_m), shrunk(z, self.stile_m))
        pane: dict[str, Piece] = {"pane": (around(sum(x) / 2, 0.006), *inner)}
        return (
            shape(f"{name}_bars", self.finish, frame((y, z), inner, x), 600.0),
            shape(f"{name}_pane", "glass", pane),
        )
