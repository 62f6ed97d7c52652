"""Baseline: usual joints by part name and bounding box, without images or video.

The gain of another actor over this one is what it obtains from the evidence.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from articulate.reconstruct.actors.protocol import Evidence, PredictedJoint, Prediction
from articulate.render.parts import PartMesh
from articulate.transforms import Array, pose

SLIDES = frozenset({"drawer", "button", "tray", "lock", "key", "pump", "box"})
"""Names of parts that usually slide."""
SPINS = frozenset({"knob", "wheel", "caster", "blade", "fan", "cap", "stem", "yoke", "shaft"})
"""Names of parts that usually rotate without limits."""
LIDS = frozenset({"lid", "cover", "screen", "handle", "seat", "lever", "switch", "leaf"})
"""Names of parts that usually rotate about a horizontal edge."""
DOORS = frozenset({"door", "window", "glass"})
"""Names of parts that usually rotate about a vertical edge."""
QUARTER_TURN_RAD = float(np.pi / 2)
SLIDE_SHARE = 0.6
"""Travel of a slide, as a share of its part's depth."""


@dataclass(frozen=True)
class PriorActor:
    """Actor that predicts the usual joint of every part with a known name."""

    name: str = "prior"

    def predict(self, evidence: Evidence) -> Prediction:
        """Return joints by names; parts with other names are fixed."""
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
            return _predicted_joint(
                part, body, "prismatic", axis, pivot, SLIDE_SHARE * float(size[0])
            )
        if words & SPINS:
            thin = np.eye(3)[int(np.argmin(size))]
            return _predicted_joint(part, body, "continuous", thin, part.centre, None)
        if words & DOORS:
            return _predicted_joint(
                part, body, "revolute", *_upright_edge(part, body), -QUARTER_TURN_RAD
            )
        if words & LIDS:
            return _predicted_joint(part, body, "revolute", *_rear_edge(part), -QUARTER_TURN_RAD)
        return None


def _upright_edge(part: PartMesh, body: PartMesh) -> tuple[Array, Array]:
    """Return axis and point of the vertical edge that is farther from the body's centre."""
    low, high = part.bounds
    outer = low[1] if part.centre[1] < body.centre[1] else high[1]
    up = 1.0 if part.centre[1] < body.centre[1] else -1.0
    return np.array([0.0, 0.0, up]), np.array([low[0], outer, part.centre[2]])


def _rear_edge(part: PartMesh) -> tuple[Array, Array]:
    """Return axis and point of the horizontal rear lower edge."""
    low, _ = part.bounds
    return np.array([0.0, 1.0, 0.0]), np.array([low[0], part.centre[1], low[2]])


def _predicted_joint(
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
