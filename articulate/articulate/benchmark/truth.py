"""What is true of an object: its parts in one frame, and its joints."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from articulate.benchmark.known_joint import KnownJoint, Status
from articulate.benchmark.metrics import ordered
from articulate.errors import AssetError
from articulate.formats.collada_up_axis import loader_of
from articulate.formats.config import ConvertConfig
from articulate.formats.link_tree import unit_axis
from articulate.formats.source_object import SourceJoint, SourceObject
from articulate.reconstruct.actors.protocol import JointKind, PredictedJoint
from articulate.reconstruct.link_meshes import (
    HALF_TURN,
    link_pieces,
    link_poses,
    merge_pieces,
)
from articulate.render.parts import PartMesh, joint_bounds
from articulate.transforms import Array, apply, pose

DIAGONAL = 2.0
"""Objects measured in metres are scaled to this diagonal, PartNet-Mobility's, so that thresholds
mean the same."""
SCORED_KINDS = frozenset({"revolute", "continuous", "prismatic"})
"""Joints of a URDF that can be scored."""


@dataclass(frozen=True, kw_only=True)
class TrueJoint:
    """One joint that is known, in ``o``."""

    joint: PredictedJoint
    """Its geometry, in the words of a prediction; ``part`` and ``parent`` are true names."""
    status: Status
    moves: tuple[str, ...]
    """Every part that goes along, the part itself first."""
    rigid: tuple[str, ...]
    """Parts fixed to the part, itself first: a joint of any of them is this joint."""


@dataclass(frozen=True, kw_only=True, eq=False)
class TrueObject:
    """An object whose joints are known."""

    object_id: str
    category: str
    parts: tuple[PartMesh, ...]
    """In ``o``, every joint at 0, by their true names."""
    labels: Mapping[str, str]
    """What each part is called, as the source has it."""
    joints: tuple[TrueJoint, ...]
    carried: frozenset[str] = frozenset()
    """Parts that a joint moves which is not scored: one that follows another, a planar one, a
    screw. To say that they move is no invention."""

    def part(self, name: str) -> PartMesh:
        """The part of this true name; KeyError if there is none."""
        return next(p for p in self.parts if p.name == name)

    def boxed(self, names: Iterable[str]) -> Array:
        """Lowest and highest corner of some parts together (2, 3)."""
        return joint_bounds([self.part(name) for name in names])


def joints_in_urdf(source: SourceObject) -> tuple[KnownJoint, ...]:
    """The movable joints that the URDF itself has.

    Raises:
        AssetError: A joint moves a link that is not there, or the links form no tree.
    """
    poses = link_poses(source)
    known = []
    for joint in source.joints:
        if not _can_be_scored(joint):
            continue
        if joint.child not in poses:
            raise AssetError(
                f"{joint.where}: joint {joint.name!r} moves {joint.child!r}, which is not declared;"
                " add the <link> or leave the joint out"
            )
        T_sc = poses[joint.child]
        axis = T_sc[:3, :3] @ unit_axis(joint)
        limited = joint.kind != "continuous" and None not in (joint.lower, joint.upper)
        kind: JointKind = "prismatic" if joint.kind == "prismatic" else "revolute"
        if kind == "revolute" and not limited:
            kind = "continuous"
        known.append(
            KnownJoint(
                link=joint.child,
                kind=kind,
                axis_s=(float(axis[0]), float(axis[1]), float(axis[2])),
                origin_s=(float(T_sc[0, 3]), float(T_sc[1, 3]), float(T_sc[2, 3])),
                lower=joint.lower if limited else None,
                upper=joint.upper if limited else None,
            )
        )
    return tuple(known)


def _can_be_scored(joint: SourceJoint) -> bool:
    return joint.kind in SCORED_KINDS and joint.mimic is None


def true_object(
    source: SourceObject,
    known: Sequence[KnownJoint],
    *,
    object_id: str,
    category: str,
    labels: Mapping[str, str],
    in_metres: bool,
) -> TrueObject:
    """The object in the frame ``o``: turned so that its front is +x, standing on z = 0.

    Args:
        source: What its URDF says; the front is -x there, as in PartNet-Mobility.
        known: Its true joints.
        object_id: Name in reports.
        category: Category in reports.
        labels: What each link is called.
        in_metres: It is scaled to the size that PartNet-Mobility's objects have.

    Raises:
        AssetError: Nothing is to be seen of it, or a joint moves nothing.
    """
    poses = link_poses(source)
    loader = loader_of(source, ConvertConfig())
    pieces = {name: link_pieces(loader, source, name, poses[name]) for name in source.links}
    parts_s = [merge_pieces(name, found) for name, found in pieces.items() if found]
    if not parts_s:
        raise AssetError(f"{source.path}: nothing of it is to be seen")
    scale, T_os = _front_pose(parts_s, in_metres=in_metres)
    parts = tuple(p.with_vertices(apply(T_os, scale * p.vertices)) for p in parts_s)
    seen = {part.name for part in parts}
    links = {k.link for k in known}
    joints = [_true_joint(source, joint, links, seen, scale, T_os) for joint in known]
    return TrueObject(
        object_id=object_id,
        category=category,
        parts=parts,
        labels={part.name: labels.get(part.name, part.name) for part in parts},
        joints=tuple(joints),
        carried=_carried(source.joints, links) & seen,
    )


def _carried(joints: Sequence[SourceJoint], known: set[str]) -> frozenset[str]:
    """All that a joint moves of which the truth says nothing."""
    movers = [j.child for j in joints if j.kind != "fixed" and j.child not in known]
    return frozenset(name for link in movers for name in _below(joints, link, set()))


def _front_pose(parts: Sequence[PartMesh], *, in_metres: bool) -> tuple[float, Array]:
    """Scale and rigid transform from the frame of the URDF's root to ``o``."""
    low, high = joint_bounds(parts)
    diagonal = float(np.linalg.norm(high - low))
    scale = DIAGONAL / diagonal if in_metres else 1.0
    return scale, pose([0.0, 0.0, -scale * low[2]], HALF_TURN)


def _true_joint(
    source: SourceObject,
    known: KnownJoint,
    movable: set[str],
    seen: set[str],
    scale: float,
    T_os: Array,
) -> TrueJoint:
    moves = [name for name in _below(source.joints, known.link, set()) if name in seen]
    # Projects froze joints of an object and hung a moving stand-in on the part: a plain joint that
    # the truth leaves out does not take a part away from it. One that no truth can state does.
    apart = {j.child for j in source.joints if j.kind != "fixed" and not _can_be_scored(j)}
    stop = (movable | apart) - {known.link}
    rigid = [name for name in _below(source.joints, known.link, stop) if name in seen]
    if not rigid:
        raise AssetError(f"{source.path}: nothing is to be seen of the moving link {known.link}")
    parents = {joint.child: joint.parent for joint in source.joints}
    parent = parents.get(known.link)
    while parent is not None and parent not in seen:
        parent = parents.get(parent)
    axis = T_os[:3, :3] @ np.asarray(known.axis_s)
    pivot = apply(T_os, scale * np.asarray(known.origin_s))
    unit = scale if known.kind == "prismatic" else 1.0
    joint = PredictedJoint(
        part=rigid[0],
        parent=parent,
        kind=known.kind,
        axis_o=(float(axis[0]), float(axis[1]), float(axis[2])),
        pivot_o=(float(pivot[0]), float(pivot[1]), float(pivot[2])),
        lower=None if known.lower is None else unit * known.lower,
        upper=None if known.upper is None else unit * known.upper,
    )
    # Some URDFs have their limits swapped; what is said of a joint is put in order as well.
    return TrueJoint(
        joint=ordered(joint), status=known.status, moves=tuple(moves), rigid=tuple(rigid)
    )


def _below(joints: Sequence[SourceJoint], link: str, stop: set[str]) -> list[str]:
    """``link`` and all below it, without what hangs on a link in ``stop``."""
    found, stack = [], [link]
    while stack:
        name = stack.pop()
        found.append(name)
        stack += [j.child for j in joints if j.parent == name and j.child not in stop | {*found}]
    return found


def renamed(joint: PredictedJoint, names: Mapping[str, str]) -> PredictedJoint:
    """The joint with its parts called by other names; parts without one become None."""
    parent = None if joint.parent is None else names.get(joint.parent)
    return replace(joint, part=names.get(joint.part, joint.part), parent=parent)
