"""Arm poses for the calibration of a camera's pose.

A JSON file, with images relative to it::

    {"robot": "panda", "poses": [{"image": "00.png", "q": [0, -0.8, 0, -2.4, 0, 1.6, 0.8]}, ...]}
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from articulate.config import from_mapping
from articulate.errors import ConfigError
from articulate.markers.base_calibration import GripperView
from articulate.markers.camera_calibration import CameraCalibration
from articulate.markers.camera_device import read_gray
from articulate.markers.detection import MarkerDetector, marker_poses
from articulate.robot.arm import arm_named
from articulate.robot.kinematics import tool_pose
from articulate.untrusted import load_json_object

MAX_POSES = 500
"""Most poses in a file."""


@dataclass(frozen=True, kw_only=True)
class PoseEntry:
    """One image and the joint angles of the arm in it."""

    image: Path
    """Image, relative to the file."""
    q: tuple[float, ...]
    """Joint angles (7,) [rad]."""


@dataclass(frozen=True, kw_only=True)
class PoseList:
    """Arm poses of a calibration."""

    poses: tuple[PoseEntry, ...]
    """Images and joint angles."""
    robot: str = "panda"
    """Arm; an FR3 has the dimensions of a Panda."""


def load_gripper_views(
    path: Path, calibration: CameraCalibration, marker: int, size_m: float, dictionary: str
) -> tuple[list[GripperView], int]:
    """Return the views in which the marker is visible, and the number of poses.

    Args:
        path: File of poses.
        calibration: Intrinsics of the camera.
        marker: Identifier of the marker on the gripper.
        size_m: Side of the marker [m].
        dictionary: Dictionary of the marker.

    Raises:
        ConfigError: The file or an image cannot be used, or an image has another size than the
            calibration.
    """
    content = from_mapping(PoseList, load_json_object(path, error=ConfigError), str(path))
    if len(content.poses) > MAX_POSES:
        raise ConfigError(f"{path}: {len(content.poses)} poses; at most {MAX_POSES} are accepted")
    arm, detector = arm_named(content.robot), MarkerDetector(dictionary)
    views = []
    for k, entry in enumerate(content.poses):
        if len(entry.q) != 7 or not np.isfinite(entry.q).all():
            raise ConfigError(f"{path}: poses[{k}].q must be 7 joint angles [rad]")
        image = read_gray(path.parent / entry.image)
        calibration.check_image(image.shape[0], image.shape[1], str(entry.image))
        corners = detector.detect(image).get(marker)
        if corners is None:
            continue
        found = marker_poses(corners, size_m, calibration.K, calibration.dist)
        if found:
            T_wt = tool_pose(arm, np.array(entry.q))
            views.append(GripperView(str(entry.image), T_wt, found[0].T_cm, corners))
    return views, len(content.poses)
