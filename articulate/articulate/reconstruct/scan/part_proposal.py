"""Part of a scan and its joint, before the object is built."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from articulate.reconstruct.actors.protocol import JointKind, PredictedJoint
from articulate.reconstruct.scan.panels import Handle
from articulate.transforms import Array, Ints

PartKind = Literal[
    "door", "flap", "drawer", "lid", "screen", "handle", "knob", "button", "wheel", "switch", "part"
]
QUARTER_RAD = float(np.pi / 2)


@dataclass(frozen=True, kw_only=True, eq=False)
class PartProposal:
    """Faces that move together, and their joint."""

    kind: PartKind
    faces: Ints
    """Faces of the mesh (K,)."""
    joint: JointKind
    axis: Array
    """Unit vector (3,); positive positions open."""
    pivot: Array
    """Point on the axis (3,) [m]."""
    upper: float
    """Position when open [m or rad]; 0 is the pose of the mesh."""
    confidence: float
    evidence: tuple[str, ...] = ()
    """Observations that support it."""
    panel: Array | None = None
    """``(y0, z0, y1, z1)`` of a front panel (4,) [m]; None for other parts."""
    handles: tuple[Handle, ...] = ()
    """Handles and knobs on a front panel."""
    front: float = 0.0
    """Coordinate x of the front panel's surface [m]."""
    hollow: bool = False
    """True if the interior behind the part must be built."""
    lower: float = 0.0
    """Position when closed [m or rad]."""
    on: int | None = None
    """Index of the proposal that carries it; None: the body."""

    def predicted(self, name: str, parent: str) -> PredictedJoint:
        """Return the joint under the names of its parts."""
        free = self.joint == "continuous"
        return PredictedJoint(
            part=name,
            parent=parent,
            kind=self.joint,
            axis_o=_three(self.axis),
            pivot_o=_three(self.pivot),
            lower=None if free else self.lower,
            upper=None if free else self.upper,
            confidence=self.confidence,
        )

    def with_confidence(self, confidence: float) -> PartProposal:
        """Return the proposal with another confidence in [0, 1]."""
        return replace(self, confidence=float(np.clip(confidence, 0.0, 1.0)))


def scaled(proposal: PartProposal, factor: float) -> PartProposal:
    """Return the proposal for a mesh that is scaled about the origin."""
    slides = proposal.joint == "prismatic"
    return replace(
        proposal,
        pivot=factor * proposal.pivot,
        lower=factor * proposal.lower if slides else proposal.lower,
        upper=factor * proposal.upper if slides else proposal.upper,
        panel=None if proposal.panel is None else factor * proposal.panel,
        handles=tuple(
            Handle(rect=factor * h.rect, height=factor * h.height) for h in proposal.handles
        ),
        front=factor * proposal.front,
    )


def _three(values: Array) -> tuple[float, float, float]:
    return float(values[0]), float(values[1]), float(values[2])
