"""Clause ``limits``: a joint goes as far and as hard as the asset and its URDF say."""

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
"""Largest difference between limits that say the same [m or rad]."""
TYPES = {"slide": ("prismatic",), "hinge": ("revolute", "continuous")}
SAME = 1e-5
"""Share by which damping and dry friction that say the same may differ: digits of the file."""
Range = tuple[float, float] | None


@dataclass(frozen=True, kw_only=True)
class Said:
    """What a URDF says of a joint."""

    kind: str
    span: Range
    damping: float | None
    """Viscous damping [N s/m or Nm s/rad], None where it says nothing."""
    friction: float | None
    """Dry friction [N or Nm], None where it says nothing."""


def check_limits(model: ObjectModel) -> tuple[Check, ...]:
    """Compare the joints of the MJCF with those of asset.json and of the canonical URDF."""
    said = _urdf_joints(model.asset.folder / "object.urdf")
    return tuple(_agrees(model, joint, said) for joint in model.asset.joints)


def _agrees(model: ObjectModel, joint: Joint, said: Mapping[str, Said]) -> Check:
    index = model.joints[joint.name]
    limited = bool(model.model.jnt_limited[index])
    own: Range = model.limits(joint.name) if limited else None
    noted = None if joint.lower is None or joint.upper is None else (joint.lower, joint.upper)
    slides = int(model.model.jnt_type[index]) == int(mujoco.mjtJoint.mjJNT_SLIDE)
    faults = _faults(own, "slide" if slides else "hinge", joint)
    gap = _gap(own, noted)
    if gap > ALLOWED:
        faults.append(f"asset.json says {_words(noted)}")
    faults += _resistance(model, joint, "asset.json", joint.damping, joint.frictionloss)
    if joint.name in said:
        other = said[joint.name]
        gap = max(gap, _gap(own, other.span))
        if _gap(own, other.span) > ALLOWED:
            faults.append(f"object.urdf says {_words(other.span)}")
        if other.kind not in TYPES[joint.kind]:
            faults.append(f"object.urdf says {other.kind}")
        faults += _resistance(model, joint, "object.urdf", other.damping, other.friction)
    elif said:
        faults.append("object.urdf has no such joint")
    message = f"{joint.name} goes {_words(own)}; {joint.closed_rule}"
    if faults:
        message += f"; {'; '.join(faults)}: make all three say the same"
    return Check(
        name="joint_limits",
        outcome="failed" if faults else "passed",
        subject=joint.name,
        measured=gap if math.isfinite(gap) else None,
        allowed=ALLOWED,
        unit="m" if joint.kind == "slide" else "rad",
        message=message,
    )


def _faults(own: Range, kind: str, joint: Joint) -> list[str]:
    """What is wrong with a range by itself."""
    found = []
    if kind != joint.kind:
        found.append(f"asset.json calls it a {joint.kind}, the MJCF a {kind}")
    if own is None:
        return found if joint.kind == "hinge" else [*found, "a slide without end"]
    low, high = own
    if not (math.isfinite(low) and math.isfinite(high) and high - low > ALLOWED):
        found.append("there is no way between them")
    for name, position in (("closed", joint.closed), ("open", joint.open)):
        if not low - ALLOWED <= position <= high + ALLOWED:
            found.append(f"its {name} position {position:.4g} lies outside")
    return found


def _resistance(
    model: ObjectModel, joint: Joint, who: str, damping: float | None, friction: float | None
) -> list[str]:
    """Where damping or dry friction in the MJCF are not what ``who`` says."""
    dof = model.dof_address(joint.name)
    units = ("N s/m", "N") if joint.kind == "slide" else ("Nm s/rad", "Nm")
    found = []
    for what, own, said, unit in (
        ("damping", float(model.model.dof_damping[dof]), damping, units[0]),
        ("dry friction", float(model.model.dof_frictionloss[dof]), friction, units[1]),
    ):
        if said is not None and not abs(own - said) <= SAME * max(abs(own), abs(said)):
            found.append(f"its {what} is {own:.4g} {unit}, {who} says {said:.4g}")
    return found


def _urdf_joints(path: Path) -> dict[str, Said]:
    """What a URDF says of each joint; nothing if it cannot be read."""
    robot = robot_in(path)
    if robot is None:
        return {}
    found: dict[str, Said] = {}
    for joint in robot.joints:
        limit, resists = joint.limit, joint.dynamics
        bounded = joint.type != "continuous" and limit is not None
        found[joint.name] = Said(
            kind=joint.type,
            span=(float(limit.lower), float(limit.upper)) if bounded else None,
            damping=None if resists is None else _number(resists.damping),
            friction=None if resists is None else _number(resists.friction),
        )
    return found


def _number(text: str | float | None) -> float | None:
    """A number as yourdfpy hands it on: as text in places; NaN, like nothing else, for a word."""
    try:
        return None if text is None else float(text)
    except ValueError:
        return math.nan


def robot_in(path: Path) -> Any:
    """What yourdfpy reads in a URDF, None if it cannot: the clause fk says so."""
    try:
        loaded = yourdfpy.URDF.load(
            str(path), load_meshes=False, load_collision_meshes=False, build_scene_graph=False
        )
    except Exception:  # noqa: BLE001  it raises anything
        return None
    return loaded.robot


def _gap(one: Range, other: Range) -> float:
    """Larger difference of two ranges; infinite if only one of them has ends."""
    if one is None or other is None:
        return 0.0 if one is other else math.inf
    return max(abs(one[0] - other[0]), abs(one[1] - other[1]))


def _words(span: Range) -> str:
    return "without end" if span is None else f"from {span[0]:.4g} to {span[1]:.4g}"
