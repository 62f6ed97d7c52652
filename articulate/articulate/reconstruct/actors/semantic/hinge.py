"""Hinges: along which edge of a part, beside which other part, does it turn?

Candidates are lines along a few directions through the corners and short sides of the part as seen
along that direction, and through what touches. Each is asked: does the line lie on what the part
hangs on, does the part swing without running into its neighbours, is the handle far from it, and
is it where such parts mostly have their hinge? Every answer is a penalty; the least sum wins.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from articulate.reconstruct.actors.geometric.surface import perpendicular_axes
from articulate.reconstruct.actors.semantic.ontology import Role, words_of
from articulate.reconstruct.actors.semantic.part_relations import Named, Shape
from articulate.transforms import Array, axis_angle_to_matrix, normalised, pose

GRIPS = frozenset({"handle", "knob", "pull", "grip", "lock", "latch", "lever", "wheel"})
"""Words of what one takes a part by."""
UP = np.array([0.0, 0.0, 1.0])
MOST_SWUNG = 8
"""Candidates that are swung."""
ALONG = 9
"""Places on a line that are looked at."""
NEAR = 0.12
"""Distances from the neighbour beyond this share of the object count alike."""
SWINGS_RAD = (0.15, 0.35, 0.7)
OUT = np.array([0.5, 0.0, 0.5])
"""Parts open to the front and upwards rather than not."""
SAME_WAY = 0.02
"""Ways in which such a share of points more or less is in the way are equally free."""
INSET = 0.010
"""A hinge lies this far inside the part's corner, as a share of the object's diagonal."""
STEEP = 0.8
"""Axes whose upward part is above this are upright; below 1 - this, level."""


@dataclass(frozen=True, eq=False)
class Line:
    """A candidate."""

    axis: Array
    pivot: Array
    penalty: float
    """The less, the likelier."""
    sign: float = 1.0
    """Which way about ``axis`` the part is free."""
    source: str = ""
    blocked: float = 0.0
    """Share of the part that runs into something on its way, where that was asked."""


@dataclass(frozen=True)
class Taste:
    """Where parts of a role mostly have their hinge."""

    upright: float = 0.0
    """Penalty of an upright axis."""
    level: float = 0.0
    """Penalty of a level one."""
    across: float = 0.0
    """Further penalty of a level one along the direction to the front."""
    towards: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Side of the part on which the hinge mostly is; its length is the weight."""
    near: float = 6.0
    """Weight of the distance from what the part hangs on."""
    free: float = 1.0
    """Weight of what is in the way."""
    handle: float = 0.5
    """Weight of the handle's distance."""
    shape: float = 0.0
    """Weight of how wide the part is across the axis: panels turn about their long side."""
    outer: float = 0.0
    """Weight of being on the object's outer side."""


TASTES: Mapping[Role, Taste] = {
    "door": Taste(level=0.20, across=0.3, towards=(-0.10, 0.0, -0.05), shape=0.35, outer=0.25),
    "pane": Taste(level=0.30, across=0.3, towards=(-0.10, -0.04, -0.05)),
    "flap": Taste(upright=0.6, across=0.5, towards=(-0.10, 0.0, -0.5)),
    "lid": Taste(upright=0.6, across=0.12, towards=(-0.30, 0.0, -0.15)),
    "screen": Taste(upright=0.8, across=0.2, towards=(-0.15, 0.0, -0.10), near=10.0),
    "clip": Taste(upright=0.6, across=0.4, towards=(-0.20, 0.0, -0.20), near=4.0),
    "temple": Taste(level=0.6, towards=(0.0, 0.0, 0.0), near=10.0),
}
SIDES = {"microwave": -0.1, "washing": -0.1, "safe": 0.1, "refrigerator": 0.05, "fridge": 0.05}
"""On which side doors of some things mostly have their hinge: right, seen from the front, is +."""
UPRIGHT = frozenset({"microwave", "safe", "refrigerator", "fridge", "door", "washing"})
"""Things whose doors stand, however wide they are."""
DEFAULT = Taste(level=0.1, across=0.2)


def hinge_of(shape: Shape, scene: Named, role: Role) -> Line:
    """The likeliest hinge of a part."""
    return min(lines_of(shape, scene, role), key=lambda line: line.penalty)


def lines_of(shape: Shape, scene: Named, role: Role) -> list[Line]:
    """All candidates with their penalties."""
    taste = _for_thing(TASTES.get(role, DEFAULT), role, scene)
    parent = scene.shapes[scene.hangs[shape.name]]
    grip = grip_of(shape, scene)
    found = []
    for axis in directions(shape):
        for source, spot in _spots(shape, parent, scene, axis):
            line = Line(axis, spot, 0.0, source=source)
            found.append(_weighed(line, shape, parent, scene, taste, grip))
    # What is in the way takes longest to find out: only the likely ones are asked.
    likely = sorted(found, key=lambda line: line.penalty)[:MOST_SWUNG]
    others = scene.around(shape)
    return [_swung(line, shape, others, scene, taste) for line in likely]


def _for_thing(taste: Taste, role: Role, scene: Named) -> Taste:
    if role != "door":
        return taste
    if scene.things & UPRIGHT:
        taste = replace(taste, level=0.4, shape=0.0)
    side = sum(weight for thing, weight in SIDES.items() if thing in scene.things)
    return replace(taste, towards=(taste.towards[0], side, taste.towards[2]))


def directions(shape: Shape) -> Iterator[Array]:
    """Directions of hinges: of the frame, and of the part's own box where these are others."""
    given: list[Array] = []
    for axis in (*np.eye(3), *(axis for _, axis in shape.axes)):
        if all(abs(float(axis @ other)) < np.cos(np.radians(12.0)) for other in given):
            given.append(axis)
            yield axis


def _spots(shape: Shape, parent: Shape, scene: Named, axis: Array) -> Iterator[tuple[str, Array]]:
    """Points through which a line along ``axis`` may pass."""
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


def _weighed(
    line: Line,
    shape: Shape,
    parent: Shape,
    scene: Named,
    taste: Taste,
    grip: Grip | None,
) -> Line:
    span = shape.points @ line.axis
    low, high = np.quantile(span, [0.05, 0.95])
    places = line.pivot + np.outer(
        np.linspace(low, high, ALONG) - float(line.pivot @ line.axis), line.axis
    )
    from_parent = np.minimum(parent.off(places) / scene.diagonal, NEAR)
    from_self = np.minimum(shape.off(places) / scene.diagonal, NEAR)
    penalty = taste.near * float(0.7 * from_parent.mean() + 0.3 * from_self.mean())
    steep = abs(float(line.axis[2]))
    penalty += taste.upright * steep + taste.level * (1.0 - steep)
    penalty += taste.across * abs(float(line.axis[0]))
    half = 0.5 * float(np.linalg.norm(shape.size)) + 1e-9
    side = (line.pivot - shape.centre) - ((line.pivot - shape.centre) @ line.axis) * line.axis
    penalty -= float(np.asarray(taste.towards) @ side) / half
    out = shape.centre - scene.middle
    out = out - (out @ line.axis) * line.axis
    penalty -= taste.outer * float(np.clip(out[:2] @ side[:2] / half**2, -0.3, 0.3))
    lever = _lever(shape.points, line)
    wide = float(lever.max()) / (float(high - low) + 1e-9)
    penalty += taste.shape * float(np.clip(np.log2(wide), -1.0, 1.0))
    if grip is not None:
        ratio = float(_lever(grip.middle[None], line)[0]) / (float(lever.max()) + 1e-9)
        penalty -= taste.handle * min(ratio, 1.0)
        if grip.along is not None:
            penalty -= 0.3 * taste.handle * abs(float(grip.along @ line.axis))
    penalty += 0.4 * (1.0 - min(1.0, float(np.quantile(lever, 0.9)) / half))
    return replace(line, penalty=penalty)


def _swung(line: Line, shape: Shape, others: Sequence[Shape], scene: Named, taste: Taste) -> Line:
    sign, blocked = _free_way(line, shape, others, scene)
    return replace(line, penalty=line.penalty + taste.free * blocked, sign=sign)


def _lever(points: Array, line: Line) -> Array:
    """Distance of points (N, 3) from a line (N,)."""
    return np.asarray(np.linalg.norm(np.cross(points - line.pivot, line.axis), axis=-1))


def _free_way(
    line: Line, shape: Shape, others: Sequence[Shape], scene: Named
) -> tuple[float, float]:
    """The way about the axis that is freer, of equals the one outwards, and what is in the way."""
    q = np.array(SWINGS_RAD)
    ahead = scene.hits(shape, others, swing(line.axis, line.pivot, q))
    back = scene.hits(shape, others, swing(line.axis, line.pivot, -q))
    motion = np.cross(line.axis, shape.centre - line.pivot)
    outwards = float(motion @ (normalised(shape.centre - scene.middle) + OUT))
    sign = 1.0 if ahead - back < (SAME_WAY if outwards > 0.0 else -SAME_WAY) else -1.0
    return sign, min(ahead, back)


def swing(axis: Array, pivot: Array, q: Array) -> Array:
    """Poses (K, 4, 4) of turning by ``q`` (K,) about a line."""
    rot = axis_angle_to_matrix(np.broadcast_to(axis, (len(q), 3)), q)
    return pose(pivot - np.einsum("kij,j->ki", rot, pivot), rot)


@dataclass(frozen=True, eq=False)
class Grip:
    """Where a part is taken."""

    middle: Array
    along: Array | None
    """Direction of a bar; None where it is none."""


def grip_of(shape: Shape, scene: Named) -> Grip | None:
    """A handle or knob on a part, or what sticks out of a panel."""
    held = [r for r in scene.riders(shape) if GRIPS & {*words_of(r.label)}]
    points = np.concatenate([r.points for r in held]) if held else _bulge(shape, scene)
    if points is None:
        return None
    size = np.ptp(points, axis=0)
    long = int(np.argmax(size))
    bar = len(held) <= 1 and size[long] > 2.0 * np.sort(size)[1]
    middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
    return Grip(middle, np.eye(3)[long] if bar else None)


def _bulge(shape: Shape, scene: Named) -> Array | None:
    """Points that stand out of the flat outer face of a panel; None if there are none."""
    thin = int(np.argmin(shape.size))
    side = np.sign((shape.centre - scene.body.centre)[thin]) or 1.0
    height = side * shape.dense[0][:, thin]
    face = np.quantile(height, 0.80)
    out = height > face + 0.012 * scene.diagonal
    if not 10 <= int(out.sum()) <= 0.2 * len(height):
        return None
    return np.asarray(shape.dense[0][out])


def bail_of(shape: Shape, scene: Named) -> Line:
    """The line through the two ends of a bow."""
    parent = scene.shapes[scene.hangs[shape.name]]
    level = int(np.argmax(shape.size[:2]))
    axis = np.eye(3)[level]
    span = shape.points[:, level]
    low, high = span.min(), span.max()
    ends = []
    for at in (low, high):
        near = shape.points[np.abs(span - at) < 0.08 * (high - low)]
        off = parent.off(near)
        held = near[off <= np.quantile(off, 0.5) + 1e-9]
        ends.append(held.mean(axis=0))
    way = normalised(ends[1] - ends[0])
    axis = way if abs(float(way[level])) > np.cos(0.3) else axis
    line = Line(axis, 0.5 * (ends[0] + ends[1]), 0.0, source="two ends")
    sign, _ = _free_way(line, shape, scene.around(shape), scene)
    return Line(line.axis, line.pivot, 0.0, sign, line.source)


def fold_of(shape: Shape, scene: Named) -> Line | None:
    """The pivot of a blade that folds in its own plane; None if it lies along what it sits in."""
    parent = scene.shapes[scene.hangs[shape.name]]
    both = np.concatenate([shape.points, parent.points])
    thin = int(np.argmin(np.ptp(both, axis=0)))
    long = int(np.argmax(np.ptp(both, axis=0)))
    low = max(shape.bounds[0, long], parent.bounds[0, long])
    high = min(shape.bounds[1, long], parent.bounds[1, long])
    if high - low > 0.5 * shape.size[long]:
        return None
    mine = shape.points[(shape.points[:, long] >= low) & (shape.points[:, long] <= high)]
    pivot = shape.centre.copy() if len(mine) < 5 else 0.5 * (mine.min(axis=0) + mine.max(axis=0))
    return Line(np.eye(3)[thin], pivot, 0.0, 1.0, "overlap")
