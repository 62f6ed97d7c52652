"""Convert a URDF to an equivalent program."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from articulate.errors import AssetError
from articulate.formats.decompose_joints import decompose_joints
from articulate.formats.link_tree import build_parts, unit_axis
from articulate.formats.read_urdf import read_urdf
from articulate.formats.source_object import SourceJoint, SourceObject
from articulate.reconstruct.program.language import MAX_NUMBER, MAX_SOURCE, MAX_TEXT
from articulate.transforms import Array, matrix_to_rpy

MAX_LIMIT_RAD = 4.0 * math.pi
"""Limits of a hinge beyond this are ignored [rad]."""


def decompile(urdf: Path) -> str:
    """Write a program for ``parts_of(urdf)`` with the same links, poses and joints.

    Args:
        urdf: File to read.

    Raises:
        AssetError: It cannot be read, or exceeds the limits of a program.
    """
    source = decompose_joints(read_urdf(urdf))
    build_parts(source)  # raises where the tree is broken
    T_wl, joints = _placed(source)
    lines = ["# Every link is a part, in its own frame.", f"root({_text(_root(source))})"]
    for name, T in T_wl.items():
        if not np.array_equal(T, np.eye(4)):
            position, rpy = _row(T[:3, 3]), _row(matrix_to_rpy(T[:3, :3]))
            lines.append(f"place({_text(name)}, {position}, rpy={rpy})")
    for joint in joints:
        lines += _joined(joint, T_wl)
    for name in T_wl:  # further roots
        if name != _root(source) and not any(joint.child == name for joint in joints):
            lines.append(f"fixed({_text(name)}, {_text(_root(source))})")
    lines += _mimics(joints)
    program = "\n".join(lines) + "\n"
    if len(program) > MAX_SOURCE:
        raise AssetError(
            f"{urdf}: as a program it has {len(program)} characters; {MAX_SOURCE} are accepted"
        )
    return program


def _root(source: SourceObject) -> str:
    """Return the root with the most children, as in the conversion."""
    children = {joint.child for joint in source.joints}
    roots = [name for name in source.links if name not in children]
    return max(roots, key=lambda name: sum(joint.parent == name for joint in source.joints))


def _placed(source: SourceObject) -> tuple[dict[str, Array], list[SourceJoint]]:
    """Return the pose of each link with every joint at 0, and the joints, parents first."""
    by_parent: dict[str, list[SourceJoint]] = {}
    for joint in source.joints:
        by_parent.setdefault(joint.parent, []).append(joint)
    children = {joint.child for joint in source.joints}
    T_wl = {name: np.eye(4) for name in source.links if name not in children}
    ordered: list[SourceJoint] = []
    for name in (order := list(T_wl)):
        for joint in by_parent.get(name, ()):
            T_wl[joint.child] = T_wl[name] @ joint.T_pc
            ordered.append(joint)
            order.append(joint.child)
    return T_wl, ordered


def _joined(joint: SourceJoint, T_wl: Mapping[str, Array]) -> list[str]:
    head = f"{_text(joint.child)}, {_text(joint.parent)}"
    if joint.kind == "fixed":
        return [f"fixed({head}, name={_text(joint.name)})"]
    T = T_wl[joint.child]
    axis, pivot = _row(T[:3, :3] @ unit_axis(joint)), _row(T[:3, 3])
    tail = f"name={_text(joint.name)}{_dynamics(joint)}"
    if joint.kind == "continuous":
        return [f"continuous({head}, {axis}, {pivot}, {tail})"]
    notes, lower, upper = _limits(joint)
    if joint.kind == "prismatic":
        return [*notes, f"prismatic({head}, {axis}, {lower}, {upper}, {tail})"]
    return [*notes, f"revolute({head}, {axis}, {pivot}, {lower}, {upper}, {tail})"]


def _limits(joint: SourceJoint) -> tuple[list[str], str, str]:
    """Return comments, lower and upper limit as source text."""
    if joint.lower is None and joint.upper is None:
        return [], "None", "None"
    low, high, notes = joint.lower or 0.0, joint.upper or 0.0, []
    if low > high:
        notes, low, high = ["# The file has its limits swapped."], high, low
    most = MAX_LIMIT_RAD if joint.kind == "revolute" else MAX_NUMBER
    if max(-low, high) > most:
        return ["# The limits of the file are out of range."], "None", "None"
    return notes, _number(low), _number(high)


def _dynamics(joint: SourceJoint) -> str:
    values = {"damping": joint.damping, "friction": joint.friction}
    return "".join(
        f", {key}={_number(value)}"
        for key, value in values.items()
        if value is not None and 0.0 < value <= MAX_NUMBER
    )


def _mimics(joints: list[SourceJoint]) -> list[str]:
    movable = {joint.name for joint in joints if joint.kind != "fixed"}
    lines = []
    for joint in joints:
        if joint.mimic is not None and {joint.name, joint.mimic[0]} <= movable:
            leader, multiplier, offset = joint.mimic
            numbers = f"{_number(multiplier)}, {_number(offset)}"
            lines.append(f"mimic({_text(joint.name)}, {_text(leader)}, {numbers})")
    return lines


def _text(value: str) -> str:
    if len(value) > MAX_TEXT:
        raise AssetError(
            f"the name {value[:40]!r}… is longer than {MAX_TEXT} characters; shorten it"
        )
    return ascii(value)


def _row(values: Array) -> str:
    return f"({', '.join(_number(value) for value in values)})"


def _number(value: float) -> str:
    """Format a number with all digits, without -0."""
    return repr(float(value) + 0.0)
