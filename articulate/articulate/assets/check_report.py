"""The noun Proof: what was found out about an asset, clause by clause."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Outcome = Literal["passed", "failed", "not_applicable"]
Verdict = Literal["proven", "repaired", "refused"]


@dataclass(frozen=True, kw_only=True)
class Check:
    """One thing that was measured, on one joint, link or the whole asset."""

    name: str
    """Name of the clause, a key of :data:`articulate.checks.descriptions.CLAUSES`."""
    outcome: Outcome
    """What came of it."""
    subject: str = ""
    """Joint or link that it is about; empty for the whole asset."""
    measured: float | None = None
    """The figure that decides, in ``unit``."""
    allowed: float | None = None
    """What it is compared with, in ``unit``."""
    unit: str = ""
    """Unit of both; ``"1"`` for shares."""
    message: str = ""
    """One sentence: what was found, and for a failure what would mend it."""


@dataclass(frozen=True, kw_only=True)
class JointCheck:
    """What was found out about one movable joint."""

    name: str
    """Name of the joint."""
    kind: Literal["slide", "hinge"]
    """``slide`` measures metres, ``hinge`` radians."""
    span: float
    """Signed way from closed to open [m or rad]."""
    swept: float
    """Share of the way that it went without being blocked, in [0, 1]."""
    blocked: bool
    """Whether something stands in its way."""
    needs: tuple[str, ...] = ()
    """Joints that must be open before this one can move."""
    opened: float | None = None
    """Share of the way that a bounded force opened; None if it was not tried."""


@dataclass(frozen=True, kw_only=True)
class Counts:
    """How many there were in the input and are in the asset."""

    links: tuple[int, int]
    joints: tuple[int, int]
    visuals: tuple[int, int]
    collisions: tuple[int, int]


@dataclass(frozen=True, kw_only=True)
class CheckReport:
    """Evidence about one asset, or why there is none."""

    asset: str
    """Name of the asset, or of the input where none could be made of it."""
    verdict: Verdict
    """``repaired`` means proven after the listed repairs."""
    reasons: tuple[str, ...] = ()
    """Why it was refused, one sentence each."""
    repairs: tuple[str, ...] = ()
    """Everything that was changed on the way from the input, one sentence each."""
    clauses: tuple[Check, ...] = ()
    """All that was measured."""
    joints: tuple[JointCheck, ...] = ()
    """The movable joints."""
    counts: Counts | None = None
    """What went in and came out."""
    source: str = "unknown"
    """Where the object came from."""
    licence: str = "unknown"
    """Its licence."""
    colliders: int = 0
    """Collision geoms of the asset."""
    step_us: float | None = None
    """Median time of a physics step of the asset alone [us]."""
    seconds: float = 0.0
    """Time that conversion and proof took [s]."""
