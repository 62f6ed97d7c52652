"""Refrigerator and freezer with one door each."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from articulate.library.procedural.build import (
    LEFT,
    RIGHT,
    Piece,
    Span,
    bar_handle,
    lined,
    linked,
    shape,
    shrunk,
    swing,
    tray,
)
from articulate.library.procedural.dimensions import Dimensions, between, one_of
from articulate.library.procedural.urdf import Part

GAP_M = 0.004
"""Gap round the doors [m]."""
WALLS_M = (0.030, 0.012)
"""Thickness of shell and liner [m]."""
FOOT_M = 0.05
"""Height of the doors over the floor [m]."""


@dataclass(frozen=True, kw_only=True)
class Fridge(Dimensions):
    """Two cavities above each other, each with shelves and a door."""

    category: ClassVar[str] = "Refrigerator"

    width_m: float = between(0.55, 0.70, accepted=(0.45, 1.0))
    """Width along y [m]."""
    depth_m: float = between(0.58, 0.68, accepted=(0.45, 0.9))
    """Depth along x without handles [m]."""
    height_m: float = between(1.50, 1.85, accepted=(0.9, 2.2))
    """Height [m]."""
    door_m: float = between(0.050, 0.065)
    """Thickness of the doors [m]."""
    freezer: str = one_of("below", "above")
    """Position of the freezer."""
    freezer_share: float = between(0.28, 0.38)
    """Height of the freezer over that of the doors."""
    hinges: str = one_of("left", "right")
    """Edge at which the doors turn, seen from the front."""
    handle_m: float = between(0.25, 0.45)
    """Length of the larger door's handle [m]."""
    finish: str = one_of("steel", "white_sheet", "dark_steel")
    """Material of shell and doors."""

    def parts(self) -> list[Part]:
        """Build the refrigerator, its two doors."""
        x = (-self.depth_m / 2, self.depth_m / 2)
        y = (-self.width_m / 2, self.width_m / 2)
        room = (FOOT_M, self.height_m)
        share = self.freezer_share if self.freezer == "below" else 1.0 - self.freezer_share
        split = room[0] + share * (room[1] - room[0])
        names = ("freezer", "fridge") if self.freezer == "below" else ("fridge", "freezer")
        body_x = (x[0] + self.door_m + GAP_M, x[1])
        shapes = [shape("fridge_foot", "black_plastic", {"foot": (body_x, y, (0.0, FOOT_M))})]
        doors = []
        for name, z in zip(names, ((room[0], split), (split, room[1])), strict=True):
            shapes += lined(name, (body_x, y, z), WALLS_M, self.finish)
            count = 3 if name == "fridge" else 1
            step = (z[1] - z[0]) / (count + 1)
            inside = ((body_x[0] + 0.15, x[1] - 0.05), shrunk(y, 0.042))
            levels = (z[0] + (k + 1) * step for k in range(count))
            shelves: dict[str, Piece] = {
                f"shelf_{k}": (*inside, (at, at + 0.008)) for k, at in enumerate(levels)
            }
            shapes.append(shape(f"{name}_shelves", "glass", shelves))
            doors.append(self._door(f"{name}_door", (x[0], x[0] + self.door_m), y, z))
        return linked([Part(name="body", shapes=tuple(shapes)), *doors])

    def _door(self, name: str, x: Span, y: Span, z: Span) -> Part:
        """Build a door with a shelf on its inside."""
        side = RIGHT if self.hinges == "right" else LEFT
        z = shrunk(z, GAP_M / 2)
        height = z[1] - z[0]
        inner_x = (x[1], x[1] + 0.10)
        inner_y = shrunk(y, 0.09)
        bins: dict[str, Piece] = {}
        for k in range(2 if height > 0.8 else 1):
            low = z[0] + 0.12 + k * 0.45 * height
            bins |= tray((inner_x, inner_y, (low, low + 0.09)), 0.005, name=f"bin_{k}_")
        length = min(self.handle_m, 0.6 * height)
        near_split = z[1] - 0.08 - length / 2 if z[0] < 0.1 else z[0] + 0.08 + length / 2
        at = (x[0], -side * (self.width_m / 2 - 0.05), near_split)
        motion = swing("body", name, (x[0], side * self.width_m / 2, z[0]), side)
        shapes = (
            shape(f"{name}_panel", self.finish, {"panel": (x, y, z)}, 140.0),
            shape(f"{name}_bins", "glass", bins, 900.0),
            bar_handle(f"{name}_handle", at, length, upright=True),
        )
        return Part(name=name, shapes=shapes, motion=motion)
