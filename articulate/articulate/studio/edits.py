"""Corrections of an object: typed records and the pure function that applies one."""

from __future__ import annotations

import dataclasses
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
import trimesh
from scipy.spatial import KDTree

from articulate.checks.surface import sample
from articulate.errors import UsageError, quote
from articulate.formats.load_meshes import Piece
from articulate.geometry.inertia import combined
from articulate.reconstruct.actors.protocol import JointKind
from articulate.studio.mass import divided_mass, moved_mass, scaled_mass
from articulate.studio.model import (
    KINDS,
    StudioJoint,
    StudioLink,
    StudioModel,
    Vec3,
    ordered,
    vec3,
)
from articulate.transforms import Array, Ints, normalised

MAX_NAME = 60
"""Longest name of a new part [characters]."""
MAX_M = 100.0
"""Largest length and coordinate [m]."""
MAX_RAD = 4.0 * math.pi
"""Largest limit of a hinge [rad]."""
MIN_TRAVEL = 1e-3
"""Smallest range of a joint [m or rad]."""
MAX_FACES = 2_000_000
"""Most faces of a selection."""
SPLIT_SAMPLES = 4000
"""Points on a part that decide which collision shapes belong to a selection."""
SHARE = 0.2
"""Collision shapes with a fraction of the selection in between are computed again."""
_NAME = re.compile(r"[A-Za-z0-9_.\-]+")


@dataclass(frozen=True, kw_only=True)
class SetJoint:
    """Change the joint of a part; fields that are None keep their value."""

    type: ClassVar[str] = "set_joint"
    part: str
    kind: JointKind | None = None
    axis_o: Vec3 | None = None
    """Direction of axis or sliding in the object frame; normalised."""
    pivot_o: Vec3 | None = None
    """A point on the axis [m]."""
    lower: float | None = None
    """Lower limit [m or rad]."""
    upper: float | None = None
    """Upper limit [m or rad]."""
    parent: str | None = None


@dataclass(frozen=True, kw_only=True)
class SetClosed:
    """Make position ``q`` [m or rad] of a part its closed position, 0."""

    type: ClassVar[str] = "set_closed"
    part: str
    q: float


@dataclass(frozen=True, kw_only=True)
class SetOpen:
    """Make position ``q`` [m or rad] of a part the far end of its range."""

    type: ClassVar[str] = "set_open"
    part: str
    q: float


@dataclass(frozen=True, kw_only=True)
class SetSize:
    """Scale the object so that its extent along axis 0, 1 or 2 is ``size_m`` [m]."""

    type: ClassVar[str] = "set_size"
    axis: int
    size_m: float
    part: str | None = None
    """Part that has this extent; None: the entire object."""


@dataclass(frozen=True, kw_only=True)
class MergeParts:
    """Make ``part`` a piece of ``into``; its joint is removed."""

    type: ClassVar[str] = "merge_parts"
    part: str
    into: str


@dataclass(frozen=True, kw_only=True)
class SplitPart:
    """Make selected faces of ``part`` a new part, fixed to it."""

    type: ClassVar[str] = "split_part"
    part: str
    name: str
    faces: tuple[tuple[int, ...], ...]
    """Indices of the selected faces of each visible piece of the part, in its order."""


@dataclass(frozen=True, kw_only=True)
class Accept:
    """Record that the joint of a part is right."""

    type: ClassVar[str] = "accept"
    part: str


Edit = SetJoint | SetClosed | SetOpen | SetSize | MergeParts | SplitPart | Accept
TYPES: dict[str, type[Any]] = {
    cls.type: cls for cls in (SetJoint, SetClosed, SetOpen, SetSize, MergeParts, SplitPart, Accept)
}


def edit_content(edit: Edit) -> dict[str, Any]:
    """Return an edit as a JSON object; fields that are None are omitted."""
    fields = {k: v for k, v in dataclasses.asdict(edit).items() if v is not None}
    return {"type": edit.type, **fields}


def parse_edit(content: Mapping[str, Any]) -> Edit:
    """Return the edit that a JSON object describes.

    Raises:
        UsageError: The type or a field is unknown, missing, or out of range.
    """
    kind = content.get("type")
    cls = TYPES.get(kind) if isinstance(kind, str) else None
    if cls is None:
        raise UsageError(f"edit type {quote(kind)}; known: {', '.join(TYPES)}")
    known = {field.name: field for field in dataclasses.fields(cls)}
    values: dict[str, Any] = {}
    for key, value in content.items():
        if key == "type":
            continue
        if key not in known:
            raise UsageError(f"edit {kind}: unknown field {quote(key)}")
        values[key] = None if value is None else _PARSERS[key](key, value)
    for name, field in known.items():
        if values.get(name) is None and field.default is dataclasses.MISSING:
            raise UsageError(f"edit {kind}: field {name} is missing")
    edit: Edit = cls(**values)
    return edit


def _text(key: str, value: Any) -> str:
    if not isinstance(value, str) or not 0 < len(value) <= 250:
        raise UsageError(f"{key} is {quote(value)}; a name is needed")
    return value


def _new_name(key: str, value: Any) -> str:
    if not isinstance(value, str) or len(value) > MAX_NAME or not _NAME.fullmatch(value):
        raise UsageError(
            f"{key} is {quote(value)}; letters, digits, '_', '-' and '.' are accepted, at most "
            f"{MAX_NAME}"
        )
    return value


def _kind(key: str, value: Any) -> str:
    if value not in KINDS:
        raise UsageError(f"{key} is {quote(value)}; accepted: {', '.join(KINDS)}")
    return str(value)


def _number(key: str, value: Any) -> float:
    number = isinstance(value, int | float) and not isinstance(value, bool)
    if not number or not math.isfinite(value) or abs(value) > MAX_M:
        raise UsageError(f"{key} is {quote(value)}; a number up to {MAX_M:g} is needed")
    return float(value)


def _index(key: str, value: Any) -> int:
    if not isinstance(value, int) or isinstance(value, bool) or value not in (0, 1, 2):
        raise UsageError(f"{key} is {quote(value)}; 0, 1 or 2 is needed")
    return value


def _vector(key: str, value: Any) -> Vec3:
    if not isinstance(value, list | tuple) or len(value) != 3:
        raise UsageError(f"{key} is {quote(value)}; three numbers are needed")
    x, y, z = (_number(key, entry) for entry in value)
    return (x, y, z)


def _direction(key: str, value: Any) -> Vec3:
    vector = _vector(key, value)
    if float(np.linalg.norm(vector)) < 1e-6:
        raise UsageError(f"{key} is zero; a direction is needed")
    return vec3(normalised(vector))


def _selection(key: str, value: Any) -> tuple[tuple[int, ...], ...]:
    def is_index(entry: Any) -> bool:
        return isinstance(entry, int) and not isinstance(entry, bool) and entry >= 0

    if not isinstance(value, list | tuple) or not all(isinstance(v, list | tuple) for v in value):
        raise UsageError(f"{key}: a list of face indices for each piece is needed")
    if sum(len(v) for v in value) > MAX_FACES:
        raise UsageError(f"{key}: more than {MAX_FACES} faces")
    if not all(is_index(entry) for v in value for entry in v):
        raise UsageError(f"{key}: face indices are integers from 0 on")
    return tuple(tuple(sorted(set(v))) for v in value)


_PARSERS: dict[str, Any] = {
    "part": _text,
    "into": _text,
    "parent": _text,
    "name": _new_name,
    "kind": _kind,
    "axis_o": _direction,
    "pivot_o": _vector,
    "lower": _number,
    "upper": _number,
    "q": _number,
    "size_m": _number,
    "axis": _index,
    "faces": _selection,
}


def apply_edit(model: StudioModel, edit: Edit) -> StudioModel:
    """Return the model after one correction; the input is not changed.

    Raises:
        UsageError: The edit is not possible: an unknown part, a cycle, an empty range.
    """
    match edit:
        case SetJoint():
            return _set_joint(model, edit)
        case SetClosed():
            return _set_closed(model, edit)
        case SetOpen():
            return _set_open(model, edit)
        case SetSize():
            return _set_size(model, edit)
        case MergeParts():
            return _merge(model, edit)
        case SplitPart():
            return _split(model, edit)
        case Accept():
            model.joint(edit.part)
            return model


def _set_joint(model: StudioModel, edit: SetJoint) -> StudioModel:
    link, joint = model.link(edit.part), model.joint(edit.part)
    fields = ("kind", "axis_o", "pivot_o", "lower", "upper", "parent")
    changes = {name: getattr(edit, name) for name in fields if getattr(edit, name) is not None}
    if "axis_o" in changes:
        changes["axis_o"] = vec3(normalised(changes["axis_o"]))
    changed = replace(joint, **changes)
    if edit.parent is not None:
        model.link(edit.parent)
        if edit.parent in model.below(edit.part):
            raise UsageError(f"{edit.parent} moves with {edit.part}; choose another parent")
    if changed.kind in {"fixed", "continuous"}:
        changed = replace(changed, lower=None, upper=None)
    elif edit.kind is not None and edit.kind != joint.kind and "upper" not in changes:
        changed = replace(changed, lower=0.0, upper=_usual_range(link, changed))
    elif changed.lower is None or changed.upper is None:
        upper = _usual_range(link, changed)
        changed = replace(
            changed,
            lower=0.0 if changed.lower is None else changed.lower,
            upper=upper if changed.upper is None else changed.upper,
        )
    if changed.kind == "fixed" or changed.kind != joint.kind:
        changed = replace(changed, mimic=None, damping=None, friction=None)
    _check_range(edit.part, changed)
    return model.with_link(replace(link, joint=changed))


def _usual_range(link: StudioLink, joint: StudioJoint) -> float:
    """Return a quarter turn [rad], or 0.8 of the part's extent along a slide [m]."""
    if joint.kind != "prismatic":
        return math.pi / 2.0
    extent = np.ptp(link.bounds_o, axis=0)
    return max(0.8 * float(np.abs(np.asarray(joint.axis_o)) @ extent), 0.01)


def _check_range(part: str, joint: StudioJoint) -> None:
    if joint.lower is None or joint.upper is None:
        return
    if joint.upper - joint.lower < MIN_TRAVEL:
        raise UsageError(
            f"{part}: limits {joint.lower:g} to {joint.upper:g}; the upper one must be larger"
        )
    most = MAX_M if joint.kind == "prismatic" else MAX_RAD
    if max(-joint.lower, joint.upper) > most:
        raise UsageError(f"{part}: limits beyond {most:g} are not accepted")


def _set_closed(model: StudioModel, edit: SetClosed) -> StudioModel:
    joint = _moving(model, edit.part)
    T = joint.T_o(edit.q)
    moved = set(model.below(edit.part))
    lower, upper = joint.lower, joint.upper
    if lower is not None and upper is not None:
        lower, upper = lower - edit.q, upper - edit.q
        # The longer side is the range of opening.
        lower, upper = (0.0, upper) if upper >= -lower else (lower, 0.0)
    own = replace(joint, lower=lower, upper=upper)
    _check_range(edit.part, own)
    links = []
    for link in model.links:
        if link.name not in moved:
            links.append(link)
            continue
        joint_moved = own if link.name == edit.part else _moved_joint(link.joint, T)
        links.append(
            replace(
                link,
                visuals=tuple(piece.moved(T) for piece in link.visuals),
                collisions=tuple(piece.moved(T) for piece in link.collisions),
                joint=joint_moved,
                inertial=None if link.inertial is None else moved_mass(link.inertial, T),
            )
        )
    return replace(model, links=tuple(links))


def _moved_joint(joint: StudioJoint | None, T: Array) -> StudioJoint | None:
    if joint is None:
        return None
    return replace(
        joint,
        axis_o=vec3(T[:3, :3] @ np.asarray(joint.axis_o)),
        pivot_o=vec3(T[:3, :3] @ np.asarray(joint.pivot_o) + T[:3, 3]),
    )


def _set_open(model: StudioModel, edit: SetOpen) -> StudioModel:
    joint = _moving(model, edit.part)
    if abs(edit.q) < MIN_TRAVEL:
        raise UsageError(f"{edit.part} is closed; move it to its open position first")
    if joint.kind == "continuous":
        raise UsageError(f"{edit.part} turns without limits; choose the type revolute first")
    lower, upper = (0.0, edit.q) if edit.q > 0.0 else (edit.q, 0.0)
    own = replace(joint, lower=lower, upper=upper)
    _check_range(edit.part, own)
    return model.with_link(replace(model.link(edit.part), joint=own))


def _moving(model: StudioModel, part: str) -> StudioJoint:
    joint = model.joint(part)
    if joint.kind == "fixed":
        raise UsageError(f"{part} is fixed; choose a joint type first")
    return joint


def _set_size(model: StudioModel, edit: SetSize) -> StudioModel:
    bounds = model.bounds_o if edit.part is None else model.link(edit.part).bounds_o
    extent = float(np.ptp(bounds, axis=0)[edit.axis])
    if extent < 1e-9 or not 1e-3 <= edit.size_m <= MAX_M:
        raise UsageError(f"size {edit.size_m:g} m; 0.001 to {MAX_M:g} is accepted")
    factor = edit.size_m / extent

    def scaled(joint: StudioJoint | None) -> StudioJoint | None:
        if joint is None:
            return None
        of = factor if joint.kind == "prismatic" else 1.0
        return replace(
            joint,
            pivot_o=vec3(factor * np.asarray(joint.pivot_o)),
            lower=None if joint.lower is None else of * joint.lower,
            upper=None if joint.upper is None else of * joint.upper,
        )

    links = tuple(
        replace(
            link,
            visuals=tuple(piece.scaled(factor) for piece in link.visuals),
            collisions=tuple(piece.scaled(factor) for piece in link.collisions),
            joint=scaled(link.joint),
            inertial=None if link.inertial is None else scaled_mass(link.inertial, factor),
        )
        for link in model.links
    )
    return replace(model, links=links)


def _merge(model: StudioModel, edit: MergeParts) -> StudioModel:
    part, into = model.link(edit.part), model.link(edit.into)
    model.joint(edit.part)
    if edit.into in model.below(edit.part):
        raise UsageError(f"{edit.into} moves with {edit.part}; merge {edit.into} into it instead")
    # Without collision shapes a part collides as it is seen; with them, both parts need some.
    both = part.collisions and into.collisions
    collisions = (*into.collisions, *part.collisions) if both else ()
    masses = [link.inertial for link in (into, part) if link.inertial is not None]
    merged = replace(
        into,
        visuals=(*into.visible, *part.visible),
        collisions=collisions,
        inertial=combined(masses) if len(masses) == 2 else None,
    )
    removed = model.joint(edit.part).name
    links = []
    for link in model.links:
        if link.name == edit.part:
            continue
        link = merged if link.name == edit.into else link
        joint = link.joint
        if joint is not None and joint.parent == edit.part:
            joint = replace(joint, parent=edit.into)
        if joint is not None and joint.mimic is not None and joint.mimic[0] == removed:
            joint = replace(joint, mimic=None)
        links.append(replace(link, joint=joint))
    return replace(model, links=ordered(links))


def _split(model: StudioModel, edit: SplitPart) -> StudioModel:
    part = model.link(edit.part)
    if any(edit.name == link.name for link in model.links):
        raise UsageError(f"part {quote(edit.name)} exists; choose another name")
    masks = _masks(part, edit.faces)
    count, total = sum(int(m.sum()) for m in masks), sum(len(m) for m in masks)
    if not 0 < count < total:
        raise UsageError(
            f"{count} of {total} faces of {edit.part} are selected; select some, but not all"
        )
    pairs = list(zip(part.visible, masks, strict=True))
    chosen = tuple(_faces_of(p, np.flatnonzero(m)) for p, m in pairs if m.any())
    rest = tuple(_faces_of(p, np.flatnonzero(~m)) for p, m in pairs if not m.all())
    sides = _sides(part.collisions, chosen, rest) if part.visuals else None
    own: tuple[Piece, ...] = ()
    kept: tuple[Piece, ...] = ()
    if sides is not None:
        own = tuple(p for p, side in zip(part.collisions, sides, strict=True) if side)
        kept = tuple(p for p, side in zip(part.collisions, sides, strict=True) if not side)
    if not own or not kept:
        own = kept = ()
    joint = StudioJoint(
        name=f"{edit.name}_joint",
        kind="fixed",
        parent=edit.part,
        pivot_o=vec3(np.mean([p.mesh.bounds.mean(axis=0) for p in chosen], axis=0)),
    )
    shares = None if part.inertial is None else divided_mass(part.inertial, (chosen, rest))
    mass, mass_left = shares or (None, None)
    new = StudioLink(name=edit.name, visuals=chosen, collisions=own, joint=joint, inertial=mass)
    changed = model.with_link(replace(part, visuals=rest, collisions=kept, inertial=mass_left))
    return replace(changed, links=ordered((*changed.links, new)))


def _masks(part: StudioLink, faces: tuple[tuple[int, ...], ...]) -> list[Any]:
    if len(faces) != len(part.visible):
        raise UsageError(
            f"faces of {len(faces)} pieces; {part.name} has {len(part.visible)} pieces"
        )
    masks = []
    for piece, chosen in zip(part.visible, faces, strict=True):
        mask = np.zeros(len(piece.mesh.faces), dtype=bool)
        index = np.asarray(chosen, dtype=np.int64)
        if len(index) and index.max() >= len(mask):
            raise UsageError(f"face {int(index.max())}; a piece of {part.name} has {len(mask)}")
        mask[index] = True
        masks.append(mask)
    return masks


def _faces_of(piece: Piece, index: Ints) -> Piece:
    if len(index) == len(piece.mesh.faces):
        return piece
    faces = np.asarray(piece.mesh.faces)[index]
    used, inverse = np.unique(faces, return_inverse=True)
    mesh = trimesh.Trimesh(
        np.asarray(piece.mesh.vertices)[used], inverse.reshape(-1, 3), process=False
    )
    return replace(piece, mesh=mesh, primitive=None)


def _sides(
    collisions: tuple[Piece, ...], chosen: tuple[Piece, ...], rest: tuple[Piece, ...]
) -> list[bool] | None:
    """Return for each collision shape whether it belongs to the selection; None if unclear."""
    if not collisions:
        return None
    points, labels = [], []
    for label, pieces in ((True, chosen), (False, rest)):
        triangles = np.concatenate([np.asarray(piece.mesh.triangles) for piece in pieces])
        found = sample(triangles, SPLIT_SAMPLES)[0]
        points.append(found)
        labels.append(np.full(len(found), label))
    tree, label_of = KDTree(np.concatenate(points)), np.concatenate(labels)
    sides = []
    for piece in collisions:
        near = tree.query(sample(np.asarray(piece.mesh.triangles), 200)[0])[1]
        share = float(label_of[near].mean())
        if SHARE < share < 1.0 - SHARE:
            return None
        sides.append(share > 0.5)
    return sides
