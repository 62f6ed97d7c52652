"""Clause ``limits``: a joint goes as far as the asset and its URDF say, and has a closed end."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import mujoco
import yourdfpy

from articulate.asset import Joint
from articulate.proof import Clause
from articulate.prove.model import ObjectModel

ALLOWED = 1e-6
"""Largest difference between limits that say the same [m or rad]."""
TYPES = {"slide": ("prismatic",), "hinge": ("revolute", "continuous")}
Range = tuple[float, float] | None


def limits(model: ObjectModel) -> tuple[Clause, ...]:
    """Compare the ranges in the MJCF with those in asset.json and in the canonical URDF."""
    said = _urdf_ranges(model.asset.folder / "object.urdf")
    return tuple(_agrees(model, joint, said) for joint in model.asset.joints)


def _agrees(model: ObjectModel, joint: Joint, said: dict[str, tuple[str, Range]]) -> Clause:
    index = model.joints[joint.name]
    limited = bool(model.model.jnt_limited[index])
    own: Range = model.limits(joint.name) if limited else None
    noted = None if joint.lower is None or joint.upper is None else (joint.lower, joint.upper)
    slides = int(model.model.jnt_type[index]) == int(mujoco.mjtJoint.mjJNT_SLIDE)
    faults = _faults(own, "slide" if slides else "hinge", joint)
    gap = _gap(own, noted)
    if gap > ALLOWED:
        faults.append(f"asset.json says {_words(noted)}")
    if joint.name in said:
        kind, other = said[joint.name]
        gap = max(gap, _gap(own, other))
        if _gap(own, other) > ALLOWED:
            faults.append(f"object.urdf says {_words(other)}")
        if kind not in TYPES[joint.kind]:
            faults.append(f"object.urdf says {kind}")
    elif said:
        faults.append("object.urdf has no such joint")
    message = f"{joint.name} goes {_words(own)}; {joint.closed_rule}"
    if faults:
        message += f"; {'; '.join(faults)}: make all three say the same"
    return Clause(
        name="limits",
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


def _urdf_ranges(path: Path) -> dict[str, tuple[str, Range]]:
    """Type and limits of each joint of a URDF; none if it cannot be read."""
    robot = robot_in(path)
    if robot is None:
        return {}
    found: dict[str, tuple[str, Range]] = {}
    for joint in robot.joints:
        limit = joint.limit
        bounded = joint.type != "continuous" and limit is not None
        found[joint.name] = (
            joint.type,
            (float(limit.lower), float(limit.upper)) if bounded else None,
        )
    return found


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
