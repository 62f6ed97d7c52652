"""Editable object: links with geometry and joints in one frame, every joint at 0."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from articulate.errors import AssetError, UsageError, nearest, quote
from articulate.formats.config import ConvertConfig
from articulate.formats.decompose_joints import decompose_joints
from articulate.formats.link_tree import Part, build_parts, unit_axis
from articulate.formats.load_meshes import Loader, PartGeometry, Piece
from articulate.formats.read_source import read_source
from articulate.formats.source_object import SourceJoint
from articulate.geometry.inertia import Inertial, stated
from articulate.reconstruct.actors.protocol import JointKind
from articulate.reconstruct.link_meshes import link_poses
from articulate.transforms import Array, axis_angle_to_matrix, pose

Vec3 = tuple[float, float, float]
KINDS: tuple[JointKind, ...] = ("revolute", "prismatic", "continuous", "fixed")


@dataclass(frozen=True, kw_only=True)
class StudioJoint:
    """Joint of a link, in the object frame."""

    name: str
    kind: JointKind
    parent: str
    """Name of the parent link."""
    axis_o: Vec3 = (0.0, 0.0, 1.0)
    """Unit direction of the axis or of sliding."""
    pivot_o: Vec3 = (0.0, 0.0, 0.0)
    """A point on the axis [m]."""
    lower: float | None = None
    """Lower limit [m or rad]; None without limits."""
    upper: float | None = None
    """Upper limit [m or rad]."""
    damping: float | None = None
    friction: float | None = None
    mimic: tuple[str, float, float] | None = None
    """Leading joint, multiplier, offset."""

    def T_o(self, q: float) -> Array:
        """Return the motion (4, 4) of the link in the object frame from 0 to ``q`` [m or rad]."""
        axis, pivot = np.asarray(self.axis_o), np.asarray(self.pivot_o)
        if self.kind == "fixed":
            return np.eye(4)
        if self.kind == "prismatic":
            return pose(q * axis)
        rotation = axis_angle_to_matrix(axis, q)
        return pose(pivot - rotation @ pivot, rotation)


@dataclass(frozen=True, kw_only=True, eq=False)
class StudioLink:
    """Rigid part with its geometry in the object frame [m]."""

    name: str
    visuals: tuple[Piece, ...] = ()
    collisions: tuple[Piece, ...] = ()
    joint: StudioJoint | None = None
    """Joint to its parent; None for the root."""
    inertial: Inertial | None = None
    """Mass properties in the object frame; None: derived from the geometry."""

    @property
    def visible(self) -> tuple[Piece, ...]:
        """Visual pieces, or collision pieces where there are none."""
        return self.visuals or self.collisions

    @property
    def bounds_o(self) -> Array:
        """Lowest and highest corner (2, 3) [m]; zeros without geometry."""
        return bounds_of([self])


@dataclass(frozen=True, kw_only=True, eq=False)
class StudioModel:
    """Links of an object, parents before children."""

    name: str
    links: tuple[StudioLink, ...]

    def link(self, name: str) -> StudioLink:
        """Return the link ``name``.

        Raises:
            UsageError: There is none; the message gives the nearest.
        """
        for link in self.links:
            if link.name == name:
                return link
        known = [link.name for link in self.links]
        raise UsageError(f"no part {quote(name)}{nearest(name, known)}")

    def joint(self, name: str) -> StudioJoint:
        """Return the joint of the link ``name``.

        Raises:
            UsageError: There is no such link, or it is the root.
        """
        joint = self.link(name).joint
        if joint is None:
            raise UsageError(f"{quote(name)} is the root; it has no joint")
        return joint

    def with_link(self, link: StudioLink) -> StudioModel:
        """Return the model with the link of the same name replaced."""
        links = tuple(link if own.name == link.name else own for own in self.links)
        return replace(self, links=ordered(links))

    def below(self, name: str) -> tuple[str, ...]:
        """Return the names of a link and of all links that move with it."""
        found = [name]
        for link in self.links:
            if link.joint is not None and link.joint.parent in found:
                found.append(link.name)
        return tuple(found)

    @property
    def bounds_o(self) -> Array:
        """Lowest and highest corner (2, 3) of all parts [m]."""
        return bounds_of(self.links)


def bounds_of(links: Sequence[StudioLink]) -> Array:
    """Return the lowest and highest corner (2, 3) of links [m]; zeros without geometry."""
    corners = [piece.mesh.bounds for link in links for piece in link.visible]
    if not corners:
        return np.zeros((2, 3))
    stacked = np.stack(corners)
    return np.stack([stacked[:, 0].min(axis=0), stacked[:, 1].max(axis=0)])


def ordered(links: Sequence[StudioLink]) -> tuple[StudioLink, ...]:
    """Return links with parents before children, otherwise in their order.

    Raises:
        UsageError: There is not one root, or the joints form a cycle.
    """
    roots = [link for link in links if link.joint is None]
    if len(roots) != 1:
        raise UsageError(f"{len(roots)} roots; an object has one")
    found = {roots[0].name: roots[0]}
    while len(found) < len(links):
        ready = [
            link
            for link in links
            if link.name not in found and link.joint is not None and link.joint.parent in found
        ]
        if not ready:
            raise UsageError("the joints form a cycle; choose another parent")
        found.update({link.name: link for link in ready})
    return tuple(found.values())


def read_model(path: Path) -> StudioModel:
    """Read the URDF, SDF or MJCF file at ``path`` as an editable object.

    Links without geometry that nothing is attached to are omitted.

    Raises:
        AssetError: It cannot be read, or its links form no tree.
    """
    source = decompose_joints(read_source(path))
    build_parts(source)  # raises where the tree is broken
    poses = link_poses(source)
    loader = Loader(source, ConvertConfig())
    children = {joint.child: joint for joint in source.joints}
    roots = [name for name in source.links if name not in children]
    main = max(roots, key=lambda name: sum(j.parent == name for j in source.joints))
    links = []
    for name, link in source.links.items():
        joint = None
        if name in children:
            joint = _joint(children[name], poses)
        elif name != main:
            joint = StudioJoint(name=f"{name}_fixed", kind="fixed", parent=main)
        geometry = PartGeometry(visuals=(), collisions=(), collides_as_seen=True)
        if link.visuals or link.collisions:
            part = Part(
                name=name,
                parent=None,
                joint=None,
                T_sp=np.eye(4),
                T_pc=np.eye(4),
                members=((link, poses[name]),),
            )
            geometry = loader.part(part)
        # Meshes that collide as they are seen are decomposed by the conversion.
        meshes = any(piece.primitive is None for piece in geometry.visuals)
        collisions = () if geometry.collides_as_seen and meshes else geometry.collisions
        links.append(
            StudioLink(
                name=name,
                visuals=geometry.visuals,
                collisions=collisions,
                joint=joint,
                inertial=None if link.inertial is None else stated(link.inertial, poses[name]),
            )
        )
    if not any(link.visible for link in links):
        raise AssetError(f"{path}: no part has geometry; give another file")
    return StudioModel(name=source.name, links=ordered(_without_frames(links)))


def _without_frames(links: Sequence[StudioLink]) -> list[StudioLink]:
    """Remove fixed links without geometry and children: frames of an asset."""
    kept = list(links)
    while True:
        parents = {link.joint.parent for link in kept if link.joint is not None}
        fewer = [
            link
            for link in kept
            if link.visible
            or link.name in parents
            or link.joint is None
            or link.joint.kind != "fixed"
        ]
        if len(fewer) == len(kept):
            return kept
        kept = fewer


def _joint(joint: SourceJoint, poses: Mapping[str, Array]) -> StudioJoint:
    T = poses[joint.child]
    kind: JointKind = "fixed"
    for known in KINDS:
        if joint.kind == known:
            kind = known
    lower, upper = joint.lower, joint.upper
    if kind in {"revolute", "prismatic"}:
        if lower is None and upper is None:
            kind = "continuous" if kind == "revolute" else kind
        else:
            lower, upper = sorted((lower or 0.0, upper or 0.0))
    else:
        lower = upper = None
    axis = (0.0, 0.0, 1.0) if kind == "fixed" else vec3(T[:3, :3] @ unit_axis(joint))
    return StudioJoint(
        name=joint.name,
        kind=kind,
        parent=joint.parent,
        axis_o=axis,
        pivot_o=vec3(T[:3, 3]),
        lower=lower,
        upper=upper,
        damping=joint.damping,
        friction=joint.friction,
        mimic=joint.mimic,
    )


def vec3(values: Array) -> Vec3:
    """Return three numbers as a tuple, without -0."""
    x, y, z = (float(value) + 0.0 for value in values)
    return (x, y, z)
