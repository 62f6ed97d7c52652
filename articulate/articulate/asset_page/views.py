"""Choose the view direction of an asset: its front is the side to which it opens."""

from __future__ import annotations

import numpy as np

from articulate.assets.asset import Asset
from articulate.transforms import Array, apply

AZIMUTH_OFF_FRONT_DEG = 32.0
"""Angle between view direction and front normal, so that a side is visible too."""
ELEVATION_DEG = -22.0
"""Elevation of the view direction; negative looks down."""
MIN_M = 1e-3
SIDEWAYS = 0.5
"""Cosine between the axis of a slide and its handle's normal below which it slides sideways."""
MAX_TURN_RAD = np.pi / 3.0
"""Angle by which a hinge is turned to find the direction of its part [rad]."""


def front_azimuth_deg(asset: Asset) -> float:
    """Return the azimuth of a view onto the front [deg]: 0 looks along +x, 90 along +y.

    The front is the side to which handles point and parts move when they open; -y if
    neither exists. A part that slides past its handle's side, as a sliding door does, counts by
    its handle only.
    """
    total = np.zeros(3)
    normals: dict[str, Array] = {}
    for handle in asset.handles:
        q = asset.joint(handle.joint).closed
        normal_o = asset.T_ol(handle.joint, q)[:3, :3] @ np.asarray(handle.normal_l)
        normals[handle.joint] = normal_o
        total += 0.1 * normal_o
    for joint in asset.joints:
        normal_o = normals.get(joint.name, np.asarray(joint.axis_o))
        if joint.kind == "slide" and abs(float(normal_o @ np.asarray(joint.axis_o))) < SIDEWAYS:
            continue
        middle_l = _middle_l(asset, joint.link)
        part_open = joint.closed + np.clip(joint.span, -MAX_TURN_RAD, MAX_TURN_RAD)
        closed_o, moved_o = apply(
            asset.T_ol(joint.name, np.array([joint.closed, part_open])), middle_l
        )
        total += moved_o - closed_o
    if float(np.hypot(total[0], total[1])) < MIN_M:
        return 90.0
    return float(np.degrees(np.arctan2(-total[1], -total[0])))


def _middle_l(asset: Asset, link: str) -> Array:
    low, high = asset.link(link).bounds_l
    return np.asarray(0.5 * np.asarray(low) + 0.5 * np.asarray(high))
