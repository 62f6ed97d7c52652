"""What was asked for, what happened, and what came of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from articulate.assets.check_report import CheckReport
from articulate.reconstruct.actors.protocol import PredictedJoint, Prediction
from articulate.reconstruct.part_set import PartSet
from articulate.reconstruct.query import Query
from articulate.render.camera import Camera

Verdict = Literal["passed", "doubtful", "unproven"]
SCHEMA, SCHEMA_VERSION = "articulate.made", 1
MADE_FILE, TRACE_FILE, RECORDING_FILE = "made.json", "trace.html", "trace.rrd"
URDF_FILE = "object.urdf"
PROGRAM_FOLDER = "program"
"""Folder for the program and what was compiled from it."""


@dataclass(frozen=True, kw_only=True)
class MakeRequest:
    """What is to be made, and how."""

    out: Path
    """Folder that is made; an earlier result there is replaced."""
    cache: Path
    """Where proofs are kept."""
    actor: str = "auto"
    """Name of the actor; ``auto``: by what was given."""
    joint: str = "auto"
    """``auto``: the one that a clip shows, else all; ``all``; or the part whose joint is meant."""
    iterations: int | None = None
    """Most proposals of the actor; None: its own number."""
    limit_s: float = 300.0
    """Time after which the proof is given up [s]."""
    seed: int = 0
    """Seed of all that is random."""


@dataclass(frozen=True, kw_only=True, eq=False)
class MakeRecord:
    """All that happened, for the page."""

    given: PartSet
    question: Query
    camera: Camera
    actor: str
    prediction: Prediction
    root: str
    held: Mapping[str, PredictedJoint]
    """The joint of every part but the root."""
    program: str
    layers: tuple[str, ...]
    """Layers of the sandbox that were active."""
    seconds: Mapping[str, float]
    """Time of each stage [s]."""

    @property
    def moving(self) -> list[PredictedJoint]:
        """Joints that move."""
        return [joint for joint in self.held.values() if joint.kind != "fixed"]


@dataclass(frozen=True, kw_only=True)
class MakeResult:
    """What came of it."""

    verdict: Verdict
    """``doubtful``: proven, but it may not be the object that was shown."""
    reasons: tuple[str, ...]
    """Why it is not proven, or doubtful."""
    out: Path
    joints: tuple[PredictedJoint, ...]
    check_report: CheckReport
    rating: float | None
    """The critic's rating; None without one."""
    seconds: float
    recording: bool = False
    """Whether there is a recording for rerun."""

    def content(self) -> dict[str, Any]:
        """What ``made.json`` holds and ``--json`` prints."""
        return {
            "schema": SCHEMA,
            "schema_version": SCHEMA_VERSION,
            "verdict": self.verdict,
            "reasons": list(self.reasons),
            "asset": str(self.out),
            "urdf": str(self.out / URDF_FILE) if self.check_report.is_usable else None,
            "program": str(self.out / PROGRAM_FOLDER / "program.py"),
            "proof": str(self.out / "check_report.html"),
            "trace": str(self.out / TRACE_FILE),
            "recording": str(self.out / RECORDING_FILE) if self.recording else None,
            "check_verdict": self.check_report.verdict,
            "rating": self.rating,
            "joints": [_joint_content(joint) for joint in self.joints],
            "seconds": round(self.seconds, 3),
        }


def _joint_content(joint: PredictedJoint) -> dict[str, Any]:
    return {
        "part": joint.part,
        "parent": joint.parent,
        "type": joint.kind,
        "axis": list(joint.axis_o),
        "pivot": list(joint.pivot_o),
        "lower": joint.lower,
        "upper": joint.upper,
        "confidence": round(joint.confidence, 3),
    }
