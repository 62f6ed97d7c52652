"""What a tick does before and after its substeps, compiled: targets and tool poses.

It repeats :func:`articulate.robot.control.next_target` and :func:`articulate.robot.kinematics.tool_pose` for one
environment at a time; tests hold them together.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from articulate.robot.arm import Arm
from articulate.robot.config import ControlConfig
from articulate.robot.control import joint_steps
from articulate.robot.kinematics import DH, FLANGE_Z_M, HAND_TURN_RAD, QUARTERS
from articulate.transforms import Array, Ints

DAMPING = 0.02
"""That of :func:`articulate.robot.kinematics.resolve_motion`."""
FADING = 1e-4
"""Length of a self motion's minors below which it fades."""


class Chain(NamedTuple):
    """The arm and how its targets move."""

    a: Array
    """Along x to each joint (7,) [m]."""
    d: Array
    """Along z to each joint (7,) [m]."""
    quarters: Ints
    """Quarter turns about x to each joint (7,)."""
    turn: Array
    """Cosine and sine of the hand's turn about the flange (2,)."""
    tool_m: float
    """Tool beyond joint 7 [m]."""
    unit: Array
    """What actions of 1 ask for (6,) [m and rad]."""
    elbow_rad: float
    """What an action of 1 asks of the elbow [rad]."""
    steps: Array
    """Largest changes of targets in a tick (7,) [rad]."""
    max_tracking_error_rad: float
    low: Array
    """Smallest targets (7,) [rad]."""
    high: Array
    """Largest targets (7,) [rad]."""


def chain_of(arm: Arm, config: ControlConfig) -> Chain:
    """The arm and the plant as numbers."""
    low, high = arm.bounds(config.margin_rad)
    return Chain(
        a=np.array([a for a, _, _ in DH]),
        d=np.array([d for _, d, _ in DH]),
        quarters=np.array(QUARTERS, dtype=np.int64),
        turn=np.array([np.cos(HAND_TURN_RAD), np.sin(HAND_TURN_RAD)]),
        tool_m=FLANGE_Z_M + arm.gripper.tcp_z_m,
        unit=np.repeat([config.move_m, config.turn_rad], 3),
        elbow_rad=config.step_rad,
        steps=joint_steps(config, arm),
        max_tracking_error_rad=config.max_tracking_error_rad,
        low=np.asarray(low, dtype=np.float64),
        high=np.asarray(high, dtype=np.float64),
    )


@njit(nogil=True, cache=True, error_model="numpy", boundscheck=False)
def write_tool(q, chain, frames, out):  # type: ignore[no-untyped-def]
    """Write the tool's pose at ``q`` (7,) into ``out`` (4, 4), and the joints' into ``frames``.

    ``frames`` (7, 6) takes each joint's axis z and origin in the world.
    """
    xx, xy, xz = 1.0, 0.0, 0.0
    yx, yy, yz = 0.0, 1.0, 0.0
    zx, zy, zz = 0.0, 0.0, 1.0
    px = py = pz = 0.0
    for i in range(7):
        k = chain.quarters[i]
        if k != 0:
            yx, zx = k * zx, -k * yx
            yy, zy = k * zy, -k * yy
            yz, zz = k * zz, -k * yz
        a, d = chain.a[i], chain.d[i]
        px += a * xx + d * zx
        py += a * xy + d * zy
        pz += a * xz + d * zz
        c, s = np.cos(q[i]), np.sin(q[i])
        xx, yx = c * xx + s * yx, c * yx - s * xx
        xy, yy = c * xy + s * yy, c * yy - s * xy
        xz, yz = c * xz + s * yz, c * yz - s * xz
        frames[i, 0], frames[i, 1], frames[i, 2] = zx, zy, zz
        frames[i, 3], frames[i, 4], frames[i, 5] = px, py, pz
    c, s = chain.turn[0], chain.turn[1]
    out[0, 0], out[1, 0], out[2, 0] = c * xx + s * yx, c * xy + s * yy, c * xz + s * yz
    out[0, 1], out[1, 1], out[2, 1] = c * yx - s * xx, c * yy - s * xy, c * yz - s * xz
    out[0, 2], out[1, 2], out[2, 2] = zx, zy, zz
    out[0, 3], out[1, 3] = px + chain.tool_m * zx, py + chain.tool_m * zy
    out[2, 3] = pz + chain.tool_m * zz
    out[3, 0] = out[3, 1] = out[3, 2] = 0.0
    out[3, 3] = 1.0


@njit(nogil=True, cache=True, error_model="numpy", boundscheck=False)
def _write_jacobian(frames, tool, out):  # type: ignore[no-untyped-def]
    """The Jacobian (6, 7) in the axes of the tool."""
    for i in range(7):
        zx, zy, zz = frames[i, 0], frames[i, 1], frames[i, 2]
        rx, ry, rz = tool[0, 3] - frames[i, 3], tool[1, 3] - frames[i, 4], tool[2, 3] - frames[i, 5]
        lx, ly, lz = zy * rz - zz * ry, zz * rx - zx * rz, zx * ry - zy * rx
        for r in range(3):
            ax, ay, az = tool[0, r], tool[1, r], tool[2, r]
            out[r, i] = ax * lx + ay * ly + az * lz
            out[r + 3, i] = ax * zx + ay * zy + az * zz


@njit(nogil=True, cache=True, error_model="numpy", boundscheck=False)
def _solve(matrix, right):  # type: ignore[no-untyped-def]
    """Solve in place by elimination with row exchanges."""
    n = len(right)
    for k in range(n):
        best = k
        for r in range(k + 1, n):
            if abs(matrix[r, k]) > abs(matrix[best, k]):
                best = r
        if matrix[best, k] == 0.0:
            return
        if best != k:
            for j in range(k, n):
                matrix[k, j], matrix[best, j] = matrix[best, j], matrix[k, j]
            right[k], right[best] = right[best], right[k]
        for r in range(k + 1, n):
            f = matrix[r, k] / matrix[k, k]
            for j in range(k + 1, n):
                matrix[r, j] -= f * matrix[k, j]
            right[r] -= f * right[k]
    for k in range(n - 1, -1, -1):
        for j in range(k + 1, n):
            right[k] -= matrix[k, j] * right[j]
        right[k] /= matrix[k, k]


@njit(nogil=True, cache=True, error_model="numpy", boundscheck=False)
def _eliminate(matrix, order):  # type: ignore[no-untyped-def]
    """Make ``matrix`` (6, 7) triangular in place; product of the pivots, and a sign for exchanges.

    The largest number left is the next pivot: rows and columns are exchanged for it, and ``order``
    (7,) says which column stands where.
    """
    det = 1.0
    for k in range(6):
        row, column = k, k
        for r in range(k, 6):
            for c in range(k, 7):
                if abs(matrix[r, c]) > abs(matrix[row, column]):
                    row, column = r, c
        pivot = matrix[row, column]
        if pivot == 0.0:
            return 0.0
        for c in range(7):
            matrix[k, c], matrix[row, c] = matrix[row, c], matrix[k, c]
        for r in range(6):
            matrix[r, k], matrix[r, column] = matrix[r, column], matrix[r, k]
        order[k], order[column] = order[column], order[k]
        det *= pivot if (row == k) == (column == k) else -pivot
        for r in range(k + 1, 6):
            f = matrix[r, k] / pivot
            for c in range(k + 1, 7):
                matrix[r, c] -= f * matrix[k, c]
    return det


@njit(nogil=True, cache=True, error_model="numpy", boundscheck=False)
def _write_minors(matrix, order, out):  # type: ignore[no-untyped-def]
    """Write the signed minors (7,) of ``matrix`` (6, 7), which is eliminated; their length.

    They are the direction that it takes to 0, and that of the column which is left over is the
    product of the pivots. ``order`` (7,) is room.
    """
    for c in range(7):
        order[c] = c
        out[c] = 0.0
    det = _eliminate(matrix, order)
    if det == 0.0:
        return 0.0
    length = det * det
    out[order[6]] = det
    for k in range(5, -1, -1):
        total = matrix[k, 6] * det
        for c in range(k + 1, 6):
            total += matrix[k, c] * out[order[c]]
        out[order[k]] = -total / matrix[k, k]
        length += out[order[k]] ** 2
    return np.sqrt(length)


@njit(nogil=True, cache=True, error_model="numpy", boundscheck=False)
def aim(target, motion, q, yields, chain, room):  # type: ignore[no-untyped-def]
    """Move ``target`` (7,) by one tick's ``motion`` (7,), in place, or back where it ``yields``.

    ``room`` is :func:`room_of`.
    """
    frames, tool, jacobian, square, right, step, minors, order = room
    write_tool(target, chain, frames, tool)
    _write_jacobian(frames, tool, jacobian)
    for r in range(6):
        for j in range(6):
            total = DAMPING**2 if r == j else 0.0
            for k in range(7):
                total += jacobian[r, k] * jacobian[j, k]
            square[r, j] = total
        right[r] = chain.unit[r] * min(max(motion[r], -1.0), 1.0)
    _solve(square, right)
    for k in range(7):
        step[k] = 0.0
        for r in range(6):
            step[k] += jacobian[r, k] * right[r]
    length = _write_minors(jacobian, order, minors)
    elbow = chain.elbow_rad * min(max(motion[6], -1.0), 1.0) / max(length, FADING)
    longest = 1.0
    for k in range(7):
        step[k] += elbow * minors[k]
        longest = max(longest, abs(step[k]) / chain.steps[k])
    for k in range(7):
        wish = q[k] if yields else target[k] + step[k] / longest
        wish = min(
            max(wish, q[k] - chain.max_tracking_error_rad), q[k] + chain.max_tracking_error_rad
        )
        wish = min(max(wish, chain.low[k]), chain.high[k])
        target[k] += min(max(wish - target[k], -chain.steps[k]), chain.steps[k])


@njit(nogil=True, cache=True, error_model="numpy", boundscheck=False)
def see(rows, q, target, chain, tool, led):  # type: ignore[no-untyped-def]
    """Write the tool's poses at ``q`` and ``target`` (N, 7) of ``rows`` into (N, 4, 4) each."""
    frames = np.zeros((7, 6))
    for i in rows:
        write_tool(q[i], chain, frames, tool[i])
        write_tool(target[i], chain, frames, led[i])


@njit(nogil=True, cache=True, error_model="numpy", boundscheck=False)
def room_of():  # type: ignore[no-untyped-def]
    """Room that :func:`aim` works in, one for each thread."""
    return (
        np.zeros((7, 6)),
        np.zeros((4, 4)),
        np.zeros((6, 7)),
        np.zeros((6, 6)),
        np.zeros(6),
        np.zeros(7),
        np.zeros(7),
        np.zeros(7, dtype=np.int64),
    )
