"""A safe with a wheel and a dial on its door."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

from articulate.library.procedural.build import (
    LEFT,
    RIGHT,
    Piece,
    cavity,
    corners_of,
    hinge,
    knob,
    linked,
    shape,
    shrunk,
    swing,
    turning,
)
from articulate.library.procedural.dimensions import Dimensions, between, integer, one_of
from articulate.library.procedural.solids import Ring, Rod
from articulate.library.procedural.urdf import Part

GAP_M = 0.003
"""Gap round the door [m]."""


@dataclass(frozen=True, kw_only=True)
class Safe(Dimensions):
    """Thick walls and a thick door; the wheel moves no bolts."""

    category: ClassVar[str] = "Safe"

    width_m: float = between(0.34, 0.50, accepted=(0.25, 1.0))
    """Width along y [m]."""
    depth_m: float = between(0.32, 0.44, accepted=(0.25, 0.8))
    """Depth along x without the wheel [m]."""
    height_m: float = between(0.34, 0.60, accepted=(0.25, 1.5))
    """Height [m]."""
    wall_m: float = between(0.022, 0.035)
    """Thickness of the walls [m]."""
    door_m: float = between(0.035, 0.050)
    """Thickness of the door [m]."""
    wheel_m: float = between(0.050, 0.065)
    """Radius of the wheel [m]."""
    spokes: int = integer(3, 5)
    """Spokes of the wheel."""
    hinges: str = one_of("left", "right")
    """Edge at which the door turns, seen from the front."""
    finish: str = one_of("dark_steel", "green_plastic", "grey_plastic")
    """Material of walls and door."""

    def parts(self) -> list[Part]:
        """Build the safe, its door, wheel and dial."""
        x = (-self.depth_m / 2, self.depth_m / 2)
        y = (-self.width_m / 2, self.width_m / 2)
        z = (0.015, self.height_m)
        front = (x[0], x[0] + self.door_m)
        body_x = (front[1] + GAP_M, x[1])
        walls = cavity((body_x, y, z), self.wall_m)
        inner_y, inner_z = shrunk(y, self.wall_m), shrunk(z, self.wall_m)
        middle = 0.5 * sum(inner_z)
        shelf = ((body_x[0] + 0.03, x[1] - self.wall_m), inner_y, (middle, middle + 0.006))
        feet: dict[str, Piece] = {
            f"foot_{k}": Rod(start=(a, b, 0.0), end=(a, b, z[0]), radius_m=0.018)
            for k, (a, b) in enumerate(corners_of(body_x, y, 0.04))
        }
        body = Part(
            name="body",
            shapes=(
                shape("body_walls", self.finish, walls, 1500.0),
                shape("body_shelf", "grey_plastic", {"shelf": shelf}),
                shape("body_feet", "rubber", feet),
            ),
        )
        side = RIGHT if self.hinges == "right" else LEFT
        inset = (shrunk(inner_y, 0.02), shrunk(inner_z, 0.02))
        bolts = {"plug": ((front[1], front[1] + 0.012), *inset)}
        door = Part(
            name="door",
            shapes=(
                shape("door_plate", self.finish, {"plate": (front, y, z)}, 900.0),
                shape("door_plug", "chrome", bolts, 900.0),
            ),
            motion=swing("body", "door", (x[0], side * self.width_m / 2, z[0]), side, 1.8),
        )
        y_wheel = -side * 0.12 * self.width_m
        wheel = self._wheel((x[0], y_wheel, z[0] + 0.40 * (z[1] - z[0])))
        at = (x[0], y_wheel, z[0] + 0.40 * (z[1] - z[0]) + self.wheel_m + 0.055)
        dial = Part(
            name="dial",
            shapes=(knob("dial_knob", at, 0.022, 0.028),),
            motion=turning("door", "dial", at, (-1.0, 0.0, 0.0)),
        )
        return linked([body, door, wheel, dial])

    def _wheel(self, at: tuple[float, float, float]) -> Part:
        x, y, z = at
        out, r = x - 0.045, self.wheel_m
        rim = Ring(
            axis=0,
            centre=(out, y, z),
            low=(-0.006, r - 0.007, r + 0.005),
            high=(0.006, r - 0.007, r + 0.005),
        )
        pieces: dict[str, Piece] = {
            "rim": rim,
            "hub": Rod(start=at, end=(out - 0.008, y, z), radius_m=0.012),
        }
        for k in range(self.spokes):
            turn = 2.0 * math.pi * k / self.spokes + math.pi / 2
            end = (out, y + (r - 0.003) * math.cos(turn), z + (r - 0.003) * math.sin(turn))
            pieces[f"spoke_{k}"] = Rod(start=(out, y, z), end=end, radius_m=0.005)
        motion = hinge("door", "wheel", at, (-1.0, 0.0, 0.0), math.pi / 2, stiff=0.1)
        own = shape("wheel_handle", "chrome", pieces)
        return Part(name="wheel", shapes=(own,), motion=motion)
