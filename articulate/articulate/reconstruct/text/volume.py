"""Sizes of an object with a given volume of its interior."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np

from articulate.library.procedural.dimensions import Dimensions

OUTER_VOLUME = {
    "trash_can": 1.15,
    "bucket": 1.1,
    "bottle": 1.3,
    "kettle": 1.3,
    "kitchen_pot": 1.1,
    "box_with_lid": 1.2,
    "suitcase": 1.1,
    "safe": 1.6,
    "fridge": 2.2,
    "microwave": 2.4,
}
"""Outer volume by that of the interior."""
SIZES = ("radius_m", "width_m", "depth_m", "height_m")
SMALLEST, LARGEST, STEPS = 0.01, 100.0, 50
"""Range of the factor of the usual sizes, and steps of the bisection."""


@dataclass(frozen=True, kw_only=True)
class VolumeRange:
    """Volumes that the objects of a class can have."""

    low_m3: float
    """Smallest volume [m^3]."""
    high_m3: float
    """Largest volume [m^3]."""

    @property
    def text(self) -> str:
        """Return the range in litres."""
        return f"[{1000.0 * self.low_m3:.3g}, {1000.0 * self.high_m3:.4g}] l"


def sizes_of_volume(
    usual: Dimensions, name: str, volume_m3: float
) -> dict[str, float] | VolumeRange:
    """Return sizes in usual proportions with a volume [m], or the possible volumes.

    A size at its limit leaves the volume to the others.

    Args:
        usual: Usual dimensions of the class.
        name: Key of :data:`OUTER_VOLUME`.
        volume_m3: Volume of the interior [m^3].
    """
    fields = {one.name: one.metadata for one in dataclasses.fields(usual)}
    names = [one for one in SIZES if one in fields]
    base = np.array([getattr(usual, one) for one in names])
    low, high = np.array([fields[one]["accepted"] for one in names]).T

    def volume(factor: float) -> float:
        sizes = np.clip(factor * base, low, high)
        section = np.pi * sizes[0] if names[0] == "radius_m" else 1.0
        return float(section * sizes.prod() / OUTER_VOLUME[name])

    possible = VolumeRange(low_m3=volume(SMALLEST), high_m3=volume(LARGEST))
    if not possible.low_m3 <= volume_m3 <= possible.high_m3:
        return possible
    small, large = SMALLEST, LARGEST
    for _ in range(STEPS):
        middle = float(np.sqrt(small * large))
        small, large = (middle, large) if volume(middle) < volume_m3 else (small, middle)
    sizes = np.clip(large * base, low, high)
    return {one: float(size) for one, size in zip(names, sizes, strict=True)}
