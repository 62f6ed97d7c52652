"""A door in its frame, with a lever."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from articulate.library.procedural.build import (
    LEFT,
    RIGHT,
    Piece,
    Span,
    hinge,
    linked,
    shape,
    shrunk,
)
from articulate.library.procedural.dimensions import Dimensions, between, integer, one_of
from articulate.library.procedural.solids import Rod
from articulate.library.procedural.urdf import Part

GAP_M = 0.004
"""Gap between leaf and frame [m]."""
LEVER_M = 1.03
"""Height of the lever [m]."""


@dataclass(frozen=True, kw_only=True)
class Door(Dimensions):
    """Leaf that opens towards the front; its lever is a separate joint."""

    category: ClassVar[str] = "Door"

    width_m: float = between(0.75, 0.95, accepted=(0.5, 1.3))
    """Width of the leaf along y [m]."""
    height_m: float = between(1.95, 2.10, accepted=(1.4, 2.8))
    """Height of the leaf [m]."""
    leaf_m: float = between(0.036, 0.044)
    """Thickness of the leaf [m]."""
    frame_m: float = between(0.05, 0.08)
    """Width of the frame [m]."""
    panels: int = integer(1, 3)
    """Raised panels on the leaf."""
    hinges: str = one_of("left", "right")
    """Edge at which the leaf turns, seen from the front."""
    open_rad: float = between(1.4, 1.8)
    """Widest opening [rad]."""
    wood: str = one_of("white_lacquer", "oak", "walnut")
    """Material of leaf and frame."""

    def parts(self) -> list[Part]:
        """Frame, leaf, lever."""
        half, top = self.width_m / 2, self.height_m + 0.008
        hole, outer = half + GAP_M, half + GAP_M + self.frame_m
        x = (-0.05, 0.05)
        posts: dict[str, Piece] = {
            "left": (x, (hole, outer), (0.0, top + GAP_M)),
            "right": (x, (-outer, -hole), (0.0, top + GAP_M)),
            "lintel": (x, (-outer, outer), (top + GAP_M, top + GAP_M + self.frame_m)),
        }
        posts["stop"] = (
            (x[0] + self.leaf_m + 0.004, x[1]),
            (-hole, hole),
            (top - 0.012, top + GAP_M),
        )
        frame = Part(name="frame", shapes=(shape("frame_posts", self.wood, posts),))
        side = LEFT if self.hinges == "left" else RIGHT
        leaf_x = (x[0], x[0] + self.leaf_m)
        leaf = Part(
            name="leaf",
            shapes=(
                shape(
                    "leaf_board",
                    self.wood,
                    {"board": (leaf_x, (-half, half), (0.008, top - 0.014))},
                    350.0,
                ),
                shape("leaf_panels", self.wood, self._raised_panels(leaf_x[0], half, top)),
            ),
            motion=hinge(
                "frame",
                "leaf",
                (x[0], side * half, 0.0),
                (0.0, 0.0, -side),
                self.open_rad,
                stiff=0.8,
            ),
        )
        return linked([frame, leaf, self._lever((leaf_x[0], -side * (half - 0.07), LEVER_M), side)])

    def _raised_panels(self, x: float, half: float, top: float) -> dict[str, Piece]:
        """Build raised panels on the front."""
        step = (top - 0.2) / self.panels
        out: dict[str, Piece] = {}
        for k in range(self.panels):
            z: Span = (0.1 + k * step, 0.1 + (k + 1) * step)
            out[f"panel_{k}"] = ((x - 0.006, x), (0.14 - half, half - 0.14), shrunk(z, 0.05))
        return out

    def _lever(self, at: tuple[float, float, float], side: float) -> Part:
        """Build a lever that points to the hinge and is pressed down."""
        x, y, z = at
        out = x - 0.055
        pieces: dict[str, Piece] = {
            "axle": Rod(start=(x, y, z), end=(out - 0.009, y, z), radius_m=0.010),
            "lever": Rod(start=(out, y, z), end=(out, y + side * 0.125, z), radius_m=0.009),
        }
        motion = hinge("leaf", "lever", (x, y, z), (side, 0.0, 0.0), 0.7, stiff=0.15)
        own = shape("lever_handle", "chrome", pieces)
        return Part(name="lever", shapes=(own,), motion=motion)
