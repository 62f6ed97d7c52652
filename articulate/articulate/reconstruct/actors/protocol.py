"""Interfaces of actors and critics: evidence, prediction and verdict.

::

    Evidence ─► Actor.predict ─► Prediction ─► Critic.assess ─► Verdict

All coordinates are in the object frame ``o``, in which the parts are given with every joint at 0;
it is the world frame of the camera too. z is up, the object is placed on z = 0, and its front is +x
if the source of the object defines a front. Predicted joints are those of a URDF.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from articulate.reconstruct.actors.modality import Modality
from articulate.render.camera import Camera
from articulate.render.parts import PartMesh
from articulate.transforms import Array, axis_angle_to_matrix, normalised, pose

Pixels = NDArray[np.uint8]
JointKind = Literal["revolute", "prismatic", "continuous", "fixed"]
Failure = Literal["success", "joint_type", "joint_axis", "joint_origin", "joint_limit"]
"""Verdicts of a critic, in the order in which failures are attributed."""
FAILURES: tuple[Failure, ...] = (
    "success",
    "joint_type",
    "joint_axis",
    "joint_origin",
    "joint_limit",
)
GOOD_ENOUGH = 5.0
"""A rating above this ends the loop."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Evidence:
    """Everything that an actor may use; no joint is part of it."""

    modality: Modality
    parts: tuple[PartMesh, ...]
    """Parts in random order, in the frame ``o`` if ``placed``; otherwise each with the centre of
    its box at the origin, and its placement is to be predicted."""
    labels: Mapping[str, str] = field(default_factory=dict)
    """Labels of the parts by name ("drawer", "door 2"); empty if the modality has none."""
    placed: bool = True
    """The parts are in their places."""
    video: Pixels | None = None
    """Frames of a video in which something moves (T, H, W, 3), 0 to 255; None without video."""
    times_s: Array | None = None
    """Time of each frame (T,) [s]."""
    image: Pixels | None = None
    """Image of the object (H, W, 3), 0 to 255; None without one."""
    camera: Camera | None = None
    """Camera of the video or image in the frame ``o``; None if it must be estimated."""
    text: str = ""
    """Description of the object; may be empty."""
    seed: int = 0
    """Seed of the actor's random numbers."""

    def part(self, name: str) -> PartMesh:
        """Return the part called ``name``.

        Raises:
            KeyError: There is none.
        """
        for part in self.parts:
            if part.name == name:
                return part
        raise KeyError(name)


@dataclass(frozen=True, kw_only=True)
class PredictedJoint:
    """A predicted joint."""

    part: str
    """Name of the child part."""
    parent: str | None
    """Name of the parent part; None for a static part."""
    kind: JointKind
    """``fixed``: the part does not move relative to its parent."""
    axis_o: tuple[float, float, float] = (0.0, 0.0, 1.0)
    """Direction of the axis or of sliding; need not be of unit length."""
    pivot_o: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """A point on the axis [m]; unused for a slide."""
    lower: float | None = None
    """Lower limit [m or rad], 0 being the given pose; None: no limit."""
    upper: float | None = None
    """Upper limit [m or rad]."""
    confidence: float = 1.0
    """Confidence, in [0, 1]."""

    def T_o(self, q: ArrayLike) -> Array:
        """Return the poses (..., 4, 4) of the part in ``o`` at positions ``q`` (...) [m or rad]."""
        q = np.asarray(q, dtype=np.float64)
        axis, pivot = normalised(self.axis_o), np.asarray(self.pivot_o, dtype=np.float64)
        if self.kind == "fixed":
            return pose(np.zeros((*q.shape, 3)))
        if self.kind == "prismatic":
            return pose(q[..., None] * axis)
        rot = axis_angle_to_matrix(np.broadcast_to(axis, (*q.shape, 3)), q)
        return pose(pivot - np.einsum("...ij,j->...i", rot, pivot), rot)


@dataclass(frozen=True, kw_only=True)
class Verdict:
    """Assessment of a prediction by a critic."""

    failure: Failure
    """``success``, or the first failure."""
    rating: float
    """0 to 10; above :data:`GOOD_ENOUGH` the loop stops."""
    reason: str = ""
    """Reason, one sentence."""
    figures: Mapping[str, float] = field(default_factory=dict)
    """Measurements, by name with unit."""
    images: Mapping[str, bytes] = field(default_factory=dict)
    """Images by caption, as WebP or PNG."""
    trace: tuple[TraceStep, ...] = ()
    """Stages of the assessment."""
    calls: int = 0
    """Calls of models over a network."""


@dataclass(frozen=True, kw_only=True)
class ActorAttempt:
    """One iteration of the loop: proposal and verdict."""

    joints: tuple[PredictedJoint, ...]
    verdict: Verdict | None = None
    """None without a critic."""
    seconds: float = 0.0
    """Duration [s]."""


@dataclass(frozen=True, kw_only=True)
class TraceStep:
    """One stage of an actor's work, for reports."""

    title: str
    text: str = ""
    figures: Mapping[str, float] = field(default_factory=dict)
    images: Mapping[str, bytes] = field(default_factory=dict)
    """Images by caption, as WebP or PNG."""
    seconds: float = 0.0


@dataclass(frozen=True, kw_only=True)
class Prediction:
    """Joints and placements that an actor predicts for an object."""

    joints: tuple[PredictedJoint, ...]
    """At most one for each part; other parts are fixed."""
    placements: Mapping[str, Array] = field(default_factory=dict)
    """Placement ``T_op`` (4, 4) of each part from its given frame to ``o``, by name; empty for
    placed parts."""
    rating: float | None = None
    """Rating by the critic, 0 to 10; None without a critic."""
    verdict: Verdict | None = None
    """Verdict of the critic; None without a critic."""
    attempts: tuple[ActorAttempt, ...] = ()
    """All iterations in order; ``joints`` are those with the best rating of the actor's own
    critic."""
    trace: tuple[TraceStep, ...] = ()
    """Stages of the actor's work."""
    calls: int = 0
    """Calls of models over a network."""
    rejection: str = ""
    """Reason why nothing is predicted, one sentence; empty otherwise."""
    program: str = ""
    """Source in the language of :mod:`articulate.reconstruct.program`, if the actor wrote one."""


class Actor(Protocol):
    """Estimator of joints, and of placements of parts that are not placed."""

    @property
    def name(self) -> str:
        """Name in reports."""
        ...

    def predict(self, evidence: Evidence) -> Prediction:
        """Predict the joints of the object."""
        ...


class Critic(Protocol):
    """Assessor of predictions by the evidence only."""

    @property
    def name(self) -> str:
        """Name in reports."""
        ...

    def assess(self, evidence: Evidence, prediction: Prediction) -> Verdict:
        """Return the first failure of the prediction, if any, and a rating."""
        ...
