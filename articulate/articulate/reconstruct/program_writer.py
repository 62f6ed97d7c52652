"""Write predicted joints as a program of :mod:`articulate.reconstruct.program`."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from articulate.reconstruct.actors.protocol import PredictedJoint
from articulate.render.parts import PartMesh
from articulate.transforms import normalised

DIGITS = 9
ENCODING = re.compile("(coding)([:=])")
"""Text that Python would read as an encoding declaration in the first line."""


def tree_of(
    joints: Sequence[PredictedJoint], meshes: Sequence[PartMesh]
) -> tuple[str, dict[str, PredictedJoint]]:
    """Return the root part, and the joint of every other part.

    Parts without a joint are fixed to the root; so are parts whose parent is missing, unknown or
    themselves. A part that moves and is also predicted to be fixed to another one, such as a knob
    on its door, moves on that one.

    Args:
        joints: Predicted joints.
        meshes: All parts.
    """
    names = [mesh.name for mesh in meshes]
    fixed = {joint.part: joint for joint in joints if joint.part in names and joint.kind == "fixed"}
    moved = {joint.part: joint for joint in joints if joint.part in names and joint.kind != "fixed"}
    both = {
        name: replace(moved[name], parent=fixed[name].parent) for name in fixed if name in moved
    }
    predicted = fixed | moved | both
    free = [mesh for mesh in meshes if mesh.name not in predicted] or list(meshes)
    root = max(free, key=_box_volume).name
    predicted.pop(root, None)
    part_joints: dict[str, PredictedJoint] = {}
    for name in names:
        if name == root:
            continue
        joint = predicted.get(name) or PredictedJoint(part=name, parent=root, kind="fixed")
        if joint.parent not in names or _is_cyclic(name, predicted):
            joint = replace(joint, parent=root)
        part_joints[name] = joint
    return root, part_joints


def program_of(
    root: str, part_joints: Mapping[str, PredictedJoint], *, actor: str, query: str
) -> str:
    """Write a program that joins placed parts.

    Args:
        root: The part that does not move.
        part_joints: The joint of every other part.
        actor: Name of the actor, for a comment.
        query: Description of the query, for a comment.
    """
    comment = " ".join(f"# Joints by {actor}, from {query}.".split())
    comment = ENCODING.sub(r"\1 \2", comment)
    lines = [ascii(comment)[1:-1], f"root({root!a})"]
    order = [root]
    for name in order:  # grows during the loop
        order += [child for child, joint in part_joints.items() if joint.parent == name]
    lines += [_line(part_joints[name]) for name in order[1:]]
    return "\n".join(lines) + "\n"


def _line(joint: PredictedJoint) -> str:
    head = f"{joint.part!a}, {joint.parent!a}"
    if joint.kind == "fixed":
        return f"fixed({head})"
    axis = _row(normalised(joint.axis_o))
    limited = joint.lower is not None and joint.upper is not None
    limits = f"{_number(joint.lower)}, {_number(joint.upper)}"
    if joint.kind == "prismatic":
        return f"prismatic({head}, axis={axis}, lower={limits.replace(', ', ', upper=')})"
    pivot = _row(joint.pivot_o)
    if joint.kind == "continuous" or not limited:
        return f"continuous({head}, axis={axis}, pivot={pivot})"
    return f"revolute({head}, axis={axis}, pivot={pivot}, lower={limits.replace(', ', ', upper=')})"


def _is_cyclic(name: str, joints: Mapping[str, PredictedJoint]) -> bool:
    """Return whether the parents of a part lead back to it."""
    at, seen = name, set()
    while at in joints and at not in seen:
        seen.add(at)
        parent = joints[at].parent
        if parent is None:
            return False
        at = parent
    return at == name and bool(seen)


def _box_volume(mesh: PartMesh) -> float:
    return float(np.prod(np.ptp(mesh.bounds, axis=0)))


def _row(values: Iterable[float]) -> str:
    return f"({', '.join(_number(value) for value in values)})"


def _number(value: float | None) -> str:
    return "None" if value is None else repr(round(float(value), DIGITS) + 0.0)
