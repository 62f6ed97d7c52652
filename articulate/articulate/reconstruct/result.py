"""Request, record and result of a reconstruction."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from articulate.assets.check_report import CheckReport
from articulate.reconstruct.actors.protocol import PredictedJoint, Prediction
from articulate.reconstruct.actors.vlm.options import ModelOptions
from articulate.reconstruct.part_set import PartSet
from articulate.reconstruct.query import Query
from articulate.render.camera import Camera

Verdict = Literal["passed", "doubtful", "rejected", "undecided"]
"""``doubtful``: the checks passed, but it may not be the intended object."""
SCHEMA, SCHEMA_VERSION = "articulate.made", 2
MADE_FILE, TRACE_FILE, RECORDING_FILE = "made.json", "trace.html", "trace.rrd"
URDF_FILE = "object.urdf"
PROGRAM_FOLDER = "program"
"""Folder for the program and its URDF."""


def _ignore(stage: str) -> None:
    """Report nothing."""


@dataclass(frozen=True, kw_only=True)
class MakeRequest:
    """Settings of a reconstruction."""

    out: Path
    """Folder of the result; an earlier result there is replaced."""
    cache: Path
    """Folder of the cache for checked assets."""
    actor: str = "auto"
    """Name of the actor; ``auto``: the default of the modality."""
    models: ModelOptions = field(default_factory=ModelOptions)
    """Settings of the actor's models."""
    joint: str = "auto"
    """``auto``: joints in the video, else all; ``all``; or the part whose joint is requested."""
    iterations: int | None = None
    """Most proposals of the actor; None: its default."""
    limit_s: float = 300.0
    """Processor time after which the check ends as undecided [s]."""
    seed: int = 0
    """Seed of all random numbers."""
    progress: Callable[[str], None] = _ignore
    """Function that reports each stage of the checks."""


@dataclass(frozen=True, kw_only=True, eq=False)
class MakeRecord:
    """Inputs and intermediate results, for the trace."""

    part_set: PartSet
    query: Query
    camera: Camera
    actor: str
    prediction: Prediction
    root: str
    part_joints: Mapping[str, PredictedJoint]
    """The joint of every part but the root."""
    program: str
    layers: tuple[str, ...]
    """Layers of the sandbox that were active."""
    seconds: Mapping[str, float]
    """Time of each stage [s]."""

    @property
    def moving(self) -> list[PredictedJoint]:
        """Joints that move."""
        return [joint for joint in self.part_joints.values() if joint.kind != "fixed"]


@dataclass(frozen=True, kw_only=True)
class MakeResult:
    """Result of a reconstruction."""

    verdict: Verdict
    reasons: tuple[str, ...]
    """Reasons for a verdict other than ``passed``."""
    out: Path
    joints: tuple[PredictedJoint, ...]
    check_report: CheckReport
    rating: float | None
    """Rating of the critic; None without a critic."""
    seconds: float
    recording: bool = False
    """True if there is a recording for rerun."""
    program: bool = True
    """True if the object was made by a program; False for a generated object."""
    category: str = ""
    """PartNet-Mobility's name of the category of a generated object."""
    confidence: float | None = None
    """Probability that a generated object is the intended one, in [0, 1]."""
    evidence: Mapping[str, str] = field(default_factory=dict)
    """Origin of each joint of a generated object, by part: text, image, video or category."""
    assumptions: tuple[str, ...] = ()
    """Values of a generated object that the query does not give."""

    def content(self) -> dict[str, Any]:
        """Return the content of ``made.json`` and of ``--json``."""
        return {
            "schema": SCHEMA,
            "schema_version": SCHEMA_VERSION,
            "verdict": self.verdict,
            "reasons": list(self.reasons),
            "asset": str(self.out),
            "urdf": str(self.out / URDF_FILE) if self.check_report.is_usable else None,
            "program": str(self.out / PROGRAM_FOLDER / "program.py") if self.program else None,
            "check_report": str(self.out / "check_report.html"),
            "trace": str(self.out / TRACE_FILE),
            "recording": str(self.out / RECORDING_FILE) if self.recording else None,
            "check_verdict": self.check_report.verdict,
            "rating": self.rating,
            "joints": [_joint_content(joint, self.evidence) for joint in self.joints],
            "category": self.category or None,
            "confidence": self.confidence,
            "assumptions": list(self.assumptions),
            "seconds": round(self.seconds, 3),
        }


def _joint_content(joint: PredictedJoint, evidence: Mapping[str, str]) -> dict[str, Any]:
    return {
        "part": joint.part,
        "parent": joint.parent,
        "type": joint.kind,
        "axis": list(joint.axis_o),
        "pivot": list(joint.pivot_o),
        "lower": joint.lower,
        "upper": joint.upper,
        "confidence": round(joint.confidence, 3),
        "evidence": evidence.get(joint.part),
    }
