"""Result of a program: poses of parts and joints as plain data in the world frame."""

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
    """Pose of a part with every joint at 0."""

    name: str
    pos_w: Vec3
    """Origin of the part's own frame in the world [m]."""
    quat_w: Quat
    """Rotation of the part's own frame in the world, wxyz."""
    material: str
    """Name in the table of materials."""
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
    """Lower limit [m or rad]; None if unknown or unlimited."""
    upper: float | None = None
    damping: float | None = None
    """Viscous damping [N s/m or Nm s/rad]; None: the default of the table."""
    friction: float | None = None
    """Dry friction [N or Nm]; None: the default of the table."""
    mimic: tuple[str, float, float] | None = None
    """Leading joint, multiplier, offset."""


@dataclass(frozen=True, kw_only=True)
class PlacementRecord:
    """Record of one ``place_relative_to``."""

    child: str
    parent: str
    placement: str
    clearance: float
    """Requested gap [m]."""
    moved_m: Vec3
    """Displacement of the child in the world [m]."""
    touches: bool
    """True if it was moved up to a contact."""
    checked_by: tuple[str, ...]
    """Contact checks that were made: ``sweep``, ``pybullet``."""


@dataclass(frozen=True, kw_only=True)
class ProgramObject:
    """An object as a program describes it."""

    root: str
    """Part that does not move."""
    parts: tuple[ObjectPart, ...]
    """All parts in the order of the input, then frames."""
    joints: tuple[ObjectJoint, ...]
    """One for each part but the root."""
    placed: tuple[PlacementRecord, ...] = ()
    notes: tuple[str, ...] = ()
    """Decisions that the program left open, one sentence each."""
    layers: tuple[str, ...] = ()
    """Layers of the sandbox that were active while the program ran."""

    def json(self) -> str:
        """Return the object as JSON text."""
        content = {"schema": SCHEMA, "schema_version": SCHEMA_VERSION, **asdict(self)}
        return json.dumps(content, indent=1, allow_nan=False) + "\n"


@dataclass(frozen=True)
class ProgramError:
    """Error of a program: a value for its author, not an exception."""

    line: int
    """From 1; 0 if no line is known."""
    column: int
    """From 1; 0 if no column is known."""
    message: str
    """The error and an alternative."""
    kind: str = "rule"
    """``syntax``, ``rule``, ``value`` (an invalid argument), ``limit`` (time, memory, size)."""
    layers: tuple[str, ...] = ()
    """Layers of the sandbox that were active."""

    def __str__(self) -> str:
        where = f"line {self.line}, column {self.column}: " if self.line else ""
        return f"{where}{self.message}"
