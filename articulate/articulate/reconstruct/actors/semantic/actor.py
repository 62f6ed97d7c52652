"""NamedActor: joints of an object of which only the parts, their names and a sentence are known."""

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
from articulate.reconstruct.actors.semantic.hinge import UP, Line, bail_of, fold_of, hinge_of
from articulate.reconstruct.actors.semantic.ontology import Role
from articulate.reconstruct.actors.semantic.part_relations import Named, Shape, named_scene
from articulate.reconstruct.actors.semantic.rotary_parts import (
    drawer_of,
    held_at,
    lift_of,
    panel_normal,
    press_of,
    slide_of,
    spin_of,
)
from articulate.transforms import Array

QUARTER_RAD = float(np.pi / 2)
SHARES = {"drawer": 0.7, "press": 0.5, "lift": 0.5, "slot": 0.8}
"""Slides go by this share of their part's depth along the way."""
ROUND_TRAY = 0.08
"""A tray whose plan is this near to a square may be a turntable."""
SURE: dict[str, float] = {"unknown": 0.2, "pane": 0.5, "fold": 0.6}
"""How sure the actor is by role, where it is not the usual."""
USUALLY = 0.8
GUESSED = 0.3
"""How sure it is of a role by the meaning of a name, at most."""
BLOCKED, DOUBTED = 0.5, 0.2
"""A slide on whose freest way more than this share of the part runs into others, and how sure the
actor is of it. Hinges of real data run into their neighbours too often to be doubted for that."""


@dataclass(frozen=True)
class SemanticActor:
    """Says joints from part names and geometry."""

    name: str = "geometric-text"

    def predict(self, evidence: Evidence) -> Prediction:
        """A joint for every part whose name says that it moves.

        Raises:
            UsageError: The parts are not in their places, or there is only one.
        """
        start = time.monotonic()
        if not evidence.placed:
            raise UsageError("the text actor needs parts in their places; place them first")
        if len(evidence.parts) < 2:
            raise UsageError("the text actor needs two parts or more; give one mesh for each")
        scene = named_scene(evidence)
        joints = []
        told = []
        for shape in scene.shapes.values():
            if shape is scene.body:
                continue
            role = role_in(shape, scene)
            joint = joint_of(shape, scene, role)
            joints.append(joint)
            told.append(f"{shape.label or shape.name}: {role}, {joint.kind} on {joint.parent}")
        step = TraceStep(
            title="what parts are called, and how such parts move",
            text="; ".join(told),
            seconds=time.monotonic() - start,
        )
        return Prediction(joints=tuple(joints), trace=(step,))


def role_in(shape: Shape, scene: Named) -> Role:
    """What is looked for in a part: by its name, and by what its shape says against that."""
    role, parent = shape.role, scene.shapes[scene.hangs[shape.name]]
    if role == "drawer" and _is_turntable(shape):
        return "spin"
    if role == "door" and parent.role == "door":
        return "latch"
    if role == "pane" and _swings(shape, scene):
        return "door"
    return role


def joint_of(shape: Shape, scene: Named, role: Role) -> PredictedJoint:
    """The joint of a part in its role."""
    sure = min(SURE.get(role, USUALLY), GUESSED if shape.guessed else 1.0)
    if role in {"still", "unknown"}:
        return _said(shape, scene, "fixed", None, 1.0)
    if role in {"drawer", "press", "lift", "slot", "pane"}:
        line = _slide(shape, scene, role)
        sure = min(sure, DOUBTED) if line.blocked > BLOCKED else sure
        share = SHARES.get(role, 0.5)
        way = share * float(np.ptp(shape.points @ line.axis))
        limits = (-way, 0.0) if role == "press" else (0.0, way)
        return _said(shape, scene, "prismatic", line, sure, limits)
    if role in {"spin", "roll"}:
        return _said(shape, scene, "continuous", spin_of(shape, scene, level=role == "roll"), sure)
    if role == "fold":
        folded = fold_of(shape, scene)
        if folded is None:
            line = _along(shape)
            way = 0.7 * float(np.ptp(shape.points @ line.axis))
            return _said(shape, scene, "prismatic", line, sure, (0.0, way))
        return _said(shape, scene, "revolute", folded, sure, (0.0, np.pi))
    line = _turn(shape, scene, role)
    end = line.sign * QUARTER_RAD
    if role in {"swivel", "rocker"}:
        return _said(shape, scene, "revolute", line, sure, (-QUARTER_RAD / 2, QUARTER_RAD / 2))
    return _said(shape, scene, "revolute", line, sure, (min(0.0, end), max(0.0, end)))


def _slide(shape: Shape, scene: Named, role: Role) -> Line:
    if role == "drawer":
        return drawer_of(shape, scene)
    if role == "press":
        return press_of(shape, scene)
    if role == "lift":
        return lift_of(shape, scene)
    if role == "slot":
        return slide_of(shape, scene, [(UP, 0.0), (-UP, 0.1)])
    y = np.eye(3)[1]
    return slide_of(shape, scene, [(y, 0.0), (-y, 0.0), (UP, 0.3), (-UP, 0.3)])


def _turn(shape: Shape, scene: Named, role: Role) -> Line:
    parent = scene.shapes[scene.hangs[shape.name]]
    if role == "bail":
        return bail_of(shape, scene)
    if role == "swivel":
        return Line(UP, held_at(shape, scene), 0.0, 1.0, "held")
    if role == "latch":
        normal = panel_normal(shape, parent, scene)
        return Line(normal, held_at(shape, scene), 0.0, 1.0, "held")
    if role == "rocker":
        normal = panel_normal(shape, parent, scene)
        axis = np.cross(UP, normal)
        axis = np.eye(3)[1] if np.linalg.norm(axis) < 0.3 else axis / np.linalg.norm(axis)
        return Line(axis, shape.centre, 0.0, 1.0, "middle")
    return hinge_of(shape, scene, role)


def _along(shape: Shape) -> Line:
    axis = np.eye(3)[int(np.argmax(shape.size))]
    return Line(axis, shape.centre, 0.0, 1.0, "along")


def _is_turntable(shape: Shape) -> bool:
    """Whether a tray is round: nothing of it reaches into the corners of its box."""
    size = shape.size
    if abs(size[0] - size[1]) > ROUND_TRAY * max(size[0], size[1]):
        return False
    arm = (shape.points - shape.centre)[:, :2] / (0.5 * size[:2] + 1e-9)
    return bool(np.linalg.norm(arm, axis=-1).max() < 1.15)


def _swings(shape: Shape, scene: Named) -> bool:
    """Whether a pane has no other pane to slide behind."""
    if "sliding" in scene.things:
        return False
    panes = [s for s in scene.shapes.values() if s.role == "pane" and s is not shape]
    wide = shape.size[1] > 0.75 * scene.body.size[1]
    apart = any(abs(s.centre[0] - shape.centre[0]) > 0.3 * shape.size[0] for s in panes)
    return not apart and bool(wide or not panes)


def _said(
    shape: Shape,
    scene: Named,
    kind: JointKind,
    line: Line | None,
    sure: float,
    limits: tuple[float, float] | None = None,
) -> PredictedJoint:
    axis: Array = UP if line is None else line.axis
    pivot: Array = shape.centre if line is None else line.pivot
    return PredictedJoint(
        part=shape.name,
        parent=scene.hangs[shape.name],
        kind=kind,
        axis_o=(float(axis[0]), float(axis[1]), float(axis[2])),
        pivot_o=(float(pivot[0]), float(pivot[1]), float(pivot[2])),
        lower=None if limits is None else float(limits[0]),
        upper=None if limits is None else float(limits[1]),
        confidence=sure,
    )
