"""Joint candidates from the shape of a part, numbered and described for a model."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from itertools import product

import cv2
import numpy as np

from articulate.reconstruct.actors.geometric.surface import perpendicular_axes
from articulate.reconstruct.actors.protocol import Evidence, PredictedJoint
from articulate.reconstruct.actors.semantic.actor import QUARTER_RAD, TRAVEL_SHARES
from articulate.reconstruct.actors.semantic.hinge import HINGE_PRIORS, directions, hinge_candidates
from articulate.reconstruct.actors.semantic.part_relations import LabelledScene, PartShape
from articulate.reconstruct.actors.semantic.rotary_parts import contact_centre
from articulate.reconstruct.actors.vlm.answers import Direction, MovingKind, MovingPart
from articulate.reconstruct.actors.vlm.images import camera_of
from articulate.reconstruct.actors.vlm.model import CaptionedImage
from articulate.reconstruct.actors.vlm.prompt_text import describe_direction, format_vector
from articulate.render.image import png
from articulate.render.scene import PartScene, segmentation_image
from articulate.transforms import Array, normalised

SAME_LINE = 0.06
"""Axes closer than this share of the part's size are the same candidate."""
SLIDE_SHARE = 0.6
"""Travel of a slide as a share of its part's depth, unless its role has another."""
MIDDLE = 0.02
"""An axis closer to the part's centre than this share of its size passes through it."""
LINE_PX = 2
SPOTS = (*tuple(product((0.0, 1.0), (0.0, 1.0))), (0.5, 0.5))
"""Positions of axes in a part's box, as shares of its sides: edges and the centre."""


@dataclass(frozen=True, eq=False)
class JointCandidate:
    """A joint that the shape of a part allows."""

    number: int
    part: str
    kind: MovingKind
    axis_o: Array
    """Unit vector (3,)."""
    pivot_o: Array
    """A point on the axis (3,) [m]."""
    description: str
    """Axis, pivot and positive direction as text."""


def joint_candidates(movers: Iterable[MovingPart], scene: LabelledScene) -> list[JointCandidate]:
    """Return the candidates of all parts that move, numbered from 1."""
    found: list[JointCandidate] = []
    for mover in movers:
        shape = scene.shapes[mover.part]
        for axis, pivot in _lines(shape, scene, mover.kind):
            text = _describe(shape, mover.kind, axis, pivot)
            found.append(JointCandidate(len(found) + 1, mover.part, mover.kind, axis, pivot, text))
    return found


def describe_candidates(candidates: Iterable[JointCandidate]) -> str:
    """List all candidates, one line each."""
    lines: list[str] = []
    part = ""
    for candidate in candidates:
        if candidate.part != part:
            part = candidate.part
            lines.append(f"For {part}, {candidate.kind}:")
        lines.append(f"  {candidate.number}: {candidate.description}")
    return "\n".join(lines)


def typical_joint(
    candidate: JointCandidate, direction: Direction, scene: LabelledScene
) -> PredictedJoint:
    """Return the joint of a candidate with the typical range of such parts."""
    shape = scene.shapes[candidate.part]
    lower: float | None = None
    upper: float | None = None
    if candidate.kind != "continuous":
        reach = QUARTER_RAD
        if candidate.kind == "prismatic":
            depth = float(np.ptp(shape.points @ candidate.axis_o))
            reach = TRAVEL_SHARES.get(shape.role, SLIDE_SHARE) * depth
        ranges = {"positive": (0.0, 1.0), "negative": (-1.0, 0.0), "both": (-0.5, 0.5)}
        lower, upper = (reach * end for end in ranges[direction])
    x, y, z = (float(v) for v in candidate.axis_o)
    px, py, pz = (float(v) for v in candidate.pivot_o)
    return PredictedJoint(
        part=candidate.part,
        parent=scene.parent_names[candidate.part],
        kind=candidate.kind,
        axis_o=(x, y, z),
        pivot_o=(px, py, pz),
        lower=lower,
        upper=upper,
    )


def with_carriers(scene: LabelledScene, movers: Iterable[MovingPart]) -> LabelledScene:
    """Return the scene in which moving parts can carry other parts, whatever their names."""
    role_of = {m.part: "drawer" if m.kind == "prismatic" else "door" for m in movers}
    shapes = {
        name: PartShape(shape.mesh, shape.label, role_of[name])  # type: ignore[arg-type]  # two roles
        if name in role_of and shape.role in {"still", "unknown"}
        else shape
        for name, shape in scene.shapes.items()
    }
    body = scene.body
    if body.name in role_of:  # a moving part cannot be the body
        still = [s for s in shapes.values() if s.name not in role_of]
        body = max(still, key=lambda s: float(np.prod(s.size + 1e-6)), default=body)
    return replace(scene, shapes=shapes, body=shapes[body.name])


def candidates_image(evidence: Evidence, candidates: list[JointCandidate]) -> CaptionedImage:
    """Render the parts in their colours with the candidates of one part as numbered arrows."""
    camera = camera_of(evidence)
    seen = PartScene(evidence.parts).rasterize(camera)
    image = np.ascontiguousarray(segmentation_image(seen, len(evidence.parts)) // 2 + 127)
    points = evidence.part(candidates[0].part).vertices
    for candidate in candidates:
        span = (points - candidate.pivot_o) @ candidate.axis_o
        ends = candidate.pivot_o + np.outer([span.min(), span.max()], candidate.axis_o)
        uv, depth = camera.project(ends)
        if not (depth > 0.0).all():
            continue
        start, end = ((int(u), int(v)) for u, v in np.rint(uv))
        share = 0.15 + 0.7 * (
            0.382 * candidate.number % 1.0
        )  # separates the numbers of crossing axes
        u, v = (int(x) for x in np.rint(uv[0] + share * (uv[1] - uv[0])))
        cv2.arrowedLine(image, start, end, (0, 0, 0), LINE_PX, cv2.LINE_AA, 0, 0.04)
        font = cv2.FONT_HERSHEY_SIMPLEX
        cv2.putText(image, str(candidate.number), (u, v), font, 0.6, (200, 0, 0), 2, cv2.LINE_AA)
    return CaptionedImage(
        f"the candidates of {candidates[0].part}, numbered on their arrows", png(image)
    )


def _lines(
    shape: PartShape, scene: LabelledScene, kind: MovingKind
) -> Iterator[tuple[Array, Array]]:
    """Yield axis and pivot, the likeliest first; positive positions move outwards."""
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


def _turns(
    shape: PartShape, scene: LabelledScene, kind: MovingKind
) -> Iterator[tuple[Array, Array]]:
    if kind == "continuous":
        for axis in directions(shape):
            yield axis, shape.centre
        held = contact_centre(shape, scene)
        for axis in directions(shape):
            yield axis, held
        return
    role = shape.role if shape.role in HINGE_PRIORS else "unknown"
    for line in hinge_candidates(shape, scene, role):
        yield line.sign * line.axis, line.pivot
    held = contact_centre(shape, scene)
    low, high = shape.bounds
    for axis in np.eye(3):
        yield axis, held
        across = perpendicular_axes(axis)
        for u, v in SPOTS:
            share = u * np.abs(across[0]) + v * np.abs(across[1]) + 0.5 * np.abs(axis)
            yield axis, low + share * (high - low)


def _off(axis: Array, pivot: Array, other: Array, spot: Array) -> float:
    """Return the distance of two nearly parallel lines, infinite for others [m]."""
    if abs(float(axis @ other)) < np.cos(np.radians(12.0)):
        return float("inf")
    return float(np.linalg.norm(np.cross(spot - pivot, axis)))


def _outwards(axis: Array, shape: PartShape, scene: LabelledScene) -> Array:
    """Return the axis with the sign that leads away from the object's centre, to front and up."""
    out = normalised(shape.centre - scene.middle + 1e-9) + np.array([0.5, 0.0, 0.5])
    return axis if float(axis @ out) >= 0.0 else -axis


def _describe(shape: PartShape, kind: MovingKind, axis: Array, pivot: Array) -> str:
    if kind == "prismatic":
        return f"along {format_vector(axis)}; positive moves {describe_direction(axis)}"
    arm = shape.centre - pivot
    arm = arm - float(arm @ axis) * axis
    size = float(np.linalg.norm(shape.size))
    if float(np.linalg.norm(arm)) < MIDDLE * size:
        return f"about {format_vector(axis)} through its centre; positive by the right-hand rule"
    direction = describe_direction(np.cross(axis, arm))
    side = describe_direction(-arm)
    return (
        f"about {format_vector(axis)} at its {side} side, {format_vector(pivot)}; "
        f"positive moves its centre {direction}"
    )
