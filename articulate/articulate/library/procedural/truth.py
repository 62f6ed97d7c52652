"""Ground truth of a generated object: its joints in the object frame."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from articulate.assets.asset import Vec3
from articulate.library.procedural.urdf import Part
from articulate.transforms import Array


@dataclass(frozen=True, kw_only=True)
class JointTruth:
    """Ground truth of one joint, as expected in an asset."""

    name: str
    kind: Literal["slide", "hinge"]
    link: str
    parent: str
    axis_o: Vec3
    """Unit axis in the object frame, closed."""
    pivot_o: Vec3
    """A point on the axis in the object frame, closed [m]."""
    lower: float | None
    """Lower limit [m or rad]; None if it turns without end."""
    upper: float | None
    """Upper limit [m or rad]; None if it turns without end."""


def origins(parts: Sequence[Part]) -> dict[str, Array]:
    """Return the origin (3,) [m] of each link in the frame of the root, closed.

    All frames are parallel.
    """
    out: dict[str, Array] = {}
    for part in parts:
        motion = part.motion
        out[part.name] = (
            np.zeros(3) if motion is None else out[motion.parent] + np.asarray(motion.origin_p)
        )
    return out


def bounds(parts: Sequence[Part]) -> Array:
    """Return the lowest and highest corner (2, 3) [m] of the closed object in its root frame."""
    at = origins(parts)
    corners = np.vstack(
        [solid.mesh()[0] + at[part.name] for part in parts for solid in part.solids]
    )
    return np.stack([corners.min(axis=0), corners.max(axis=0)])


def joints_of(parts: Sequence[Part]) -> list[JointTruth]:
    """Return the joints of an object in its object frame.

    That frame is upright, under the middle of the closed object's box, the floor at z = 0.
    """
    at, (low, high) = origins(parts), bounds(parts)
    origin = np.array([(low[0] + high[0]) / 2, (low[1] + high[1]) / 2, low[2]])
    out = []
    for part in parts:
        motion = part.motion
        if motion is None:
            continue
        endless = motion.kind == "continuous"
        x, y, z = at[part.name] - origin
        out.append(
            JointTruth(
                name=motion.name,
                kind="slide" if motion.kind == "prismatic" else "hinge",
                link=part.name,
                parent=motion.parent,
                axis_o=motion.axis,
                pivot_o=(float(x), float(y), float(z)),
                lower=None if endless else 0.0,
                upper=None if endless else motion.upper,
            )
        )
    return out
