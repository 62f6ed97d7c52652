"""True parts and joints of an object, in one frame."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from articulate.benchmark.known_joint import KnownJoint, Status
from articulate.benchmark.metrics import ordered
from articulate.errors import AssetError
from articulate.formats.config import ConvertConfig
from articulate.formats.link_tree import unit_axis
from articulate.formats.orient_collada import make_loader
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
"""Diagonal of PartNet-Mobility's objects [units]; objects in metres are scaled to it, so that
thresholds mean the same."""
SCORED_KINDS = frozenset({"revolute", "continuous", "prismatic"})
"""Joints of a URDF that can be scored."""


@dataclass(frozen=True, kw_only=True)
class TrueJoint:
    """A known joint in ``o``."""

    joint: PredictedJoint
    """Its geometry as a prediction; ``part`` and ``parent`` are true names."""
    status: Status
    moves: tuple[str, ...]
    """All parts that move along, the part itself first."""
    rigid: tuple[str, ...]
    """Parts fixed to the part, itself first; a joint of any of them counts as this joint."""


@dataclass(frozen=True, kw_only=True, eq=False)
class TrueObject:
    """An object with known joints."""

    object_id: str
    category: str
    parts: tuple[PartMesh, ...]
    """Parts in ``o`` with every joint at 0, by their true names."""
    labels: Mapping[str, str]
    """Label of each part in the source."""
    joints: tuple[TrueJoint, ...]
    carried: frozenset[str] = frozenset()
    """Parts that a joint without a score moves: a mimic, a planar joint, a screw. A joint predicted
    for them is not a false positive."""

    def part(self, name: str) -> PartMesh:
        """Return the part with this true name; KeyError if there is none."""
        return next(p for p in self.parts if p.name == name)

    def box_of(self, names: Iterable[str]) -> Array:
        """Return the box around several parts (2, 3)."""
        return joint_bounds([self.part(name) for name in names])


def joints_in_urdf(source: SourceObject) -> tuple[KnownJoint, ...]:
    """Return the movable joints of a URDF.

    Raises:
        AssetError: A joint moves an unknown link, or the links form no tree.
    """
    poses = link_poses(source)
    known = []
    for joint in source.joints:
        if not _can_be_scored(joint):
            continue
        if joint.child not in poses:
            raise AssetError(
                f"{joint.where}: joint {joint.name!r} moves {joint.child!r}, which does not exist;"
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
    """Create the object in the frame ``o``: front at +x, bottom on z = 0.

    Args:
        source: Its URDF, with the front at -x as in PartNet-Mobility.
        known: Its true joints.
        object_id: Name in reports.
        category: Category in reports.
        labels: Label of each link.
        in_metres: Scale it to the size of PartNet-Mobility's objects.

    Raises:
        AssetError: It has no visible part, or a joint moves none.
    """
    poses = link_poses(source)
    loader = make_loader(source, ConvertConfig())
    pieces = {name: link_pieces(loader, source, name, poses[name]) for name in source.links}
    parts_s = [merge_pieces(name, found) for name, found in pieces.items() if found]
    if not parts_s:
        raise AssetError(f"{source.path}: has no visible geometry")
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
    """Return the links that a joint outside of the truth moves."""
    movers = [j.child for j in joints if j.kind != "fixed" and j.child not in known]
    return frozenset(name for link in movers for name in _below(joints, link, set()))


def _front_pose(parts: Sequence[PartMesh], *, in_metres: bool) -> tuple[float, Array]:
    """Return scale and rigid transform from the frame of the URDF's root to ``o``."""
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
    # Some projects fixed joints of an object and attached a moving substitute to the part: a plain
    # joint that the truth omits does not separate a part. One that no truth can state does.
    apart = {j.child for j in source.joints if j.kind != "fixed" and not _can_be_scored(j)}
    stop = (movable | apart) - {known.link}
    rigid = [name for name in _below(source.joints, known.link, stop) if name in seen]
    helpers = _helpers(source.joints, movable, seen)
    status: Status = known.status
    if helpers & {known.link, *_above(source.joints, known.link)}:
        status = "compound"
    rigid = rigid or (moves if known.link in helpers else [])
    if not rigid:
        raise AssetError(f"{source.path}: the moving link {known.link} has no visible geometry")
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
    # Some URDFs have swapped limits; predictions are ordered as well.
    return TrueJoint(joint=ordered(joint), status=status, moves=tuple(moves), rigid=tuple(rigid))


def _helpers(joints: Sequence[SourceJoint], movable: set[str], seen: set[str]) -> set[str]:
    """Return moving links without geometry that another joint follows: a slide and a turn in a row.

    The part that both move has no single joint.
    """
    return {
        joint.parent
        for joint in joints
        if joint.child in movable and joint.parent in movable - seen
    }


def _above(joints: Sequence[SourceJoint], link: str) -> list[str]:
    """Return the parent of ``link`` as a list, empty for the root."""
    return [joint.parent for joint in joints if joint.child == link]


def _below(joints: Sequence[SourceJoint], link: str, stop: set[str]) -> list[str]:
    """Return ``link`` and its descendants, without the subtrees of links in ``stop``."""
    found, stack = [], [link]
    while stack:
        name = stack.pop()
        found.append(name)
        stack += [j.child for j in joints if j.parent == name and j.child not in stop | {*found}]
    return found


def renamed(joint: PredictedJoint, names: Mapping[str, str]) -> PredictedJoint:
    """Return the joint with other names of its parts; a parent without one becomes None."""
    parent = None if joint.parent is None else names.get(joint.parent)
    return replace(joint, part=names.get(joint.part, joint.part), parent=parent)
