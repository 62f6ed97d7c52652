"""Compiled kernels of the joint fit: residuals, normal equations, Levenberg-Marquardt.

A point ``x`` (3,) in units of the mean depth appears at joint position ``q`` at
``y = pivot + R(q) (x - pivot)`` for a hinge and ``y = x + q axis`` for a slide, and is seen at
``y[:2] / y[2]``. Robust cost of a squared residual r²: Geman-McClure, ``r² / (1 + r² / 9)``.
"""

from __future__ import annotations

import numba
import numpy as np
from numpy.typing import NDArray

from articulate.transforms import Array

DEPTH_SPREAD = 0.2
"""Expected deviation of the logarithm of the points' depth from 0: parts are compact."""
NEAREST = 0.05
"""Least depth of a point, as a share of the mean."""
SMOOTHNESS = 0.02
"""Weight of the second differences of the joint positions."""
ROBUST = 9.0
"""Squared residual at which the robust cost turns [px²]."""
MAX_STEP = 0.5
"""Largest change of a coordinate or joint position in one iteration."""
ATTEMPTS = 5
"""Dampings tried in one iteration."""
LEAST_GAIN = 1e-4
"""Relative decrease of the cost below which the iteration ends."""
JOINT = 5
"""Parameters of the joint in one frame: its position, two of the axis and two of the pivot."""

Seen = NDArray[np.bool_]


@numba.njit(cache=True, nogil=True)
def _rotation(axis: Array, angle: float, out: Array) -> None:
    """Write the rotation by ``angle`` about a unit ``axis`` (3,) to ``out`` (3, 3)."""
    s, c = np.sin(angle), np.cos(angle)
    v = 1.0 - c
    x, y, z = axis[0], axis[1], axis[2]
    out[0, 0], out[0, 1], out[0, 2] = c + x * x * v, x * y * v - z * s, x * z * v + y * s
    out[1, 0], out[1, 1], out[1, 2] = y * x * v + z * s, c + y * y * v, y * z * v - x * s
    out[2, 0], out[2, 1], out[2, 2] = z * x * v - y * s, z * y * v + x * s, c + z * z * v


@numba.njit(cache=True, nogil=True)
def _rotations(turns: bool, axis: Array, q: Array) -> Array:
    """Return the rotation at each frame (T, 3, 3); identity for a slide."""
    out = np.empty((len(q), 3, 3))
    for t in range(len(q)):
        _rotation(axis, q[t] if turns else 0.0, out[t])
    return out


@numba.njit(cache=True, nogil=True)
def _cross(a: Array, b: Array, out: Array) -> None:
    out[0] = a[1] * b[2] - a[2] * b[1]
    out[1] = a[2] * b[0] - a[0] * b[2]
    out[2] = a[0] * b[1] - a[1] * b[0]


@numba.njit(cache=True, nogil=True)
def _tangent(axis: Array, out: Array) -> None:
    """Write two unit vectors perpendicular to ``axis`` to ``out`` (2, 3)."""
    k = 0
    for j in range(1, 3):
        if abs(axis[j]) < abs(axis[k]):
            k = j
    helper = np.zeros(3)
    helper[k] = 1.0
    _cross(axis, helper, out[0])
    length = np.sqrt((out[0] ** 2).sum())
    for j in range(3):
        out[0, j] /= length
    _cross(axis, out[0], out[1])


@numba.njit(cache=True, nogil=True)
def _moved(turns: bool, R: Array, axis: Array, pivot: Array, q: float, x: Array, y: Array) -> None:
    """Write point ``x`` (3,) at joint position ``q`` to ``y`` (3,)."""
    for j in range(3):
        if turns:
            y[j] = pivot[j]
            for k in range(3):
                y[j] += R[j, k] * (x[k] - pivot[k])
        else:
            y[j] = x[j] + q * axis[j]


@numba.njit(cache=True, nogil=True)
def cost(
    turns: bool,
    axis: Array,
    pivot: Array,
    q: Array,
    points: Array,
    xy: Array,
    seen: Seen,
    scale: float,
) -> float:
    """Return the robust cost; residuals are multiplied by ``scale`` [px per unit]."""
    n, t_count = seen.shape
    R = _rotations(turns, axis, q)
    y = np.empty(3)
    total = 0.0
    for i in range(n):
        total += (np.log(max(points[i, 2], NEAREST)) / DEPTH_SPREAD) ** 2
        for t in range(t_count):
            if not seen[i, t]:
                continue
            _moved(turns, R[t], axis, pivot, q[t], points[i], y)
            if y[2] < NEAREST:
                total += 5.0 * ROBUST
                continue
            r2 = ((y[0] / y[2] - xy[i, t, 0]) ** 2 + (y[1] / y[2] - xy[i, t, 1]) ** 2) * scale**2
            total += r2 / (1.0 + r2 / ROBUST)
    for t in range(1, t_count - 1):
        total += (SMOOTHNESS * scale * (q[t - 1] - 2.0 * q[t] + q[t + 1])) ** 2 / t_count
    return total


@numba.njit(cache=True, nogil=True)
def _solve3(a: Array, b: Array, out: Array) -> None:
    """Solve a symmetric system (3, 3) for columns ``b`` (3, M) into ``out`` (3, M)."""
    c00 = a[1, 1] * a[2, 2] - a[1, 2] * a[2, 1]
    c01 = a[0, 2] * a[2, 1] - a[0, 1] * a[2, 2]
    c02 = a[0, 1] * a[1, 2] - a[0, 2] * a[1, 1]
    det = a[0, 0] * c00 + a[1, 0] * c01 + a[2, 0] * c02
    c11 = a[0, 0] * a[2, 2] - a[0, 2] * a[2, 0]
    c12 = a[0, 2] * a[1, 0] - a[0, 0] * a[1, 2]
    c22 = a[0, 0] * a[1, 1] - a[0, 1] * a[1, 0]
    for m in range(b.shape[1]):
        out[0, m] = (c00 * b[0, m] + c01 * b[1, m] + c02 * b[2, m]) / det
        out[1, m] = (c01 * b[0, m] + c11 * b[1, m] + c12 * b[2, m]) / det
        out[2, m] = (c02 * b[0, m] + c12 * b[1, m] + c22 * b[2, m]) / det


@numba.njit(cache=True, nogil=True)
def _joint_derivative(
    turns: bool, R: Array, axis: Array, pivot: Array, q: float, x: Array, y: Array, D: Array
) -> None:
    """Write the derivative of ``y`` by the parameters of the joint to ``D`` (3, 5).

    A small turn ``b`` of the axis moves a point of a hinge by ``b × R a - R (b × a)``, where ``a``
    is the point relative to the pivot.
    """
    basis = np.empty((2, 3))
    _tangent(axis, basis)
    if not turns:
        for j in range(3):
            D[j, 0] = axis[j]
            for k in range(2):
                D[j, 1 + k] = q * basis[k, j]
                D[j, 3 + k] = 0.0
        return
    arm, turned, left, right = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    for j in range(3):
        arm[j] = x[j] - pivot[j]
        turned[j] = y[j] - pivot[j]
    _cross(axis, turned, left)
    for j in range(3):
        D[j, 0] = left[j]
    for k in range(2):
        _cross(basis[k], turned, left)
        _cross(basis[k], arm, right)
        for j in range(3):
            D[j, 1 + k] = left[j]
            for m in range(3):
                D[j, 1 + k] -= R[j, m] * right[m]
            D[j, 3 + k] = (1.0 if j == k else 0.0) - R[j, k]


@numba.njit(cache=True, nogil=True)
def _project(D: Array, y: Array, scale: float, J: Array) -> None:
    """Write the derivative of the pixel of ``y``, from that of ``y`` (3, M), to ``J`` (2, M)."""
    depth = 1.0 / max(y[2], NEAREST)
    u, v = y[0] * depth, y[1] * depth
    for k in range(D.shape[1]):
        J[0, k] = (D[0, k] - u * D[2, k]) * depth * scale
        J[1, k] = (D[1, k] - v * D[2, k]) * depth * scale


@numba.njit(cache=True, nogil=True)
def _depth_prior(z: float, A: Array, b: Array) -> None:
    """Add the expected depth to the normal equations of one point, in place."""
    depth = max(z, NEAREST)
    A[2, 2] += 1.0 / (depth * DEPTH_SPREAD) ** 2
    b[2] -= np.log(depth) / (depth * DEPTH_SPREAD**2)


@numba.njit(cache=True, nogil=True)
def _normal_equations(
    turns: bool,
    axis: Array,
    pivot: Array,
    q: Array,
    points: Array,
    xy: Array,
    seen: Seen,
    scale: float,
    A: Array,
    b: Array,
    H: Array,
    g: Array,
    W: Array,
) -> None:
    """Accumulate the blocks of the points (N, 3, 3), of the joint (M, M) and between them."""
    n, t_count = seen.shape
    R = _rotations(turns, axis, q)
    A[:], b[:], H[:], g[:], W[:] = 0.0, 0.0, 0.0, 0.0, 0.0
    y, D = np.empty(3), np.zeros((3, JOINT))
    J, P = np.zeros((2, JOINT)), np.zeros((2, 3))
    columns = np.arange(t_count - 1, t_count - 1 + JOINT)
    for i in range(n):
        _depth_prior(points[i, 2], A[i], b[i])
        for t in range(t_count):
            if not seen[i, t]:
                continue
            _moved(turns, R[t], axis, pivot, q[t], points[i], y)
            if y[2] < NEAREST:
                continue
            ru = (xy[i, t, 0] - y[0] / y[2]) * scale
            rv = (xy[i, t, 1] - y[1] / y[2]) * scale
            w = 1.0 / (1.0 + (ru * ru + rv * rv) / ROBUST) ** 2
            _joint_derivative(turns, R[t], axis, pivot, q[t], points[i], y, D)
            _project(D, y, scale, J)
            _project(R[t], y, scale, P)
            columns[0] = t
            for k in range(3):
                b[i, k] += w * (P[0, k] * ru + P[1, k] * rv)
                for m in range(3):
                    A[i, k, m] += w * (P[0, k] * P[0, m] + P[1, k] * P[1, m])
                for m in range(JOINT):
                    W[i, k, columns[m]] += w * (P[0, k] * J[0, m] + P[1, k] * J[1, m])
            for k in range(JOINT):
                g[columns[k]] += w * (J[0, k] * ru + J[1, k] * rv)
                for m in range(JOINT):
                    H[columns[k], columns[m]] += w * (J[0, k] * J[0, m] + J[1, k] * J[1, m])
    _add_smoothness(q, (SMOOTHNESS * scale) ** 2 / t_count, H, g)


@numba.njit(cache=True, nogil=True)
def _add_smoothness(q: Array, weight: float, H: Array, g: Array) -> None:
    """Add the second differences of the joint positions to the normal equations, in place."""
    for t in range(1, len(q) - 1):
        r = -(q[t - 1] - 2.0 * q[t] + q[t + 1])
        for k in range(3):
            ck = -2.0 if k == 1 else 1.0
            g[t - 1 + k] += weight * ck * r
            for m in range(3):
                cm = -2.0 if m == 1 else 1.0
                H[t - 1 + k, t - 1 + m] += weight * ck * cm


@numba.njit(cache=True, nogil=True)
def _eliminated(
    damping: float, scale: float, A: Array, b: Array, H: Array, g: Array, W: Array, rows: Array
) -> Array:
    """Return the step of the joint (M,) with the points eliminated.

    ``rows`` (N, 3, M + 1) receives the inverse of each point's block times its other blocks.
    """
    size = len(g)
    S, r = H.copy(), g.copy()
    damped, both = np.empty((3, 3)), np.empty((3, size + 1))
    for k in range(size):
        S[k, k] += damping * H[k, k] + 1e-6 * scale
    for i in range(len(A)):
        for k in range(3):
            for m in range(3):
                damped[k, m] = A[i, k, m]
            damped[k, k] += damping * A[i, k, k] + 1e-3
            for m in range(size):
                both[k, m] = W[i, k, m]
            both[k, size] = b[i, k]
        _solve3(damped, both, rows[i])
        for k in range(size):
            if W[i, 0, k] == 0.0 and W[i, 1, k] == 0.0 and W[i, 2, k] == 0.0:
                continue
            for j in range(3):
                for m in range(size):
                    S[k, m] -= W[i, j, k] * rows[i, j, m]
                r[k] -= W[i, j, k] * rows[i, j, size]
    return np.asarray(np.linalg.solve(S, r))


@numba.njit(cache=True, nogil=True)
def _stepped_axis(turns: bool, axis: Array, first: float, second: float) -> Array:
    """Return the axis moved by two tangent parameters: turned by them for a hinge."""
    basis, vector, moved = np.empty((2, 3)), np.empty(3), np.empty(3)
    _tangent(axis, basis)
    for k in range(3):
        vector[k] = first * basis[0, k] + second * basis[1, k]
    if turns:
        _cross(vector, axis, moved)
    else:
        moved[:] = vector
    out = axis + moved
    length = np.sqrt((out**2).sum())
    for k in range(3):
        out[k] /= length
    return out


@numba.njit(cache=True, nogil=True)
def _stepped_points(points: Array, rows: Array, step: Array) -> Array:
    """Return the points (N, 3) after the joint moved by ``step`` (M,)."""
    size = len(step)
    out = points.copy()
    for i in range(len(points)):
        for k in range(3):
            delta = rows[i, k, size]
            for m in range(size):
                delta -= rows[i, k, m] * step[m]
            out[i, k] += min(max(delta, -MAX_STEP), MAX_STEP)
    return out


@numba.njit(cache=True, nogil=True)
def _centre(axis: Array, q: Array, points: Array) -> None:
    """Make the mean position of a slide 0, so that the expected depth is that of the middle."""
    middle = q.mean()
    q -= middle
    for i in range(len(points)):
        for k in range(3):
            points[i, k] += middle * axis[k]


@numba.njit(cache=True, nogil=True)
def refine(
    turns: bool,
    axis: Array,
    pivot: Array,
    q: Array,
    points: Array,
    xy: Array,
    seen: Seen,
    scale: float,
    iterations: int,
) -> float:
    """Minimise the cost by axis (3,), pivot (3,), q (T,) and points (N, 3), in place; return it."""
    n, t_count = seen.shape
    size = t_count + 4  # the axis and the pivot come last
    A, b, W = np.empty((n, 3, 3)), np.empty((n, 3)), np.empty((n, 3, size))
    H, g, rows = np.empty((size, size)), np.empty(size), np.empty((n, 3, size + 1))
    best = cost(turns, axis, pivot, q, points, xy, seen, scale)
    damping = 1e-2
    for _ in range(iterations):
        if not turns:
            _centre(axis, q, points)
            best = cost(turns, axis, pivot, q, points, xy, seen, scale)
        _normal_equations(turns, axis, pivot, q, points, xy, seen, scale, A, b, H, g, W)
        improved = False
        for _attempt in range(ATTEMPTS):
            step = _eliminated(damping, scale, A, b, H, g, W, rows)
            first, second = float(step[t_count]), float(step[t_count + 1])
            new_axis = _stepped_axis(turns, axis, first, second)
            new_pivot, new_q = pivot.copy(), q.copy()
            new_pivot[0] += step[t_count + 2]
            new_pivot[1] += step[t_count + 3]
            for t in range(t_count):
                new_q[t] += min(max(step[t], -MAX_STEP), MAX_STEP)
            new_points = _stepped_points(points, rows, step)
            now = cost(turns, new_axis, new_pivot, new_q, new_points, xy, seen, scale)
            if now < best:
                improved = (best - now) / best > LEAST_GAIN
                best = now
                axis[:], pivot[:], q[:], points[:] = new_axis, new_pivot, new_q, new_points
                damping = max(damping * 0.3, 1e-6)
                break
            damping *= 4.0
        if not improved:
            break
    return best


@numba.njit(cache=True, nogil=True)
def residuals(
    turns: bool,
    axis: Array,
    pivot: Array,
    q: Array,
    points: Array,
    xy: Array,
    seen: Seen,
    scale: float,
) -> Array:
    """Return the residual of each observation (N, T) [px]; 0 where not seen."""
    n, t_count = seen.shape
    out = np.zeros((n, t_count))
    R, y = _rotations(turns, axis, q), np.empty(3)
    for t in range(t_count):
        for i in range(n):
            if not seen[i, t]:
                continue
            _moved(turns, R[t], axis, pivot, q[t], points[i], y)
            z = max(y[2], NEAREST)
            du, dv = y[0] / z - xy[i, t, 0], y[1] / z - xy[i, t, 1]
            out[i, t] = scale * np.sqrt(du * du + dv * dv)
    return out


@numba.njit(cache=True, nogil=True)
def place(
    turns: bool,
    axis: Array,
    pivot: Array,
    q: Array,
    points: Array,
    xy: Array,
    seen: Seen,
    scale: float,
) -> None:
    """Fit the points (N, 3) of a known joint, in place."""
    n, t_count = seen.shape
    R, y, P = _rotations(turns, axis, q), np.empty(3), np.empty((2, 3))
    A, b, step = np.empty((3, 3)), np.empty((3, 1)), np.empty((3, 1))
    for i in range(n):
        for _ in range(12):
            A[:], b[:] = 0.0, 0.0
            _depth_prior(points[i, 2], A, b[:, 0])
            for t in range(t_count):
                if not seen[i, t]:
                    continue
                _moved(turns, R[t], axis, pivot, q[t], points[i], y)
                z = max(y[2], NEAREST)
                ru, rv = (xy[i, t, 0] - y[0] / z) * scale, (xy[i, t, 1] - y[1] / z) * scale
                _project(R[t], y, scale, P)
                for k in range(3):
                    b[k, 0] += P[0, k] * ru + P[1, k] * rv
                    for m in range(3):
                        A[k, m] += P[0, k] * P[0, m] + P[1, k] * P[1, m]
            for k in range(3):
                A[k, k] *= 1.0 + 1e-4
            _solve3(A, b, step)
            size = 0.0
            for k in range(3):
                d = min(max(step[k, 0], -0.3), 0.3)
                points[i, k] += d
                size += d * d
            if size < 1e-10:
                break
