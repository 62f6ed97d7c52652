"""Upright suitcase on wheels."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from articulate.library.procedural.build import (
    LEFT,
    RIGHT,
    Piece,
    around,
    cavity,
    linked,
    shape,
    shrunk,
    slide,
    swing,
)
from articulate.library.procedural.dimensions import Dimensions, between, one_of
from articulate.library.procedural.solids import Rod
from articulate.library.procedural.urdf import Part

GAP_M = 0.002
"""Gap between the two shells [m]."""
WALL_M = 0.006
"""Thickness of the shells [m]."""


@dataclass(frozen=True, kw_only=True)
class Suitcase(Dimensions):
    """Two shells, the one in front opens like a door; a telescopic handle is pulled out above."""

    category: ClassVar[str] = "Suitcase"

    width_m: float = between(0.38, 0.48, accepted=(0.3, 0.6))
    """Width along y [m]."""
    height_m: float = between(0.50, 0.70, accepted=(0.35, 0.9))
    """Height of the shells [m]."""
    depth_m: float = between(0.20, 0.30, accepted=(0.15, 0.4))
    """Depth of both shells along x [m]."""
    front_share: float = between(0.35, 0.50)
    """Depth of the front shell over that of both."""
    wheel_m: float = between(0.020, 0.030)
    """Radius of the wheels [m]."""
    pull_m: float = between(0.30, 0.42)
    """Travel of the pulled handle [m]."""
    hinges: str = one_of("left", "right")
    """Edge at which the front shell turns, seen from the front."""
    finish: str = one_of("blue_plastic", "red_plastic", "grey_plastic", "black_plastic")
    """Material of the shells."""

    def parts(self) -> list[Part]:
        """Build the suitcase, its front shell, its pulled handle."""
        x = (-self.depth_m / 2, self.depth_m / 2)
        y = (-self.width_m / 2, self.width_m / 2)
        low = 2 * self.wheel_m + 0.01
        z = (low, low + self.height_m)
        split = x[0] + self.front_share * self.depth_m
        wheels: dict[str, Piece] = {}
        forks: dict[str, Piece] = {}
        for k, (a, b) in enumerate((a, b) for a in shrunk(x, 0.04) for b in shrunk(y, 0.05)):
            at = (a + 0.03) if a < 0 else a
            ends = [(at, b + d, self.wheel_m) for d in (-0.009, 0.009)]
            wheels[f"wheel_{k}"] = Rod(start=ends[0], end=ends[1], radius_m=self.wheel_m)
            for i, side in enumerate((-0.013, 0.013)):
                span = (self.wheel_m - 0.006, low)
                forks[f"fork_{k}_{i}"] = (around(at, 0.016), around(b + side, 0.006), span)
        guides: dict[str, Piece] = {
            f"guide_{k}_{i}": ((x[1], x[1] + 0.006), around(b, 0.03), around(at, 0.03))
            for k, b in enumerate((-0.07, 0.07))
            for i, at in enumerate((z[0] + 0.15, z[1] - 0.03))
        }
        body = Part(
            name="body",
            shapes=(
                shape("body_shell", self.finish, cavity(((split, x[1]), y, z), WALL_M)),
                shape("body_wheels", "rubber", wheels),
                shape("body_forks", "black_plastic", forks),
                shape("body_guides", "black_plastic", guides),
            ),
        )
        return linked([body, self._shell((x[0], split - GAP_M), y, z), self._pull(x[1], z)])

    def _shell(
        self, x: tuple[float, float], y: tuple[float, float], z: tuple[float, float]
    ) -> Part:
        """Build the front shell with a lip at the edge that opens."""
        side = LEFT if self.hinges == "left" else RIGHT
        wall, inner_z = WALL_M, shrunk(z, WALL_M)
        pieces: dict[str, Piece] = {
            "front": ((x[0], x[0] + wall), y, z),
            "above": ((x[0] + wall, x[1]), y, (inner_z[1], z[1])),
            "below": ((x[0] + wall, x[1]), y, (z[0], inner_z[0])),
            "left": ((x[0] + wall, x[1]), (y[1] - wall, y[1]), inner_z),
            "right": ((x[0] + wall, x[1]), (y[0], y[0] + wall), inner_z),
        }
        edge = -side * self.width_m / 2
        lip = (
            (x[1] - 0.012, x[1]),
            (min(edge, edge - side * 0.03), max(edge, edge - side * 0.03)),
            around(sum(z) / 2, 0.12),
        )
        shapes = (
            shape("front_shell", self.finish, pieces),
            shape("front_handle", "black_plastic", {"lip": lip}),
        )
        at = (x[1], -edge, z[0])
        return Part(name="front", shapes=shapes, motion=swing("body", "front", at, side, 1.7))

    def _pull(self, x: float, z: tuple[float, float]) -> Part:
        """Two rods behind the shell with a grip between their upper ends."""
        at, top = x + 0.015, z[1] + 0.04
        rods: dict[str, Piece] = {
            f"rod_{k}": Rod(start=(at, b, z[0] + 0.05), end=(at, b, top), radius_m=0.007)
            for k, b in enumerate((-0.07, 0.07))
        }
        grip = Rod(start=(at, -0.085, top), end=(at, 0.085, top), radius_m=0.012)
        shapes = (
            shape("pull_rods", "chrome", rods),
            shape("pull_handle", "black_plastic", {"grip": grip}),
        )
        motion = slide("body", "pull", (at, 0.0, top), (0.0, 0.0, 1.0), self.pull_m)
        return Part(name="pull", shapes=shapes, motion=motion)
