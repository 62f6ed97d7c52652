"""A cooker: an oven whose door falls open, knobs, and plates on top."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from articulate.library.procedural.build import (
    Piece,
    Span,
    around,
    bar_handle,
    frame,
    hinge,
    knob,
    lined,
    linked,
    shape,
    shrunk,
)
from articulate.library.procedural.dimensions import Dimensions, between, integer, one_of
from articulate.library.procedural.drawers import drawer
from articulate.library.procedural.solids import Rod
from articulate.library.procedural.urdf import Part

GAP_M = 0.003
"""Gap round door and drawer [m]."""
DRAWER_Z: Span = (0.04, 0.19)
"""Extent of the drawer's front [m]."""
PANEL_M = 0.11
"""Height of the panel with the knobs [m]."""


@dataclass(frozen=True, kw_only=True)
class Oven(Dimensions):
    """A cooker with a drawer for trays, an oven, and a hob."""

    category: ClassVar[str] = "Oven"

    width_m: float = between(0.55, 0.70, accepted=(0.45, 0.9))
    """Width along y [m]."""
    depth_m: float = between(0.55, 0.65, accepted=(0.5, 0.75))
    """Depth along x without handles [m]."""
    height_m: float = between(0.84, 0.92, accepted=(0.7, 0.92))
    """Height [m]."""
    door_m: float = between(0.030, 0.045)
    """Thickness of the door [m]."""
    knobs: int = integer(3, 5, accepted=(1, 8))
    """Number of knobs."""
    open_rad: float = between(1.40, 1.57)
    """Widest opening of the door [rad]."""
    finish: str = one_of("steel", "white_sheet", "dark_steel")
    """Material of the shell."""

    def parts(self) -> list[Part]:
        """Build the cooker, its door, its drawer, its knobs."""
        x = (-self.depth_m / 2, self.depth_m / 2)
        y = (-self.width_m / 2, self.width_m / 2)
        front = (x[0], x[0] + self.door_m)
        body_x = (front[1] + GAP_M, x[1])
        panel_z = (self.height_m - 0.02 - PANEL_M, self.height_m - 0.02)
        door_z = (DRAWER_Z[1] + GAP_M, panel_z[0] - GAP_M)
        chest_z = (DRAWER_Z[0] - 0.01, DRAWER_Z[1])
        hob = (self.height_m - 0.02, self.height_m)
        rack = ((body_x[0] + 0.02, x[1] - 0.06), shrunk(y, 0.06))
        rods: dict[str, Piece] = {
            f"bar_{k}": (rack[0], around(b, 0.008), around(sum(door_z) / 2, 0.008))
            for k, b in enumerate(self._across(rack[1], 7))
        }
        shapes = [
            *lined("case", (body_x, y, chest_z), (0.012, 0.002), self.finish),
            *lined("oven", (body_x, y, (DRAWER_Z[1], panel_z[0])), (0.03, 0.012), self.finish),
            shape("oven_rack", "chrome", rods),
            shape("oven_panel", self.finish, {"panel": ((x[0], x[1]), y, panel_z)}),
            shape("oven_hob", "dark_glass", {"hob": (x, y, hob)}, 1000.0),
            shape("oven_plates", "grey_plastic", self._plates(hob[1])),
            shape("oven_foot", "black_plastic", {"foot": (body_x, y, (0.0, chest_z[0]))}),
        ]
        parts = [Part(name="body", shapes=tuple(shapes)), self._door(front, y, door_z)]
        hole = (shrunk(y, 0.014), (chest_z[0] + 0.014, chest_z[1] - 0.014))
        panel = (front, y, shrunk(DRAWER_Z, GAP_M / 2))
        parts.append(
            drawer("drawer", "body", panel, hole, x[1] - 0.04, material=self.finish, handle="bar")
        )
        for k, b in enumerate(reversed(self._across(shrunk(y, 0.08), self.knobs))):
            at = (x[0], b, sum(panel_z) / 2)
            motion = hinge("body", f"knob_{k}", at, (-1.0, 0.0, 0.0), 4.712, stiff=0.02)
            own = knob(f"knob_{k}", at, 0.022, 0.028, material="black_plastic")
            parts.append(Part(name=f"knob_{k}", shapes=(own,), motion=motion))
        return linked(parts)

    def _across(self, span: Span, count: int) -> list[float]:
        """Places evenly along a span."""
        if count == 1:
            return [sum(span) / 2]
        return [span[0] + k * (span[1] - span[0]) / (count - 1) for k in range(count)]

    def _plates(self, z: float) -> dict[str, Piece]:
        out: dict[str, Piece] = {}
        for k, (a, b) in enumerate((a, b) for a in (-0.24, 0.24) for b in (-0.24, 0.24)):
            at = (a * self.depth_m, b * self.width_m)
            radius = 0.075 + 0.018 * (k in {0, 3})
            out[f"plate_{k}"] = Rod(start=(*at, z), end=(*at, z + 0.006), radius_m=radius)
        return out

    def _door(self, x: Span, y: Span, z: Span) -> Part:
        window = (shrunk(y, 0.08), (z[0] + 0.08, z[1] - 0.13))
        pane = (around(sum(x) / 2, 0.5 * self.door_m), *window)
        at = (x[0], 0.0, z[1] - 0.06)
        shapes = (
            shape("door_frame", self.finish, frame((y, z), window, x), 180.0),
            shape("door_window", "dark_glass", {"pane": pane}, 450.0),
            bar_handle("door_handle", at, 0.75 * self.width_m, upright=False),
        )
        motion = hinge(
            "body", "door", (x[0], 0.0, z[0]), (0.0, -1.0, 0.0), self.open_rad, stiff=1.0
        )
        return Part(name="door", shapes=shapes, motion=motion)
