"""Up axis of a file: the turn from y up to z up, and signs that it was read the wrong way."""

from __future__ import annotations

import numpy as np

from articulate.assets.asset import Asset, Joint
from articulate.task.part_kinds import named_kind
from articulate.transforms import Array, normalised, pose

Z_FROM_Y_UP = pose(np.zeros(3), [[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
"""Pose of a frame with y up in one with z up (4, 4); the front (z) becomes -y."""
UPWARDS = 0.7
"""Vertical component of a unit vector above which a part opens upwards."""
FRONTS = frozenset({"Dishwasher", "Microwave", "Oven", "Refrigerator", "Safe", "StorageFurniture"})
"""Categories whose doors and drawers open forwards or sideways."""


def parts_opening_upwards(asset: Asset) -> tuple[str, ...]:
    """Return the links that indicate an object on its back, if there are any.

    These are doors and drawers, by name or by category, that open upwards about a level axis or
    along an upright one, while no other part opens sideways. A quarter turn would set the hinge
    upright, or the handle in front.
    """
    upwards = []
    for joint in asset.joints:
        is_front = named_kind(joint) in ("door", "drawer")
        if not is_front and not (named_kind(joint) is None and asset.category in FRONTS):
            continue
        if opening_direction(asset, joint)[2] <= UPWARDS:
            return ()
        upwards.append(joint.link)
    return tuple(upwards)


def opening_direction(asset: Asset, joint: Joint) -> Array:
    """Return the unit vector (3,) along which the middle of a closed part starts to open."""
    sign = 1.0 if joint.span >= 0.0 else -1.0
    axis = sign * np.asarray(joint.axis_o)
    if joint.kind == "slide":
        return axis
    low, high = (np.asarray(corner) for corner in asset.link(joint.link).bounds_l)
    T_ol = asset.T_ol(joint.name, joint.closed)
    middle = T_ol[:3, :3] @ ((low + high) / 2.0) + T_ol[:3, 3]
    return normalised(np.cross(axis, middle - np.asarray(joint.pivot_o)))
