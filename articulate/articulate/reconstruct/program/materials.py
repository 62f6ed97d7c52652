"""Table of materials: density and thickness of walls."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class PartMaterial:
    """Material of a part."""

    density: float
    """Density of the material [kg/m3]."""
    wall_m: float
    """Thickness of walls of hollow parts and of open surfaces [m]."""


MATERIALS: dict[str, PartMaterial] = {
    "wood": PartMaterial(density=650.0, wall_m=0.016),  # particle board of cabinets
    "metal": PartMaterial(density=7800.0, wall_m=0.001),  # sheet of appliances
    "plastic": PartMaterial(density=1050.0, wall_m=0.003),  # ABS
    "glass": PartMaterial(density=2500.0, wall_m=0.005),
    "ceramic": PartMaterial(density=2300.0, wall_m=0.010),
    "fabric": PartMaterial(density=300.0, wall_m=0.010),
    "rubber": PartMaterial(density=1100.0, wall_m=0.005),
}
"""Common commercial materials; ``geometry.presets`` has damping and friction of joints."""
DEFAULT = "wood"
EFFORT = {"slide": 100.0, "hinge": 50.0}
"""Effort limit of the URDF [N or Nm], above that of the arm, so that it never limits."""
VELOCITY = {"slide": 2.0, "hinge": 6.0}
"""Velocity limit of the URDF [m/s or rad/s], likewise."""
