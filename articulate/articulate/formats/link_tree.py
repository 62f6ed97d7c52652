"""Join links that are fixed together to rigid parts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from articulate.errors import AssetError, nearest, quote
from articulate.formats.repairs import Repairs
from articulate.formats.source_object import SourceJoint, SourceLink, SourceObject
from articulate.transforms import Array, axis_angle_to_matrix, normalised, pose


@dataclass(frozen=True, kw_only=True)
class Part:
    """Links that are rigidly connected."""

    name: str
    """Name of the link whose frame is that of the part; of the root the first with geometry."""
    parent: str | None
    """Name of the parent part."""
    joint: SourceJoint | None
    """Joint that moves it; None for the root."""
    T_sp: Array
    """Pose in the frame of the URDF's root link, every joint at 0 (4, 4), in source units."""
    T_pc: Array
    """Pose in the parent part, joint at 0 (4, 4), in source units."""
    members: tuple[tuple[SourceLink, Array], ...]
    """Links with their poses in the part (4, 4)."""


def build_parts(source: SourceObject) -> tuple[Part, ...]:
    """Return the rigid parts, parents first; the first is the fixed root.

    Raises:
        AssetError: A joint names an unknown link, a link has two parents, or there is a cycle.
    """
    joints = [_without_empty_range(joint, source.repairs) for joint in source.joints]
    by_parent: dict[str, list[SourceJoint]] = {}
    parent_of: dict[str, SourceJoint] = {}
    for joint in joints:
        for link in (joint.parent, joint.child):
            if link not in source.links:
                raise AssetError(
                    f"{joint.where}: joint {quote(joint.name)} names link {quote(link)}, which "
                    f"does not exist{nearest(link, source.links)}"
                )
        if joint.child in parent_of:
            raise AssetError(
                f"{joint.where}: link {quote(joint.child)} has two parents, joints "
                f"{quote(parent_of[joint.child].name)} and {quote(joint.name)}"
            )
        parent_of[joint.child] = joint
        by_parent.setdefault(joint.parent, []).append(joint)
    roots = [name for name in source.links if name not in parent_of]
    if not roots:
        raise AssetError(f"{source.path}: the joints form a cycle; a tree with one root is needed")
    parts = _walk(source, roots, by_parent)
    seen = sum(len(part.members) for part in parts)
    if seen != len(source.links):
        raise AssetError(
            f"{source.path}: {len(source.links) - seen} links are part of a cycle of joints"
        )
    return _rooted(parts)


def _without_empty_range(joint: SourceJoint, repairs: Repairs) -> SourceJoint:
    q = joint.lower
    if joint.kind not in {"revolute", "prismatic"} or q is None or q != joint.upper:
        return joint
    repairs.add(f"joint {joint.name} has lower = upper = {q:g}: fixed")
    T_pc = joint.T_pc if q == 0.0 else joint.T_pc @ motion(joint, q)
    return replace(joint, kind="fixed", T_pc=T_pc)


def _walk(
    source: SourceObject, roots: list[str], by_parent: Mapping[str, list[SourceJoint]]
) -> list[Part]:
    parts: dict[str, Part] = {}
    main = max(roots, key=lambda name: len(by_parent.get(name, ())))
    ordered = [main, *[name for name in roots if name != main]]
    if len(roots) > 1:
        source.repairs.add(f"several root links; {', '.join(ordered[1:])} fixed to {main}")
    stack = [(name, main, pose(np.zeros(3))) for name in ordered]
    parts[main] = Part(
        name=main, parent=None, joint=None, T_sp=np.eye(4), T_pc=np.eye(4), members=()
    )
    while stack:
        link_name, part_name, T_pl = stack.pop(0)
        part = parts[part_name]
        parts[part_name] = replace(part, members=(*part.members, (source.links[link_name], T_pl)))
        for joint in by_parent.get(link_name, ()):
            T_pc = T_pl @ joint.T_pc
            if joint.kind == "fixed":
                if source.links[joint.child].visuals:
                    source.repairs.note(f"link {joint.child} is fixed to {part_name}: one body")
                stack.append((joint.child, part_name, T_pc))
                continue
            parts[joint.child] = Part(
                name=joint.child,
                parent=part_name,
                joint=joint,
                T_sp=part.T_sp @ T_pc,
                T_pc=T_pc,
                members=(),
            )
            stack.append((joint.child, joint.child, np.eye(4)))
    return list(parts.values())


def _rooted(parts: list[Part]) -> tuple[Part, ...]:
    """Return the parts with the root named after the first of its links that has geometry."""
    root = parts[0]
    named = next((link.name for link, _ in root.members if link.visuals or link.collisions), None)
    if named is None or named == root.name:
        return tuple(parts)
    renamed = [replace(p, parent=named if p.parent == root.name else p.parent) for p in parts[1:]]
    return (replace(root, name=named), *renamed)


def unit_axis(joint: SourceJoint) -> Array:
    """Return the unit axis (3,) in the frame of the child.

    Raises:
        AssetError: It is zero.
    """
    axis = np.array(joint.axis)
    if np.linalg.norm(axis) < 1e-6:
        raise AssetError(
            f"{joint.where}: joint {quote(joint.name)} has a zero axis; give its direction"
        )
    return normalised(axis)


def motion(joint: SourceJoint, q: float) -> Array:
    """Return the pose (4, 4) of the child at position ``q`` in its frame at 0, in source units."""
    axis = unit_axis(joint)
    if joint.kind == "prismatic":
        return pose(q * axis)
    return pose(np.zeros(3), axis_angle_to_matrix(axis, q))


def poses_at(parts: tuple[Part, ...], q: Mapping[str, float]) -> dict[str, Array]:
    """Return the pose (4, 4) of each part in the root frame with the joints at ``q``.

    Lengths are in source units, angles in radians.
    """
    poses: dict[str, Array] = {}
    for part in parts:
        if part.joint is None or part.parent is None:
            poses[part.name] = part.T_sp
        else:
            moved = motion(part.joint, q.get(part.joint.name, 0.0))
            poses[part.name] = poses[part.parent] @ part.T_pc @ moved
    return poses
