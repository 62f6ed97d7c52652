"""PriorActor: what a part of this name and shape mostly does. The baseline that looks at nothing.

It knows a few words and the boxes of parts, and neither picture nor clip. Whatever another actor
gains over it, it gains by looking.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from articulate.reconstruct.actors.protocol import Evidence, PredictedJoint, Prediction
from articulate.render.parts import PartMesh
from articulate.transforms import Array, pose

SLIDES = frozenset({"drawer", "button", "tray", "lock", "key", "pump", "box"})
"""Words of parts that mostly slide."""
TURNS_ON = frozenset({"knob", "wheel", "caster", "blade", "fan", "cap", "stem", "yoke", "shaft"})
"""Words of parts that mostly turn without end."""
LIDS = frozenset({"lid", "cover", "screen", "handle", "seat", "lever", "switch", "leaf"})
"""Words of parts that mostly turn about a level edge."""
DOORS = frozenset({"door", "window", "glass"})
"""Words of parts that mostly turn about an upright edge."""
QUARTER_TURN_RAD = float(np.pi / 2)
SLIDE_SHARE = 0.6
"""A slide goes by this share of its part's depth."""


@dataclass(frozen=True)
class PriorActor:
    """Says of every part whose name is known what such parts mostly do."""

    name: str = "prior"

    def predict(self, evidence: Evidence) -> Prediction:
        """Joints by names; parts with names that say nothing stand still."""
        body = max(evidence.parts, key=lambda part: float(np.prod(np.ptp(part.bounds, axis=0))))
        joints = [
            joint
            for part in evidence.parts
            if part is not body
            for joint in [self._joint(part, evidence.labels.get(part.name, ""), body)]
            if joint is not None
        ]
        placements = {} if evidence.placed else {p.name: pose(np.zeros(3)) for p in evidence.parts}
        return Prediction(joints=tuple(joints), placements=placements)

    def _joint(self, part: PartMesh, label: str, body: PartMesh) -> PredictedJoint | None:
        words = set(label.split())
        size = np.ptp(part.bounds, axis=0)
        if words & SLIDES:
            axis, pivot = np.array([1.0, 0.0, 0.0]), part.centre
            return _said(part, body, "prismatic", axis, pivot, SLIDE_SHARE * float(size[0]))
        if words & TURNS_ON:
            thin = np.eye(3)[int(np.argmin(size))]
            return _said(part, body, "continuous", thin, part.centre, None)
        if words & DOORS:
            return _said(part, body, "revolute", *_upright_edge(part, body), -QUARTER_TURN_RAD)
        if words & LIDS:
            return _said(part, body, "revolute", *_rear_edge(part), -QUARTER_TURN_RAD)
        return None


def _upright_edge(part: PartMesh, body: PartMesh) -> tuple[Array, Array]:
    """Axis and point of the upright edge that is farther from the body's middle."""
    low, high = part.bounds
    outer = low[1] if part.centre[1] < body.centre[1] else high[1]
    up = 1.0 if part.centre[1] < body.centre[1] else -1.0
    return np.array([0.0, 0.0, up]), np.array([low[0], outer, part.centre[2]])


def _rear_edge(part: PartMesh) -> tuple[Array, Array]:
    """Axis and point of the level edge at the back, below."""
    low, _ = part.bounds
    return np.array([0.0, 1.0, 0.0]), np.array([low[0], part.centre[1], low[2]])


def _said(
    part: PartMesh, body: PartMesh, kind: str, axis: Array, pivot: Array, end: float | None
) -> PredictedJoint:
    limits = (None, None) if end is None else (min(0.0, end), max(0.0, end))
    return PredictedJoint(
        part=part.name,
        parent=body.name,
        kind=kind,  # type: ignore[arg-type]  # one of three literals above
        axis_o=(float(axis[0]), float(axis[1]), float(axis[2])),
        pivot_o=(float(pivot[0]), float(pivot[1]), float(pivot[2])),
        lower=limits[0],
        upper=limits[1],
        confidence=0.5,
    )
