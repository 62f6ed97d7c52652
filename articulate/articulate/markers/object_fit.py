"""Pose of an object and position of its joint from marker corners in one image.

One least-squares problem over all corners: six numbers of the object's pose in the camera frame and
one of the joint. It is better conditioned than two poses of single markers, whose depths are
uncertain, because the joint's axis is known.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from articulate.markers.camera_calibration import CameraCalibration
from articulate.markers.detection import Detections, marker_poses
from articulate.markers.layout import MarkerModel
from articulate.transforms import Array, Ints, axis_angle_to_matrix, inverse, normalised, pose

SIGMA_PX = 0.25
"""Standard deviation of a coordinate of a corner [px], with errors of print and layout."""
HUBER = 3.0
"""Normalised residual of a corner above which its weight falls."""
MAX_RMS_PX = 3.0
"""Root mean square residual above which an image contradicts the layout [px]."""
RANGE_MARGIN = 0.06
"""Accepted position beyond the joint's range, as a share of it."""
GRID = 33
"""Initial positions of the joint that are tried."""
ITERATIONS = 12
"""Most iterations of the least squares."""


class PosePrior(NamedTuple):
    """Normal distribution of the object's pose in the camera frame."""

    T_co: Array
    """Mean (4, 4) [m]."""
    covariance: Array
    """Covariance (6, 6) of translation [m] and rotation vector [rad] in the object frame."""


@dataclass(frozen=True, eq=False)
class ObjectFit:
    """Result of a fit."""

    T_co: Array
    """Pose of the object in the camera frame (4, 4) [m]."""
    covariance: Array
    """Covariance (6, 6) of translation [m] and rotation vector [rad] in the object frame."""
    q: float | None
    """Position of the joint [m or rad]; None if no marker of the moving part was used."""
    q_std: float
    """Standard deviation of ``q`` [m or rad]; infinite without it."""
    rms_px: float
    """Root mean square residual of the corners [px]."""
    ids: tuple[int, ...]
    """Identifiers of the markers that were used."""


class _Problem(NamedTuple):
    """Corners of one image."""

    points_o: Array  # (N, 3), joint at 0
    moving: Array  # (N,) 0 or 1
    observed: Array  # (N, 2) on the plane z = 1
    scale: float  # residuals to standard deviations
    model: MarkerModel


def fit_object(
    model: MarkerModel,
    calibration: CameraCalibration,
    detections: Detections,
    *,
    prior: PosePrior | None = None,
) -> ObjectFit | None:
    """Return the pose of the object and the position of its joint; None if they are undetermined.

    Without ``prior`` a marker on the body must be visible. Its two possible poses are tried, with
    positions over the joint's range; the solution whose corners fit best within the range counts.

    Args:
        model: Markers and joint.
        calibration: Intrinsics of the camera.
        detections: Corners of the visible markers.
        prior: Pose of the object from earlier images or from a placement.
    """
    rows = [k for k, number in enumerate(model.ids) if number in detections]
    if not rows or (prior is None and all(model.moving[k] for k in rows)):
        return None
    corners = np.stack([detections[model.ids[k]] for k in rows])
    problem = _Problem(
        points_o=model.corners_o[rows].reshape(-1, 3),
        moving=np.repeat([float(model.moving[k]) for k in rows], 4),
        observed=calibration.undistorted(corners).reshape(-1, 2),
        scale=calibration.focal_px / SIGMA_PX,
        model=model,
    )
    starts = [] if prior is None else [prior.T_co]
    if prior is None:
        starts = _starts(model, calibration, detections, rows)
    best: tuple[float, ObjectFit] | None = None
    ids = tuple(model.ids[k] for k in rows)
    for T_co in starts:
        q = _grid_search(problem, T_co) if problem.moving.any() else None
        cost, found = _refined(problem, T_co, q, prior, ids)
        if found is not None and (best is None or cost < best[0]):
            best = (cost, found)
    return None if best is None else best[1]


def _starts(
    model: MarkerModel, calibration: CameraCalibration, detections: Detections, rows: list[int]
) -> list[Array]:
    """Return initial poses of the object (4, 4), two for each visible marker on the body."""
    out = []
    for k in rows:
        if model.moving[k]:
            continue
        T_mo = inverse(square_pose(model.corners_o[k]))
        size = float(model.sizes_m[k])
        found = marker_poses(detections[model.ids[k]], size, calibration.K, calibration.dist)
        out += [candidate.T_cm @ T_mo for candidate in found]
    return out


def square_pose(corners: Array) -> Array:
    """Return the pose (4, 4) [m] of a square with corners (4, 3), upper left first, clockwise."""
    x = normalised(corners[1] - corners[0] + corners[2] - corners[3])
    y = normalised(corners[0] - corners[3] + corners[1] - corners[2])
    return pose(corners.mean(axis=0), np.stack([x, y, np.cross(x, y)], axis=-1))


def _moved(model: MarkerModel, points_o: Array, moving: Array, q: float) -> Array:
    """Return points (N, 3) with the joint at ``q``."""
    if model.hinge:
        rotation = axis_angle_to_matrix(model.axis_o, q)
        moved = (points_o - model.pivot_o) @ rotation.T + model.pivot_o
    else:
        moved = points_o + q * model.axis_o
    return np.where(moving[:, None] > 0.0, moved, points_o)


def _residuals(problem: _Problem, T_co: Array, points_o: Array) -> tuple[Array, Array]:
    """Return normalised residuals (N, 2) and points in the camera frame (N, 3)."""
    points_c = points_o @ T_co[:3, :3].T + T_co[:3, 3]
    z = np.maximum(points_c[:, 2:], 1e-6)
    return problem.scale * (points_c[:, :2] / z - problem.observed), points_c


def _grid_search(problem: _Problem, T_co: Array) -> float:
    """Return the position of the joint on a grid over its range with the smallest residuals."""
    low, high = problem.model.range
    costs = []
    grid = np.linspace(low, high, GRID)
    for q in grid:
        points_o = _moved(problem.model, problem.points_o, problem.moving, float(q))
        residual, _ = _residuals(problem, T_co, points_o)
        costs.append(np.minimum(np.linalg.norm(residual, axis=1), 1e4).sum())
    return float(grid[int(np.argmin(costs))])


def _refined(
    problem: _Problem, T_co: Array, q: float | None, prior: PosePrior | None, ids: tuple[int, ...]
) -> tuple[float, ObjectFit | None]:
    """Return robust cost and fit from an initial pose and position; None where it contradicts."""
    information = None if prior is None else _inverse(prior.covariance)
    n = 6 if q is None else 7
    damping, position = 1e-6, 0.0 if q is None else q
    cost, H, g = _normal_equations(problem, T_co, position, n, prior, information)
    for _ in range(ITERATIONS):
        step = np.asarray(np.linalg.solve(H + damping * np.diag(np.diag(H)), -g), np.float64)
        T_new = T_co @ _motion(step[:6])
        q_new = position + (float(step[6]) if n == 7 else 0.0)
        new = _normal_equations(problem, T_new, q_new, n, prior, information)
        if new[0] <= cost:
            done = cost - new[0] < 1e-6 * (1.0 + cost)
            T_co, position, damping = T_new, q_new, 0.1 * damping
            cost, H, g = new
            if done:
                break
        else:
            damping = max(10.0 * damping, 1e-3)
            if damping > 1e6:
                break
    points_o = _moved(problem.model, problem.points_o, problem.moving, position)
    residual, points_c = _residuals(problem, T_co, points_o)
    rms_px = float(np.sqrt((residual**2).sum(axis=1).mean() / 2.0)) * SIGMA_PX
    low, high = problem.model.range
    margin = RANGE_MARGIN * (high - low)
    in_range = n == 6 or low - margin <= position <= high + margin
    if rms_px > MAX_RMS_PX or not in_range or points_c[:, 2].min() <= 0.0:
        return np.inf, None
    try:
        covariance = _inverse(H + 1e-9 * np.diag(np.diag(H)))
    except np.linalg.LinAlgError:
        return np.inf, None
    found = ObjectFit(
        T_co=T_co,
        covariance=covariance[:6, :6],
        q=position if n == 7 else None,
        q_std=float(np.sqrt(max(covariance[6, 6], 0.0))) if n == 7 else np.inf,
        rms_px=rms_px,
        ids=ids,
    )
    return cost, found


def _inverse(matrix: Array) -> Array:
    return np.asarray(np.linalg.inv(matrix), dtype=np.float64)


def _normal_equations(
    problem: _Problem,
    T_co: Array,
    q: float,
    n: int,
    prior: PosePrior | None,
    information: Array | None,
) -> tuple[float, Array, Array]:
    """Return robust cost, Gauss-Newton matrix (n, n) and gradient (n,) of pose and position."""
    model = problem.model
    points_o = _moved(model, problem.points_o, problem.moving, q)
    residual, points_c = _residuals(problem, T_co, points_o)
    size = np.maximum(np.linalg.norm(residual, axis=1), 1e-12)
    weight = np.minimum(1.0, HUBER / size)
    cost = float(np.where(size <= HUBER, 0.5 * size**2, HUBER * (size - 0.5 * HUBER)).sum())
    R = T_co[:3, :3]
    x, y = points_o, points_c
    zero = np.zeros(len(x))
    skew = np.stack(
        [zero, -x[:, 2], x[:, 1], x[:, 2], zero, -x[:, 0], -x[:, 1], x[:, 0], zero], axis=-1
    ).reshape(-1, 3, 3)
    motion = np.concatenate([np.broadcast_to(R, (len(x), 3, 3)), -R @ skew], axis=2)
    if n == 7:
        direction = np.broadcast_to(model.axis_o, x.shape)
        if model.hinge:
            direction = np.cross(model.axis_o, x - model.pivot_o)
        column = (problem.moving[:, None] * direction) @ R.T
        motion = np.concatenate([motion, column[:, :, None]], axis=2)
    z = np.maximum(y[:, 2], 1e-6)
    project = np.zeros((len(x), 2, 3))
    project[:, 0, 0] = project[:, 1, 1] = problem.scale / z
    project[:, :, 2] = -problem.scale * y[:, :2] / z[:, None] ** 2
    J = (project @ motion).reshape(-1, n)
    w = np.repeat(weight, 2)
    H, g = (J * w[:, None]).T @ J, J.T @ (w * residual.ravel())
    if prior is not None and information is not None:
        error = pose_difference(prior.T_co, T_co)
        cost += 0.5 * float(error @ information @ error)
        H[:6, :6] += information
        g[:6] += information @ error
    H[np.arange(n), np.arange(n)] += 1e-12
    return cost, H, g


def _motion(step: Array) -> Array:
    """Return the rigid motion (4, 4) of a translation and a rotation vector (6,)."""
    angle = float(np.linalg.norm(step[3:]))
    axis = step[3:] / angle if angle > 0.0 else np.array([1.0, 0.0, 0.0])
    return pose(step[:3], axis_angle_to_matrix(axis, angle))


def pose_difference(T_a: Array, T_b: Array) -> Array:
    """Return translation [m] and rotation vector [rad] (6,) from pose ``T_a`` to ``T_b`` (4, 4).

    Both are in the axes of ``T_a``; the rotation is below half a turn.
    """
    T_ab = inverse(T_a) @ T_b
    return np.concatenate([T_ab[:3, 3], rotation_vector(T_ab[:3, :3])])


def rotation_vector(matrix: Array) -> Array:
    """Return the rotation vector (3,) [rad] of a rotation matrix (3, 3), below half a turn."""
    axial = 0.5 * np.array(
        [matrix[2, 1] - matrix[1, 2], matrix[0, 2] - matrix[2, 0], matrix[1, 0] - matrix[0, 1]]
    )
    sine, cosine = float(np.linalg.norm(axial)), 0.5 * (float(np.trace(matrix)) - 1.0)
    angle = float(np.arctan2(sine, cosine))
    return axial * (angle / sine) if sine > 1e-9 else axial


def visible_ids(model: MarkerModel, detections: Detections) -> Ints:
    """Return the identifiers (M,) of the markers of ``model`` in ``detections``, as indices."""
    return np.array([number for number in model.ids if number in detections], dtype=np.int64)
