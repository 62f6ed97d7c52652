"""Rotations and poses over arrays, with leading batch axes.

Quaternions are ``wxyz``. A pose is a 4x4 matrix ``T_ab`` that takes coordinates of frame
``b`` to frame ``a``.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from articulate.jit import row_function

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Ints = NDArray[np.int64]


def normalised(v: ArrayLike, *, axis: int = -1) -> Array:
    """Return unit vectors along ``v``; a zero vector stays zero. The shape is kept."""
    v = np.asarray(v, dtype=np.float64)
    length = np.linalg.norm(v, axis=axis, keepdims=True)
    return v / np.where(length > 0.0, length, 1.0)


def quat_to_matrix(quat: ArrayLike) -> Array:
    """Return rotation matrices (..., 3, 3) of quaternions ``wxyz`` (..., 4), normalised first."""
    w, x, y, z = np.moveaxis(normalised(quat), -1, 0)
    out = np.empty((*w.shape, 3, 3))
    out[..., 0, 0] = 1 - 2 * (y * y + z * z)
    out[..., 0, 1] = 2 * (x * y - w * z)
    out[..., 0, 2] = 2 * (x * z + w * y)
    out[..., 1, 0] = 2 * (x * y + w * z)
    out[..., 1, 1] = 1 - 2 * (x * x + z * z)
    out[..., 1, 2] = 2 * (y * z - w * x)
    out[..., 2, 0] = 2 * (x * z - w * y)
    out[..., 2, 1] = 2 * (y * z + w * x)
    out[..., 2, 2] = 1 - 2 * (x * x + y * y)
    return out


def matrix_to_quat(matrix: ArrayLike) -> Array:
    """Return quaternions ``wxyz`` (..., 4) with w >= 0 of rotation matrices (..., 3, 3).

    The eigenvector form of I. Bar-Itzhack, "New method for extracting the quaternion from a
    rotation matrix", J. Guidance 23(6), 2000: stable for every angle.
    """
    m = np.asarray(matrix, dtype=np.float64)
    k = np.zeros((*m.shape[:-2], 4, 4))
    k[..., 0, 0] = m[..., 0, 0] - m[..., 1, 1] - m[..., 2, 2]
    k[..., 1, 0] = m[..., 1, 0] + m[..., 0, 1]
    k[..., 1, 1] = m[..., 1, 1] - m[..., 0, 0] - m[..., 2, 2]
    k[..., 2, 0] = m[..., 2, 0] + m[..., 0, 2]
    k[..., 2, 1] = m[..., 2, 1] + m[..., 1, 2]
    k[..., 2, 2] = m[..., 2, 2] - m[..., 0, 0] - m[..., 1, 1]
    k[..., 3, 0] = m[..., 2, 1] - m[..., 1, 2]
    k[..., 3, 1] = m[..., 0, 2] - m[..., 2, 0]
    k[..., 3, 2] = m[..., 1, 0] - m[..., 0, 1]
    k[..., 3, 3] = m[..., 0, 0] + m[..., 1, 1] + m[..., 2, 2]
    _, vectors = np.linalg.eigh(k / 3.0)
    quat = vectors[..., [3, 0, 1, 2], -1]
    return np.where(quat[..., :1] < 0.0, -quat, quat)


def axis_angle_to_matrix(axis: ArrayLike, angle: ArrayLike) -> Array:
    """Return rotation matrices (..., 3, 3) by ``angle`` (...) [rad] about a unit axis (..., 3)."""
    axis = np.asarray(axis, dtype=np.float64)
    half = np.asarray(angle, dtype=np.float64)[..., None] / 2.0
    quat = np.concatenate([np.cos(half) * np.ones_like(axis[..., :1]), np.sin(half) * axis], -1)
    return quat_to_matrix(quat)


def rpy_to_matrix(rpy: ArrayLike) -> Array:
    """Return rotation matrices (..., 3, 3) of URDF's fixed-axis roll, pitch, yaw (..., 3) [rad]."""
    rpy = np.asarray(rpy, dtype=np.float64)
    eye = np.eye(3)
    x, y, z = (axis_angle_to_matrix(eye[i], rpy[..., i]) for i in range(3))
    return z @ y @ x


def matrix_to_rpy(matrix: ArrayLike) -> Array:
    """Return URDF's roll, pitch, yaw (..., 3) [rad] of rotation matrices (..., 3, 3).

    Yaw is 0 at gimbal lock.
    """
    m = np.asarray(matrix, dtype=np.float64)
    cos_pitch = np.hypot(m[..., 0, 0], m[..., 1, 0])
    pitch = np.arctan2(-m[..., 2, 0], cos_pitch)
    yaw = np.where(cos_pitch < 1e-12, 0.0, np.arctan2(m[..., 1, 0], m[..., 0, 0]))
    # Roll of the rotation without yaw. Near gimbal lock yaw is mostly rounding error; this roll
    # compensates it, so that the three angles together give the input rotation.
    sin, cos = np.sin(yaw), np.cos(yaw)
    roll = np.arctan2(
        sin * m[..., 0, 2] - cos * m[..., 1, 2], cos * m[..., 1, 1] - sin * m[..., 0, 1]
    )
    return np.stack([roll, pitch, yaw], axis=-1)


def pose(pos: ArrayLike, rotation: ArrayLike | None = None) -> Array:
    """Return poses (..., 4, 4) of positions (..., 3) [m] and rotation matrices (..., 3, 3).

    The rotation is the identity by default.
    """
    pos = np.asarray(pos, dtype=np.float64)
    rot = np.eye(3) if rotation is None else np.asarray(rotation, dtype=np.float64)
    batch = np.broadcast_shapes(pos.shape[:-1], rot.shape[:-2])
    out = np.zeros((*batch, 4, 4))
    out[..., :3, :3] = rot
    out[..., :3, 3] = pos
    out[..., 3, 3] = 1.0
    return out


def inverse(T: ArrayLike) -> Array:
    """Return the inverse of rigid transforms (..., 4, 4), homogeneous matrices."""
    T = np.asarray(T, dtype=np.float64)
    rot = np.swapaxes(T[..., :3, :3], -1, -2)
    return pose(-np.einsum("...ij,...j->...i", rot, T[..., :3, 3]), rot)


def apply(T: ArrayLike, points: ArrayLike) -> Array:
    """Transform ``points`` (..., 3) [m] by rigid transforms ``T`` (..., 4, 4)."""
    T = np.asarray(T, dtype=np.float64)
    points = np.asarray(points, dtype=np.float64)
    moved: Array = np.einsum("...ij,...j->...i", T[..., :3, :3], points) + T[..., :3, 3]
    return moved


def angle_between(a: ArrayLike, b: ArrayLike) -> Array:
    """Return the angle (...) [rad] in [0, pi] between vectors (..., 3), exact near 0 and pi.

    W. Kahan, "How futile are mindless assessments of roundoff", 2006: twice the arctangent of
    the half-difference over the half-sum of the unit vectors.
    """
    a, b = normalised(a), normalised(b)
    return np.asarray(
        2.0 * np.arctan2(np.linalg.norm(a - b, axis=-1), np.linalg.norm(a + b, axis=-1))
    )


def rotation_angle(matrix: ArrayLike) -> Array:
    """Return the angle (...) [rad] in [0, pi] of rotation matrices (..., 3, 3).

    It is exact near 0 and pi: the antisymmetric part has twice the sine, the trace is one plus
    twice the cosine.
    """
    m = np.moveaxis(np.asarray(matrix, dtype=np.float64), (-2, -1), (0, 1))
    return np.asarray(matrix_angle(m))


@row_function
def matrix_angle(m: Any) -> Any:
    """Return the angle [rad] of a rotation (3, 3, ...); see :func:`rotation_angle`."""
    x, y, z = m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]
    trace = m[0, 0] + m[1, 1] + m[2, 2]
    return np.arctan2(np.sqrt(x * x + y * y + z * z), trace - 1.0)
