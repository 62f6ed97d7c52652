"""Placement of a child relative to its parent: one table and one formula."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from articulate.transforms import Array


@dataclass(frozen=True)
class Side:
    """A side of the parent, seen with the front along +x, the right along +y and up along +z."""

    axis: int
    """0, 1 or 2: the axis along which the child moves."""
    sign: int
    """Face of that axis: +1 for the larger coordinate, -1 for the smaller one."""
    inside: bool
    """True if the child is inside the parent's box and flush with the face, else outside of it."""


TABLE: dict[str, Side | None] = {
    "above": Side(2, +1, False),
    "above_inside": Side(2, +1, True),
    "below": Side(2, -1, False),
    "below_inside": Side(2, -1, True),
    "left": Side(1, -1, False),
    "left_inside": Side(1, -1, True),
    "right": Side(1, +1, False),
    "right_inside": Side(1, +1, True),
    "front": Side(0, +1, False),
    "front_inside": Side(0, +1, True),
    "back": Side(0, -1, False),
    "back_inside": Side(0, -1, True),
    "inside": None,
}
"""Placements by name; ``inside`` has no side."""


def shift(side: Side, child: Array, parent: Array, clearance: float) -> float:
    """Compute the shift of the child along the side's axis [m].

    Args:
        side: Side of the parent.
        child: Lowest and highest corner of its box (2, 3) [m].
        parent: Lowest and highest corner of the parent's box (2, 3) [m].
        clearance: Gap between the faces [m]: outwards from the parent's face for a child outside,
            inwards for a child inside.
    """
    outer = (1 + side.sign) // 2  # row of the face on that side
    face = parent[outer, side.axis]
    own = child[outer if side.inside else 1 - outer, side.axis]
    away = -side.sign if side.inside else side.sign
    return float(face + away * clearance - own)


def centred(child: Array, parent: Array, side: Side | None) -> Array:
    """Compute the shift (3,) that aligns the centres of boxes (2, 3), except along the side [m]."""
    shift_m = (parent.sum(axis=0) - child.sum(axis=0)) / 2.0
    if side is not None:
        shift_m[side.axis] = 0.0
    return np.asarray(shift_m)
