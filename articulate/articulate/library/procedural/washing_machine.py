"""A washing machine with a round door, a drawer for powder and a dial."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

from articulate.library.procedural.build import (
    LEFT,
    RIGHT,
    Piece,
    Span,
    bar_handle,
    cavity,
    corners_of,
    frame,
    knob,
    linked,
    shape,
    shrunk,
    swing,
    turning,
)
from articulate.library.procedural.dimensions import Dimensions, between, one_of
from articulate.library.procedural.drawers import drawer
from articulate.library.procedural.solids import Ring, Rod, prism, tube
from articulate.library.procedural.urdf import Part

GAP_M = 0.003
"""Gap behind door and drawer [m]."""
DOOR_M = 0.045
"""Thickness of the door's rim [m]."""
PANEL_M = 0.12
"""Height of the panel [m]."""


@dataclass(frozen=True, kw_only=True)
class WashingMachine(Dimensions):
    """A case with a drum that is open in front."""

    category: ClassVar[str] = "WashingMachine"

    width_m: float = between(0.58, 0.64, accepted=(0.45, 0.75))
    """Width along y [m]."""
    depth_m: float = between(0.52, 0.64, accepted=(0.4, 0.8))
    """Depth along x without handles [m]."""
    height_m: float = between(0.82, 0.88, accepted=(0.75, 1.0))
    """Height [m]."""
    hole_m: float = between(0.15, 0.18)
    """Radius of the drum [m]."""
    hinges: str = one_of("left", "right")
    """Edge at which the door turns, seen from the front."""
    open_rad: float = between(1.7, 2.1)
    """Widest opening of the door [rad]."""
    finish: str = one_of("white_sheet", "steel", "dark_steel")
    """Material of the case."""

    def parts(self) -> list[Part]:
        """Build the machine, its door, its drawer, its dial."""
        x = (-self.depth_m / 2, self.depth_m / 2)
        y = (-self.width_m / 2, self.width_m / 2)
        body_x = (x[0] + DOOR_M + GAP_M, x[1])
        split = self.height_m - PANEL_M
        z = (0.02, split)
        middle = (body_x[0], 0.0, 0.46 * self.height_m)
        hole = ((-self.hole_m, self.hole_m), (middle[2] - self.hole_m, middle[2] + self.hole_m))
        drum_x, inner = (0.045, self.depth_m - DOOR_M - 0.09), self.hole_m + 0.02
        ends = [(body_x[0] + drum_x[1] + d, 0.0, middle[2]) for d in (0.0, 0.01)]
        drum: dict[str, Piece] = {
            "wall": Ring(
                axis=0,
                centre=middle,
                low=(drum_x[0], inner, inner + 0.01),
                high=(drum_x[1], inner, inner + 0.01),
                segments=16,
            ),
            "rear": Rod(start=ends[0], end=ends[1], radius_m=inner + 0.01),
        }
        case = cavity(((body_x[0] + 0.015, x[1]), y, z), 0.015)
        case |= frame((y, z), hole, (body_x[0], body_x[0] + 0.015), name="front_")
        case |= self._corners(body_x[0], middle[2])
        slot_y, front_x = (y[1] - 0.20, y[1]), (x[0] + 0.02, body_x[0])
        slot = ((body_x[0], body_x[0] + 0.30), slot_y, (split, self.height_m - 0.02))
        rest = (y[0], slot_y[0])
        shapes = (
            shape("case_walls", self.finish, case),
            shape("case_drum", "chrome", drum, 400.0),
            shape("case_slot", "white_plastic", cavity(slot, 0.006)),
            shape(
                "case_panel",
                self.finish,
                {
                    "panel": ((front_x[0], slot[0][1]), rest, slot[2]),
                    "behind": ((slot[0][1], x[1]), y, slot[2]),
                    "cover": ((front_x[0], x[1]), y, (self.height_m - 0.02, self.height_m)),
                },
            ),
            shape("case_feet", "rubber", self._feet(body_x, y)),
        )
        front = ((front_x[0], body_x[0] - GAP_M), shrunk(slot_y, 0.002), shrunk(slot[2], 0.002))
        free = (shrunk(slot_y, 0.006), shrunk(slot[2], 0.006))
        powder = drawer(
            "drawer", "body", front, free, slot[0][1] - 0.02, material=self.finish, handle="bar"
        )
        at = (front_x[0], 0.4 * rest[0] + 0.6 * rest[1], sum(slot[2]) / 2)
        dial = Part(
            name="dial",
            shapes=(knob("dial_knob", at, 0.026, 0.026),),
            motion=turning("body", "dial", at, (-1.0, 0.0, 0.0)),
        )
        body = Part(name="body", shapes=shapes)
        return linked([body, self._door(x[0], middle[2]), powder, dial])

    def _corners(self, x: float, z: float) -> dict[str, Piece]:
        """Four triangles that make an octagon of a square hole."""
        r, leg = self.hole_m, (2.0 - math.sqrt(2.0)) * self.hole_m
        out: dict[str, Piece] = {}
        for k, (a, b) in enumerate(((1, 1), (-1, 1), (-1, -1), (1, -1))):
            outline = [(a * r, z + b * r), (a * (r - leg), z + b * r), (a * r, z + b * (r - leg))]
            out[f"corner_{k}"] = prism(0, outline, (x, x + 0.015))
        return out

    def _feet(self, x: Span, y: Span) -> dict[str, Piece]:
        return {
            f"foot_{k}": Rod(start=(a, b, 0.0), end=(a, b, 0.02), radius_m=0.02)
            for k, (a, b) in enumerate(corners_of(x, y, 0.05))
        }

    def _door(self, x: float, z: float) -> Part:
        """Build a rim, a glass bowl that reaches into the drum, a handle opposite to the hinge."""
        side = LEFT if self.hinges == "left" else RIGHT
        inner, outer = self.hole_m - 0.03, self.hole_m + 0.035
        middle = (x, 0.0, z)
        rim = tube(0, middle, (0.0, DOOR_M), inner, outer)
        pane = Rod(start=(x + 0.02, 0.0, z), end=(x + 0.03, 0.0, z), radius_m=inner)
        reach = (DOOR_M - 0.015, DOOR_M + 0.05)
        bowl = Ring(
            axis=0,
            centre=middle,
            low=(reach[0], inner - 0.006, inner),
            high=(reach[1], inner - 0.030, inner - 0.024),
        )
        at = (x, -side * (inner + outer) / 2, z)
        shapes = (
            shape("door_rim", "grey_plastic", {"rim": rim}, 700.0),
            shape("door_window", "glass", {"pane": pane, "bowl": bowl}, 1500.0),
            bar_handle("door_handle", at, 0.10, upright=True),
        )
        motion = swing("body", "door", (x, side * outer, z), side, self.open_rad)
        return Part(name="door", shapes=shapes, motion=motion)
