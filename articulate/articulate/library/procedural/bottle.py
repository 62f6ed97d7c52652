"""A bottle with a cap that is turned or flipped open."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from articulate.library.procedural.build import Piece, around, hinge, linked, shape, turning
from articulate.library.procedural.dimensions import Dimensions, between, one_of
from articulate.library.procedural.solids import Ring, Rod, cone
from articulate.library.procedural.urdf import Part

WALL_M = 0.003
"""Thickness of the wall [m]."""
GAP_M = 0.001
"""Gap between neck and cap [m]."""


@dataclass(frozen=True, kw_only=True)
class Bottle(Dimensions):
    """A hollow bottle with a shoulder and a neck."""

    category: ClassVar[str] = "Bottle"

    radius_m: float = between(0.033, 0.045, accepted=(0.025, 0.08))
    """Radius of the body [m]."""
    height_m: float = between(0.18, 0.28, accepted=(0.1, 0.5))
    """Height up to the cap [m]."""
    neck_m: float = between(0.016, 0.020)
    """Radius of the neck [m]."""
    shoulder_share: float = between(0.14, 0.22)
    """Height of the shoulder over that of the bottle."""
    cap: str = one_of("twist", "flip")
    """A cap that turns without end, or one on a hinge."""
    cap_m: float = between(0.020, 0.028)
    """Height of the cap [m]."""
    finish: str = one_of("blue_plastic", "green_plastic", "glass", "steel")
    """Material of the bottle."""

    def parts(self) -> list[Part]:
        """Build the bottle and its cap."""
        r, neck, h = self.radius_m, self.neck_m, self.height_m
        shoulder = (0.80 - self.shoulder_share) * h
        levels = (0.006, shoulder, 0.80 * h, h)
        radii = (r, r, neck, neck)
        pieces: dict[str, Piece] = {"floor": cone(2, (0.0, 0.0, 0.0), (0.0, 0.94 * r), (0.006, r))}
        for k, name in enumerate(("body", "shoulder", "neck")):
            low, high = ((levels[i], radii[i] - WALL_M, radii[i]) for i in (k, k + 1))
            pieces[name] = Ring(low=low, high=high, segments=12)
        density = 950.0 if self.finish == "steel" else None
        bottle = Part(name="bottle", shapes=(shape("bottle_wall", self.finish, pieces, density),))
        z = h + GAP_M
        cap = Rod(start=(0.0, 0.0, z), end=(0.0, 0.0, z + self.cap_m), radius_m=neck + 0.002)
        shapes = [shape("cap_grip", "black_plastic", {"cap": cap})]
        if self.cap == "twist":
            motion = turning("bottle", "cap", (0.0, 0.0, z), (0.0, 0.0, 1.0))
        else:
            at = (neck + 0.004, 0.0, z)
            arm = ((neck, neck + 0.004), around(0.0, 0.012), (z, z + 0.006))
            shapes.append(shape("cap_arm", "black_plastic", {"arm": arm}))
            motion = hinge("bottle", "cap", at, (0.0, 1.0, 0.0), 2.1, stiff=0.01)
        return linked([bottle, Part(name="cap", shapes=tuple(shapes), motion=motion)])
