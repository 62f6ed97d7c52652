"""Offers: the joints that the shape of a part allows, numbered and put in words."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from itertools import product

import cv2
import numpy as np

from articulate.reconstruct.actors.geometric.candidates import plane_of
from articulate.reconstruct.actors.protocol import Evidence, PredictedJoint
from articulate.reconstruct.actors.semantic.actor import QUARTER_RAD, SHARES
from articulate.reconstruct.actors.semantic.hinge import TASTES, directions, lines_of
from articulate.reconstruct.actors.semantic.part_relations import Named, Shape
from articulate.reconstruct.actors.semantic.rotary_parts import held_at
from articulate.reconstruct.actors.vlm.answers import Mover, TurningKind, Way
from articulate.reconstruct.actors.vlm.images import camera_of
from articulate.reconstruct.actors.vlm.model import Picture
from articulate.reconstruct.actors.vlm.prompt_text import direction_told, three
from articulate.render.image import png
from articulate.render.scene import PartScene, segmentation_image
from articulate.transforms import Array, normalised

SAME_LINE = 0.06
"""Lines nearer to each other than this share of the part's size are one."""
SLIDE_SHARE = 0.6
"""A slide goes by this share of its part's depth, unless its name says another."""
MIDDLE = 0.02
"""A line that passes nearer to the part's middle than this share of its size goes through it."""
LINE_PX = 2
SPOTS = (*tuple(product((0.0, 1.0), (0.0, 1.0))), (0.5, 0.5))
"""Where a line may pass through a part's box, as shares of its sides: edges, and the middle."""


@dataclass(frozen=True, eq=False)
class Offer:
    """One joint that a part may have."""

    number: int
    part: str
    kind: TurningKind
    axis_o: Array
    """Unit vector (3,)."""
    pivot_o: Array
    """A point on the axis (3,) [m]."""
    told: str
    """The same, in words."""


def offers_of(movers: Iterable[Mover], scene: Named) -> list[Offer]:
    """Candidates for all parts that move, numbered from 1 on."""
    found: list[Offer] = []
    for mover in movers:
        shape = scene.shapes[mover.part]
        for axis, pivot in _lines(shape, scene, mover.kind):
            told = _told(shape, mover.kind, axis, pivot)
            found.append(Offer(len(found) + 1, mover.part, mover.kind, axis, pivot, told))
    return found


def offers_told(offers: Iterable[Offer]) -> str:
    """All candidates, one line each."""
    lines: list[str] = []
    part = ""
    for offer in offers:
        if offer.part != part:
            part = offer.part
            lines.append(f"For {part}, {offer.kind}:")
        lines.append(f"  {offer.number}: {offer.told}")
    return "\n".join(lines)


def usual_joint(offer: Offer, way: Way, scene: Named) -> PredictedJoint:
    """The joint of an offer with the range that such parts mostly have."""
    shape = scene.shapes[offer.part]
    lower: float | None = None
    upper: float | None = None
    if offer.kind != "continuous":
        reach = QUARTER_RAD
        if offer.kind == "prismatic":
            depth = float(np.ptp(shape.points @ offer.axis_o))
            reach = SHARES.get(shape.role, SLIDE_SHARE) * depth
        ranges = {"positive": (0.0, 1.0), "negative": (-1.0, 0.0), "both": (-0.5, 0.5)}
        lower, upper = (reach * end for end in ranges[way])
    x, y, z = (float(v) for v in offer.axis_o)
    px, py, pz = (float(v) for v in offer.pivot_o)
    return PredictedJoint(
        part=offer.part,
        parent=scene.hangs[offer.part],
        kind=offer.kind,
        axis_o=(x, y, z),
        pivot_o=(px, py, pz),
        lower=lower,
        upper=upper,
    )


def with_carriers(scene: Named, movers: Iterable[Mover]) -> Named:
    """The scene in which other parts may hang on those that move, whatever they are called."""
    role_of = {m.part: "drawer" if m.kind == "prismatic" else "door" for m in movers}
    shapes = {
        name: Shape(shape.mesh, shape.label, role_of[name])  # type: ignore[arg-type]  # two roles
        if name in role_of and shape.role in {"still", "unknown"}
        else shape
        for name, shape in scene.shapes.items()
    }
    body = scene.body
    if body.name in role_of:  # what moves is no body
        still = [s for s in shapes.values() if s.name not in role_of]
        body = max(still, key=lambda s: float(np.prod(s.size + 1e-6)), default=body)
    return replace(scene, shapes=shapes, body=shapes[body.name])


def offers_picture(evidence: Evidence, offers: list[Offer]) -> Picture:
    """The parts in their colours, with the candidates of one part drawn as numbered lines."""
    camera = camera_of(evidence)
    seen = PartScene(evidence.parts).rasterize(camera)
    drawn = np.ascontiguousarray(segmentation_image(seen, len(evidence.parts)) // 2 + 127)
    points = evidence.part(offers[0].part).vertices
    for offer in offers:
        span = (points - offer.pivot_o) @ offer.axis_o
        ends = offer.pivot_o + np.outer([span.min(), span.max()], offer.axis_o)
        uv, depth = camera.project(ends)
        if not (depth > 0.0).all():
            continue
        start, end = ((int(u), int(v)) for u, v in np.rint(uv))
        share = 0.15 + 0.7 * (0.382 * offer.number % 1.0)  # numbers on crossing lines lie apart
        u, v = (int(x) for x in np.rint(uv[0] + share * (uv[1] - uv[0])))
        cv2.arrowedLine(drawn, start, end, (0, 0, 0), LINE_PX, cv2.LINE_AA, 0, 0.04)
        font = cv2.FONT_HERSHEY_SIMPLEX
        cv2.putText(drawn, str(offer.number), (u, v), font, 0.6, (200, 0, 0), 2, cv2.LINE_AA)
    return Picture(f"the candidates of {offers[0].part}, numbered on their arrows", png(drawn))


def _lines(shape: Shape, scene: Named, kind: TurningKind) -> Iterator[tuple[Array, Array]]:
    """Axis and a point on it, the likeliest first, so that positive positions lead outwards."""
    if kind == "prismatic":
        for axis in directions(shape):
            yield _outwards(axis, shape, scene), shape.centre
        return
    same_m = SAME_LINE * float(np.linalg.norm(shape.size))
    kept: list[tuple[Array, Array]] = []
    for axis, pivot in _turns(shape, scene, kind):
        if all(_off(axis, pivot, a, p) > same_m for a, p in kept):
            kept.append((axis, pivot))
            yield axis, pivot


def _turns(shape: Shape, scene: Named, kind: TurningKind) -> Iterator[tuple[Array, Array]]:
    if kind == "continuous":
        for axis in directions(shape):
            yield axis, shape.centre
        held = held_at(shape, scene)
        for axis in directions(shape):
            yield axis, held
        return
    role = shape.role if shape.role in TASTES else "unknown"
    for line in lines_of(shape, scene, role):
        yield line.sign * line.axis, line.pivot
    held = held_at(shape, scene)
    low, high = shape.bounds
    for axis in np.eye(3):
        yield axis, held
        across = plane_of(axis)
        for u, v in SPOTS:
            share = u * np.abs(across[0]) + v * np.abs(across[1]) + 0.5 * np.abs(axis)
            yield axis, low + share * (high - low)


def _off(axis: Array, pivot: Array, other: Array, spot: Array) -> float:
    """Distance of two lines where they are nearly parallel; else infinite [m]."""
    if abs(float(axis @ other)) < np.cos(np.radians(12.0)):
        return float("inf")
    return float(np.linalg.norm(np.cross(spot - pivot, axis)))


def _outwards(axis: Array, shape: Shape, scene: Named) -> Array:
    """The axis, turned so that it leads away from the middle of the object, to the front, up."""
    out = normalised(shape.centre - scene.middle + 1e-9) + np.array([0.5, 0.0, 0.5])
    return axis if float(axis @ out) >= 0.0 else -axis


def _told(shape: Shape, kind: TurningKind, axis: Array, pivot: Array) -> str:
    if kind == "prismatic":
        return f"along {three(axis)}; positive leads {direction_told(axis)}"
    arm = shape.centre - pivot
    arm = arm - float(arm @ axis) * axis
    size = float(np.linalg.norm(shape.size))
    if float(np.linalg.norm(arm)) < MIDDLE * size:
        return f"about {three(axis)} through its middle; positive by the right-hand rule"
    way = direction_told(np.cross(axis, arm))
    where = direction_told(-arm)
    return (
        f"about {three(axis)} at its {where} side, {three(pivot)}; positive leads its middle {way}"
    )
