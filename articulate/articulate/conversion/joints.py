"""Limits, the closed position and the motion of each joint, from what the source says."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from articulate.formats.config import ConvertConfig
from articulate.formats.link_tree import unit_axis
from articulate.formats.load_meshes import PartGeometry, bounds
from articulate.formats.repairs import Repairs
from articulate.formats.source_object import SourceJoint
from articulate.transforms import Array

QUARTER = math.pi / 2
ABSURD = {"hinge": 4.0 * math.pi, "slide": 100.0}
"""A limit of this size [rad, source units] or more is no limit."""
OWN_SIZES = 10.0
"""A slide that goes less than so many times the size of what it moves says something all the
same."""
NEAR_ZERO = 0.05
"""Share of the range within which a limit counts as 0."""


@dataclass(frozen=True, kw_only=True)
class Travel:
    """How far a joint goes, in units of the source."""

    kind: Literal["slide", "hinge"]
    axis: Array
    """Unit axis in the frame of the child (3,)."""
    lower: float | None
    upper: float | None
    closed: float
    open: float
    closed_rule: str


def travel_of(
    joint: SourceJoint, geometry: PartGeometry, config: ConvertConfig, repairs: Repairs
) -> Travel:
    """Limits and closed position of ``joint`` after repairs."""
    kind: Literal["slide", "hinge"] = "slide" if joint.kind == "prismatic" else "hinge"
    axis = unit_axis(joint)
    length = float(np.linalg.norm(joint.axis))
    if abs(length - 1.0) > 1e-6:
        repairs.add(f"axis of joint {joint.name} had length {length:.4g}: made 1")
    lower, upper = _limits(joint, kind, geometry, repairs)
    if kind == "slide" and (lower is None or upper is None):
        lower, upper = 0.0, _depth(geometry, axis)
        repairs.add(f"joint {joint.name} had no limits: 0 to {upper:.3g}, 0.8 of its depth")
    if lower is None or upper is None:
        rule = "turns without end: closed is 0, open a quarter turn"
        return Travel(
            kind=kind, axis=axis, lower=None, upper=None, closed=0.0, open=QUARTER, closed_rule=rule
        )
    closed, far, rule = _closed(lower, upper, config.closed)
    return Travel(
        kind=kind, axis=axis, lower=lower, upper=upper, closed=closed, open=far, closed_rule=rule
    )


def _limits(
    joint: SourceJoint, kind: str, geometry: PartGeometry, repairs: Repairs
) -> tuple[float | None, float | None]:
    if joint.kind == "continuous":
        if joint.lower is not None or joint.upper is not None:
            repairs.note(f"limits of the continuous joint {joint.name} left out: it turns")
        return None, None
    lower, upper = joint.lower, joint.upper
    if lower is None and upper is None:
        if kind == "hinge":
            repairs.add(f"joint {joint.name} had no limits: turns without end")
        return None, None
    lower, upper = lower or 0.0, upper or 0.0
    if lower > upper:
        repairs.add(f"limits of joint {joint.name} were swapped: {upper:g} to {lower:g}")
        lower, upper = upper, lower
    most = ABSURD[kind]
    if kind == "slide":
        most = max(most, OWN_SIZES * _size(geometry))  # in millimetres a drawer goes far
    if upper - lower < 1e-6 or max(-lower, upper) >= most:
        repairs.add(f"limits of joint {joint.name} say nothing ({lower:g} to {upper:g}): left out")
        return None, None
    return lower, upper


def _closed(
    lower: float, upper: float, wanted: Literal["auto", "lower", "upper"]
) -> tuple[float, float, str]:
    """Closed, open, and why."""
    if wanted != "auto":
        pair = (lower, upper) if wanted == "lower" else (upper, lower)
        return (*pair, f"closed is the {wanted} limit as asked for")
    is_lower = abs(lower) <= abs(upper)
    closed, far = (lower, upper) if is_lower else (upper, lower)
    side = "lower" if is_lower else "upper"
    if abs(closed) <= NEAR_ZERO * (upper - lower):
        return closed, far, f"closed is the {side} limit, which lies at 0"
    return closed, far, f"closed is the {side} limit, the nearer one to 0"


def _size(geometry: PartGeometry) -> float:
    """Longest side of the box round what is shown; 0 without it."""
    box = bounds(geometry, np.eye(4))
    return 0.0 if box is None else float((box[1] - box[0]).max())


def _depth(geometry: PartGeometry, axis: Array) -> float:
    along = [piece.mesh.vertices @ axis for piece in geometry.shown]
    if not along:
        return 1.0
    reach = max(float(a.max()) for a in along) - min(float(a.min()) for a in along)
    return 0.8 * reach if reach > 0.0 else 1.0
