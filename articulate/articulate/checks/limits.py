"""Check ``joint_limits``: limits and resistance agree in MJCF, URDF and asset.json."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yourdfpy

from articulate.assets.asset import Joint
from articulate.assets.check_report import Check
from articulate.checks.model import ObjectModel
from articulate.simulator import mujoco

ALLOWED = 1e-6
"""Largest difference between equal limits [m or rad]."""
TYPES = {"slide": ("prismatic",), "hinge": ("revolute", "continuous")}
SAME = 1e-5
"""Relative tolerance of damping and dry friction: digits of the file."""
Range = tuple[float, float] | None


@dataclass(frozen=True, kw_only=True)
class UrdfJoint:
    """Joint of a URDF."""

    kind: str
    span: Range
    damping: float | None
    """Viscous damping [N s/m or Nm s/rad], None if absent."""
    friction: float | None
    """Dry friction [N or Nm], None if absent."""


def check_limits(model: ObjectModel) -> tuple[Check, ...]:
    """Compare the joints of the MJCF with those of asset.json and of the canonical URDF."""
    urdf_joints = _urdf_joints(model.asset.folder / "object.urdf")
    return tuple(_compare(model, joint, urdf_joints) for joint in model.asset.joints)


def _compare(model: ObjectModel, joint: Joint, urdf_joints: Mapping[str, UrdfJoint]) -> Check:
    index = model.joints[joint.name]
    limited = bool(model.model.jnt_limited[index])
    own: Range = model.limits(joint.name) if limited else None
    noted = None if joint.lower is None or joint.upper is None else (joint.lower, joint.upper)
    slides = int(model.model.jnt_type[index]) == int(mujoco.mjtJoint.mjJNT_SLIDE)
    violations = _violations(own, "slide" if slides else "hinge", joint)
    gap = _gap(own, noted)
    if gap > ALLOWED:
        violations.append(f"asset.json has {_range_text(noted)}")
    violations += _resistance(model, joint, "asset.json", joint.damping, joint.frictionloss)
    if joint.name in urdf_joints:
        other = urdf_joints[joint.name]
        gap = max(gap, _gap(own, other.span))
        if _gap(own, other.span) > ALLOWED:
            violations.append(f"object.urdf has {_range_text(other.span)}")
        if other.kind not in TYPES[joint.kind]:
            violations.append(f"object.urdf has {other.kind}")
        violations += _resistance(model, joint, "object.urdf", other.damping, other.friction)
    elif urdf_joints:
        violations.append("object.urdf has no such joint")
    message = f"{joint.name} goes {_range_text(own)}; {joint.closed_rule}"
    if violations:
        message += f"; {'; '.join(violations)}: make all three agree"
    return Check(
        name="joint_limits",
        outcome="failed" if violations else "passed",
        subject=joint.name,
        measured=gap if math.isfinite(gap) else None,
        allowed=ALLOWED,
        unit="m" if joint.kind == "slide" else "rad",
        message=message,
    )


def _violations(own: Range, kind: str, joint: Joint) -> list[str]:
    """Return the faults of a range."""
    found = []
    if kind != joint.kind:
        found.append(f"asset.json calls it a {joint.kind}, the MJCF a {kind}")
    if own is None:
        return found if joint.kind == "hinge" else [*found, "a slide without end"]
    low, high = own
    if not (math.isfinite(low) and math.isfinite(high) and high - low > ALLOWED):
        found.append("the range is empty")
    for name, position in (("closed", joint.closed), ("open", joint.open)):
        if not low - ALLOWED <= position <= high + ALLOWED:
            found.append(f"its {name} position {position:.4g} is outside")
    return found


def _resistance(
    model: ObjectModel, joint: Joint, who: str, damping: float | None, friction: float | None
) -> list[str]:
    """Return differences of damping and dry friction between the MJCF and ``who``."""
    dof = model.dof_address(joint.name)
    units = ("N s/m", "N") if joint.kind == "slide" else ("Nm s/rad", "Nm")
    found = []
    for quantity, own, other, unit in (
        ("damping", float(model.model.dof_damping[dof]), damping, units[0]),
        ("dry friction", float(model.model.dof_frictionloss[dof]), friction, units[1]),
    ):
        if other is not None and not abs(own - other) <= SAME * max(abs(own), abs(other)):
            found.append(f"its {quantity} is {own:.4g} {unit}, in {who} {other:.4g}")
    return found


def _urdf_joints(path: Path) -> dict[str, UrdfJoint]:
    """Return the joints of a URDF; empty if it cannot be read."""
    robot = robot_in(path)
    if robot is None:
        return {}
    found: dict[str, UrdfJoint] = {}
    for joint in robot.joints:
        limit, resists = joint.limit, joint.dynamics
        bounded = joint.type != "continuous" and limit is not None
        found[joint.name] = UrdfJoint(
            kind=joint.type,
            span=(float(limit.lower), float(limit.upper)) if bounded else None,
            damping=None if resists is None else _number(resists.damping),
            friction=None if resists is None else _number(resists.friction),
        )
    return found


def _number(text: str | float | None) -> float | None:
    """Parse a number from yourdfpy, which may be text; NaN, which differs from all, for words."""
    try:
        return None if text is None else float(text)
    except ValueError:
        return math.nan


def robot_in(path: Path) -> Any:
    """Read a URDF with yourdfpy; None on error, which the check forward_kinematics reports."""
    try:
        loaded = yourdfpy.URDF.load(
            str(path), load_meshes=False, load_collision_meshes=False, build_scene_graph=False
        )
    except Exception:  # noqa: BLE001  it raises anything
        return None
    return loaded.robot


def _gap(one: Range, other: Range) -> float:
    """Return the larger difference of two ranges; infinite if only one of them is limited."""
    if one is None or other is None:
        return 0.0 if one is other else math.inf
    return max(abs(one[0] - other[0]), abs(one[1] - other[1]))


def _range_text(span: Range) -> str:
    return "without end" if span is None else f"from {span[0]:.4g} to {span[1]:.4g}"
