"""An object as its file describes it: links, joints and geometry as plain data.

The readers of URDF, SDF and MJCF all return a :class:`SourceObject`. Lengths are in units of the
file, angles in radians.
"""

from __future__ import annotations

import itertools
from collections.abc import Container, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from articulate.errors import AssetError
from articulate.formats.repairs import Repairs
from articulate.transforms import Array

MAX_LINKS = 400
"""Most links of an object."""
MAX_JOINTS = 400
"""Most joints of an object."""
MAX_GEOMETRIES = 5_000
"""Most visual and collision elements of an object."""
LARGEST = 1e9
"""Masses, limits and coefficients of this size or more are ignored."""
JOINT_KINDS = ("revolute", "continuous", "prismatic", "fixed", "planar", "floating", "screw")

Rgba = tuple[float, float, float, float]
"""Red, green, blue and opacity, each in [0, 1]."""


@dataclass(frozen=True, kw_only=True)
class SourceGeometry:
    """One visual or collision element."""

    kind: Literal["mesh", "box", "cylinder", "sphere", "capsule"]
    name: str
    T_lg: Array
    """Pose of the geometry in its link (4, 4)."""
    size: tuple[float, ...] = ()
    """Full sides of a box; radius and length of a cylinder or capsule; radius of a sphere."""
    filename: str = ""
    scale: tuple[float, float, float] = (1.0, 1.0, 1.0)
    triangles: Array | None = None
    """Corners (N, 3, 3) of a mesh in the file itself; replaces ``filename``."""
    rgba: Rgba | None = None
    texture: str = ""
    """Image that the file names for a mesh without a colour."""
    where: str = ""
    """File and line, for messages."""


@dataclass(frozen=True, kw_only=True)
class SourceInertial:
    """Mass, centre of mass and inertia from the file."""

    mass: float
    """Mass [kg]."""
    T_li: Array
    """Pose of the inertial frame in the link (4, 4)."""
    inertia: Array
    """Inertia about the centre of mass in the inertial frame (3, 3)."""


@dataclass(frozen=True, kw_only=True)
class SourceLink:
    """One ``<link>``."""

    name: str
    visuals: tuple[SourceGeometry, ...] = ()
    collisions: tuple[SourceGeometry, ...] = ()
    inertial: SourceInertial | None = None


@dataclass(frozen=True, kw_only=True)
class SourceJoint:
    """One ``<joint>``."""

    name: str
    kind: str
    """One of ``JOINT_KINDS``."""
    parent: str
    child: str
    T_pc: Array
    """Pose of the child in its parent with the joint at 0 (4, 4)."""
    axis: tuple[float, float, float] = (1.0, 0.0, 0.0)
    """Direction in the frame of the child."""
    lower: float | None = None
    upper: float | None = None
    damping: float | None = None
    friction: float | None = None
    armature: float | None = None
    """Inertia added to the joint [kg or kg m2]; URDF has none."""
    mimic: tuple[str, float, float] | None = None
    """Leading joint, multiplier, offset."""
    pitch: float | None = None
    """Travel of a screw along its axis for one turn."""
    where: str = ""
    """File and line, for messages."""


@dataclass(frozen=True, kw_only=True)
class SourceObject:
    """Content of a URDF, SDF or MJCF file."""

    name: str
    path: Path
    links: dict[str, SourceLink]
    joints: tuple[SourceJoint, ...]
    repairs: Repairs = field(default_factory=Repairs)
    files: Mapping[str, Path] = field(default_factory=dict)
    """Files read in addition to ``path`` and the meshes, by reference."""


def check_counts(path: Path, links: int, joints: int, geometries: int) -> None:
    """Reject an object of too many elements, before they are processed.

    Raises:
        AssetError: There are more links, joints or geometries than accepted.
    """
    for count, most, name in (
        (links, MAX_LINKS, "links"),
        (joints, MAX_JOINTS, "joints"),
        (geometries, MAX_GEOMETRIES, "visual and collision elements"),
    ):
        if count > most:
            raise AssetError(f"{path}: {count} {name}; at most {most} are accepted")


def free_name(name: str, used: Container[str]) -> str:
    """Return ``name``, or ``name`` with the first number from 2 on that is not ``used``."""
    names = itertools.chain([name], (f"{name}_{i}" for i in itertools.count(2)))
    return next(candidate for candidate in names if candidate not in used)
