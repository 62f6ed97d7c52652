"""What running a program gives: poses of parts and joints, plain data in the world's frame."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from typing import Literal

from articulate.assets.asset import Quat, Vec3

SCHEMA = "articulate.program"
SCHEMA_VERSION = 1
JointKind = Literal["fixed", "revolute", "continuous", "prismatic"]


@dataclass(frozen=True, kw_only=True)
class ObjectPart:
    """Where a part is while every joint is at 0."""

    name: str
    pos_w: Vec3
    """Origin of the part's own frame in the world [m]."""
    quat_w: Quat
    """Rotation of the part's own frame in the world, wxyz."""
    material: str
    """Key of the table of materials."""
    geometry: bool = True
    """False for a link that the program added."""


@dataclass(frozen=True, kw_only=True)
class ObjectJoint:
    """One joint, at its position 0."""

    name: str
    kind: JointKind
    child: str
    parent: str
    axis_w: Vec3 | None = None
    """Unit axis in the world; None if fixed."""
    pivot_w: Vec3 | None = None
    """A point on the axis in the world [m]; None: the part's own origin."""
    lower: float | None = None
    """Lower limit [m or rad]; None: not known, or none."""
    upper: float | None = None
    damping: float | None = None
    """Viscous damping [N s/m or Nm s/rad]; None: by the table."""
    friction: float | None = None
    """Dry friction [N or Nm]; None: by the table."""
    mimic: tuple[str, float, float] | None = None
    """Joint that is followed, multiplier, offset."""


@dataclass(frozen=True, kw_only=True)
class PlacementRecord:
    """What one ``place_relative_to`` did."""

    child: str
    parent: str
    placement: str
    clearance: float
    """Gap that was asked for [m]."""
    moved_m: Vec3
    """Way of the child in the world [m]."""
    touches: bool
    """Whether it was moved up to a contact."""
    checked_by: tuple[str, ...]
    """Which checks for contact were made: ``sweep``, ``pybullet``."""


@dataclass(frozen=True, kw_only=True)
class ProgramObject:
    """A whole object, as a program describes it."""

    root: str
    """The part that stands still."""
    parts: tuple[ObjectPart, ...]
    """All parts, in the order in which they were given, then frames."""
    joints: tuple[ObjectJoint, ...]
    """One for each part but the root."""
    placed: tuple[PlacementRecord, ...] = ()
    notes: tuple[str, ...] = ()
    """What was decided for the program, one sentence each."""
    layers: tuple[str, ...] = ()
    """Layers of the sandbox that were active while the program ran."""

    def json(self) -> str:
        """All of it as JSON text."""
        content = {"schema": SCHEMA, "schema_version": SCHEMA_VERSION, **asdict(self)}
        return json.dumps(content, indent=1, allow_nan=False) + "\n"


@dataclass(frozen=True)
class ProgramError:
    """Why a program gives nothing: a value to be shown to its author, not an exception."""

    line: int
    """From 1; 0 if no line is to blame."""
    column: int
    """From 1; 0 if no column is to blame."""
    message: str
    """What is wrong and what to write instead."""
    kind: str = "guard"
    """``syntax``, ``guard``, ``value`` (a call refused it), ``limit`` (time, memory, size)."""
    layers: tuple[str, ...] = ()
    """Layers of the sandbox that were active."""

    def __str__(self) -> str:
        where = f"line {self.line}, column {self.column}: " if self.line else ""
        return f"{where}{self.message}"
