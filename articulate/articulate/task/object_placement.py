"""Placement of an object in the world, and the path of its handle."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from articulate.assets.asset import Asset, Handle, Joint, joint_motion
from articulate.robot.arm import PAD_M
from articulate.transforms import Array, axis_angle_to_matrix, pose


@dataclass(frozen=True, kw_only=True)
class ObjectPlacement:
    """Pose of the object in the world and start pose of the arm."""

    pos_w: tuple[float, float, float]
    """Origin of the object frame in the world frame at nominal size [m]."""
    yaw_rad: float
    """Turn of the object about the vertical [rad]."""
    flip: bool
    """True for a gripper turned by 180 degrees about its approach axis."""
    start_q: tuple[float, ...]
    """Start pose of the arm, its wrist aligned with the handle (7,) [rad]."""
    joint_margin_rad: float
    """Smallest distance to a joint limit along the nominal path [rad]."""
    manipulability: float
    """Smallest singular value of the tool's Jacobian along the nominal path."""
    reachable_share: float
    """Fraction of sampled poses and sizes at which the complete path is reachable."""
    tilt_rad: float = 0.0
    """Turn of the gripper about the long axis of the handle [rad]; see :func:`tilted`."""

    def T_wo(self) -> Array:
        """Pose of the object in the world (4, 4)."""
        return pose(self.pos_w, axis_angle_to_matrix(np.array([0.0, 0.0, 1.0]), self.yaw_rad))

    def as_dict(self) -> dict[str, Any]:
        """Return a JSON-compatible dictionary."""
        return asdict(self)


def tilted(asset: Asset, joint: str, tilt_rad: float) -> Asset:
    """Return ``asset`` with the handle of ``joint`` turned by ``tilt_rad`` about its long axis.

    Fingers can hold a bar from slightly above or from the side. On a hinge, a gripper that starts
    turned the other way can follow the handle farther. The thickness between the fingers is that
    of the section that the short pads reach.
    """
    if tilt_rad == 0.0:
        return asset
    c, s = abs(np.cos(tilt_rad)), abs(np.sin(tilt_rad))

    def turned(handle: Handle) -> Handle:
        turn = axis_angle_to_matrix(np.asarray(handle.along_l), tilt_rad)
        x, y, z = turn @ np.asarray(handle.normal_l)
        long, thick, deep = handle.extent
        between = min(deep, 2.0 * PAD_M)
        return replace(
            handle,
            normal_l=(float(x), float(y), float(z)),
            extent=(long, c * thick + s * between, s * thick + c * deep),
        )

    handles = (turned(h) if h.joint == joint else h for h in asset.handles)
    return replace(asset, handles=tuple(handles))


@dataclass(frozen=True)
class HandlePath:
    """Path of a handle in the frame of its object, with its constant part precomputed."""

    joint: Joint
    """Joint that moves it."""
    T_oh: Array
    """Pose of the handle with that joint at 0 (4, 4)."""

    def at(self, opened: Array) -> Array:
        """Return poses ``T_oh`` (..., 4, 4) [m] at open fractions ``opened`` (...)."""
        moved = joint_motion(self.joint, self.joint.closed + opened * self.joint.span)
        return np.asarray(moved @ self.T_oh)

    def in_world(self, *, T_wo: Array, scale: Array, opened: Array) -> Array:
        """Return poses ``T_wh`` (N, 4, 4) [m] of objects of sizes ``scale`` (N,) at ``T_wo``."""
        T_oh = self.at(opened)
        T_oh[..., :3, 3] *= np.asarray(scale)[..., None]
        return np.asarray(T_wo @ T_oh)


def handle_path_of(asset: Asset, joint: str, *, flip: bool = False) -> HandlePath:
    """Return the path of the handle of ``joint``, with ``flip`` for a gripper turned by 180 deg."""
    T_oh = asset.T_oh(joint, 0.0)
    if flip:
        T_oh = T_oh @ pose(np.zeros(3), np.diag([-1.0, -1.0, 1.0]))
    return HandlePath(asset.joint(joint), np.asarray(T_oh))


def handle_poses(asset: Asset, joint: str, opened: Array, *, flip: bool = False) -> Array:
    """Return handle poses ``T_oh`` (..., 4, 4) [m] at open fractions ``opened`` (...)."""
    return handle_path_of(asset, joint, flip=flip).at(opened)


def handle_in_world(
    asset: Asset,
    joint: str,
    *,
    T_wo: Array,
    scale: Array,
    opened: Array,
    flip: bool,
) -> Array:
    """Return handle poses ``T_wh`` (N, 4, 4) [m].

    Args:
        asset: The object.
        joint: Joint that moves the handle.
        T_wo: Poses of the objects (N, 4, 4) [m].
        scale: Sizes relative to the asset (N,).
        opened: Open fractions (N,).
        flip: The gripper is turned by 180 degrees about its approach axis.
    """
    return handle_path_of(asset, joint, flip=flip).in_world(T_wo=T_wo, scale=scale, opened=opened)


def object_pose(
    asset: Asset, joint: str, place: ObjectPlacement, *, scale: Array, shift: Array, yaw: Array
) -> Array:
    """Return object poses ``T_wo`` (N, 4, 4) [m] with the closed handle in place but for a shift.

    The handle keeps its position seen from above; the object stays on its floor, so that at another
    size its handle is higher or lower.

    Args:
        asset: The object.
        joint: Joint of the task.
        place: Nominal placement.
        scale: Sizes relative to the asset (N,).
        shift: Shift of the closed handle along world x and y (N, 2) [m].
        yaw: Turn about the vertical through the closed handle (N,) [rad].
    """
    grip_o = handle_poses(asset, joint, np.zeros(1))[0, :3, 3]
    nominal = place.T_wo()
    grip_w = nominal[:3, :3] @ grip_o + nominal[:3, 3]
    turn = axis_angle_to_matrix(np.array([0.0, 0.0, 1.0]), place.yaw_rad + np.asarray(yaw))
    offset = np.einsum("nij,j->ni", turn, grip_o) * np.asarray(scale)[:, None]
    pos = grip_w - offset
    pos[:, :2] += shift
    pos[:, 2] = place.pos_w[2]
    return pose(pos, turn)
