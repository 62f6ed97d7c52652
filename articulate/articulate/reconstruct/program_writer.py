"""From joints that an actor says to a program in the language of :mod:`articulate.reconstruct.program`."""

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
"""Words that Python would take for the declaration of an encoding in the first line."""


def tree_of(
    joints: Sequence[PredictedJoint], meshes: Sequence[PartMesh]
) -> tuple[str, dict[str, PredictedJoint]]:
    """The part that stands still, and for every other part the joint that holds it.

    Parts of which nothing is said are fixed to the one that stands still; so is what an actor
    hangs on itself, on nothing, or on a part that does not exist. A part that moves and is said to
    be fixed to another one as well, as a knob that goes along with its door, moves on that one.

    Args:
        joints: What an actor says.
        meshes: All parts.
    """
    names = [mesh.name for mesh in meshes]
    fixed = {joint.part: joint for joint in joints if joint.part in names and joint.kind == "fixed"}
    moved = {joint.part: joint for joint in joints if joint.part in names and joint.kind != "fixed"}
    both = {
        name: replace(moved[name], parent=fixed[name].parent) for name in fixed if name in moved
    }
    said = fixed | moved | both
    free = [mesh for mesh in meshes if mesh.name not in said] or list(meshes)
    root = max(free, key=_room).name
    said.pop(root, None)
    held: dict[str, PredictedJoint] = {}
    for name in names:
        if name == root:
            continue
        joint = said.get(name) or PredictedJoint(part=name, parent=root, kind="fixed")
        if joint.parent not in names or _circles(name, said):
            joint = replace(joint, parent=root)
        held[name] = joint
    return root, held


def program_of(root: str, held: Mapping[str, PredictedJoint], *, actor: str, question: str) -> str:
    """A program that joins parts in their places.

    Args:
        root: The part that stands still.
        held: The joint of every other part.
        actor: Who says so.
        question: What was given.
    """
    said = " ".join(f"# Joints by {actor}, from {question}.".split())
    said = ENCODING.sub(r"\1 \2", said)
    lines = [ascii(said)[1:-1], f"root({root!a})"]
    order = [root]
    for name in order:  # grows while it is gone through
        order += [child for child, joint in held.items() if joint.parent == name]
    lines += [_line(held[name]) for name in order[1:]]
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


def _circles(name: str, said: Mapping[str, PredictedJoint]) -> bool:
    """Whether going from a part to what holds it comes back to the part."""
    at, seen = name, set()
    while at in said and at not in seen:
        seen.add(at)
        parent = said[at].parent
        if parent is None:
            return False
        at = parent
    return at == name and bool(seen)


def _room(mesh: PartMesh) -> float:
    return float(np.prod(np.ptp(mesh.bounds, axis=0)))


def _row(values: Iterable[float]) -> str:
    return f"({', '.join(_number(value) for value in values)})"


def _number(value: float | None) -> str:
    return "None" if value is None else repr(round(float(value), DIGITS) + 0.0)
