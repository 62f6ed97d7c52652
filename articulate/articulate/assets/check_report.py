"""Result of the checks of an asset: verdict, reasons, repairs and every measurement."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Outcome = Literal["passed", "failed", "warning", "undecided", "not_applicable"]
"""``warning`` exceeds the limit and is accepted, ``undecided`` could not be measured."""
Verdict = Literal["passed", "repaired", "rejected", "undecided"]
VERDICTS: tuple[Verdict, ...] = ("passed", "repaired", "rejected", "undecided")


@dataclass(frozen=True, kw_only=True)
class Check:
    """One measurement, on one joint, link or the complete asset."""

    name: str
    """Name of the check, a key of :data:`articulate.checks.descriptions.CHECKS`."""
    outcome: Outcome
    """Result of comparing ``measured`` with ``allowed``."""
    subject: str = ""
    """Joint or link that was measured; empty for the complete asset."""
    measured: float | None = None
    """Measured value in ``unit``."""
    allowed: float | None = None
    """Limit that ``measured`` is compared with, in ``unit``."""
    unit: str = ""
    """Unit of both; ``"1"`` for fractions."""
    message: str = ""
    """One sentence: what was measured, and for a failure a possible remedy."""


@dataclass(frozen=True, kw_only=True)
class JointCheck:
    """Summary of the checks of one movable joint."""

    name: str
    """Name of the joint."""
    kind: Literal["slide", "hinge"]
    """``slide`` measures metres, ``hinge`` radians."""
    span: float
    """Signed travel from closed to open [m or rad]."""
    lower: float | None = None
    """Lower limit in the written files [m or rad]; None for a joint that turns without end."""
    upper: float | None = None
    """Upper limit in the written files [m or rad]; None for a joint that turns without end."""
    swept: float
    """Fraction of the travel before the first interference, in [0, 1]."""
    blocked: bool
    """True if the part interferes with another one on the travel."""
    needs: tuple[str, ...] = ()
    """Joints that must be open before this one can move."""
    opened: float | None = None
    """Fraction of the travel that a bounded force opened; None if it was not tried."""


@dataclass(frozen=True, kw_only=True)
class Counts:
    """Numbers of elements in the input and in the asset."""

    links: tuple[int, int]
    joints: tuple[int, int]
    visuals: tuple[int, int]
    collisions: tuple[int, int]


@dataclass(frozen=True, kw_only=True)
class CheckReport:
    """Verdict on one asset with the measurements behind it."""

    asset: str
    """Name of the asset, or of the input if no asset could be made."""
    verdict: Verdict
    """``repaired``: passed after the listed repairs, or with a warning. ``undecided``: no
    statement about the object, for example because the time limit ended the check."""
    reasons: tuple[str, ...] = ()
    """Reasons for ``rejected`` and ``undecided``, one sentence each."""
    repairs: tuple[str, ...] = ()
    """Everything that was changed from the input, one sentence each."""
    checks: tuple[Check, ...] = ()
    """All measurements."""
    joints: tuple[JointCheck, ...] = ()
    """The movable joints."""
    counts: Counts | None = None
    """Numbers of elements before and after conversion."""
    source: str = "unknown"
    """Origin of the object."""
    licence: str = "unknown"
    """Licence of the object."""
    colliders: int = 0
    """Number of collision geoms of the asset."""
    step_us: float | None = None
    """Median time of one physics step of the asset [us]."""
    seconds: float = 0.0
    """Time of conversion and checks [s]."""

    @property
    def is_usable(self) -> bool:
        """True if the verdict is ``passed`` or ``repaired``."""
        return self.verdict in ("passed", "repaired")
