"""A microwave oven with a door on the left and a panel of knobs on the right."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from articulate.library.procedural.build import (
    LEFT,
    Piece,
    around,
    bar_handle,
    corners_of,
    frame,
    hinge,
    knob,
    lined,
    linked,
    shape,
    shrunk,
    swing,
)
from articulate.library.procedural.dimensions import Dimensions, between, integer, one_of
from articulate.library.procedural.solids import Rod
from articulate.library.procedural.urdf import Part

GAP_M = 0.002
"""Gap round the door [m]."""
WALLS_M = (0.012, 0.006)
"""Thickness of shell and liner [m]."""


@dataclass(frozen=True, kw_only=True)
class Microwave(Dimensions):
    """A cavity with a plate inside; the door turns at its left edge."""

    category: ClassVar[str] = "Microwave"

    width_m: float = between(0.44, 0.56, accepted=(0.4, 0.7))
    """Width along y [m]."""
    depth_m: float = between(0.34, 0.44, accepted=(0.3, 0.5))
    """Depth along x without handle and knobs [m]."""
    height_m: float = between(0.26, 0.33, accepted=(0.22, 0.5))
    """Height [m]."""
    door_share: float = between(0.70, 0.78)
    """Width of the door over that of the oven."""
    door_m: float = between(0.025, 0.035)
    """Thickness of the door [m]."""
    knobs: int = integer(1, 2)
    """Number of knobs: power, time."""
    finish: str = one_of("steel", "white_sheet", "black_plastic")
    """Material of the shell."""

    def parts(self) -> list[Part]:
        """Build the oven, its door, its knobs."""
        x = (-self.depth_m / 2, self.depth_m / 2)
        y = (-self.width_m / 2, self.width_m / 2)
        z = (0.012, self.height_m)
        split = y[1] - self.door_share * self.width_m
        front = (x[0], x[0] + self.door_m)
        body_x = (front[1] + GAP_M, x[1])
        feet: dict[str, Piece] = {
            f"foot_{k}": Rod(start=(a, b, 0.0), end=(a, b, z[0]), radius_m=0.012)
            for k, (a, b) in enumerate(corners_of(body_x, y, 0.04))
        }
        middle = (y[1] + split) / 2
        plate = Rod(
            start=(x[1] - 0.42 * self.depth_m, middle, z[0] + 0.024),
            end=(x[1] - 0.42 * self.depth_m, middle, z[0] + 0.032),
            radius_m=0.32 * self.depth_m,
        )
        panel_y = (y[0], split - GAP_M)
        box = {"box": (body_x, (y[0], split), z)}
        shapes = (
            *lined("oven", (body_x, (split, y[1]), z), WALLS_M, self.finish),
            shape("oven_electronics", self.finish, box),
            shape("oven_panel", "black_plastic", {"panel": ((x[0], body_x[0]), panel_y, z)}),
            shape("oven_plate", "glass", {"plate": plate}),
            shape("oven_feet", "rubber", feet),
        )
        parts = [Part(name="body", shapes=shapes), self._door(front, (split, y[1]), z)]
        for k, name in enumerate(("power_knob", "time_knob")[: self.knobs]):
            at = (x[0], sum(panel_y) / 2, z[0] + (0.28 + 0.34 * k) * (z[1] - z[0]))
            motion = hinge("body", name, at, (-1.0, 0.0, 0.0), 4.712, stiff=0.02)
            shapes = (knob(name, at, 0.021, 0.024),)
            parts.append(Part(name=name, shapes=shapes, motion=motion))
        return linked(parts)

    def _door(self, x: tuple[float, float], y: tuple[float, float], z: tuple[float, float]) -> Part:
        rim = 0.045
        window = (shrunk((y[0] + 0.03, y[1]), rim), shrunk(z, rim))
        pane = (around((x[0] + x[1]) / 2, 0.5 * self.door_m), *window)
        at = (x[0], y[0] + 0.028, (z[0] + z[1]) / 2)
        shapes = (
            shape("door_frame", self.finish, frame((y, z), window, x), 500.0),
            shape("door_window", "dark_glass", {"pane": pane}, 1200.0),
            bar_handle("door_handle", at, 0.65 * (z[1] - z[0]), upright=True),
        )
        motion = swing("body", "door", (x[0], y[1], z[0]), LEFT)
        return Part(name="door", shapes=shapes, motion=motion)
