"""Hinges: the edge of a part, beside another part, about which it rotates.

Candidates are lines along a few directions through the corners and short sides of the part's
projection, and through its contacts. Each has a penalty for its distance from the parent, for
collisions of the part on its travel, for a short lever arm of the handle, and for an unusual side;
the smallest sum wins.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from articulate.reconstruct.actors.geometric.surface import perpendicular_axes
from articulate.reconstruct.actors.semantic.ontology import Role, words_of
from articulate.reconstruct.actors.semantic.part_relations import LabelledScene, PartShape
from articulate.transforms import Array, axis_angle_to_matrix, normalised, pose

GRIPS = frozenset({"handle", "knob", "pull", "grip", "lock", "latch", "lever", "wheel"})
"""Names of handles."""
UP = np.array([0.0, 0.0, 1.0])
MOTION_CANDIDATES = 8
"""Candidates whose travel is checked for collisions."""
LINE_SAMPLES = 9
"""Samples on a line."""
MAX_DISTANCE = 0.12
"""Larger distances from the neighbour count as this, as a share of the object's diagonal."""
SWINGS_RAD = (0.15, 0.35, 0.7)
OPENING_DIRECTION = np.array([0.5, 0.0, 0.5])
"""Preferred direction of opening: to the front and upwards."""
EQUAL_SHARE = 0.02
"""Collision shares that differ by less are equal."""
INSET = 0.010
"""Distance of a hinge from the part's corner, as a share of the object's diagonal."""
UPRIGHT_COMPONENT = 0.8
"""Axes whose vertical component is above this are vertical; below 1 - this, horizontal."""


@dataclass(frozen=True, eq=False)
class AxisCandidate:
    """A candidate axis of a hinge or slide."""

    axis: Array
    pivot: Array
    penalty: float
    """Penalty; the smallest is the most likely."""
    sign: float = 1.0
    """Direction of free rotation about ``axis``."""
    source: str = ""
    blocked: float = 0.0
    """Share of the part that collides on its travel, where it was computed."""


@dataclass(frozen=True)
class HingePrior:
    """Usual hinge of parts of a role."""

    upright: float = 0.0
    """Penalty of a vertical axis."""
    level: float = 0.0
    """Penalty of a horizontal axis."""
    across: float = 0.0
    """Further penalty of a horizontal axis along the front direction."""
    towards: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Usual side of the hinge; its length is the weight."""
    near: float = 6.0
    """Weight of the distance from the parent."""
    free: float = 1.0
    """Weight of collisions."""
    handle: float = 0.5
    """Weight of the handle's lever arm."""
    shape: float = 0.0
    """Weight of the width across the axis: panels rotate about their long side."""
    outer: float = 0.0
    """Weight of the object's outer side."""


HINGE_PRIORS: Mapping[Role, HingePrior] = {
    "door": HingePrior(level=0.20, across=0.3, towards=(-0.10, 0.0, -0.05), shape=0.35, outer=0.25),
    "pane": HingePrior(level=0.30, across=0.3, towards=(-0.10, -0.04, -0.05)),
    "flap": HingePrior(upright=0.6, across=0.5, towards=(-0.10, 0.0, -0.5)),
    "lid": HingePrior(upright=0.6, across=0.12, towards=(-0.30, 0.0, -0.15)),
    "screen": HingePrior(upright=0.8, across=0.2, towards=(-0.15, 0.0, -0.10), near=10.0),
    "clip": HingePrior(upright=0.6, across=0.4, towards=(-0.20, 0.0, -0.20), near=4.0),
    "temple": HingePrior(level=0.6, towards=(0.0, 0.0, 0.0), near=10.0),
}
DOOR_SIDES = {"microwave": -0.1, "washing": -0.1, "safe": 0.1, "refrigerator": 0.05, "fridge": 0.05}
"""Usual hinge side of the doors of some objects: right, seen from the front, is positive."""
UPRIGHT_DOORS = frozenset({"microwave", "safe", "refrigerator", "fridge", "door", "washing"})
"""Objects whose doors have a vertical axis, however wide they are."""
DEFAULT = HingePrior(level=0.1, across=0.2)


def find_hinge(shape: PartShape, scene: LabelledScene, role: Role) -> AxisCandidate:
    """Return the most likely hinge of a part."""
    return min(hinge_candidates(shape, scene, role), key=lambda line: line.penalty)


def hinge_candidates(shape: PartShape, scene: LabelledScene, role: Role) -> list[AxisCandidate]:
    """Return all candidates with their penalties."""
    prior = _prior_for_object(HINGE_PRIORS.get(role, DEFAULT), role, scene)
    parent = scene.shapes[scene.parent_names[shape.name]]
    grip = find_grip(shape, scene)
    found = []
    for axis in directions(shape):
        for source, spot in _spots(shape, parent, scene, axis):
            line = AxisCandidate(axis, spot, 0.0, source=source)
            found.append(_with_shape_penalty(line, shape, parent, scene, prior, grip))
    # Collision checks take longest: only likely candidates are checked.
    likely = sorted(found, key=lambda line: line.penalty)[:MOTION_CANDIDATES]
    others = scene.neighbours(shape)
    return [_with_motion_penalty(line, shape, others, scene, prior) for line in likely]


def _prior_for_object(prior: HingePrior, role: Role, scene: LabelledScene) -> HingePrior:
    if role != "door":
        return prior
    if scene.object_words & UPRIGHT_DOORS:
        prior = replace(prior, level=0.4, shape=0.0)
    side = sum(weight for thing, weight in DOOR_SIDES.items() if thing in scene.object_words)
    return replace(prior, towards=(prior.towards[0], side, prior.towards[2]))


def directions(shape: PartShape) -> Iterator[Array]:
    """Yield hinge directions (3,): of the frame, and of the part's own box where these differ."""
    inputs: list[Array] = []
    for axis in (*np.eye(3), *(axis for _, axis in shape.axes)):
        if all(abs(float(axis @ other)) < np.cos(np.radians(12.0)) for other in inputs):
            inputs.append(axis)
            yield axis


def _spots(
    shape: PartShape, parent: PartShape, scene: LabelledScene, axis: Array
) -> Iterator[tuple[str, Array]]:
    """Yield points through which a line along ``axis`` may pass."""
    across = perpendicular_axes(axis)
    flat = shape.points @ across.T
    along = axis * float(np.mean(shape.points @ axis))
    inset = INSET * scene.diagonal
    (cx, cy), (w, h), angle = cv2.minAreaRect(flat.astype(np.float32))
    turn = np.radians(angle)
    u, v = np.array([np.cos(turn), np.sin(turn)]), np.array([-np.sin(turn), np.cos(turn)])
    if h > w:
        u, v, w, h = v, u, h, w
    middle = np.array([cx, cy])
    for su in (-1.0, 1.0):
        for sv in (-1.0, 0.0, 1.0):
            end = max(0.5 * w - inset, 0.0)
            side = max(0.5 * h - inset, 0.0)
            spot = middle + su * end * u + sv * side * v
            yield f"edge {su:+.0f}{sv:+.0f}", across.T @ spot + along
    touching = scene.contact(shape, parent)
    if len(touching) >= 5:
        yield "contact", across.T @ np.median(touching @ across.T, axis=0) + along


def _with_shape_penalty(
    line: AxisCandidate,
    shape: PartShape,
    parent: PartShape,
    scene: LabelledScene,
    prior: HingePrior,
    grip: PartGrip | None,
) -> AxisCandidate:
    span = shape.points @ line.axis
    low, high = np.quantile(span, [0.05, 0.95])
    places = line.pivot + np.outer(
        np.linspace(low, high, LINE_SAMPLES) - float(line.pivot @ line.axis), line.axis
    )
    from_parent = np.minimum(parent.distance(places) / scene.diagonal, MAX_DISTANCE)
    from_self = np.minimum(shape.distance(places) / scene.diagonal, MAX_DISTANCE)
    penalty = prior.near * float(0.7 * from_parent.mean() + 0.3 * from_self.mean())
    steep = abs(float(line.axis[2]))
    penalty += prior.upright * steep + prior.level * (1.0 - steep)
    penalty += prior.across * abs(float(line.axis[0]))
    half = 0.5 * float(np.linalg.norm(shape.size)) + 1e-9
    side = (line.pivot - shape.centre) - ((line.pivot - shape.centre) @ line.axis) * line.axis
    penalty -= float(np.asarray(prior.towards) @ side) / half
    out = shape.centre - scene.middle
    out = out - (out @ line.axis) * line.axis
    penalty -= prior.outer * float(np.clip(out[:2] @ side[:2] / half**2, -0.3, 0.3))
    lever = _lever(shape.points, line)
    wide = float(lever.max()) / (float(high - low) + 1e-9)
    penalty += prior.shape * float(np.clip(np.log2(wide), -1.0, 1.0))
    if grip is not None:
        ratio = float(_lever(grip.middle[None], line)[0]) / (float(lever.max()) + 1e-9)
        penalty -= prior.handle * min(ratio, 1.0)
        if grip.along is not None:
            penalty -= 0.3 * prior.handle * abs(float(grip.along @ line.axis))
    penalty += 0.4 * (1.0 - min(1.0, float(np.quantile(lever, 0.9)) / half))
    return replace(line, penalty=penalty)


def _with_motion_penalty(
    line: AxisCandidate,
    shape: PartShape,
    others: Sequence[PartShape],
    scene: LabelledScene,
    prior: HingePrior,
) -> AxisCandidate:
    sign, blocked = _free_direction(line, shape, others, scene)
    return replace(line, penalty=line.penalty + prior.free * blocked, sign=sign)


def _lever(points: Array, line: AxisCandidate) -> Array:
    """Return the distance of points (N, 3) from a line (N,) [m]."""
    return np.asarray(np.linalg.norm(np.cross(points - line.pivot, line.axis), axis=-1))


def _free_direction(
    line: AxisCandidate, shape: PartShape, others: Sequence[PartShape], scene: LabelledScene
) -> tuple[float, float]:
    """Return the sign of the direction with fewer collisions, and the colliding share."""
    q = np.array(SWINGS_RAD)
    ahead = scene.blocked_share(shape, others, swing(line.axis, line.pivot, q))
    back = scene.blocked_share(shape, others, swing(line.axis, line.pivot, -q))
    motion = np.cross(line.axis, shape.centre - line.pivot)
    outwards = float(motion @ (normalised(shape.centre - scene.middle) + OPENING_DIRECTION))
    sign = 1.0 if ahead - back < (EQUAL_SHARE if outwards > 0.0 else -EQUAL_SHARE) else -1.0
    return sign, min(ahead, back)


def swing(axis: Array, pivot: Array, q: Array) -> Array:
    """Return poses (K, 4, 4) of rotations by ``q`` (K,) [rad] about a line."""
    rot = axis_angle_to_matrix(np.broadcast_to(axis, (len(q), 3)), q)
    return pose(pivot - np.einsum("kij,j->ki", rot, pivot), rot)


@dataclass(frozen=True, eq=False)
class PartGrip:
    """Grasp position of a part."""

    middle: Array
    along: Array | None
    """Direction of a bar; None for other handles."""


def find_grip(shape: PartShape, scene: LabelledScene) -> PartGrip | None:
    """Return the handle or knob of a part, or the protrusion of a panel, if any."""
    held = [r for r in scene.attached_parts(shape) if GRIPS & {*words_of(r.label)}]
    points = np.concatenate([r.points for r in held]) if held else _bulge(shape, scene)
    if points is None:
        return None
    size = np.ptp(points, axis=0)
    long = int(np.argmax(size))
    bar = len(held) <= 1 and size[long] > 2.0 * np.sort(size)[1]
    middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
    return PartGrip(middle, np.eye(3)[long] if bar else None)


def _bulge(shape: PartShape, scene: LabelledScene) -> Array | None:
    """Return the points that protrude from the flat outer face of a panel, if any."""
    thin = int(np.argmin(shape.size))
    side = np.sign((shape.centre - scene.body.centre)[thin]) or 1.0
    height = side * shape.dense[0][:, thin]
    face = np.quantile(height, 0.80)
    out = height > face + 0.012 * scene.diagonal
    if not 10 <= int(out.sum()) <= 0.2 * len(height):
        return None
    return np.asarray(shape.dense[0][out])


def find_bail_axis(shape: PartShape, scene: LabelledScene) -> AxisCandidate:
    """Return the line through the two ends of a bail handle."""
    parent = scene.shapes[scene.parent_names[shape.name]]
    level = int(np.argmax(shape.size[:2]))
    axis = np.eye(3)[level]
    span = shape.points[:, level]
    low, high = span.min(), span.max()
    ends = []
    for at in (low, high):
        near = shape.points[np.abs(span - at) < 0.08 * (high - low)]
        distance = parent.distance(near)
        held = near[distance <= np.quantile(distance, 0.5) + 1e-9]
        ends.append(held.mean(axis=0))
    travel = normalised(ends[1] - ends[0])
    axis = travel if abs(float(travel[level])) > np.cos(0.3) else axis
    line = AxisCandidate(axis, 0.5 * (ends[0] + ends[1]), 0.0, source="two ends")
    sign, _ = _free_direction(line, shape, scene.neighbours(shape), scene)
    return AxisCandidate(line.axis, line.pivot, 0.0, sign, line.source)


def find_fold_axis(shape: PartShape, scene: LabelledScene) -> AxisCandidate | None:
    """Return the pivot of a blade that folds in its own plane; None if it is folded in."""
    parent = scene.shapes[scene.parent_names[shape.name]]
    both = np.concatenate([shape.points, parent.points])
    thin = int(np.argmin(np.ptp(both, axis=0)))
    long = int(np.argmax(np.ptp(both, axis=0)))
    low = max(shape.bounds[0, long], parent.bounds[0, long])
    high = min(shape.bounds[1, long], parent.bounds[1, long])
    if high - low > 0.5 * shape.size[long]:
        return None
    mine = shape.points[(shape.points[:, long] >= low) & (shape.points[:, long] <= high)]
    pivot = shape.centre.copy() if len(mine) < 5 else 0.5 * (mine.min(axis=0) + mine.max(axis=0))
    return AxisCandidate(np.eye(3)[thin], pivot, 0.0, 1.0, "overlap")
