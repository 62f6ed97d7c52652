"""A laptop computer."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from articulate.library.procedural.build import Piece, around, hinge, linked, shape, shrunk
from articulate.library.procedural.dimensions import Dimensions, between, one_of
from articulate.library.procedural.urdf import Part

GAP_M = 0.004
"""Gap between base and lid for the keys [m]."""


@dataclass(frozen=True, kw_only=True)
class Laptop(Dimensions):
    """A base with keys, and a lid with the screen; a lip in front of the lid opens it."""

    category: ClassVar[str] = "Laptop"

    width_m: float = between(0.29, 0.39, accepted=(0.22, 0.45))
    """Width along y [m]."""
    depth_m: float = between(0.20, 0.27, accepted=(0.16, 0.33))
    """Depth along x without the lip [m]."""
    base_m: float = between(0.014, 0.022)
    """Thickness of the base [m]."""
    lid_m: float = between(0.007, 0.010)
    """Thickness of the lid [m]."""
    lip_m: float = between(0.010, 0.014)
    """Overhang of the lip [m]."""
    open_rad: float = between(1.9, 2.4)
    """Widest opening of the lid [rad]."""
    finish: str = one_of("grey_plastic", "black_plastic", "chrome")
    """Material of base and lid."""

    def parts(self) -> list[Part]:
        """Build the base and the lid."""
        x = (-self.depth_m / 2, self.depth_m / 2)
        y = (-self.width_m / 2, self.width_m / 2)
        base_z = (0.0, self.base_m)
        low = self.base_m + GAP_M
        lid_z = (low, low + self.lid_m)
        step = 0.5 * self.depth_m / 5
        pitch, up = 0.9 * self.width_m / 8, self._up()
        keys: dict[str, Piece] = {}
        for row in range(4):
            key_x = around(x[1] - 0.03 - (row + 0.5) * step, 0.85 * step)
            for k in range(8):
                b = 0.45 * self.width_m - (k + 0.5) * pitch
                keys[f"key_{row}_{k}"] = (key_x, around(b, 0.9 * pitch), up)
        space_x = around(x[1] - 0.03 - 4.5 * step, 0.85 * step)
        keys["space"] = (space_x, around(0.0, 0.4 * self.width_m), up)
        pad = (around(x[0] + 0.2 * self.depth_m, 0.24 * self.depth_m), around(0.0, 0.1))
        hinges: dict[str, Piece] = {
            f"hinge_{k}": (
                (x[1] - 0.012, x[1] - 0.001),
                around(b, 0.05),
                (self.base_m, low - 0.001),
            )
            for k, b in enumerate((-0.3 * self.width_m, 0.3 * self.width_m))
        }
        base = Part(
            name="base",
            shapes=(
                shape("base_case", self.finish, {"case": (x, y, base_z)}, 1600.0),
                shape("base_keys", "black_plastic", keys),
                shape("base_pad", "dark_glass", {"pad": (*pad, self._up())}),
                shape("base_hinges", "black_plastic", hinges),
            ),
        )
        screen = (shrunk(x, 0.012), shrunk(y, 0.012), (low - 0.001, low))
        lip = ((x[0] - self.lip_m, x[0]), around(0.0, 0.07), lid_z)
        lid = Part(
            name="lid",
            shapes=(
                shape("lid_case", self.finish, {"case": (x, y, lid_z)}, 900.0),
                shape("lid_screen", "screen", {"screen": screen}),
                shape("lid_handle", self.finish, {"lip": lip}),
            ),
            motion=hinge(
                "base", "lid", (x[1], 0.0, low), (0.0, 1.0, 0.0), self.open_rad, stiff=0.25
            ),
        )
        return linked([base, lid])

    def _up(self) -> tuple[float, float]:
        """Extent along z of the parts on the base."""
        return (self.base_m, self.base_m + 0.0015)
