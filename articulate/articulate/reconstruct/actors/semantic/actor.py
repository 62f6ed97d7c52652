"""Actor for texts: joints from the parts, their names and a sentence."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from articulate.errors import UsageError
from articulate.reconstruct.actors.protocol import (
    Evidence,
    JointKind,
    PredictedJoint,
    Prediction,
    TraceStep,
)
from articulate.reconstruct.actors.semantic.hinge import (
    UP,
    AxisCandidate,
    find_bail_axis,
    find_fold_axis,
    find_hinge,
)
from articulate.reconstruct.actors.semantic.ontology import Role
from articulate.reconstruct.actors.semantic.part_relations import (
    LabelledScene,
    PartShape,
    build_labelled_scene,
)
from articulate.reconstruct.actors.semantic.rotary_parts import (
    contact_centre,
    find_drawer_axis,
    find_lift_axis,
    find_press_axis,
    find_slide_axis,
    find_spin_axis,
    panel_normal,
)
from articulate.transforms import Array

QUARTER_RAD = float(np.pi / 2)
TRAVEL_SHARES = {"drawer": 0.7, "press": 0.5, "lift": 0.5, "slot": 0.8}
"""Travel of slides, as a share of their part's extent along it."""
ROUND_TRAY = 0.08
"""A tray whose footprint is this close to a square may be a turntable."""
ROLE_CONFIDENCE: dict[str, float] = {"unknown": 0.2, "pane": 0.5, "fold": 0.6}
"""Confidence by role, where it is not the default."""
DEFAULT_CONFIDENCE = 0.8
GUESSED_CONFIDENCE = 0.3
"""Highest confidence of a role inferred from the meaning of a name."""
MAX_BLOCKED, BLOCKED_CONFIDENCE = 0.5, 0.2
"""A slide on whose freest path more than the first share of the part collides with others has the
second as confidence. Hinges of real data collide with their neighbours too often for such a
rule."""


@dataclass(frozen=True)
class SemanticActor:
    """Actor that predicts joints from part names and geometry."""

    name: str = "geometric-text"

    def predict(self, evidence: Evidence) -> Prediction:
        """Return a joint for every part whose name implies that it moves.

        Raises:
            UsageError: The parts are not in their places, or there is only one.
        """
        start = time.monotonic()
        if not evidence.placed:
            raise UsageError("the text actor needs parts in their places; place them first")
        if len(evidence.parts) < 2:
            raise UsageError("the text actor needs two parts or more; give one mesh for each")
        scene = build_labelled_scene(evidence)
        joints = []
        descriptions = []
        for shape in scene.shapes.values():
            if shape is scene.body:
                continue
            role = refine_role(shape, scene)
            joint = joint_of(shape, scene, role)
            joints.append(joint)
            descriptions.append(
                f"{shape.label or shape.name}: {role}, {joint.kind} on {joint.parent}"
            )
        step = TraceStep(
            title="what parts are called, and how such parts move",
            text="; ".join(descriptions),
            seconds=time.monotonic() - start,
        )
        return Prediction(joints=tuple(joints), trace=(step,))


def refine_role(shape: PartShape, scene: LabelledScene) -> Role:
    """Return the role of a part by its name, corrected by its shape."""
    role, parent = shape.role, scene.shapes[scene.parent_names[shape.name]]
    if role == "drawer" and _is_turntable(shape):
        return "spin"
    if role == "door" and parent.role == "door":
        return "latch"
    if role == "pane" and _swings(shape, scene):
        return "door"
    return role


def joint_of(shape: PartShape, scene: LabelledScene, role: Role) -> PredictedJoint:
    """Return the joint of a part in its role."""
    confidence = min(
        ROLE_CONFIDENCE.get(role, DEFAULT_CONFIDENCE), GUESSED_CONFIDENCE if shape.guessed else 1.0
    )
    if role in {"still", "unknown"}:
        return _predicted_joint(shape, scene, "fixed", None, 1.0)
    if role in {"drawer", "press", "lift", "slot", "pane"}:
        line = _slide(shape, scene, role)
        confidence = (
            min(confidence, BLOCKED_CONFIDENCE) if line.blocked > MAX_BLOCKED else confidence
        )
        share = TRAVEL_SHARES.get(role, 0.5)
        travel = share * float(np.ptp(shape.points @ line.axis))
        limits = (-travel, 0.0) if role == "press" else (0.0, travel)
        return _predicted_joint(shape, scene, "prismatic", line, confidence, limits)
    if role in {"spin", "roll"}:
        return _predicted_joint(
            shape,
            scene,
            "continuous",
            find_spin_axis(shape, scene, level=role == "roll"),
            confidence,
        )
    if role == "fold":
        folded = find_fold_axis(shape, scene)
        if folded is None:
            line = _along(shape)
            travel = 0.7 * float(np.ptp(shape.points @ line.axis))
            return _predicted_joint(shape, scene, "prismatic", line, confidence, (0.0, travel))
        return _predicted_joint(shape, scene, "revolute", folded, confidence, (0.0, np.pi))
    line = _turn(shape, scene, role)
    end = line.sign * QUARTER_RAD
    if role in {"swivel", "rocker"}:
        return _predicted_joint(
            shape, scene, "revolute", line, confidence, (-QUARTER_RAD / 2, QUARTER_RAD / 2)
        )
    return _predicted_joint(
        shape, scene, "revolute", line, confidence, (min(0.0, end), max(0.0, end))
    )


def _slide(shape: PartShape, scene: LabelledScene, role: Role) -> AxisCandidate:
    if role == "drawer":
        return find_drawer_axis(shape, scene)
    if role == "press":
        return find_press_axis(shape, scene)
    if role == "lift":
        return find_lift_axis(shape, scene)
    if role == "slot":
        return find_slide_axis(shape, scene, [(UP, 0.0), (-UP, 0.1)])
    y = np.eye(3)[1]
    return find_slide_axis(shape, scene, [(y, 0.0), (-y, 0.0), (UP, 0.3), (-UP, 0.3)])


def _turn(shape: PartShape, scene: LabelledScene, role: Role) -> AxisCandidate:
    parent = scene.shapes[scene.parent_names[shape.name]]
    if role == "bail":
        return find_bail_axis(shape, scene)
    if role == "swivel":
        return AxisCandidate(UP, contact_centre(shape, scene), 0.0, 1.0, "held")
    if role == "latch":
        normal = panel_normal(shape, parent, scene)
        return AxisCandidate(normal, contact_centre(shape, scene), 0.0, 1.0, "held")
    if role == "rocker":
        normal = panel_normal(shape, parent, scene)
        axis = np.cross(UP, normal)
        axis = np.eye(3)[1] if np.linalg.norm(axis) < 0.3 else axis / np.linalg.norm(axis)
        return AxisCandidate(axis, shape.centre, 0.0, 1.0, "middle")
    return find_hinge(shape, scene, role)


def _along(shape: PartShape) -> AxisCandidate:
    axis = np.eye(3)[int(np.argmax(shape.size))]
    return AxisCandidate(axis, shape.centre, 0.0, 1.0, "along")


def _is_turntable(shape: PartShape) -> bool:
    """Return whether a tray is round: its corners do not reach those of its box."""
    size = shape.size
    if abs(size[0] - size[1]) > ROUND_TRAY * max(size[0], size[1]):
        return False
    arm = (shape.points - shape.centre)[:, :2] / (0.5 * size[:2] + 1e-9)
    return bool(np.linalg.norm(arm, axis=-1).max() < 1.15)


def _swings(shape: PartShape, scene: LabelledScene) -> bool:
    """Return whether a pane has no other pane to slide behind."""
    if "sliding" in scene.object_words:
        return False
    panes = [s for s in scene.shapes.values() if s.role == "pane" and s is not shape]
    wide = shape.size[1] > 0.75 * scene.body.size[1]
    apart = any(abs(s.centre[0] - shape.centre[0]) > 0.3 * shape.size[0] for s in panes)
    return not apart and bool(wide or not panes)


def _predicted_joint(
    shape: PartShape,
    scene: LabelledScene,
    kind: JointKind,
    line: AxisCandidate | None,
    confidence: float,
    limits: tuple[float, float] | None = None,
) -> PredictedJoint:
    axis: Array = UP if line is None else line.axis
    pivot: Array = shape.centre if line is None else line.pivot
    return PredictedJoint(
        part=shape.name,
        parent=scene.parent_names[shape.name],
        kind=kind,
        axis_o=(float(axis[0]), float(axis[1]), float(axis[2])),
        pivot_o=(float(pivot[0]), float(pivot[1]), float(pivot[2])),
        lower=None if limits is None else float(limits[0]),
        upper=None if limits is None else float(limits[1]),
        confidence=confidence,
    )
