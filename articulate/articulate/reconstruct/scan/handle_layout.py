"""Doors and drawers of a front without seams, as in a scan: divided by the handles on it.

A scanner does not resolve the gaps between fronts, but handles stand out of them. Between rows and
columns of handles the front is divided such that bars are in the middle of drawers and upright bars
near the edge of doors.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from articulate.reconstruct.actors.protocol import JointKind
from articulate.reconstruct.scan.front_view import FrontView
from articulate.reconstruct.scan.fronts import Front, moved_front
from articulate.reconstruct.scan.panels import PROUD, Handle, Panel, handles_of
from articulate.reconstruct.scan.part_proposal import PartProposal
from articulate.reconstruct.scan.scan_mesh import ScanMesh
from articulate.reconstruct.scan.segmentation import Segmentation
from articulate.transforms import Array, Ints

EVIDENCE, DIAL_EVIDENCE = "a handle on a front without seams", "a dial beside the fronts"
LEVEL = 0.008
"""Largest distance from the plane of the front, as a share of the diagonal of the object."""
THICK = 0.04
"""Largest thickness of a door, as a share of the diagonal: a gap may show its inner side."""
BINS = 200
"""Steps of the depth in which the plane of the front is searched."""
NEAREST = 0.35
"""Share of the depth of the object, from the front, in which it is."""
LEAST_FRONT = 0.12
"""Least area of the front, as a share of the rectangle around the object."""
JOIN, JOIN_BAR = 0.012, 0.05
"""Largest gap in a handle, and along a bar, as a share of the diagonal of the object."""
SMALL = 0.02
"""Handles that are smaller than this share of the diagonal of the object have no direction."""
LARGEST = 0.75
"""Largest side of a handle, as a share of that of the front."""
BAR = 1.7
"""Ratio of the sides of a handle from which it is a bar."""
MOST = 24
"""Most handles of a front; more are ornaments."""
FLAP = 0.6
"""Ratio of height and width from which a front with a bar at its upper or lower edge is a flap."""
CENTRED, AT_EDGE = 0.2, 0.3
"""Largest offset of a handle in the middle of its front, and least one of a handle at its edge, as
a share of it."""
BESIDE = 0.3
"""Offset from the middle from which an upright bar is at an edge, as a share of the width."""
TALL, HIGH = 1.2, 0.3
"""Ratio of height and width from which a front with a knob in the middle is a door, and the cost of
a drawer for each unit beyond it."""
DIALS, MIDDLE = 3, 0.3
"""Least number of dials in a row, and its least offset from the middle, as a share of the height:
other knobs do not form one row there."""
DIAL = 0.025
"""Knobs that are larger than this share of the diagonal, beside bars, are dials."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Grip:
    """A handle on the front."""

    handle: Handle
    direction: Literal["level", "upright", "round", "dial"]
    """Direction of a bar, ``round`` for a knob, ``dial`` for one that is on no door or drawer."""

    @property
    def rect(self) -> Array:
        """``(y0, z0, y1, z1)`` (4,) [m]."""
        return self.handle.rect


@dataclass(frozen=True, kw_only=True, eq=False)
class Leaf:
    """Rectangle of the front with one handle."""

    rect: Array
    """``(y0, z0, y1, z1)`` (4,) [m]."""
    grip: Grip
    stacked: bool
    """True if others are above or below it."""

    @property
    def offset(self) -> Array:
        """Offset of the handle from the middle in y and z, as shares of the sides (2,)."""
        size = self.rect[2:] - self.rect[:2]
        return np.asarray((self.grip.handle.centre - 0.5 * (self.rect[:2] + self.rect[2:])) / size)

    @property
    def cost(self) -> float:
        """Distance of the handle from where one is on a drawer or door, as a share of its width.

        Drawers are not much higher than wide.
        """
        beside = abs(float(self.offset[0]))
        wide, high = self.rect[2:] - self.rect[:2]
        drawer = beside + HIGH * max(float(high / wide) - TALL, 0.0)
        door = max(BESIDE - beside, 0.0)
        either = {"level": drawer, "upright": door, "round": min(drawer, door), "dial": 0.0}
        return either[self.grip.direction]


def parts_by_handles(parts: Segmentation) -> list[PartProposal]:
    """Propose the doors and drawers of a front that its handles divide; none without handles.

    Args:
        parts: The object; its front is +x.
    """
    found = _front(parts)
    if found is None:
        return []
    rect, front = found
    grips = _grips(parts, rect, front)
    if not 0 < len(grips) <= MOST:
        return []
    leaves = divided(rect, grips)
    fronts = [_proposal(parts, leaf, front) for leaf in leaves if leaf.grip.direction != "dial"]
    dials = [_dial(parts, grip, front) for grip in grips if grip.direction == "dial"]
    return [*fronts, *dials] if fronts else []


def divided(rect: Array, grips: Sequence[Grip], stacked: bool = False) -> list[Leaf]:
    """Divide a rectangle into one for each handle, by rows or columns of handles.

    Handles that neither rows nor columns separate belong to one part, whose handle is the largest.

    Args:
        rect: ``(y0, z0, y1, z1)`` (4,) [m].
        grips: Handles in it, at least one.
        stacked: True if other handles are above or below the rectangle.
    """
    best: list[Leaf] = []
    for axis in (1, 0):
        groups = _groups(grips, axis)
        if len(groups) < 2:
            continue
        edges = _boundaries(rect, groups, axis)
        leaves: list[Leaf] = []
        for group, low, high in zip(groups, edges[:-1], edges[1:], strict=True):
            own = rect.copy()
            own[[axis, axis + 2]] = low, high
            others = [grip for grip in grips if grip not in group and grip.direction != "dial"]
            leaves += divided(own, group, stacked or (axis == 1 and len(others) > 0))
        if not best or _mean_cost(leaves) < _mean_cost(best):
            best = leaves
    if best:
        return best
    largest = max(grips, key=lambda grip: float(np.prod(grip.handle.size)))
    return [Leaf(rect=rect, grip=largest, stacked=stacked)]


def _mean_cost(leaves: Sequence[Leaf]) -> float:
    return float(np.mean([leaf.cost for leaf in leaves]))


def _groups(grips: Sequence[Grip], axis: int) -> list[list[Grip]]:
    """Return the handles in groups that do not overlap along an axis (0: y, 1: z), in order."""
    groups: list[list[Grip]] = []
    end = -np.inf
    for grip in sorted(grips, key=lambda grip: float(grip.rect[axis])):
        if grip.rect[axis] < end:
            groups[-1].append(grip)
        else:
            groups.append([grip])
        end = max(end, float(grip.rect[axis + 2]))
    return groups


def _boundaries(rect: Array, groups: Sequence[Sequence[Grip]], axis: int) -> list[float]:
    """Return the edges of the regions of groups along an axis, from the low to the high end [m].

    Between equal groups the edge is in the middle. Otherwise a group of drawers, whose handles are
    in the middle, extends as far on both sides of them.
    """
    edges = [float(rect[axis])]
    end = float(rect[axis + 2])
    for k, (one, other) in enumerate(itertools.pairwise(groups)):
        low, high = _end(one, axis), _start(other, axis)
        middle = 0.5 * (_centre(one, axis) + _centre(other, axis))
        tries = [0.5 * (low + high)]
        if _kinds(one) == _kinds(other):
            tries = [middle, *tries]
        elif _is_centred(one, axis):
            tries = [2.0 * _centre(one, axis) - edges[-1], *tries]
        elif _is_centred(other, axis) and k == len(groups) - 2:
            tries = [2.0 * _centre(other, axis) - end, *tries]
        edges.append(next((at for at in tries if low <= at <= high), tries[-1]))
    return [*edges, end]


def _kinds(group: Sequence[Grip]) -> set[str]:
    return {grip.direction for grip in group}


def _is_centred(group: Sequence[Grip], axis: int) -> bool:
    """Return whether the handles are those of drawers, one beside or above the other."""
    aligned = len(group) == 1 or np.ptp([grip.handle.centre[axis] for grip in group]) < 1e-2
    return bool(aligned and _kinds(group) == {"level"})


def _start(group: Sequence[Grip], axis: int) -> float:
    return min(float(grip.rect[axis]) for grip in group)


def _end(group: Sequence[Grip], axis: int) -> float:
    return max(float(grip.rect[axis + 2]) for grip in group)


def _centre(group: Sequence[Grip], axis: int) -> float:
    return 0.5 * (_start(group, axis) + _end(group, axis))


def _front(parts: Segmentation) -> tuple[Array, float] | None:
    """Return the rectangle and the coordinate x of the front; None without a flat one."""
    mesh, view = parts.mesh, parts.view
    seen = view.face >= 0
    facing = seen & (mesh.normals[np.maximum(view.face, 0), 0] > 0.9)
    low, high = mesh.bounds[:, 0]
    counts, edges = np.histogram(view.depth[facing], BINS, (low, high))
    counts[: int((1.0 - NEAREST) * BINS)] = 0
    smooth = np.convolve(counts, np.ones(3), "same")
    if not smooth.any():
        return None
    k = int(smooth.argmax())
    tolerance = LEVEL * mesh.diagonal
    near = facing & (np.abs(view.depth - edges[k : k + 2].mean()) < 2.0 * tolerance)
    front = float(np.median(view.depth[near]))
    flat = facing & (np.abs(view.depth - front) < tolerance)
    rect = _rect(view, flat)
    share = float(flat.sum()) * view.pixel**2 / max(float(np.prod(mesh.size[1:])), 1e-12)
    return (rect, front) if share > LEAST_FRONT else None


def _rect(view: FrontView, flat: NDArray[np.bool_]) -> Array:
    """Return the rectangle around rows and columns of which a third is flat (4,) [m]."""
    rows, columns = flat.sum(axis=1), flat.sum(axis=0)
    mask = np.outer(rows > rows.max() / 3.0, columns > columns.max() / 3.0)
    return view.rect_of(mask, slice(0, flat.shape[0]), slice(0, flat.shape[1]))


def _grips(parts: Segmentation, rect: Array, front: float) -> list[Grip]:
    """Return the handles on the front: bars and dials, if there are bars, otherwise knobs."""
    mesh, view = parts.mesh, parts.view
    rows, columns = view.window(rect)
    side = 2 * round(0.5 * JOIN * mesh.diagonal / view.pixel) + 1
    depth = np.where(np.isfinite(view.depth), view.depth, front)[rows, columns]
    closed: Array = np.asarray(
        cv2.morphologyEx(depth, cv2.MORPH_CLOSE, np.ones((side, side))), dtype=np.float64
    )
    size = rect[2:] - rect[:2]
    found = [
        handle
        for handle in handles_of(mesh, view, rect, closed, front)
        if (handle.size < LARGEST * size).all() and not _is_border(handle, rect, 1.5 * view.pixel)
    ]
    grips = [_grip(handle, mesh.diagonal) for handle in found]
    for axis in (0, 1):
        grips = _joined(grips, axis, mesh.diagonal)
    bars = [grip for grip in grips if grip.direction != "round"]
    if not bars:
        return [] if _are_dials(grips, rect) else grips
    dials = [
        replace(grip, direction="dial")
        for grip in grips
        if grip.direction == "round" and grip.handle.size.min() > DIAL * mesh.diagonal
    ]
    return [*bars, *dials]


def _are_dials(knobs: Sequence[Grip], rect: Array) -> bool:
    """Return whether knobs are one row, at the top or bottom of the front."""
    if len(knobs) < DIALS or len(_groups(knobs, 1)) > 1:
        return False
    low, high = float(rect[1]), float(rect[3])
    return abs(_centre(knobs, 1) - 0.5 * (low + high)) > MIDDLE * (high - low)


def _is_border(handle: Handle, rect: Array, near: float) -> bool:
    """Return whether a protrusion is along the border of the front, such as a table top."""
    touches = np.asarray((np.abs(handle.rect - rect) < near).reshape(2, 2).any(axis=0))  # y, z
    wide, high = handle.size
    return bool((touches[1] and wide > high) or (touches[0] and high > wide))


def _grip(handle: Handle, diagonal: float) -> Grip:
    wide, high = handle.size
    if max(wide, high) < SMALL * diagonal or max(wide, high) < BAR * min(wide, high):
        return Grip(handle=handle, direction="round")
    return Grip(handle=handle, direction="level" if wide > high else "upright")


def _joined(grips: Sequence[Grip], axis: int, diagonal: float) -> list[Grip]:
    """Join the pieces of bars along an axis (0: y, 1: z).

    They are near each other, or between the ends of another bar in line with them.
    """
    along, across = ("level", 1) if axis == 0 else ("upright", 0)
    bars = [grip for grip in grips if grip.direction == along]
    out: list[Grip] = []
    for grip in sorted(grips, key=lambda grip: float(grip.rect[axis])):
        last = next((one for one in reversed(out) if _in_line(one, grip, across)), None)
        if last is not None:
            gap = float(grip.rect[axis] - last.rect[axis + 2])
            both = np.array([last.rect[axis], grip.rect[axis + 2]])
            alike = [np.abs(both - bar.rect[[axis, axis + 2]]).max() for bar in bars]
            near = gap < JOIN_BAR * diagonal and along in {last.direction, grip.direction}
            if near or min(alike, default=np.inf) < SMALL * diagonal:
                out = [one for one in out if one is not last]
                grip = _union(last, grip, diagonal)
        out.append(grip)
    return out


def _in_line(one: Grip, other: Grip, across: int) -> bool:
    """Return whether two handles overlap across an axis."""
    low = max(one.rect[across], other.rect[across])
    return bool(low < min(one.rect[across + 2], other.rect[across + 2]))


def _union(one: Grip, other: Grip, diagonal: float) -> Grip:
    low, high = np.minimum(one.rect, other.rect)[:2], np.maximum(one.rect, other.rect)[2:]
    height = max(one.handle.height, other.handle.height)
    return _grip(Handle(rect=np.concatenate([low, high]), height=height), diagonal)


def _within(mesh: ScanMesh, rect: Array, least_x: float) -> Ints:
    """Return the faces whose centres are in a rectangle of the front and before ``least_x``."""
    centres = mesh.triangles.mean(axis=1)
    inside = (centres[:, 1:] > rect[:2]).all(axis=1) & (centres[:, 1:] < rect[2:]).all(axis=1)
    return np.flatnonzero(inside & (centres[:, 0] > least_x))


def _dial(parts: Segmentation, grip: Grip, front: float) -> PartProposal:
    mesh = parts.mesh
    faces = _within(mesh, grip.rect, front + 0.5 * PROUD * mesh.diagonal)
    return PartProposal(
        kind="knob",
        faces=faces,
        joint="continuous",
        axis=np.array([1.0, 0.0, 0.0]),
        pivot=np.array([front, *grip.handle.centre]),
        upper=0.0,
        confidence=0.5,
        evidence=(DIAL_EVIDENCE,),
    )


def _proposal(parts: Segmentation, leaf: Leaf, front: float) -> PartProposal:
    mesh = parts.mesh
    panel = Panel(
        rect=leaf.rect,
        front=front,
        back=front - 0.02 * mesh.diagonal,
        own=_within(mesh, leaf.rect, front - THICK * mesh.diagonal),
        fill=1.0,
        thin=False,
        score=1.0,
        board=False,
        handles=(leaf.grip.handle,),
    )
    nothing = np.zeros(0, dtype=np.int64)
    found = Front(panel=panel, tray=nothing, handle=leaf.grip.handle, depth=0.0)
    joint, side = _motion(leaf)
    return moved_front(parts, found, joint, side, EVIDENCE)


def _motion(leaf: Leaf) -> tuple[JointKind, str]:
    """Return the type of the joint, and the edge of a hinge as seen from the front."""
    aside, above = leaf.offset
    size = leaf.rect[2:] - leaf.rect[:2]
    kind = leaf.grip.direction
    centred = abs(aside) < CENTRED
    if kind == "round" and centred and not leaf.stacked and size[1] > TALL * size[0]:
        centred = False
    if kind == "upright" or not centred:
        return "revolute", "left" if aside > 0.0 else "right"
    is_drawer = abs(above) < AT_EDGE or size[1] < FLAP * size[0]
    if abs(above) < CENTRED or (leaf.stacked and is_drawer):
        return "prismatic", ""
    return "revolute", "bottom" if above > 0.0 else "top"
