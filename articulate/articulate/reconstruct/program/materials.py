"""The one table of materials: what a mesh does not say."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class PartMaterial:
    """What a part is made of."""

    density: float
    """Of the stuff itself [kg/m3]."""
    wall_m: float
    """Thickness of its walls where the mesh is a mere surface or the part is hollow [m]."""


MATERIALS: dict[str, PartMaterial] = {
    "wood": PartMaterial(density=650.0, wall_m=0.016),  # particle board of cabinets
    "metal": PartMaterial(density=7800.0, wall_m=0.001),  # sheet of appliances
    "plastic": PartMaterial(density=1050.0, wall_m=0.003),  # ABS
    "glass": PartMaterial(density=2500.0, wall_m=0.005),
    "ceramic": PartMaterial(density=2300.0, wall_m=0.010),
    "fabric": PartMaterial(density=300.0, wall_m=0.010),
    "rubber": PartMaterial(density=1100.0, wall_m=0.005),
}
"""Densities and walls as sold; damping and friction of joints are those of ``convert.presets``."""
DEFAULT = "wood"
EFFORT = {"slide": 100.0, "hinge": 50.0}
"""Largest effort that a URDF must name [N or Nm]: beyond what the arm gives, so that it never
limits."""
VELOCITY = {"slide": 2.0, "hinge": 6.0}
"""Largest speed that a URDF must name [m/s or rad/s], likewise."""
