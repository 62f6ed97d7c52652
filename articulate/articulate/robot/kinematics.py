"""Forward and inverse kinematics of the Panda.

The world frame ``w`` is the frame of the robot's base. The tool frame ``t`` is between the finger
pads: z is the approach direction, y the closing direction of the fingers.

Row functions (:mod:`articulate.jit`) take the components on the first axes. Further axes are a
batch, which :func:`tool_pose` and its like put last for them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from articulate.jit import row_function
from articulate.robot.arm import Arm
from articulate.transforms import Array, Ints, Mask, inverse, rotation_angle

# Craig's modified Denavit-Hartenberg parameters (a, d, alpha) of joints 1 to 7;
# Franka Control Interface documentation, "Denavit-Hartenberg parameters".
DH = (
    (0.0, 0.333, 0.0),
    (0.0, 0.0, -np.pi / 2),
    (0.0, 0.316, np.pi / 2),
    (0.0825, 0.0, np.pi / 2),
    (-0.0825, 0.384, -np.pi / 2),
    (0.0, 0.0, np.pi / 2),
    (0.088, 0.0, np.pi / 2),
)
FLANGE_Z_M = 0.107
"""Flange above joint 7 [m]; same source."""
GRIPPER_YAW_RAD = -np.pi / 4
"""Rotation of the gripper about the flange axis [rad]; franka_description."""
FADE_LENGTH = 1e-4
"""Length of the minors of a Jacobian below which the self-motion fades to 0."""
MAX_TWIST = 0.3
"""Largest component of the motion in a step of inverse kinematics [m or rad]."""
IK_DAMPING = 1e-4
"""Square of the damping of inverse kinematics."""
WORLD_AXES = np.eye(3)
"""Axes of the world."""


class ArmGeometry(NamedTuple):
    """Dimensions of the kinematic chain, as numbers for row functions."""

    a: Array
    """Offsets along x to each joint (7,) [m]."""
    d: Array
    """Offsets along z to each joint (7,) [m]."""
    quarter_turns: Ints
    """Rotations about x to each joint (7,), in quarter turns: all angles alpha are multiples."""
    gripper_yaw: Array
    """Cosine and sine of :data:`GRIPPER_YAW_RAD` (2,)."""
    tool_m: float
    """Distance of the tool from joint 7 along its axis [m]."""


@cache
def arm_geometry(arm: Arm) -> ArmGeometry:
    """Return the dimensions of ``arm``."""
    return ArmGeometry(
        a=np.array([a for a, _, _ in DH]),
        d=np.array([d for _, d, _ in DH]),
        quarter_turns=np.array([round(2.0 * alpha / np.pi) for *_, alpha in DH], dtype=np.int64),
        gripper_yaw=np.array([np.cos(GRIPPER_YAW_RAD), np.sin(GRIPPER_YAW_RAD)]),
        tool_m=FLANGE_Z_M + arm.gripper.tcp_z_m,
    )


@row_function
def write_frames(q: Any, geometry: ArmGeometry, frames: Array, T_wt: Array) -> None:
    """Write the joint frames and the tool pose for joint angles.

    The products of the seven matrices of :data:`DH`, without their zeros and ones.

    Args:
        q: Joint angles (7, ...) [rad].
        geometry: Dimensions of the arm.
        frames: Output (7, 12, ...): axis z, origin, axis x and axis y of each joint in the world.
        T_wt: Output (4, 4, ...): pose of the tool in the world.
    """
    xx, xy, xz = 1.0, 0.0, 0.0
    yx, yy, yz = 0.0, 1.0, 0.0
    zx, zy, zz = 0.0, 0.0, 1.0
    px = py = pz = 0.0
    for i in range(7):
        k = geometry.quarter_turns[i]
        if k != 0:
            yx, zx = k * zx, -k * yx
            yy, zy = k * zy, -k * yy
            yz, zz = k * zz, -k * yz
        a, d = geometry.a[i], geometry.d[i]
        px = px + (a * xx + d * zx)
        py = py + (a * xy + d * zy)
        pz = pz + (a * xz + d * zz)
        c, s = np.cos(q[i]), np.sin(q[i])
        xx, yx = c * xx + s * yx, c * yx - s * xx
        xy, yy = c * xy + s * yy, c * yy - s * xy
        xz, yz = c * xz + s * yz, c * yz - s * xz
        frames[i, 0], frames[i, 1], frames[i, 2] = zx, zy, zz
        frames[i, 3], frames[i, 4], frames[i, 5] = px, py, pz
        frames[i, 6], frames[i, 7], frames[i, 8] = xx, xy, xz
        frames[i, 9], frames[i, 10], frames[i, 11] = yx, yy, yz
    c, s, tool_m = geometry.gripper_yaw[0], geometry.gripper_yaw[1], geometry.tool_m
    T_wt[0, 0], T_wt[1, 0], T_wt[2, 0] = c * xx + s * yx, c * xy + s * yy, c * xz + s * yz
    T_wt[0, 1], T_wt[1, 1], T_wt[2, 1] = c * yx - s * xx, c * yy - s * xy, c * yz - s * xz
    T_wt[0, 2], T_wt[1, 2], T_wt[2, 2] = zx, zy, zz
    T_wt[0, 3], T_wt[1, 3] = px + tool_m * zx, py + tool_m * zy
    T_wt[2, 3] = pz + tool_m * zz
    T_wt[3, 0] = T_wt[3, 1] = T_wt[3, 2] = 0.0
    T_wt[3, 3] = 1.0


@row_function
def write_jacobian(frames: Array, T_wt: Array, axes: Array, out: Array) -> None:
    """Write the geometric Jacobian of the tool in the axes of a frame.

    Args:
        frames: Joint frames (7, 12, ...) of :func:`write_frames`.
        T_wt: Pose of the tool in the world (4, 4, ...).
        axes: Axes of the frame in the world, as columns (3, 3, ...) or a pose (4, 4, ...).
        out: Output (6, 7, ...): linear rows [m/rad], then angular rows.
    """
    for i in range(7):
        zx, zy, zz = frames[i, 0], frames[i, 1], frames[i, 2]
        rx, ry, rz = T_wt[0, 3] - frames[i, 3], T_wt[1, 3] - frames[i, 4], T_wt[2, 3] - frames[i, 5]
        lx, ly, lz = zy * rz - zz * ry, zz * rx - zx * rz, zx * ry - zy * rx
        for r in range(3):
            ax, ay, az = axes[0, r], axes[1, r], axes[2, r]
            out[r, i] = ax * lx + ay * ly + az * lz
            out[r + 3, i] = ax * zx + ay * zy + az * zz


@row_function
def _solve(matrix: Array, right: Array) -> None:
    """Solve ``matrix x = right`` in place by elimination with row exchanges, x into ``right``."""
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


@row_function
def resolve_motion(
    jacobian: Array, twist: Array, damping: float, square: Array, out: Array
) -> None:
    """Write the smallest joint motion that moves the tool by ``twist``.

    Damped least squares (Wampler 1986): short of the request by damping^2 / sigma^2 along a
    direction of singular value sigma, and never large near a singular pose.

    Args:
        jacobian: Jacobian of the tool (6, 7), in the frame of ``twist``.
        twist: Small motion of the tool (6,): [m], then a rotation vector [rad]; overwritten.
        damping: Singular value at which the motion is halved.
        square: Scratch (6, 6).
        out: Output (7,) [rad].
    """
    for r in range(6):
        for j in range(6):
            total = damping**2 if r == j else 0.0
            for k in range(7):
                total += jacobian[r, k] * jacobian[j, k]
            square[r, j] = total
    _solve(square, twist)
    for k in range(7):
        out[k] = 0.0
        for r in range(6):
            out[k] += jacobian[r, k] * twist[r]


@row_function
def _eliminate(matrix: Array, order: Ints) -> float:
    """Make ``matrix`` (6, 7) triangular in place and return the signed product of the pivots.

    The largest remaining number is the next pivot: rows and columns are exchanged for it, and
    ``order`` (7,) records which column is at which position.
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


@row_function
def write_self_motion(jacobian: Array, order: Ints, out: Array) -> None:
    """Write the unit joint motion that leaves the tool in place.

    Its components are the signed minors of the Jacobian (the generalised cross product of its
    rows), so its sign changes at singular poses only, where it fades to 0.

    Args:
        jacobian: Jacobian of the tool (6, 7); overwritten.
        order: Scratch (7,) of int.
        out: Output (7,).
    """
    for c in range(7):
        order[c] = c
        out[c] = 0.0
    det = _eliminate(jacobian, order)
    if det == 0.0:
        return
    length = det * det
    out[order[6]] = det
    for k in range(5, -1, -1):
        total = jacobian[k, 6] * det
        for c in range(k + 1, 6):
            total += jacobian[k, c] * out[order[c]]
        out[order[k]] = -total / jacobian[k, k]
        length += out[order[k]] ** 2
    length = max(np.sqrt(length), FADE_LENGTH)
    for c in range(7):
        out[c] /= length


def _batch(arm: Arm, q: ArrayLike) -> tuple[Array, Array]:
    """Frames (7, 12, ...) and tool poses (4, 4, ...) for angles (..., 7)."""
    q = np.moveaxis(np.asarray(q, dtype=np.float64), -1, 0)
    frames, T_wt = np.empty((7, 12, *q.shape[1:])), np.empty((4, 4, *q.shape[1:]))
    write_frames(q, arm_geometry(arm), frames, T_wt)
    return frames, T_wt


def _matrices_last(values: Array) -> Array:
    """Move the first two axes to the end."""
    return np.ascontiguousarray(np.moveaxis(values, (0, 1), (-2, -1)))


def joint_poses(arm: Arm, q: ArrayLike) -> Array:
    """Return the world poses (..., 7, 4, 4) of the joint frames for angles (..., 7) [rad]."""
    frames, _ = _batch(arm, q)
    out = np.zeros((*frames.shape[2:], 7, 4, 4))
    out[..., 3, 3] = 1.0
    for column, first in enumerate((6, 9, 0, 3)):
        out[..., :3, column] = np.moveaxis(frames[:, first : first + 3], (0, 1), (-2, -1))
    return out


def tool_pose(arm: Arm, q: ArrayLike) -> Array:
    """Return the pose ``T_wt`` (..., 4, 4) of the tool frame for angles (..., 7) [rad]."""
    return _matrices_last(_batch(arm, q)[1])


def tool_jacobian(arm: Arm, q: ArrayLike, *, in_tool: bool = False) -> Array:
    """Return the geometric Jacobian (..., 6, 7) of the tool: linear rows [m/rad], then angular.

    Args:
        arm: Arm.
        q: Joint angles (..., 7) [rad].
        in_tool: Use the axes of the tool instead of those of the world.
    """
    frames, T_wt = _batch(arm, q)
    out = np.empty((6, 7, *T_wt.shape[2:]))
    write_jacobian(frames, T_wt, T_wt if in_tool else np.eye(3), out)
    return _matrices_last(out)


@dataclass(frozen=True)
class IkResult:
    """Result of inverse kinematics for a batch of N poses."""

    q: Array
    """Angles (N, 7) [rad], always within the limits."""
    pos_error: Array
    """Distance of the tool from its goal (N,) [m]."""
    rot_error: Array
    """Angle between tool and goal (N,) [rad]."""

    @property
    def reached(self) -> Mask:
        """True where the goal is reached to 2 mm and 0.02 rad (N,)."""
        return np.asarray((self.pos_error < 2e-3) & (self.rot_error < 0.02))


class IkScratch(NamedTuple):
    """Memory of :func:`write_ik`."""

    frames: Array
    """Joint frames (7, 12)."""
    T_wt: Array
    """Pose of the tool (4, 4)."""
    jacobian: Array
    """Jacobian (6, 7) of the tool in world axes."""
    square: Array
    """Scratch (6, 6)."""
    twist: Array
    """Twist (6,) to the goal."""


def new_ik_scratch() -> IkScratch:
    """Return memory for :func:`write_ik`."""
    return IkScratch(
        frames=np.empty((7, 12)),
        T_wt=np.empty((4, 4)),
        jacobian=np.empty((6, 7)),
        square=np.empty((6, 6)),
        twist=np.empty(6),
    )


@row_function
def _write_pose_error(goal: Array, now: Array, out: Array) -> None:
    """Write the twist (6,) that carries ``now`` to ``goal`` (4, 4): [m], then a rotation vector.

    The rotation vector is 0 at half a turn.
    """
    trace = 0.0
    for r in range(3):
        out[r] = goal[r, 3] - now[r, 3]
        a, b = (r + 1) % 3, (r + 2) % 3
        skew = 0.0
        for j in range(3):
            skew += goal[b, j] * now[a, j] - goal[a, j] * now[b, j]
            trace += goal[r, j] * now[r, j]
        out[3 + r] = skew
    sine = np.sqrt(out[3] ** 2 + out[4] ** 2 + out[5] ** 2)
    factor = np.arctan2(sine, trace - 1.0) / sine if sine > 1e-9 else 0.5
    for r in range(3):
        out[3 + r] *= factor


@row_function
def write_ik(
    goals: Array,
    rest: Array,
    low: Array,
    high: Array,
    geometry: ArmGeometry,
    iterations: int,
    rest_gain: float,
    scratch: IkScratch,
    q: Array,
) -> None:
    """Improve joint angles for tool poses by damped least squares; see :func:`solve_ik`.

    Args:
        goals: Poses of the tool (N, 4, 4).
        rest: Rest angles (N, 7) [rad].
        low: Lower bounds (7,) [rad].
        high: Upper bounds (7,) [rad].
        geometry: Dimensions of the arm.
        iterations: Newton steps.
        rest_gain: Pull towards the rest pose in the null space, per step.
        scratch: Memory.
        q: Angles (N, 7) [rad], overwritten.
    """
    frames, T_wt, jacobian, square, twist = scratch
    for i in range(len(goals)):
        for _ in range(iterations):
            write_frames(q[i], geometry, frames, T_wt)
            write_jacobian(frames, T_wt, WORLD_AXES, jacobian)
            _write_pose_error(goals[i], T_wt, twist)
            for r in range(6):
                twist[r] = min(max(twist[r], -MAX_TWIST), MAX_TWIST)
                for j in range(7):
                    twist[r] -= rest_gain * jacobian[r, j] * (rest[i, j] - q[i, j])
                for c in range(6):
                    total = IK_DAMPING if r == c else 0.0
                    for j in range(7):
                        total += jacobian[r, j] * jacobian[c, j]
                    square[r, c] = total
            _solve(square, twist)
            for j in range(7):
                step = rest_gain * (rest[i, j] - q[i, j])
                for r in range(6):
                    step += jacobian[r, j] * twist[r]
                q[i, j] = min(max(q[i, j] + step, low[j]), high[j])


def solve_ik(
    arm: Arm,
    T_wt: Array,
    q_start: ArrayLike,
    *,
    iterations: int = 60,
    margin_rad: float = 0.05,
    rest_gain: float = 0.02,
    rows: Callable[..., None] = write_ik,
) -> IkResult:
    """Find angles that bring the tool frame to ``T_wt``: damped least squares with a rest pose.

    The method of C. W. Wampler, "Manipulator inverse kinematic solutions based on vector
    formulations and damped least-squares methods", IEEE Trans. SMC 16(1), 1986; the remaining
    freedom is pulled towards ``q_start``.

    Args:
        arm: Arm, for its geometry and joint limits.
        T_wt: Goals (N, 4, 4).
        q_start: Start and rest angles (7,) or (N, 7) [rad].
        iterations: Newton steps.
        margin_rad: Distance from the joint limits [rad].
        rest_gain: Pull towards the rest pose in the null space, per step.
        rows: :func:`write_ik` or its compiled form.
    """
    n = len(T_wt)
    rest = np.full((n, 7), q_start, dtype=np.float64)
    q = rest.copy()
    low, high = arm.bounds(margin_rad)
    goals = np.ascontiguousarray(T_wt, dtype=np.float64)
    rows(goals, rest, low, high, arm_geometry(arm), iterations, rest_gain, new_ik_scratch(), q)
    now = tool_pose(arm, q)
    turn = T_wt[:, :3, :3] @ np.swapaxes(now[:, :3, :3], -1, -2)
    pos_error = np.linalg.norm(T_wt[:, :3, 3] - now[:, :3, 3], axis=-1)
    return IkResult(q, pos_error, rotation_angle(turn))


def manipulability(arm: Arm, q: ArrayLike) -> Array:
    """Return the smallest singular value (...) of the tool Jacobian: near 0 at a singular pose."""
    return np.asarray(np.linalg.svd(tool_jacobian(arm, q), compute_uv=False)[..., -1])


@row_function
def write_small_twist(T_wa: Array, T_wb: Array, out: Array) -> None:
    """Write the motion from frame a to a nearby frame b, in the axes of a.

    The rotation vector has the length of the angle's sine: the angle to 1 % below 0.25 rad.

    Args:
        T_wa: Pose of frame a (4, 4, ...).
        T_wb: Pose of frame b (4, 4, ...).
        out: Output (6, ...): translation [m], then a rotation vector [rad].
    """
    for r in range(3):
        total = 0.0
        for j in range(3):
            total = total + T_wa[j, r] * (T_wb[j, 3] - T_wa[j, 3])
        out[r] = total
    for r in range(3):
        a, b = (r + 1) % 3, (r + 2) % 3
        total = 0.0
        for j in range(3):
            total = total + (T_wa[j, b] * T_wb[j, a] - T_wa[j, a] * T_wb[j, b])
        out[3 + r] = 0.5 * total


def small_twist(T_wa: Array, T_wb: Array) -> Array:
    """Return the motion (..., 6) from poses a to nearby poses b (..., 4, 4), in the axes of a.

    Translation [m], then a rotation vector [rad]; see :func:`write_small_twist`.
    """
    T_wa, T_wb = np.broadcast_arrays(T_wa, T_wb)
    out = np.empty((6, *T_wa.shape[:-2]))
    first = (0, 1)
    write_small_twist(np.moveaxis(T_wa, (-2, -1), first), np.moveaxis(T_wb, (-2, -1), first), out)
    return np.ascontiguousarray(np.moveaxis(out, 0, -1))


def relative(T_wa: Array, T_wb: Array) -> Array:
    """Return the pose ``T_ab`` (..., 4, 4) of frame b in frame a."""
    return np.asarray(inverse(T_wa) @ T_wb)
