"""Pose of a fixed camera in the base frame of the robot, from a marker on the gripper.

The arm takes several poses; in each the camera measures the marker. Known are the pose of the tool
in the base frame ``T_wt`` and that of the marker in the camera frame ``T_cm``. Unknown are the pose
of the marker on the tool ``T_tm`` and that of the camera ``T_wc``. In every pose
``T_wt T_tm = T_wc T_cm``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from articulate.errors import UsageError
from articulate.markers.camera_calibration import CameraCalibration, CameraPose
from articulate.markers.layout import SQUARE
from articulate.markers.object_fit import rotation_vector
from articulate.transforms import (
    Array,
    apply,
    axis_angle_to_matrix,
    inverse,
    matrix_to_quat,
    normalised,
    pose,
)

MIN_POSES = 8
"""Arm poses that a calibration needs."""
MIN_TURN_RAD = 0.35
"""Least rotation between poses, about two different axes."""
MAX_ERROR_M = 0.01
"""Largest root mean square position error [m]."""
ITERATIONS = 30
"""Iterations of the refinement."""
HUBER_PX = 1.5
"""Residual of a corner above which its weight falls [px]."""


@dataclass(frozen=True, eq=False)
class GripperView:
    """Marker on the gripper in one image."""

    name: str
    """Name of the image."""
    T_wt: Array
    """Pose of the tool in the base frame (4, 4) [m]."""
    T_cm: Array
    """Pose of the marker in the camera frame (4, 4) [m]."""
    corners: Array
    """Corners of the marker in the image (4, 2) [px]."""


def park_martin(motions_a: Sequence[Array], motions_b: Sequence[Array]) -> Array:
    """Return X of ``A X = X B`` for pairs of motions (4, 4) [m].

    F. Park and B. Martin, "Robot sensor calibration: solving AX = XB on the Euclidean group",
    IEEE Trans. Robotics and Automation 10(5), 1994: the rotation aligns the rotation vectors of the
    motions, then the translation is linear.

    Args:
        motions_a: Motions A.
        motions_b: Motions B, one for each A.
    """
    M = np.zeros((3, 3))
    for A, B in zip(motions_a, motions_b, strict=True):
        M += np.outer(rotation_vector(B[:3, :3]), rotation_vector(A[:3, :3]))
    U, _, Vt = np.linalg.svd(M)
    R = Vt.T @ np.diag([1.0, 1.0, np.sign(np.linalg.det(Vt.T @ U.T))]) @ U.T
    left = np.concatenate([A[:3, :3] - np.eye(3) for A in motions_a])
    right = np.concatenate(
        [R @ B[:3, 3] - A[:3, 3] for A, B in zip(motions_a, motions_b, strict=True)]
    )
    return pose(np.linalg.lstsq(left, right, rcond=None)[0], R)


def calibrate_base(
    views: Sequence[GripperView], calibration: CameraCalibration, size_m: float
) -> tuple[CameraPose, Array]:
    """Return the pose of the camera in the base frame and that of the marker on the tool (4, 4).

    Park and Martin's solution starts a least squares over the corners of all images.

    Args:
        views: Marker and arm in several poses.
        calibration: Intrinsics of the camera.
        size_m: Side of the marker [m].

    Raises:
        UsageError: The poses are too few or too similar, or do not agree.
    """
    if len(views) < MIN_POSES:
        raise UsageError(
            f"the marker is visible in {len(views)} arm poses; at least {MIN_POSES} are needed"
        )
    _check_rotations(views)
    pairs = [(a, b) for k, a in enumerate(views) for b in views[k + 1 :]]
    motions_a = [inverse(b.T_wt) @ a.T_wt for a, b in pairs]
    motions_b = [inverse(b.T_cm) @ a.T_cm for a, b in pairs]
    T_tm = park_martin(motions_a, motions_b)
    T_wc = _mean_pose([view.T_wt @ T_tm @ inverse(view.T_cm) for view in views])
    T_wc, T_tm = _refined(views, calibration, size_m, T_wc, T_tm)
    shift, turn = _errors(views, T_wc, T_tm)
    if shift > MAX_ERROR_M:
        raise UsageError(
            f"the poses disagree by {1000 * shift:.0f} mm, more than {1000 * MAX_ERROR_M:.0f}; "
            "check the size of the marker, that it is fixed to the gripper, and that the joint "
            "angles belong to the images"
        )
    x, y, z = T_wc[:3, 3]
    quat = matrix_to_quat(T_wc[:3, :3])
    found = CameraPose(
        camera=calibration.camera,
        pos_w=(float(x), float(y), float(z)),
        quat_w=(float(quat[0]), float(quat[1]), float(quat[2]), float(quat[3])),
        error_m=shift,
        error_rad=turn,
        poses=len(views),
    )
    return found, T_tm


def _check_rotations(views: Sequence[GripperView]) -> None:
    """Raise UsageError unless the tool was rotated about two axes."""
    vectors = np.stack(
        [rotation_vector(inverse(views[0].T_wt)[:3, :3] @ view.T_wt[:3, :3]) for view in views]
    )
    values = np.linalg.svd(vectors - vectors.mean(axis=0), compute_uv=False)
    spread = values[1] / np.sqrt(len(views)) * 2.0
    if spread < MIN_TURN_RAD:
        raise UsageError(
            f"the arm poses differ by {np.degrees(spread):.0f} degrees about their second axis; "
            "rotate the gripper by 20 to 40 degrees about two different axes"
        )


def _mean_pose(poses: Sequence[Array]) -> Array:
    """Return the mean (4, 4) [m] of similar poses."""
    stack = np.stack(poses)
    U, _, Vt = np.linalg.svd(stack[:, :3, :3].mean(axis=0))
    R = U @ np.diag([1.0, 1.0, np.sign(np.linalg.det(U @ Vt))]) @ Vt
    return pose(np.median(stack[:, :3, 3], axis=0), R)


def _refined(
    views: Sequence[GripperView],
    calibration: CameraCalibration,
    size_m: float,
    T_wc: Array,
    T_tm: Array,
) -> tuple[Array, Array]:
    """Return both poses after Levenberg-Marquardt over the corners of all images."""
    points_m = size_m * SQUARE
    observed = calibration.undistorted(np.stack([view.corners for view in views]))
    tools = np.stack([view.T_wt for view in views])
    scale = calibration.focal_px

    def residuals(x: Array) -> Array:
        T_cw = inverse(_moved(T_wc, x[:6]))
        points_c = apply((T_cw @ tools @ _moved(T_tm, x[6:]))[:, None], points_m)
        z = np.maximum(points_c[..., 2:], 1e-6)
        return np.asarray(scale * (points_c[..., :2] / z - observed)).ravel()

    def weights(r: Array) -> Array:
        size = np.repeat(np.linalg.norm(r.reshape(-1, 2), axis=1), 2)
        return np.asarray(np.minimum(1.0, HUBER_PX / np.maximum(size, 1e-12)))

    x, damping = np.zeros(12), 1e-3
    r = residuals(x)
    for _ in range(ITERATIONS):
        steps = 1e-6 * np.eye(12)
        J = np.stack([(residuals(x + s) - residuals(x - s)) / 2e-6 for s in steps], axis=1)
        w = weights(r)
        H, g = (J * w[:, None]).T @ J, J.T @ (w * r)
        step = np.linalg.solve(H + damping * np.diag(np.diag(H)), -g)
        new = residuals(x + step)
        if (w * new**2).sum() < (w * r**2).sum():
            x, r, damping = x + step, new, 0.3 * damping
            if float(np.linalg.norm(step)) < 1e-9:
                break
        else:
            damping *= 10.0
    return _moved(T_wc, x[:6]), _moved(T_tm, x[6:])


def _moved(T: Array, step: Array) -> Array:
    """Return a pose (4, 4) moved by a translation and a rotation vector (6,) in its axes."""
    angle = float(np.linalg.norm(step[3:]))
    return np.asarray(T @ pose(step[:3], axis_angle_to_matrix(normalised(step[3:]), angle)))


def _errors(views: Sequence[GripperView], T_wc: Array, T_tm: Array) -> tuple[float, float]:
    """Return root mean square errors of the marker: position [m] and rotation [rad]."""
    shifts, turns = [], []
    for view in views:
        error = inverse(view.T_wt @ T_tm) @ T_wc @ view.T_cm
        shifts.append(float(error[:3, 3] @ error[:3, 3]))
        turns.append(float(np.sum(rotation_vector(error[:3, :3]) ** 2)))
    return float(np.sqrt(np.mean(shifts))), float(np.sqrt(np.mean(turns)))
