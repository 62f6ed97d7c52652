"""Align a mesh with its own sides: scanners and generators place an object at any angle."""

from __future__ import annotations

import cv2
import numpy as np
from scipy.spatial import ConvexHull, QhullError

from articulate.reconstruct.scan.scan_mesh import ScanMesh
from articulate.transforms import Array, axis_angle_to_matrix, normalised, rotation_angle

MOST_TILT = float(np.cos(np.radians(20.0)))
"""Cosine of the largest tilt of an object that is corrected."""
LEVEL_RAD = float(np.radians(0.5))
"""Smaller angles are left as they are."""
NEAR_RAD = (float(np.radians(3.0)), float(np.radians(1.0)))
"""Windows in which the mean of the angles is taken, the coarse one first."""
BINS = 360
"""Steps of the angle in a quarter turn."""
UPRIGHT = 0.3
"""Largest vertical component of the normals of sides."""
LEAST_SHARE = 0.3
"""Least share of the area of sides that agrees on an angle: 0.07 of a round object does."""
LEAST_AGREEMENT = 0.4
"""Least area of sides along the axes, as a share of that along another angle, that leaves them."""
CLEARER = 0.8
"""Largest symmetry of a round object about its axes, as a share of that about another plane, that
turns it."""
LEVEL_BASE = 0.25
"""Least level area at the bottom of the convex hull of an object that is left as it is, as a share
of its outline seen from above."""
CANDIDATES = 3
"""Directions of the sides on which an object can stand, and of its level surfaces, each."""
WITHIN_DEG = 4.0
"""Largest angle from a principal axis to a plane of symmetry."""
ROUND = 2e-3
"""Largest difference of the variances along the principal axes, as a share of their sum, of a round
surface."""
STRAIGHTER = 1.2
"""Least growth of the area that is level or upright."""


def aligned(mesh: ScanMesh) -> tuple[ScanMesh, str]:
    """Return a mesh whose level surfaces and sides are along the axes, and what was changed.

    Args:
        mesh: An object with z up, tilted by less than 20 degrees.

    Returns:
        The mesh, turned by 45 degrees at most about z, and the assumption; empty without a change.
    """
    level = _level(mesh)
    upright = mesh.transformed(level, 1.0, np.zeros(3))
    yaw = _yaw(upright)
    turned = upright.transformed(axis_angle_to_matrix((0.0, 0.0, 1.0), -yaw), 1.0, np.zeros(3))
    tilt = float(rotation_angle(level))
    changes = [
        f"{np.degrees(angle):.1f} degrees {how}"
        for angle, how in ((abs(yaw), "about the vertical"), (tilt, "upright"))
        if angle > 0.0
    ]
    note = f"it was turned by {' and '.join(changes)}, along its own sides" if changes else ""
    return turned, note


def _level(mesh: ScanMesh) -> Array:
    """Return the rotation (3, 3) that makes the most of an object level and upright.

    Candidates are the sides on which it can stand and its level surfaces. The identity is returned
    if none is clearly better, or if the bottom of the object is level.
    """
    try:
        hull = ConvexHull(mesh.vertices[np.unique(mesh.faces)])
    except QhullError:  # a flat surface that is not along the axes
        return np.eye(3)
    edges = np.diff(hull.points[hull.simplices], axis=1)
    areas = 0.5 * np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1)
    down = -hull.equations[:, 2]
    footprint = float((areas * np.clip(down, 0.0, None)).sum())
    if areas[down > np.cos(LEVEL_RAD)].sum() > LEVEL_BASE * footprint:
        return np.eye(3)
    upward = mesh.normals * np.where(mesh.normals[:, 2:] < 0.0, -1.0, 1.0)
    candidates = [
        *_directions(-hull.equations[:, :3], areas),
        *_directions(upward, mesh.areas),
    ]
    best, most = np.eye(3), _straight(mesh, np.eye(3))
    for up in candidates:
        if up[2] < np.cos(LEVEL_RAD):
            axis = normalised((up[1], -up[0], 0.0))
            rotation = axis_angle_to_matrix(axis, np.arccos(up[2]))
            straight = _straight(mesh, rotation)
            if straight > STRAIGHTER * most:
                best, most = rotation, straight
    return best


def _directions(normals: Array, areas: Array) -> list[Array]:
    """Return upward directions (3,) on which the area of nearly upward normals (N, 3) agrees."""
    near = (normals[:, 2] > MOST_TILT) & (areas > 0.0)
    normals, areas = normals[near], areas[near]
    found: list[Array] = []
    while len(found) < CANDIDATES and len(areas):
        up = normals[np.argmax(_agreement(normals, areas))]
        for window in NEAR_RAD:
            chosen = normals @ up > np.cos(window)
            if chosen.any():
                up = normalised(areas[chosen] @ normals[chosen])
        found.append(up)
        other = normals @ up < np.cos(NEAR_RAD[0])
        normals, areas = normals[other], areas[other]
    return found


def _agreement(normals: Array, areas: Array) -> Array:
    """Return the area of the normals (N, 3) in the cells around each one (N,)."""
    cell = NEAR_RAD[0]
    index = np.floor(normals[:, :2] / cell).astype(np.int64)
    index -= index.min(axis=0) - 1
    table = np.zeros(tuple(index.max(axis=0) + 2))
    np.add.at(table, tuple(index.T), areas)
    around = cv2.blur(table, (3, 3), borderType=cv2.BORDER_CONSTANT)
    return np.asarray(around[tuple(index.T)])


def _straight(mesh: ScanMesh, rotation: Array) -> float:
    """Return the area that is level or upright after a rotation (3, 3)."""
    z = np.abs(mesh.normals @ rotation[2])
    return float(mesh.areas[(z > np.cos(LEVEL_RAD)) | (z < np.sin(LEVEL_RAD))].sum())


def _yaw(mesh: ScanMesh) -> float:
    """Return the angle about z of the sides of an object to the axes, in (-pi/4, pi/4].

    It is 0 if they are along the axes or agree on no angle.
    """
    normals, areas = mesh.normals, mesh.areas
    sides = np.abs(normals[:, 2]) < UPRIGHT
    areas, normals = areas[sides], normals[sides]
    if areas.sum() <= 0.0:
        return 0.0
    quarter = 0.5 * np.pi
    angles = np.mod(np.arctan2(normals[:, 1], normals[:, 0]), quarter)

    def off(angle: float) -> Array:
        return np.asarray(np.mod(angles - angle + 0.5 * quarter, quarter) - 0.5 * quarter)

    def agree(angle: float) -> float:
        return float(areas[np.abs(off(angle)) < LEVEL_RAD].sum() / areas.sum())

    histogram = np.bincount((angles / quarter * BINS).astype(np.int64) % BINS, areas, BINS)
    width = 2 * int(NEAR_RAD[1] / quarter * BINS) + 1
    smooth = np.convolve(np.tile(histogram, 3), np.ones(width), "same")[BINS : 2 * BINS]
    yaw = (int(np.argmax(smooth)) + 0.5) / BINS * quarter
    for window in NEAR_RAD:
        weights = np.where(np.abs(off(yaw)) < window, areas, 0.0)
        yaw += float(off(yaw) @ weights / max(float(weights.sum()), 1e-300))
    share = float(areas[np.abs(off(yaw)) < NEAR_RAD[0]].sum() / areas.sum())
    if share < LEAST_SHARE:
        yaw = _symmetric(mesh, normals, areas)
    elif agree(0.0) > LEAST_AGREEMENT * agree(yaw):
        return 0.0
    yaw = float(np.mod(yaw + 0.5 * quarter, quarter) - 0.5 * quarter)
    return yaw if abs(yaw) > LEVEL_RAD else 0.0


def _symmetric(mesh: ScanMesh, normals: Array, areas: Array) -> float:
    """Return the angle of the plane about which the sides (N, 3) are the most symmetric.

    A round body is symmetric about many planes: the principal axes of the surface decide, which
    lie along the plane of symmetry. It is 0 if the axes are nearly as good.
    """
    angles = np.degrees(np.arctan2(normals[:, 1], normals[:, 0]))
    histogram = np.bincount(np.mod(np.round(angles), 360).astype(np.int64), areas, 360)
    smooth = np.convolve(np.tile(histogram, 3), np.hanning(7), "same")[360:720]
    to = np.arange(360)
    scores = np.array([float(smooth @ smooth[(2 * plane - to) % 360]) for plane in range(180)])
    likely = scores > CLEARER * scores.max()
    principal = _principal(mesh)
    if principal is not None:
        off = np.abs(np.mod(np.arange(180) - np.degrees(principal) + 45.0, 90.0) - 45.0)
        if likely[off < WITHIN_DEG].any():
            return principal
    return 0.0 if likely[0] or likely[90] else float(np.radians(np.argmax(scores)))


def _principal(mesh: ScanMesh) -> float | None:
    """Return the angle of a principal axis of the surface seen from above; None if it is round."""
    middles = 0.5 * (mesh.triangles + np.roll(mesh.triangles, 1, axis=1))[..., :2]
    weights = np.repeat(mesh.areas, 3)
    covariance = np.cov(middles.reshape(-1, 2).T, aweights=weights)
    spread, axes = np.linalg.eigh(covariance)
    if spread[1] - spread[0] < ROUND * spread.sum():
        return None
    return float(np.arctan2(axes[1, 1], axes[0, 1]))
