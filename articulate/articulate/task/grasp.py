"""Grasp of a handle: the segment at which fingers hold it, and its thickness between them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:  # configurations import this module, and --help does without numpy
    from articulate.assets.asset import Handle
    from articulate.task.object_placement import ObjectPlacement

FINGER_M = 0.022
"""Width of a finger along the handle [m]: 21 mm in franka's finger.stl, and one."""
HELD_SHARE = 0.6
"""Smallest opening of fingers with the handle between them, as a share of its thickness; closer
fingers have grasped nothing."""
MAX_ALONG_M = 0.05
"""Largest distance from a handle's middle that counts as its middle [m]."""


@dataclass(frozen=True, kw_only=True)
class Grasp:
    """Dimensions of a handle that matter for a grasp."""

    along_m: float = 0.0
    """Distance from the handle's middle along its long axis at which fingers may hold it [m]."""
    thick_m: float = 0.0
    """Thickness between the fingers [m]."""
    beside_m: float = 0.0
    """Position of the handle's middle along the closing axis of the gripper [m]; not 0 where the
    gripper approaches beside it (:attr:`.ObjectPlacement.beside_m`)."""


NO_GRASP = Grasp()
"""Grasp of a part that is not held between the fingers: its point is to be reached."""


def grasp_of(handle: Handle | None, placement: ObjectPlacement | None = None) -> Grasp:
    """Return the grasp of ``handle`` as it is held in ``placement``; no handle means a point.

    All places along a bar or an edge are equal. A knob is held at its middle: beside it its sides
    lean outward and push fingers off.
    """
    if handle is None or handle.shut:
        return NO_GRASP
    long_m = 0.0 if handle.kind == "knob" else handle.extent[0] - FINGER_M
    along_m = min(max(0.0, 0.9 * long_m / 2.0), MAX_ALONG_M)
    beside_m = 0.0
    if placement is not None:
        beside_m = placement.beside_m if placement.flip else -placement.beside_m
    return Grasp(along_m=along_m, thick_m=handle.extent[1], beside_m=beside_m)
