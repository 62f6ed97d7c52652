"""A dishwasher whose door falls open."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from articulate.library.procedural.build import (
    Piece,
    around,
    bar_handle,
    hinge,
    lined,
    linked,
    shape,
    shrunk,
)
from articulate.library.procedural.dimensions import Dimensions, between, one_of
from articulate.library.procedural.urdf import Part

GAP_M = 0.003
"""Gap round the door [m]."""
FOOT_M = 0.10
"""Height of the door over the floor [m]."""


@dataclass(frozen=True, kw_only=True)
class Dishwasher(Dimensions):
    """A cavity with two racks behind a door with a panel on top."""

    category: ClassVar[str] = "Dishwasher"

    width_m: float = between(0.45, 0.60, accepted=(0.4, 0.61))
    """Width along y [m]."""
    depth_m: float = between(0.55, 0.62, accepted=(0.45, 0.7))
    """Depth along x without the handle [m]."""
    height_m: float = between(0.81, 0.87, accepted=(0.7, 0.88))
    """Height [m]."""
    door_m: float = between(0.040, 0.055)
    """Thickness of the door [m]."""
    open_rad: float = between(1.45, 1.57)
    """Widest opening of the door [rad]."""
    handle_share: float = between(0.5, 0.8)
    """Length of the handle over the width."""
    finish: str = one_of("steel", "white_sheet", "dark_steel")
    """Material of the door."""

    def parts(self) -> list[Part]:
        """Build the dishwasher and its door."""
        x = (-self.depth_m / 2, self.depth_m / 2)
        y = (-self.width_m / 2, self.width_m / 2)
        top = self.height_m - 0.025
        front = (x[0], x[0] + self.door_m)
        body_x = (front[1] + GAP_M, x[1])
        foot = {"foot": ((body_x[0] + 0.04, x[1]), y, (0.0, FOOT_M))}
        cover = {"cover": ((x[0], x[1]), y, (top, self.height_m))}
        shapes = [
            *lined("tub", (body_x, y, (FOOT_M, top)), (0.02, 0.008), "white_sheet"),
            shape("tub_foot", "black_plastic", foot),
            shape("tub_cover", "white_lacquer", cover),
            shape("racks", "grey_plastic", self._racks((body_x[0] + 0.02, x[1] - 0.05), y, top)),
        ]
        z = (FOOT_M, top - GAP_M)
        panel_z = (z[1] - 0.09, z[1])
        leaf_z = (z[0], panel_z[0])
        door = (
            shape("door_leaf", self.finish, {"leaf": (front, y, leaf_z)}, 180.0),
            shape("door_panel", "black_plastic", {"panel": (front, y, panel_z)}, 300.0),
            bar_handle(
                "door_handle",
                (front[0], 0.0, leaf_z[1] - 0.05),
                self.handle_share * self.width_m,
                upright=False,
            ),
        )
        axis = (0.0, -1.0, 0.0)
        motion = hinge("body", "door", (front[0], 0.0, z[0]), axis, self.open_rad, stiff=1.0)
        return linked(
            [
                Part(name="body", shapes=tuple(shapes)),
                Part(name="door", shapes=door, motion=motion),
            ]
        )

    def _racks(
        self, x: tuple[float, float], y: tuple[float, float], top: float
    ) -> dict[str, Piece]:
        """Two racks of bars with a rim, fixed."""
        inner_y, out = shrunk(y, 0.04), dict[str, Piece]()
        for k, share in enumerate((0.12, 0.55)):
            low = FOOT_M + share * (top - FOOT_M)
            for i in range(5):
                at = inner_y[0] + 0.005 + i * (inner_y[1] - inner_y[0] - 0.01) / 4
                out[f"rack_{k}_bar_{i}"] = (x, around(at, 0.01), (low, low + 0.01))
            for i, at in enumerate((x[0] + 0.005, x[1] - 0.005)):
                out[f"rack_{k}_rim_{i}"] = (around(at, 0.01), inner_y, (low + 0.01, low + 0.07))
        return out
