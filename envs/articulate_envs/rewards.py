"""Reward: a sum of terms, the same for every asset.

Those of a tick are in :mod:`articulate_envs.compiled.reward`; what they pay for is said beside
their weights, :class:`articulate_envs.config.RewardConfig`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from articulate.assets.asset import Handle
from articulate.transforms import Array, Mask
from articulate_envs.config import RewardConfig

TERMS = (
    "approach", "reach", "align", "grip", "premature_close", "lateral_offset", "open", "progress", "rest",
    "force", "speed", "action", "violation", "success",
)  # fmt: skip
"""Names of the terms, in the order in which they are written; the last is :func:`at_end`'s."""


FINGER_M = 0.022
"""Width of a finger along the handle that it holds [m]: 21 mm in franka's finger.stl, and one."""
MOST_ALONG_M = 0.05
"""Largest distance from a handle's middle that counts as its middle [m]."""


@dataclass(frozen=True, kw_only=True)
class Grasp:
    """What a handle asks of a hand."""

    along_m: float = 0.0
    """Distance from the handle's middle along its long axis at which fingers hold it [m]."""
    thick_m: float = 0.0
    """What has to fit between the fingers [m]."""


NO_GRASP = Grasp()
"""Of a part without a handle: its point is to be reached."""


def grasp_of(handle: Handle | None) -> Grasp:
    """What ``handle`` asks of a hand; None asks for a point.

    Any place along a bar or an edge is as good as its middle; a knob is held at its middle, beside
    which its sides lean outward and push fingers off.
    """
    if handle is None:
        return NO_GRASP
    long_m = 0.0 if handle.kind == "knob" else handle.extent[0] - FINGER_M
    along_m = min(max(0.0, 0.9 * long_m / 2.0), MOST_ALONG_M)
    return Grasp(along_m=along_m, thick_m=handle.extent[1])


def at_end(config: RewardConfig, succeeded: Mask) -> Array:
    """Weighted terms (M, len(TERMS)) of how M episodes ended that ran their full length."""
    terms = np.zeros((len(succeeded), len(TERMS)))
    terms[:, TERMS.index("success")] = config.success * succeeded
    return terms
