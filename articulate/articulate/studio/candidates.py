"""Candidate joints of a part, and axes at clicked geometry, from boxes and sharp edges."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from articulate.errors import UsageError
from articulate.studio.edits import SetJoint
from articulate.studio.model import StudioLink, StudioModel, Vec3, vec3
from articulate.transforms import Array, normalised

ALIGNED = math.cos(math.radians(15.0))
"""Directions within 15 degrees of an axis of the object become this axis."""
SHARP_RAD = math.radians(30.0)
"""Mesh edges with a larger angle between their faces are sharp."""
MAX_EDGES = 20_000
"""Sharp edges of a part that are considered."""
BOX_PREFERENCE = 0.03
"""Edges of the box win by this fraction of the part's diagonal over edges of the mesh."""
QUARTER = math.pi / 2.0
SnapMode = Literal["edge", "face", "axle"]
NAMES = ("x", "y", "z")


@dataclass(frozen=True, kw_only=True)
class Candidate:
    """A joint that a part of this shape may have."""

    label: str
    """Short description, e.g. ``hinge left``."""
    edit: SetJoint


@dataclass(frozen=True, kw_only=True)
class Snap:
    """Axis at a clicked point."""

    axis_o: Vec3
    """Unit direction in the object frame."""
    pivot_o: Vec3
    """A point on the axis [m]."""


def front_direction(model: StudioModel) -> Array:
    """Return the horizontal unit direction (3,) of the object's front.

    It is the direction in which moving parts are displaced from the middle of the object; -x if
    there are none.
    """
    centre = model.bounds_o.mean(axis=0)
    total = np.zeros(2)
    for link in model.links:
        if link.joint is None or link.joint.kind == "fixed" or not link.visible:
            continue
        box = link.bounds_o
        size = np.ptp(box, axis=0)[:2]
        offset = (box.mean(axis=0) - centre)[:2]
        thin = int(np.argmin(size))
        total[thin] += offset[thin]
    if float(np.abs(total).max()) < 1e-6:
        return np.array([-1.0, 0.0, 0.0])
    axis = int(np.argmax(np.abs(total)))
    front = np.zeros(3)
    front[axis] = math.copysign(1.0, total[axis])
    return front


def candidates(model: StudioModel, part: str) -> tuple[Candidate, ...]:
    """Return candidate joints of a part: slides, hinges at the edges of its front, an axle.

    Limits are 0 and a usual range in the direction in which the part opens: away from the object.

    Raises:
        UsageError: There is no such part, or it is the root.
    """
    link = model.link(part)
    model.joint(part)
    front = front_direction(model)
    up = np.array([0.0, 0.0, 1.0])
    right = np.cross(up, front)  # of the object, seen from its front: the viewer's right
    low, high = _main_bounds(link)
    centre, half = 0.5 * (low + high), 0.5 * (high - low)
    found = []
    for label, direction in (("slide out", front), ("slide up", up), ("slide right", right)):
        extent = 2.0 * float(np.abs(direction) @ half)
        depth = max(extent, _depth(model, direction)) if label == "slide out" else extent
        found.append(_slide(label, part, direction, 0.8 * depth))
    face = centre + front * float(np.abs(front) @ half)
    back = centre - front * float(np.abs(front) @ half)
    for label, side, axis in (
        ("hinge left", -right, -up),
        ("hinge right", right, up),
        ("hinge top", up, -right),
        ("hinge bottom", -up, right),
    ):
        edge = side * float(np.abs(side) @ half)
        found.append(_hinge(label, part, axis, face + edge, QUARTER))
    top = centre + up * half[2]
    rear = top - front * float(np.abs(front) @ half)
    found.append(_hinge("lid hinged at the back", part, -right, rear, QUARTER))
    found.append(_hinge("hinge left, behind", part, -up, back - right * _along(right, half),
                        QUARTER))  # fmt: skip
    found.append(_hinge("hinge right, behind", part, up, back + right * _along(right, half),
                        QUARTER))  # fmt: skip
    for label, axis in (("axle to the front", front), ("axle upright", up), ("axle across", right)):
        edit = SetJoint(part=part, kind="continuous", axis_o=vec3(axis), pivot_o=vec3(centre))
        found.append(Candidate(label=label, edit=edit))
    return tuple(found)


def _main_bounds(link: StudioLink) -> Array:
    """Return the box (2, 3) of the mesh of a part with the largest surface [m].

    The panel of a door decides where its hinges may be, and not its handle.
    """
    if not link.visible:
        return link.bounds_o
    main = max(link.visible, key=lambda piece: float(piece.mesh.area))
    return np.asarray(main.mesh.bounds)


def _along(direction: Array, half: Array) -> float:
    return float(np.abs(direction) @ half)


def _depth(model: StudioModel, direction: Array) -> float:
    """Return half the extent of the object along a direction [m]: drawers have long boxes."""
    return 0.5 * float(np.abs(direction) @ np.ptp(model.bounds_o, axis=0))


def _slide(label: str, part: str, direction: Array, travel_m: float) -> Candidate:
    upper = max(travel_m, 0.01)
    edit = SetJoint(
        part=part, kind="prismatic", axis_o=vec3(direction), lower=0.0, upper=round(upper, 4)
    )
    return Candidate(label=label, edit=edit)


def _hinge(label: str, part: str, axis: Array, pivot: Array, upper: float) -> Candidate:
    edit = SetJoint(
        part=part,
        kind="revolute",
        axis_o=vec3(axis),
        pivot_o=vec3(pivot),
        lower=0.0,
        upper=upper,
    )
    return Candidate(label=label, edit=edit)


def snap(link: StudioLink, point_o: Vec3, mode: SnapMode, normal_o: Vec3 | None = None) -> Snap:
    """Return the axis that a click on a part selects.

    Args:
        link: The part.
        point_o: Clicked point in the object frame, every joint at 0 [m].
        mode: ``edge``: the nearest edge of the part's box or sharp edge of its mesh; ``face``: the
            normal of the clicked face; ``axle``: that normal through the centre of the part.
        normal_o: Normal of the clicked face, for ``face`` and ``axle``.

    Raises:
        UsageError: The part has no geometry, or a normal is missing.
    """
    if not link.visible:
        raise UsageError(f"{link.name} has no geometry")
    point = np.asarray(point_o)
    if mode == "edge":
        return _snap_edge(link, point)
    if normal_o is None or float(np.linalg.norm(normal_o)) < 1e-6:
        raise UsageError("a click on a face needs its normal")
    normal = _aligned(normalised(normal_o))
    pivot = link.bounds_o.mean(axis=0) if mode == "axle" else point
    return Snap(axis_o=vec3(normal), pivot_o=vec3(pivot))


def _snap_edge(link: StudioLink, point: Array) -> Snap:
    box = _box_edges(link.bounds_o)
    sharp = _sharp_edges(link)
    diagonal = float(np.linalg.norm(np.ptp(link.bounds_o, axis=0)))
    edges = np.concatenate([box, sharp])
    away = _distances(point, edges)
    away[len(box) :] += BOX_PREFERENCE * diagonal
    start, end = edges[int(np.argmin(away))]
    axis = _aligned(normalised(end - start))
    return Snap(axis_o=vec3(axis), pivot_o=vec3(0.5 * (start + end)))


def _aligned(direction: Array) -> Array:
    axis = int(np.argmax(np.abs(direction)))
    if abs(direction[axis]) < ALIGNED:
        return direction
    out = np.zeros(3)
    out[axis] = math.copysign(1.0, direction[axis])
    return out


def _box_edges(bounds: Array) -> Array:
    """Return the edges (12, 2, 3) of a box."""
    low, high = bounds
    edges = []
    for axis in range(3):
        a, b = (k for k in range(3) if k != axis)
        for u in (low[a], high[a]):
            for v in (low[b], high[b]):
                start, end = np.zeros(3), np.zeros(3)
                start[[a, b]], end[[a, b]] = (u, v), (u, v)
                start[axis], end[axis] = low[axis], high[axis]
                edges.append((start, end))
    return np.asarray(edges)


def _sharp_edges(link: StudioLink) -> Array:
    """Return sharp edges (N, 2, 3) of a part's meshes, the longest first."""
    found = [np.zeros((0, 2, 3))]
    for piece in link.visible:
        mesh = piece.mesh.copy()
        mesh.merge_vertices(merge_tex=True, merge_norm=True)
        if not len(mesh.face_adjacency_angles):
            continue
        sharp = mesh.face_adjacency_angles > SHARP_RAD
        found.append(np.asarray(mesh.vertices)[mesh.face_adjacency_edges[sharp]])
    edges = np.concatenate(found)
    length = np.linalg.norm(edges[:, 1] - edges[:, 0], axis=1)
    edges = edges[length > 1e-6]
    order = np.argsort(-length[length > 1e-6], kind="stable")[:MAX_EDGES]
    return np.asarray(edges[order])


def _distances(point: Array, edges: Array) -> Array:
    """Return the distance of a point from each segment (N,) [m]."""
    start, along = edges[:, 0], edges[:, 1] - edges[:, 0]
    length2 = np.maximum(np.einsum("ni,ni->n", along, along), 1e-18)
    share = np.clip(np.einsum("ni,ni->n", point - start, along) / length2, 0.0, 1.0)
    return np.asarray(np.linalg.norm(start + share[:, None] * along - point, axis=1))
