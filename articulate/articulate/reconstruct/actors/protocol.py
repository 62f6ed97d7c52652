"""What an actor is given, what it says, and what a critic says of that.

::

    Evidence ─► Actor.predict ─► Prediction ─► Critic.judge ─► Verdict

Everything is in one frame, ``o``: the frame of the object in which its parts were baked with every
joint at 0. It is the world of the camera too. z is up, the object stands on z = 0, and its front is
+x where the source of the object knows a front. Joints of an actor are those of a URDF.
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
"""What a critic may say, in the order in which failures are attributed."""
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
class Tracks:
    """Points followed through a clip."""

    uv: Array
    """Pixels (T, N, 2), OpenCV's coordinates."""
    visible: NDArray[np.bool_]
    """Whether the point is seen (T, N)."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Evidence:
    """Everything an actor may know of an object. Nothing in it tells a joint."""

    modality: Modality
    parts: tuple[PartMesh, ...]
    """The parts, in a meaningless order. Baked into the frame ``o`` if ``placed``; else each is
    moved so that the middle of its box is the origin, and where it belongs is asked."""
    labels: Mapping[str, str] = field(default_factory=dict)
    """What parts are, by their name ("drawer", "door 2"); empty where the modality says nothing."""
    placed: bool = True
    """Whether the parts are where they belong."""
    video: Pixels | None = None
    """Frames (T, H, W, 3) in which something moves; None without video."""
    times_s: Array | None = None
    """Time of each frame (T,) [s]."""
    image: Pixels | None = None
    """One picture of the object (H, W, 3); None without one."""
    camera: Camera | None = None
    """Camera of the clip or picture, in the frame ``o``; None if it must be estimated."""
    text: str = ""
    """What a person said of the object; may be empty."""
    tracks: Tracks | None = None
    """Points that were followed before; None leaves that to the actor."""
    seed: int = 0
    """Seed of everything random that the actor does."""

    def part(self, name: str) -> PartMesh:
        """The part called ``name``; KeyError if there is none."""
        for part in self.parts:
            if part.name == name:
                return part
        raise KeyError(name)


@dataclass(frozen=True, kw_only=True)
class PredictedJoint:
    """One joint that an actor says there is."""

    part: str
    """Name of the part that moves."""
    parent: str | None
    """Name of the part that it moves against; None for what stands still."""
    kind: JointKind
    """``fixed`` says that the part does not move against its parent."""
    axis_o: tuple[float, float, float] = (0.0, 0.0, 1.0)
    """Direction of sliding or of the axis; need not be of unit length."""
    pivot_o: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """A point on the axis [m]; of no meaning for a slide."""
    lower: float | None = None
    """Lower limit [m or rad], 0 being the pose in which the parts were given; None: no limit."""
    upper: float | None = None
    """Upper limit [m or rad]."""
    confidence: float = 1.0
    """How sure the actor is, in [0, 1]."""

    def T_o(self, q: ArrayLike) -> Array:
        """What moving the joint from 0 to ``q`` (...) does to the part, (..., 4, 4), in ``o``."""
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
    """What a critic says of a prediction."""

    failure: Failure
    """``success``, or the first thing that is wrong."""
    rating: float
    """0 to 10; above :data:`GOOD_ENOUGH` the loop stops."""
    reason: str = ""
    """One sentence: what was seen."""
    figures: Mapping[str, float] = field(default_factory=dict)
    """What was measured, by name with unit."""
    images: Mapping[str, bytes] = field(default_factory=dict)
    """Evidence by caption, as WebP or PNG."""
    trace: tuple[TraceStep, ...] = ()
    """How it came about."""
    calls: int = 0
    """Calls of models over a network."""


@dataclass(frozen=True, kw_only=True)
class ActorAttempt:
    """One turn of the loop: what was proposed and what the critic said."""

    joints: tuple[PredictedJoint, ...]
    verdict: Verdict | None = None
    """None where no critic looked."""
    seconds: float = 0.0
    """Time this turn took [s]."""


@dataclass(frozen=True, kw_only=True)
class TraceStep:
    """One stage of an actor's work, for people to read."""

    title: str
    text: str = ""
    figures: Mapping[str, float] = field(default_factory=dict)
    images: Mapping[str, bytes] = field(default_factory=dict)
    """By caption, as WebP or PNG."""
    seconds: float = 0.0


@dataclass(frozen=True, kw_only=True)
class Prediction:
    """What an actor says about an object."""

    joints: tuple[PredictedJoint, ...]
    """At most one for each part; parts that are not named do not move."""
    placements: Mapping[str, Array] = field(default_factory=dict)
    """Where each part belongs, ``T_op`` (4, 4) from the given part to ``o``, by name; empty where
    the parts were given in their places."""
    rating: float | None = None
    """The critic's rating of what is said, 0 to 10; None without a critic."""
    verdict: Verdict | None = None
    """The critic's whole verdict; None without a critic."""
    attempts: tuple[ActorAttempt, ...] = ()
    """Every turn in order; what stands in ``joints`` is the one the actor's own critic kept."""
    trace: tuple[TraceStep, ...] = ()
    """How it came about."""
    calls: int = 0
    """Calls of models over a network."""
    rejection: str = ""
    """Why nothing is said, one sentence; empty where something is."""
    program: str = ""
    """Source in the language of :mod:`articulate.reconstruct.program`, where the actor wrote one."""


class Actor(Protocol):
    """Finds joints, and where parts belong where that is asked."""

    @property
    def name(self) -> str:
        """Name in reports."""
        ...

    def predict(self, evidence: Evidence) -> Prediction:
        """What the evidence says of the object's joints."""
        ...


class Critic(Protocol):
    """Judges a prediction by the evidence alone."""

    @property
    def name(self) -> str:
        """Name in reports."""
        ...

    def assess(self, evidence: Evidence, prediction: Prediction) -> Verdict:
        """What is wrong with the prediction, if anything is."""
        ...
