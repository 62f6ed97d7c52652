"""Forward and inverse kinematics of the Panda, over batches.

The world frame ``w`` is the frame of the robot's base. The tool frame ``t`` lies between the
finger pads: z is the way in which the hand approaches, y the one along which fingers close.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from articulate.robot.arm import Arm
from articulate.transforms import Array, Mask, inverse, pose, rotation_angle

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
HAND_TURN_RAD = -np.pi / 4
"""The hand is mounted turned by -45 degrees about the flange; franka_description."""


QUARTERS = tuple(round(2.0 * alpha / np.pi) for *_, alpha in DH)
"""The angles alpha in quarter turns: none, forward or backward."""


def _frames(q: Array) -> Iterator[tuple[Array, Array, Array, Array]]:
    """Axes x, y, z and origin (3, ...) of each joint's frame in the world for angles (..., 7).

    What multiplying the seven matrices of :data:`DH` comes to, without their noughts and ones.
    """
    c, s = np.cos(q), np.sin(q)
    x, y, z = (np.zeros((3, *q.shape[:-1])) for _ in range(3))
    x[0], y[1], z[2] = 1.0, 1.0, 1.0
    pos = np.zeros_like(x)
    for i, (a, d, _) in enumerate(DH):
        if QUARTERS[i]:
            y, z = QUARTERS[i] * z, -QUARTERS[i] * y
        if a:
            pos = pos + a * x
        if d:
            pos = pos + d * z
        x, y = c[..., i] * x + s[..., i] * y, c[..., i] * y - s[..., i] * x
        yield x, y, z, pos


def joint_poses(q: ArrayLike) -> Array:
    """Poses (..., 7, 4, 4) of the joint frames in the world frame for angles (..., 7) [rad]."""
    q = np.asarray(q, dtype=np.float64)
    out = np.zeros((*q.shape, 4, 4))
    out[..., 3, 3] = 1.0
    for i, frame in enumerate(_frames(q)):
        _write(out[..., i, :, :], *frame)
    return out


def _write(out: Array, x: Array, y: Array, z: Array, pos: Array) -> None:
    """Write axes and origins (3, ...) into poses (..., 4, 4)."""
    columns = np.moveaxis(out, (-2, -1), (0, 1))
    columns[:3, 0], columns[:3, 1], columns[:3, 2], columns[:3, 3] = x, y, z, pos


def flange_to_tool(arm: Arm) -> Array:
    """Pose ``T_7t`` (4, 4) of the tool frame in the frame of joint 7."""
    c, s = np.cos(HAND_TURN_RAD), np.sin(HAND_TURN_RAD)
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    return pose((0.0, 0.0, FLANGE_Z_M + arm.gripper.tcp_z_m), turn)


def _tool(arm: Arm, frame: tuple[Array, Array, Array, Array]) -> Array:
    """Pose of the tool (..., 4, 4) of the axes and origin of joint 7."""
    x, y, z, pos = frame
    c, s = np.cos(HAND_TURN_RAD), np.sin(HAND_TURN_RAD)
    out = np.zeros((*x.shape[1:], 4, 4))
    out[..., 3, 3] = 1.0
    _write(out, c * x + s * y, c * y - s * x, z, pos + (FLANGE_Z_M + arm.gripper.tcp_z_m) * z)
    return out


def tool_pose(arm: Arm, q: ArrayLike) -> Array:
    """Pose ``T_wt`` (..., 4, 4) of the tool frame for angles (..., 7) [rad]."""
    *_, last = _frames(np.asarray(q, dtype=np.float64))
    return _tool(arm, last)


def tool_jacobian(arm: Arm, q: ArrayLike) -> Array:
    """Geometric Jacobian (..., 6, 7) of the tool frame in the world: linear rows, then angular."""
    _, linear, axes = _joint_motions(arm, q)
    return np.swapaxes(np.concatenate([linear, axes], axis=-1), -1, -2)


def _joint_motions(arm: Arm, q: ArrayLike) -> tuple[Array, Array, Array]:
    """Pose of the tool, and what each joint moves and turns it by (..., 7, 3), in the world."""
    frames = list(_frames(np.asarray(q, dtype=np.float64)))
    T_wt = _tool(arm, frames[-1])
    tool = np.moveaxis(T_wt[..., :3, 3], -1, 0)
    out = np.empty((6, 7, *tool.shape[1:]))
    for i, (_, _, (x, y, z), pos) in enumerate(frames):
        along, across, up = tool - pos
        out[0, i] = y * up - z * across
        out[1, i] = z * along - x * up
        out[2, i] = x * across - y * along
        out[3, i], out[4, i], out[5, i] = x, y, z
    motions = np.moveaxis(out, (0, 1), (-1, -2))
    return T_wt, motions[..., :3], motions[..., 3:]


def tool_jacobian_t(arm: Arm, q: ArrayLike) -> Array:
    """The Jacobian (..., 6, 7) of :func:`tool_jacobian` in the axes of the tool."""
    T_wt, linear, axes = _joint_motions(arm, q)
    turn = T_wt[..., :3, :3]
    return np.swapaxes(np.concatenate([linear @ turn, axes @ turn], axis=-1), -1, -2)


def self_motion(jacobian: Array) -> Array:
    """Unit joint motion (..., 7) that leaves the tool where it is, for Jacobians (..., 6, 7).

    Its components are the signed minors of the Jacobian (the generalised cross product of its
    rows), so that its sign changes nowhere but at singular poses, where it fades to 0.
    """
    columns = np.arange(7)
    minors = np.stack([jacobian[..., columns != i] for i in columns], axis=-3)
    with np.errstate(divide="ignore"):  # of numbers near the smallest, which are as good as 0
        out = np.linalg.det(minors) * (-1.0) ** columns
    length = np.linalg.norm(out, axis=-1, keepdims=True)
    return np.asarray(out / np.maximum(length, 1e-4))


def resolve_motion(jacobian: Array, twist: Array, *, damping: float = 0.02) -> Array:
    """Smallest joint motion (..., 7) [rad] that moves the tool by ``twist`` (..., 6).

    Damped least squares (Wampler 1986): short of what is asked for by a share of
    damping^2 / sigma^2 along a direction of singular value sigma, and never large near a
    singular pose.

    Args:
        jacobian: Of the tool (..., 6, 7), in the frame of ``twist``.
        twist: Small motion of the tool: [m], then a rotation vector [rad].
        damping: Singular value at which the motion is halved.
    """
    transposed = np.swapaxes(jacobian, -1, -2)
    gram = jacobian @ transposed + damping**2 * np.eye(6)
    return np.asarray((transposed @ np.linalg.solve(gram, twist[..., None]))[..., 0])


@dataclass(frozen=True)
class IkResult:
    """What inverse kinematics found for a batch of N poses."""

    q: Array
    """Angles (N, 7) [rad], always within the limits."""
    pos_error: Array
    """Distance of the tool from its goal (N,) [m]."""
    rot_error: Array
    """Angle between tool and goal (N,) [rad]."""

    @property
    def reached(self) -> Mask:
        """Which goals were reached to 2 mm and 0.02 rad (N,)."""
        return np.asarray((self.pos_error < 2e-3) & (self.rot_error < 0.02))


def solve_ik(
    arm: Arm,
    T_wt: Array,
    q_start: ArrayLike,
    *,
    iterations: int = 60,
    margin_rad: float = 0.05,
    rest_gain: float = 0.02,
) -> IkResult:
    """Angles that bring the tool frame to ``T_wt``, by damped least squares with a rest pose.

    The method of C. W. Wampler, "Manipulator inverse kinematic solutions based on vector
    formulations and damped least-squares methods", IEEE Trans. SMC 16(1), 1986; what is left
    of freedom is drawn towards ``q_start``.

    Args:
        arm: Arm whose limits are kept.
        T_wt: Goals (N, 4, 4).
        q_start: Start and rest angles (7,) or (N, 7) [rad].
        iterations: Newton steps.
        margin_rad: Distance kept from the joint limits [rad].
        rest_gain: Pull towards the rest pose in the null space, per step.
    """
    n = len(T_wt)
    rest = np.broadcast_to(np.asarray(q_start, dtype=np.float64), (n, 7))
    q = rest.copy()
    low, high = arm.bounds(margin_rad)
    for _ in range(iterations):
        error = _pose_error(T_wt, tool_pose(arm, q))
        jac = tool_jacobian(arm, q)
        gram = jac @ np.swapaxes(jac, -1, -2) + 1e-4 * np.eye(6)
        pinv = np.swapaxes(jac, -1, -2) @ np.linalg.inv(gram)
        null = np.eye(7) - pinv @ jac
        step = np.einsum("nij,nj->ni", pinv, np.clip(error, -0.3, 0.3))
        step += rest_gain * np.einsum("nij,nj->ni", null, rest - q)
        q = np.clip(q + step, low, high)
    now = tool_pose(arm, q)
    turn = T_wt[:, :3, :3] @ np.swapaxes(
        now[:, :3, :3], -1, -2
    )  # the step's error is 0 at half one
    pos_error = np.linalg.norm(T_wt[:, :3, 3] - now[:, :3, 3], axis=-1)
    return IkResult(q, pos_error, rotation_angle(turn))


def manipulability(arm: Arm, q: ArrayLike) -> Array:
    """Smallest singular value (...) of the tool's Jacobian: near 0 at a singular pose."""
    return np.asarray(np.linalg.svd(tool_jacobian(arm, q), compute_uv=False)[..., -1])


def _pose_error(goal: Array, now: Array) -> Array:
    """Twist (N, 6) that carries ``now`` to ``goal``: metres, then a rotation vector."""
    rot = goal[..., :3, :3] @ np.swapaxes(now[..., :3, :3], -1, -2)
    skew = np.stack(
        [
            rot[..., 2, 1] - rot[..., 1, 2],
            rot[..., 0, 2] - rot[..., 2, 0],
            rot[..., 1, 0] - rot[..., 0, 1],
        ],
        axis=-1,
    )
    length = np.linalg.norm(skew, axis=-1, keepdims=True)
    angle = rotation_angle(rot)[..., None]
    turn = np.where(length > 1e-9, skew / np.where(length > 1e-9, length, 1.0) * angle, 0.5 * skew)
    return np.concatenate([goal[..., :3, 3] - now[..., :3, 3], turn], axis=-1)


def small_twist(T: Array) -> Array:
    """Motion (..., 6) of poses (..., 4, 4) near the identity: [m], then a rotation vector [rad].

    The vector has the length of the angle's sine, which is the angle to 1 % below 0.25 rad.
    """
    turn = [T[..., 2, 1] - T[..., 1, 2], T[..., 0, 2] - T[..., 2, 0], T[..., 1, 0] - T[..., 0, 1]]
    return np.concatenate([T[..., :3, 3], 0.5 * np.stack(turn, axis=-1)], axis=-1)


def relative(T_wa: Array, T_wb: Array) -> Array:
    """Pose ``T_ab`` (..., 4, 4) of frame b in frame a."""
    return np.asarray(inverse(T_wa) @ T_wb)
