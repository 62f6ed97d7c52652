"""Calibration of a camera: intrinsics file, and pose of the camera in the robot's base frame."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import cv2
import numpy as np

from articulate.config import from_mapping, to_plain
from articulate.errors import ConfigError, quote
from articulate.files import write_json
from articulate.transforms import Array, inverse, pose, quat_to_matrix
from articulate.untrusted import load_json_object

Matrix3 = tuple[tuple[float, float, float], tuple[float, float, float], tuple[float, float, float]]
T = TypeVar("T")
MAX_SIDE_PX = 20_000
"""Largest side of an image [px]."""


@dataclass(frozen=True, kw_only=True)
class CameraCalibration:
    """Intrinsics of one camera at one image size."""

    camera: str
    """Name of the camera, chosen by the user."""
    width_px: int
    """Width of its images [px]."""
    height_px: int
    """Height of its images [px]."""
    matrix: Matrix3
    """Intrinsic matrix, OpenCV's convention [px]."""
    distortion: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0, 0.0)
    """OpenCV's distortion coefficients k1, k2, p1, p2, k3."""
    error_px: float = 0.0
    """Root mean square reprojection error of the calibration [px]."""
    views: int = 0
    """Number of images of the calibration."""
    coverage: float = 0.0
    """Share of the image area in which board corners were seen, in [0, 1]."""

    def __post_init__(self) -> None:
        if not (1 <= self.width_px <= MAX_SIDE_PX and 1 <= self.height_px <= MAX_SIDE_PX):
            raise ConfigError(
                f"calibration of {quote(self.camera)}: image of {self.width_px}x{self.height_px} "
                f"px; sides must be in [1, {MAX_SIDE_PX}]"
            )
        K = self.K
        ok = K[0, 0] > 0.0 and K[1, 1] > 0.0 and np.array_equal(K[2], (0.0, 0.0, 1.0))
        if not ok or K[1, 0] != 0.0 or not np.isfinite(K).all():
            raise ConfigError(
                f"calibration of {quote(self.camera)}: matrix is not an intrinsic one"
            )
        if len(self.distortion) not in (0, 4, 5, 8):
            raise ConfigError(
                f"calibration of {quote(self.camera)}: {len(self.distortion)} distortion "
                "coefficients; 4, 5 or 8 are accepted"
            )

    @property
    def K(self) -> Array:
        """Intrinsic matrix (3, 3) [px]."""
        return np.array(self.matrix, dtype=np.float64)

    @property
    def dist(self) -> Array:
        """Distortion coefficients (D,)."""
        return np.array(self.distortion, dtype=np.float64)

    @property
    def focal_px(self) -> float:
        """Mean focal length [px]."""
        return 0.5 * (self.matrix[0][0] + self.matrix[1][1])

    def undistorted(self, uv: Array) -> Array:
        """Return coordinates on the plane z = 1 of the camera (..., 2) of pixels (..., 2)."""
        flat = np.ascontiguousarray(uv, dtype=np.float64).reshape(-1, 1, 2)
        criteria = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 40, 1e-9)
        out = cv2.undistortPoints(flat, self.K, self.dist, None, None, None, criteria)
        return np.asarray(out, dtype=np.float64).reshape(np.shape(uv))

    def projected(self, points_c: Array) -> Array:
        """Return pixels (N, 2) of points in the camera frame (N, 3) [m]."""
        zero = np.zeros(3)
        points = np.ascontiguousarray(points_c, dtype=np.float64).reshape(-1, 1, 3)
        out, _ = cv2.projectPoints(points, zero, zero, self.K, self.dist)
        return np.asarray(out, dtype=np.float64).reshape(-1, 2)

    def check_image(self, height_px: int, width_px: int, where: str) -> None:
        """Raise ConfigError unless an image has the size of the calibration.

        Args:
            height_px: Height of the image [px].
            width_px: Width of the image [px].
            where: Origin of the image, for the message.
        """
        if (width_px, height_px) != (self.width_px, self.height_px):
            raise ConfigError(
                f"{where}: images are {width_px}x{height_px} px, but the calibration of "
                f"{quote(self.camera)} is for {self.width_px}x{self.height_px}; set the camera to "
                "that size or calibrate it at this one"
            )

    def check_camera(self, camera: str) -> None:
        """Raise ConfigError unless the calibration is of the camera with the name ``camera``."""
        if camera != self.camera:
            raise ConfigError(
                f"the calibration is of camera {quote(self.camera)}, not {quote(camera)}; "
                "calibrate this camera: articulate calibrate camera"
            )


@dataclass(frozen=True, kw_only=True)
class CameraPose:
    """Pose of a camera in the base frame of the robot."""

    camera: str
    """Name of the camera."""
    pos_w: tuple[float, float, float]
    """Position in the base frame [m]."""
    quat_w: tuple[float, float, float, float]
    """Rotation in the base frame, wxyz; z is the view direction, y points down in the image."""
    error_m: float = 0.0
    """Root mean square position error of the marker on the gripper [m]."""
    error_rad: float = 0.0
    """Root mean square rotation error of that marker [rad]."""
    poses: int = 0
    """Number of arm poses of the calibration."""

    def __post_init__(self) -> None:
        numbers = np.array([*self.pos_w, *self.quat_w])
        length = float(np.linalg.norm(self.quat_w))
        if not np.isfinite(numbers).all() or not abs(length - 1.0) < 1e-3:
            raise ConfigError(f"camera pose of {quote(self.camera)}: quat_w is not a unit one")

    @property
    def T_wc(self) -> Array:
        """Pose of the camera in the base frame (4, 4) [m]."""
        return pose(self.pos_w, quat_to_matrix(self.quat_w))

    @property
    def T_cw(self) -> Array:
        """Transform from the base frame to the camera frame (4, 4) [m]."""
        return inverse(self.T_wc)


CALIBRATION_SCHEMA = "articulate.camera-calibration"
CAMERA_POSE_SCHEMA = "articulate.camera-pose"
SCHEMA_VERSION = 1


def save_calibration(path: Path, calibration: CameraCalibration) -> None:
    """Write the calibration as JSON."""
    _save(path, CALIBRATION_SCHEMA, calibration)


def load_calibration(path: Path) -> CameraCalibration:
    """Read a calibration; ConfigError if the file is not one."""
    return _load(path, CALIBRATION_SCHEMA, CameraCalibration, "articulate calibrate camera")


def save_camera_pose(path: Path, found: CameraPose) -> None:
    """Write the pose of a camera as JSON."""
    _save(path, CAMERA_POSE_SCHEMA, found)


def load_camera_pose(path: Path) -> CameraPose:
    """Read the pose of a camera; ConfigError if the file is not one."""
    return _load(path, CAMERA_POSE_SCHEMA, CameraPose, "articulate calibrate base")


def _save(path: Path, schema: str, value: object) -> None:
    write_json(path, {"schema": schema, "schema_version": SCHEMA_VERSION, **to_plain(value)})


def _load(path: Path, schema: str, cls: type[T], command: str) -> T:
    content = load_json_object(path, error=ConfigError)
    name, version = content.pop("schema", None), content.pop("schema_version", None)
    if name != schema or version != SCHEMA_VERSION:
        raise ConfigError(
            f"{path}: schema {quote(name)} {quote(version)}, not {schema} {SCHEMA_VERSION}; "
            f"write the file with {command}"
        )
    return from_mapping(cls, content, str(path))
