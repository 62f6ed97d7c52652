"""Physical presets for values that a URDF rarely has: mass, damping and friction."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

MASS_KG = {"slide": (0.2, 6.0), "hinge": (0.05, 15.0), "fixed": (0.2, 200.0)}
"""Range of a part's mass by its joint [kg]; outside it the density is scaled.

An empty kitchen drawer weighs 1.5 to 5 kg, a refrigerator's door up to 15. The fixed body never
moves; its mass is for reports.
"""
SLIDING_FRICTION = 0.8
"""Coulomb friction of every collision geom; wood or lacquer on rubber, middle of 0.6 to 1.0."""
TORSIONAL_FRICTION_M = 0.005
"""MuJoCo's default torsional friction [m]."""
ROLLING_FRICTION_M = 0.0001
"""MuJoCo's default rolling friction [m]."""


@dataclass(frozen=True, kw_only=True)
class Weight:
    """Weight of the parts of a category without masses in the file."""

    density_kg_m3: float
    """Density of the collision shapes [kg/m3]."""
    sheet_kg_m2: float
    """Least weight per area of a shape [kg/m2]: some models have panels as thin as paper."""


WEIGHT = {
    "unknown": Weight(density_kg_m3=500.0, sheet_kg_m2=2.0),
    "StorageFurniture": Weight(density_kg_m3=500.0, sheet_kg_m2=3.0),
    "Table": Weight(density_kg_m3=500.0, sheet_kg_m2=3.0),
    "Door": Weight(density_kg_m3=400.0, sheet_kg_m2=10.0),
    "Window": Weight(density_kg_m3=600.0, sheet_kg_m2=10.0),
    "Refrigerator": Weight(density_kg_m3=150.0, sheet_kg_m2=10.0),
    "Dishwasher": Weight(density_kg_m3=250.0, sheet_kg_m2=10.0),
    "Oven": Weight(density_kg_m3=300.0, sheet_kg_m2=15.0),
    "Microwave": Weight(density_kg_m3=250.0, sheet_kg_m2=10.0),
    "WashingMachine": Weight(density_kg_m3=250.0, sheet_kg_m2=10.0),
    "Safe": Weight(density_kg_m3=800.0, sheet_kg_m2=15.0),
    "Laptop": Weight(density_kg_m3=1200.0, sheet_kg_m2=5.0),
    "TrashCan": Weight(density_kg_m3=300.0, sheet_kg_m2=2.0),
    "Box": Weight(density_kg_m3=200.0, sheet_kg_m2=0.5),
    "Kettle": Weight(density_kg_m3=500.0, sheet_kg_m2=2.0),
    "Faucet": Weight(density_kg_m3=2500.0, sheet_kg_m2=5.0),
}
"""Weight of parts by category.

Shapes follow panels: particle board is 600 to 700 but carries relief and gaps, which the boxes
fill; appliances are foam and sheet metal; a drawer of 10 mm panels comes out at 1.5 to 5 kg.
A sheet of 10 kg/m2 is 4 mm of glass or 1.3 mm of steel, as doors of appliances have in total; 2 is
2 mm of plastic, 3 is 5 mm of board, 5 the lid of a laptop with its screen, 0.5 cardboard.
"""


@dataclass(frozen=True, kw_only=True)
class JointPreset:
    """Damping and dry friction of one kind of joint."""

    damping: float
    """Viscous damping [N s/m or Nm s/rad]."""
    frictionloss: float
    """Dry friction [N or Nm]."""
    armature: float
    """Added inertia [kg or kg m2]; keeps light parts stable at 2 ms steps."""


SLIDE = JointPreset(damping=5.0, frictionloss=2.0, armature=0.05)
"""A drawer on rollers."""
LARGE_HINGE = JointPreset(damping=0.1, frictionloss=0.1, armature=0.005)
"""A door, moving part of more than 0.5 kg."""
SMALL_HINGE = JointPreset(damping=0.01, frictionloss=0.01, armature=0.0005)
"""A lid, knob or lever of at most 0.5 kg."""
LARGE_HINGE_KG = 0.5


def weight(category: str) -> Weight:
    """Return the weight of the parts of an object of ``category``."""
    return WEIGHT.get(category, WEIGHT["unknown"])


def joint_preset(kind: Literal["slide", "hinge"], mass_kg: float) -> JointPreset:
    """Return damping and friction of a joint that moves ``mass_kg`` [kg]."""
    if kind == "slide":
        return SLIDE
    return LARGE_HINGE if mass_kg > LARGE_HINGE_KG else SMALL_HINGE


def joint_dynamics(
    preset: JointPreset, damping: float | None, friction: float | None, *, rescaled: bool
) -> tuple[float, float]:
    """Return damping and dry friction of a joint, from the file if it has positive ones.

    Args:
        preset: Values for a file without them.
        damping: Damping in the file, if any [N s/m or Nm s/rad].
        friction: Dry friction in the file, if any [N or Nm].
        rescaled: The source is not metric, so that its values are meaningless.
    """
    stated = [
        v if v is not None and v > 0.0 and not rescaled else None for v in (damping, friction)
    ]
    return (
        preset.damping if stated[0] is None else stated[0],
        preset.frictionloss if stated[1] is None else stated[1],
    )
