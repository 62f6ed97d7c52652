"""From where an asset is looked at: its front is where it opens to."""

from __future__ import annotations

import numpy as np

from articulate.assets.asset import Asset
from articulate.transforms import Array, apply

AZIMUTH_OFF_FRONT_DEG = 32.0
"""How far from straight ahead the camera stands, so that a side is seen too."""
ELEVATION_DEG = -22.0
"""Direction of view over the horizon; negative looks down."""
LEAST_M = 1e-3
MOST_TURN_RAD = np.pi / 3.0
"""How far a hinge is turned to find where its part moves to; further it would turn back."""


def front_azimuth_deg(asset: Asset) -> float:
    """Direction of view about the vertical that meets the front: 0 looks along +x, 90 along +y.

    The front is where handles point to and parts move to when they open; -y where neither says
    anything.
    """
    total = np.zeros(3)
    for joint in asset.joints:
        middle_l = _middle_l(asset, joint.link)
        part_way = joint.closed + np.clip(joint.span, -MOST_TURN_RAD, MOST_TURN_RAD)
        closed_o, moved_o = apply(
            asset.T_ol(joint.name, np.array([joint.closed, part_way])), middle_l
        )
        total += moved_o - closed_o
    for handle in asset.handles:
        q = asset.joint(handle.joint).closed
        normal_o = asset.T_ol(handle.joint, q)[:3, :3] @ np.asarray(handle.normal_l)
        total += 0.1 * normal_o
    if float(np.hypot(total[0], total[1])) < LEAST_M:
        return 90.0
    return float(np.degrees(np.arctan2(-total[1], -total[0])))


def _middle_l(asset: Asset, link: str) -> Array:
    low, high = asset.link(link).bounds_l
    return np.asarray(0.5 * np.asarray(low) + 0.5 * np.asarray(high))
