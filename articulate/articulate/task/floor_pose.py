"""Pose of an upright object in the robot's base frame, as a user or a measurement gives it.

A placement file is JSON of the schema ``articulate.object-location``: the fields of
:class:`ObjectLocation`. ``articulate locate`` writes it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from articulate.config import from_mapping, to_plain
from articulate.errors import ConfigError, quote
from articulate.files import write_json
from articulate.transforms import Array, axis_angle_to_matrix, pose
from articulate.untrusted import load_json_object

SCHEMA, SCHEMA_VERSION = "articulate.object-location", 1
MAX_DISTANCE_M = 5.0
"""Largest coordinate of an object that an arm could reach [m]."""


@dataclass(frozen=True, kw_only=True)
class FloorPose:
    """Position and yaw of the frame of an upright object in the base frame of the robot."""

    x_m: float
    """Position of the object's origin in front of the base [m]."""
    y_m: float
    """Position to the left of the base [m]."""
    yaw_deg: float
    """Rotation about the vertical, counterclockwise seen from above [degrees]."""
    z_m: float = 0.0
    """Height of the object's floor above the base [m]."""

    def __post_init__(self) -> None:
        for name in ("x_m", "y_m", "z_m"):
            value = getattr(self, name)
            if not abs(value) <= MAX_DISTANCE_M:
                raise ConfigError(
                    f"placement: {name} is {value:g}; it must be within {MAX_DISTANCE_M:g} m of "
                    "the base"
                )
        if not abs(self.yaw_deg) <= 360.0:
            raise ConfigError(
                f"placement: yaw is {self.yaw_deg:g}; it must be in [-360, 360] degrees"
            )

    @property
    def yaw_rad(self) -> float:
        """Rotation about the vertical [rad]."""
        return math.radians(self.yaw_deg)

    def T_wo(self) -> Array:
        """Return the pose of the object in the base frame (4, 4) [m]."""
        turn = axis_angle_to_matrix(np.array([0.0, 0.0, 1.0]), self.yaw_rad)
        return pose((self.x_m, self.y_m, self.z_m), turn)

    def words(self) -> str:
        """Return the pose as values of ``--placement``."""
        numbers = [self.x_m, self.y_m, self.yaw_deg]
        digits = [3, 3, 1]
        if abs(self.z_m) >= 0.0005:
            numbers.append(self.z_m)
            digits.append(3)
        texts = [f"{number:.{n}f}" for number, n in zip(numbers, digits, strict=True)]
        return " ".join(_short(text) for text in texts)

    def as_tuple(self) -> tuple[float, float, float, float]:
        """Return x [m], y [m], yaw [degrees], z [m]."""
        return (self.x_m, self.y_m, self.yaw_deg, self.z_m)


@dataclass(frozen=True, kw_only=True)
class ObjectLocation:
    """Measured pose of an object, with the quality of the measurement."""

    object: str
    """Name of the asset."""
    pose: FloorPose
    """Pose in the base frame of the robot."""
    camera: str = ""
    """Name of the camera."""
    images: int = 0
    """Number of images."""
    spread_m: float = 0.0
    """Standard deviation of the position over the images [m]."""
    spread_deg: float = 0.0
    """Standard deviation of the yaw over the images [degrees]."""
    lean_deg: float = 0.0
    """Measured rotation of the object's vertical axis from that of the base [degrees]."""
    joints: dict[str, float] = field(default_factory=dict)
    """Measured positions of joints [m or rad]."""


def save_location(path: Path, location: ObjectLocation) -> None:
    """Write a placement file."""
    write_json(path, {"schema": SCHEMA, "schema_version": SCHEMA_VERSION, **to_plain(location)})


def load_location(path: Path) -> ObjectLocation:
    """Read a placement file.

    Raises:
        ConfigError: It cannot be read, or is not a placement file.
    """
    content = load_json_object(path, error=ConfigError)
    schema, version = content.pop("schema", None), content.pop("schema_version", None)
    if schema != SCHEMA or version != SCHEMA_VERSION:
        raise ConfigError(
            f"{path}: schema {quote(schema)} {quote(version)}, not {SCHEMA} {SCHEMA_VERSION}; "
            "write the file with articulate locate"
        )
    return from_mapping(ObjectLocation, content, str(path))


def parse_floor_pose(values: Sequence[float | Path]) -> FloorPose:
    """Return the pose that the values of ``--placement`` give.

    Args:
        values: x [m], y [m], yaw [degrees] and optionally z [m]; or one placement file.

    Raises:
        ConfigError: They are neither.
    """
    if len(values) == 1 and isinstance(values[0], Path):
        return load_location(values[0]).pose
    numbers: list[Any] = [v for v in values if not isinstance(v, Path)]
    if len(numbers) != len(values) or len(numbers) not in (3, 4):
        text = " ".join(str(v) for v in values)
        raise ConfigError(
            f"--placement is {quote(text)}; it must be x y yaw [m m degrees], optionally with a "
            "height z [m], or a file from articulate locate"
        )
    x, y, yaw, *z = numbers
    return FloorPose(x_m=x, y_m=y, yaw_deg=yaw, z_m=z[0] if z else 0.0)


def _short(text: str) -> str:
    """Return a decimal number without trailing zeros and without "-0"."""
    text = text.rstrip("0").rstrip(".") if "." in text else text
    return "0" if text in ("-0", "") else text
