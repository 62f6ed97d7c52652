"""Where an object stands in the world, and where that puts its handle."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from articulate.assets.asset import Asset, Handle, Joint, joint_motion
from articulate.robot.arm import PAD_M
from articulate.transforms import Array, axis_angle_to_matrix, pose


@dataclass(frozen=True, kw_only=True)
class ObjectPlacement:
    """Where the object stands in the world and how the hand starts."""

    pos_w: tuple[float, float, float]
    """Origin of the object frame in the world frame at nominal size [m]."""
    yaw_rad: float
    """Turn of the object about the vertical [rad]."""
    flip: bool
    """The hand holds the handle turned by 180 degrees about its approach axis."""
    start_q: tuple[float, ...]
    """Start pose of the arm, its wrist turned as the handle asks (7,) [rad]."""
    joint_margin_rad: float
    """Smallest distance to a joint limit along the nominal way [rad]."""
    manipulability: float
    """Smallest singular value of the tool's Jacobian along the nominal way."""
    reachable_share: float
    """Share of drawn poses and sizes at which the whole way can be reached."""
    tilt_rad: float = 0.0
    """The hand holds the handle turned by this about its long axis [rad]; see :func:`tilted`."""

    def T_wo(self) -> Array:
        """Pose of the object in the world (4, 4)."""
        return pose(self.pos_w, axis_angle_to_matrix(np.array([0.0, 0.0, 1.0]), self.yaw_rad))

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return asdict(self)


def tilted(asset: Asset, joint: str, tilt_rad: float) -> Asset:
    """``asset`` with the handle of ``joint`` turned by ``tilt_rad`` about its long axis.

    Fingers hold a bar as well from a little above or from the side. Where the part turns, a hand
    that begins turned the other way can follow farther. What is then between them is as thick as
    what of the handle the pads reach, which are short.
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
    """How a handle moves in the frame of its object: what does not change is worked out once."""

    joint: Joint
    """The joint that moves it."""
    T_oh: Array
    """Its pose with that joint at 0 (4, 4)."""

    def at(self, opened: Array) -> Array:
        """Poses ``T_oh`` (..., 4, 4) at fractions ``opened`` (...)."""
        moved = joint_motion(self.joint, self.joint.closed + opened * self.joint.span)
        return np.asarray(moved @ self.T_oh)

    def in_world(self, *, T_wo: Array, scale: Array, opened: Array) -> Array:
        """Poses ``T_wh`` (N, 4, 4) of objects of sizes ``scale`` (N,) at ``T_wo`` (N, 4, 4)."""
        T_oh = self.at(opened)
        T_oh[..., :3, 3] *= np.asarray(scale)[..., None]
        return np.asarray(T_wo @ T_oh)


def way_of(asset: Asset, joint: str, *, flip: bool = False) -> HandlePath:
    """How the handle of ``joint`` moves; with ``flip`` as a hand turned by 180 degrees holds it."""
    T_oh = asset.T_oh(joint, 0.0)
    if flip:
        T_oh = T_oh @ pose(np.zeros(3), np.diag([-1.0, -1.0, 1.0]))
    return HandlePath(asset.joint(joint), np.asarray(T_oh))


def handle_way(asset: Asset, joint: str, opened: Array, *, flip: bool = False) -> Array:
    """Handle poses ``T_oh`` (..., 4, 4) in the object frame at fractions ``opened`` (...)."""
    return way_of(asset, joint, flip=flip).at(opened)


def handle_in_world(
    asset: Asset,
    joint: str,
    *,
    T_wo: Array,
    scale: Array,
    opened: Array,
    flip: bool,
) -> Array:
    """Handle poses ``T_wh`` (N, 4, 4) of objects of sizes ``scale`` (N,) at ``T_wo`` (N, 4, 4)."""
    return way_of(asset, joint, flip=flip).in_world(T_wo=T_wo, scale=scale, opened=opened)


def object_pose(
    asset: Asset, joint: str, place: ObjectPlacement, *, scale: Array, shift: Array, yaw: Array
) -> Array:
    """Poses ``T_wo`` (N, 4, 4) so that the closed handle stays where it is but for the shift.

    That is as seen from above: the object keeps its floor, and at another size its handle is
    higher or lower.

    Args:
        asset: The object.
        joint: Joint of the task.
        place: Nominal place.
        scale: Sizes (N,).
        shift: Shift of the closed handle along world x and y (N, 2) [m].
        yaw: Turn about the vertical through the closed handle (N,) [rad].
    """
    grip_o = handle_way(asset, joint, np.zeros(1))[0, :3, 3]
    nominal = place.T_wo()
    grip_w = nominal[:3, :3] @ grip_o + nominal[:3, 3]
    turn = axis_angle_to_matrix(np.array([0.0, 0.0, 1.0]), place.yaw_rad + np.asarray(yaw))
    offset = np.einsum("nij,j->ni", turn, grip_o) * np.asarray(scale)[:, None]
    pos = grip_w - offset
    pos[:, :2] += shift
    pos[:, 2] = place.pos_w[2]
    return pose(pos, turn)
