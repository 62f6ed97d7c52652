"""Kinds of moving parts: drawer, door or lid by names and category, otherwise joint."""

from __future__ import annotations

import re
from typing import Literal

import numpy as np

from articulate.assets.asset import Asset, Joint
from articulate.transforms import Array

PartKind = Literal["drawer", "door", "lid", "joint"]

NAMED: dict[str, PartKind] = {
    "drawer": "drawer",
    "door": "door",
    "lid": "lid",
    "cover": "lid",
    "flap": "lid",
    "button": "joint",
    "handle": "joint",
    "key": "joint",
    "knob": "joint",
    "lever": "joint",
    "pedal": "joint",
    "switch": "joint",
    "wheel": "joint",
}
"""Words in the name of a link or joint and the kind they mean; a drawer that turns is ignored."""
PARTS: dict[str, frozenset[PartKind]] = {
    "Bottle": frozenset({"lid"}),
    "Box": frozenset({"lid"}),
    "Cart": frozenset({"drawer", "door"}),
    "CoffeeMachine": frozenset({"drawer", "door", "lid"}),
    "Dishwasher": frozenset({"drawer", "door"}),
    "Door": frozenset({"door"}),
    "Kettle": frozenset({"lid"}),
    "KitchenPot": frozenset({"lid"}),
    "Laptop": frozenset({"lid"}),
    "Microwave": frozenset({"door"}),
    "Oven": frozenset({"drawer", "door"}),
    "Printer": frozenset({"drawer", "lid"}),
    "Refrigerator": frozenset({"drawer", "door"}),
    "Safe": frozenset({"door"}),
    "StorageFurniture": frozenset({"drawer", "door", "lid"}),
    "Suitcase": frozenset({"lid"}),
    "Table": frozenset({"drawer", "door", "lid"}),
    "Toilet": frozenset({"lid"}),
    "TrashCan": frozenset({"door", "lid"}),
    "WashingMachine": frozenset({"drawer", "door", "lid"}),
    "Window": frozenset({"door"}),
}
"""Kinds of parts by PartNet-Mobility category; its other categories have none of them."""
UNKNOWN = "unknown"
"""Category of an object that no table lists."""
SMALL = 0.12
"""Fraction of the object's longest side below which a part without a name is a knob or button."""
STEEP = float(np.cos(np.pi / 4))
"""Vertical component of a unit axis above which it is upright rather than level."""


def part_kind(asset: Asset, joint: Joint) -> PartKind:
    """Classify the part that ``joint`` moves.

    The name of its link or of the joint decides if it has a word of :data:`NAMED`, the last one of
    several (the handle of a door is not a door). Without a name the motion decides, among the
    kinds of :data:`PARTS` that its category has, or all kinds for a joint with limits if the
    category is unknown. Everything else is a ``joint``.
    """
    named = named_kind(joint)
    if named is not None:
        return named
    kinds = PARTS.get(asset.category, frozenset())
    if asset.category == UNKNOWN and joint.upper is not None:
        kinds = frozenset({"drawer", "door", "lid"})
    kind = _kind_by_motion(asset, joint)
    if kind == "door" and "door" not in kinds and abs(joint.axis_o[2]) <= STEEP:
        kind = "lid"  # a laptop's lid may be upright
    return kind if kind in kinds and not _is_small(asset, joint) else "joint"


def named_kind(joint: Joint) -> PartKind | None:
    """Return the kind that the name of the link or of the joint gives, or None."""
    for name in (joint.link, joint.name):
        for word in reversed(re.findall("[a-z]+", _separated(name))):
            if word in NAMED and not (word == "drawer" and joint.kind == "hinge"):
                return NAMED[word]
    return None


def _kind_by_motion(asset: Asset, joint: Joint) -> PartKind:
    """Classify a part by its axis and its closed posture.

    A level slide is a drawer, an upright hinge a door. A level hinge is a lid if the closed part
    is flat, a door if it is upright (an oven's). A part on an upright slide is lifted like a lid.
    """
    steep = abs(joint.axis_o[2]) > STEEP
    if joint.kind == "slide":
        return "lid" if steep else "drawer"
    return "door" if steep or _is_upright(asset, joint) else "lid"


def _separated(name: str) -> str:
    """``name`` in lower case, with the words of camel case separated by spaces."""
    return re.sub("(?<=[a-z])(?=[A-Z])", " ", name).lower()


def _is_upright(asset: Asset, joint: Joint) -> bool:
    """Return whether the closed part is higher than it is deep across its level axis."""
    low, high = (np.asarray(corner) for corner in asset.link(joint.link).bounds_l)
    T_ol = asset.T_ol(joint.name, joint.closed)
    across = np.cross(np.array([0.0, 0.0, 1.0]), np.asarray(joint.axis_o))
    across /= np.linalg.norm(across)
    size: Array = np.abs(np.stack([across, [0.0, 0.0, 1.0]]) @ T_ol[:3, :3]) @ (high - low)
    return bool(size[1] > size[0])


def _is_small(asset: Asset, joint: Joint) -> bool:
    """Return whether the part is as small as a knob or a button of its object."""
    low, high = (np.asarray(corner) for corner in asset.link(joint.link).bounds_l)
    object_low, object_high = (np.asarray(corner) for corner in asset.bounds_o)
    return bool((high - low).max() < SMALL * (object_high - object_low).max())
