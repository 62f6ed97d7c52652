"""Kinds of parts: which joints a person would call those of a drawer, a door or a lid."""

from __future__ import annotations

import re
from typing import Literal

import numpy as np

from articulate.assets.asset import Asset, Joint
from articulate.transforms import Array

PartKind = Literal["drawer", "door", "lid", "other"]

NAMED: dict[str, PartKind] = {
    "drawer": "drawer",
    "door": "door",
    "lid": "lid",
    "cover": "lid",
    "flap": "lid",
    "button": "other",
    "handle": "other",
    "key": "other",
    "knob": "other",
    "lever": "other",
    "pedal": "other",
    "switch": "other",
    "wheel": "other",
}
"""Words in the name of a link that tell what it is; a drawer that turns is not meant."""
STEEP = float(np.cos(np.pi / 4))
"""An axis is steep if the vertical part of its unit vector is above this: nearer to upright."""


def part_kind(asset: Asset, joint: Joint) -> PartKind:
    """What a person would call the part that ``joint`` moves.

    The name of its link decides if it holds a word of :data:`NAMED`, the last one if several
    (the handle of a door is no door). Else a level slide is a drawer and a hinge about a steep
    axis a door; a hinge about a level axis is a lid where the closed part lies flat, a door where
    it stands upright (an oven's); and a steep slide is lifted off like a lid.
    """
    for word in reversed(re.findall("[a-z]+", _spaced(joint.link))):
        if word in NAMED and not (word == "drawer" and joint.kind == "hinge"):
            return NAMED[word]
    steep = abs(joint.axis_o[2]) > STEEP
    if joint.kind == "slide":
        return "lid" if steep else "drawer"
    return "door" if steep or _stands(asset, joint) else "lid"


def _spaced(name: str) -> str:
    """``name`` in lower case, with the words of camel case apart."""
    return re.sub("(?<=[a-z])(?=[A-Z])", " ", name).lower()


def _stands(asset: Asset, joint: Joint) -> bool:
    """Whether the closed part is higher than it is deep across its level axis."""
    low, high = (np.asarray(corner) for corner in asset.link(joint.link).bounds_l)
    T_ol = asset.T_ol(joint.name, joint.closed)
    across = np.cross(np.array([0.0, 0.0, 1.0]), np.asarray(joint.axis_o))
    across /= np.linalg.norm(across)
    size: Array = np.abs(np.stack([across, [0.0, 0.0, 1.0]]) @ T_ol[:3, :3]) @ (high - low)
    return bool(size[1] > size[0])
