"""Asset of an articulated object: links, joints, handles and its folder.

An asset is a folder::

    asset.json     the fields of Asset, in the object frame and SI units
    object.xml     MJCF: one fixed root body, links as bodies, joints, excludes
    object.urdf    the same object as canonical URDF
    meshes/        meshes of both files

The object frame ``o`` is the frame of the root body: z points up and the lowest point is at z = 0
when every joint is closed.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from articulate.errors import AssetError, field_error, nearest, quote
from articulate.files import write_text
from articulate.transforms import Array, axis_angle_to_matrix, pose, quat_to_matrix
from articulate.untrusted import load_json_object

SCHEMA = "articulate.asset"
SCHEMA_VERSION = 2
ABOUT = frozenset({"check_report.json", "check_report.html", "check_report.webp"})
"""Files in an asset folder that describe the asset and are not part of it."""
NAMES = frozenset({"name", "category", "link", "parent", "joint"})
MAX_NAME = 250
"""Longest name [characters]."""
Vec3 = tuple[float, float, float]
Quat = tuple[float, float, float, float]


@dataclass(frozen=True, kw_only=True)
class Link:
    """One rigid part."""

    name: str
    """Name of the link and of its MuJoCo body."""
    parent: str | None
    """Name of the parent link; None for the root."""
    pos_o: Vec3
    """Origin of the link's frame in the object frame, every joint at 0 [m]."""
    quat_o: Quat
    """Rotation of the link's frame in the object frame, every joint at 0, wxyz."""
    mass_kg: float
    """Mass [kg]."""
    bounds_l: tuple[Vec3, Vec3]
    """Lowest and highest corner of its visual geometry in the link's frame [m]."""
    visuals: int = 0
    """Number of visual geoms."""
    collisions: int = 0
    """Number of collision geoms."""
    trimmed: float = 0.0
    """Fraction of its collision volume that repairs cut away, in [0, 1]."""


@dataclass(frozen=True, kw_only=True)
class Joint:
    """One moving connection between a link and its parent."""

    name: str
    """Name of the joint, in URDF and MJCF alike."""
    kind: Literal["slide", "hinge"]
    """``slide`` measures metres, ``hinge`` radians."""
    link: str
    """Name of the link that it moves."""
    parent: str
    """Name of the link that it moves against."""
    axis_o: Vec3
    """Unit axis in the object frame, every joint at 0."""
    pivot_o: Vec3
    """A point on the axis in the object frame, every joint at 0 [m]."""
    lower: float | None
    """Lower limit [m or rad]; None if it turns without end."""
    upper: float | None
    """Upper limit [m or rad]; None if it turns without end."""
    closed: float
    """Position in which the part is closed [m or rad]."""
    open: float
    """Far end of opening [m or rad]; a quarter turn from closed where there are no limits."""
    closed_rule: str
    """Rule that chose ``closed`` and ``open``, as text."""
    damping: float = 0.0
    """Viscous damping [N s/m or Nm s/rad]."""
    frictionloss: float = 0.0
    """Dry friction [N or Nm]."""

    @property
    def span(self) -> float:
        """Signed travel from closed to open [m or rad]."""
        return self.open - self.closed


@dataclass(frozen=True, kw_only=True)
class Handle:
    """Place where fingers hold a moving part, in the frame of its link."""

    name: str
    """Name, unique in the asset."""
    link: str
    """Link that carries it."""
    joint: str
    """Joint that moves it."""
    pos_l: Vec3
    """Middle between the finger tips when they hold it [m]."""
    normal_l: Vec3
    """Unit vector from the handle towards the gripper, which approaches along -normal."""
    along_l: Vec3
    """Unit long axis, perpendicular to ``normal_l``; fingers close along normal x along."""
    extent: Vec3
    """Size along ``along_l``, along the closing axis, and along ``normal_l`` [m]."""
    kind: Literal["bar", "knob", "edge", "push", "hook", "none"]
    """``bar`` is long and free behind, ``knob`` is compact, ``edge`` is the rim of a panel,
    ``push`` is a place on the front that closed fingers push, ``hook`` is a place behind an edge
    that they pull, with ``along_l`` in the direction of opening, ``none`` is the outermost point of
    a part without a graspable handle."""

    @property
    def shut(self) -> bool:
        """True if fingers are closed at this place and hold nothing between them."""
        return self.kind in ("push", "hook")

    source: Literal["name", "geometry", "edge", "given"]
    """Origin: its name, its shape, an edge, or the user."""


@dataclass(frozen=True, kw_only=True)
class Asset:
    """An articulated object in a folder, in metres."""

    name: str
    """Short name, used for folders and reports."""
    category: str
    """PartNet-Mobility's name of the category where one fits, else ``"unknown"``."""
    links: tuple[Link, ...]
    """Parents come before children; the first is the root."""
    joints: tuple[Joint, ...]
    """Movable joints, in the order of their links."""
    handles: tuple[Handle, ...]
    """At most one for each joint in this version."""
    bounds_o: tuple[Vec3, Vec3]
    """Lowest and highest corner in the object frame, every joint closed [m]."""
    source: str = "unknown"
    """Origin of the object."""
    licence: str = "unknown"
    """Licence of the object, inherited by everything made from it."""
    repairs: tuple[str, ...] = ()
    """Everything that was changed from the input, one sentence each."""
    accepted: tuple[str, ...] = ()
    """Names of checks whose failure is accepted as a warning."""
    size_rule: str = ""
    """Rule that chose the metric size, as text."""
    folder: Path = Path()
    """Asset folder; not part of the content."""

    @property
    def mjcf_path(self) -> Path:
        """Path of the object's MJCF file."""
        return self.folder / "object.xml"

    def joint(self, name: str) -> Joint:
        """Return the joint ``name``.

        Raises:
            AssetError: It does not exist; the message lists the joints.
        """
        for joint in self.joints:
            if joint.name == name:
                return joint
        known = [joint.name for joint in self.joints]
        raise AssetError(f"{self.name}: no joint {quote(name)}{nearest(name, known)}")

    def link(self, name: str) -> Link:
        """Return the link ``name``; AssetError if it does not exist."""
        for link in self.links:
            if link.name == name:
                return link
        raise AssetError(
            f"{self.name}: no link {name!r}{nearest(name, [x.name for x in self.links])}"
        )

    def handle_of(self, joint_name: str) -> Handle | None:
        """Return the handle that ``joint_name`` moves, or None."""
        return next((h for h in self.handles if h.joint == joint_name), None)

    def with_handle(self, handle: Handle) -> Asset:
        """Return this asset with ``handle`` as the handle of its joint."""
        others = tuple(h for h in self.handles if h.joint != handle.joint)
        return replace(self, handles=(*others, handle))

    def T_ol(self, joint_name: str, q: Array | float) -> Array:
        """Return the pose of the link that ``joint_name`` moves (..., 4, 4) [m], all others at 0.

        Args:
            joint_name: Joint that is moved.
            q: Its position (...) [m or rad].
        """
        joint = self.joint(joint_name)
        link = self.link(joint.link)
        T_ol = pose(link.pos_o, quat_to_matrix(link.quat_o))
        return joint_motion(joint, q) @ T_ol

    def T_oh(self, joint_name: str, q: Array | float) -> Array:
        """Return the pose of the handle of ``joint_name`` (..., 4, 4) [m] at position ``q``.

        Its z axis is the approach direction (-normal), its y axis the closing axis of the fingers:
        it coincides with the frame of a gripper that holds the handle.

        Raises:
            AssetError: The joint has no handle.
        """
        handle = self.handle_of(joint_name)
        if handle is None:
            raise AssetError(f"{self.name}: joint {joint_name} has no handle; take another joint")
        return self.T_ol(joint_name, q) @ handle_frame(handle)

    def handle_travel(self, joint_name: str) -> float | None:
        """Return the path length of the handle from closed to open [m]; None without a handle."""
        handle, joint = self.handle_of(joint_name), self.joint(joint_name)
        if handle is None or joint.kind == "slide":
            return None if handle is None else abs(joint.span)
        arm = self.T_oh(joint_name, 0.0)[:3, 3] - np.asarray(joint.pivot_o)
        return float(abs(joint.span) * np.linalg.norm(np.cross(joint.axis_o, arm)))

    def content_id(self) -> str:
        """Return the SHA-256 of all files of the folder and their names, except ``ABOUT``."""
        digest = hashlib.sha256()
        files = (p for p in self.folder.rglob("*") if p.is_file() and p.name not in ABOUT)
        for path in sorted(files):
            digest.update(path.relative_to(self.folder).as_posix().encode() + b"\0")
            digest.update(hashlib.sha256(path.read_bytes()).digest())
        return digest.hexdigest()


def joint_motion(joint: Joint, q: Array | float) -> Array:
    """Return the motion (..., 4, 4) [m] in the object frame when ``joint`` moves from 0 to ``q``.

    Args:
        joint: Joint that moves.
        q: Positions (...) [m or rad].
    """
    q = np.asarray(q, dtype=np.float64)
    axis = np.asarray(joint.axis_o)
    if joint.kind == "slide":
        return pose(q[..., None] * axis)
    rot = axis_angle_to_matrix(np.broadcast_to(axis, (*q.shape, 3)), q)
    pivot = np.asarray(joint.pivot_o)
    return pose(pivot - np.einsum("...ij,j->...i", rot, pivot), rot)


def handle_frame(handle: Handle) -> Array:
    """Return the pose ``T_lh`` (4, 4) of a handle: z = -normal, x = along, y = closing axis."""
    z = -np.asarray(handle.normal_l)
    x = np.asarray(handle.along_l)
    return pose(handle.pos_l, np.stack([x, np.cross(z, x), z], axis=-1))


def save_asset(asset: Asset) -> Path:
    """Write ``asset.json`` into the asset's folder and return its path."""
    content = dataclasses.asdict(asset)
    del content["folder"]
    content = {"schema": SCHEMA, "schema_version": SCHEMA_VERSION, **content}
    path = asset.folder / "asset.json"
    write_text(path, json.dumps(content, indent=1) + "\n")
    return path


def load_asset(folder: Path) -> Asset:
    """Read the asset in ``folder``.

    Raises:
        AssetError: There is none, or it is of another schema.
    """
    path = folder / "asset.json"
    if not path.exists():
        raise AssetError(f"{folder}: not an asset folder; make one with check-asset")
    content = load_json_object(path, error=AssetError)
    if content.get("schema") != SCHEMA or content.get("schema_version") != SCHEMA_VERSION:
        raise AssetError(
            f"{path}: not an asset of schema {SCHEMA} {SCHEMA_VERSION}; make it with check-asset"
        )
    return _decode(content, folder, path)


def _decode(content: dict[str, Any], folder: Path, path: Path) -> Asset:
    def parts(cls: type[Any], key: str) -> tuple[Any, ...]:
        return tuple(cls(**_fields(cls, item)) for item in content[key])

    try:
        names = {f.name for f in dataclasses.fields(Asset)} - {"links", "joints", "handles"}
        own = {name: content[name] for name in names - {"folder"}}
        return Asset(
            links=parts(Link, "links"),
            joints=parts(Joint, "joints"),
            handles=parts(Handle, "handles"),
            folder=folder,
            **_fields(Asset, own),
        )
    except (KeyError, TypeError) as error:
        raise AssetError(f"{path}: {field_error(error)}; make it with check-asset") from None


def _fields(cls: type[Any], item: Any) -> dict[str, Any]:
    """Return the fields of ``cls`` in a JSON object with lists as tuples.

    Raises:
        TypeError: A value is of another type than its field.
    """
    if not isinstance(item, dict):
        raise TypeError(f"{quote(item)} where an object was expected")
    types = {f.name: str(f.type) for f in dataclasses.fields(cls)}
    found = {name: _as_tuples(value) for name, value in item.items()}
    for name, value in found.items():
        if name in types and not _matches(value, types[name]):
            raise TypeError(f"{name} is {quote(value)}, not {types[name]}")
        if name in NAMES and isinstance(value, str) and not _is_name(value):
            raise TypeError(f"{name} {quote(value, 40)} is longer than {MAX_NAME} or not printable")
    return found


def _is_name(value: str) -> bool:
    return len(value) <= MAX_NAME and value.isprintable()


def _as_tuples(value: Any) -> Any:
    return tuple(_as_tuples(v) for v in value) if isinstance(value, list) else value


def _matches(value: Any, kind: str) -> bool:
    """Return whether ``value`` fits the annotation ``kind`` of a field of this module."""
    if kind.endswith(" | None"):
        return value is None or _matches(value, kind.removesuffix(" | None"))
    if kind.startswith("Literal["):
        return isinstance(value, str) and repr(value) in kind.replace('"', "'")
    if kind in {"str", "int"}:
        return type(value).__name__ == kind
    if kind == "float":
        return type(value) in {int, float}
    if kind == "tuple[str, ...]":
        return isinstance(value, tuple) and all(isinstance(v, str) for v in value)
    if kind == "tuple[Vec3, Vec3]":
        return (
            isinstance(value, tuple) and len(value) == 2 and all(_matches(v, "Vec3") for v in value)
        )
    sizes = {"Vec3": 3, "Quat": 4}
    return (
        isinstance(value, tuple)
        and len(value) == sizes[kind]
        and all(_matches(v, "float") for v in value)
    )
