"""Placement of an object in the world, and the path of its handle."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from articulate.assets.asset import Asset, Handle, handle_frame
from articulate.errors import ConfigError
from articulate.jit import row_function
from articulate.robot.arm import PAD_M
from articulate.transforms import Array, axis_angle_to_matrix, pose

MAX_NUMBER = 100.0
"""Largest size of a coordinate or angle of a placement [m or rad]."""


@dataclass(frozen=True, kw_only=True)
class ObjectPlacement:
    """Pose of the object in the world, and start pose of the arm."""

    pos_w: tuple[float, float, float]
    """Origin of the object frame in the world frame at nominal size [m]."""
    yaw_rad: float
    """Rotation of the object about the vertical [rad]."""
    flip: bool
    """True if the gripper is rotated by 180 degrees about its approach axis."""
    start_q: tuple[float, ...]
    """Start pose of the arm, with the wrist aligned to the handle (7,) [rad]."""
    joint_margin_rad: float
    """Smallest distance to a joint limit along the nominal path [rad]."""
    manipulability: float
    """Smallest singular value of the tool's Jacobian along the nominal path."""
    reachable_share: float
    """Share of sampled poses and sizes at which the complete path is reachable."""
    tilt_rad: float = 0.0
    """Rotation of the grasp about the handle's long axis [rad]; see :func:`tilted`."""
    beside_m: float = 0.0
    """Shift of the grasp along the closing axis of the fingers, the y axis of
    :func:`articulate.assets.asset.handle_frame` [m]: an open gripper that approaches beside the
    middle of the handle stays clear of a neighbouring part."""
    deeper_m: float = 0.0
    """Shift of the grasp along the approach [m]: fingers that close deeper hold a handle more
    firmly, and less deep they stay clear of the part behind it."""
    handle: Handle | None = None
    """Place to hold instead of the asset's handle; None: the asset's handle."""

    def __post_init__(self) -> None:
        grasp = (self.tilt_rad, self.beside_m, self.deeper_m)
        numbers = (*self.pos_w, self.yaw_rad, *self.start_q, *grasp)
        if not all(abs(number) <= MAX_NUMBER for number in numbers):
            raise ConfigError(
                f"placement: a position or angle is not within {MAX_NUMBER:g} m or rad of 0"
            )

    def T_wo(self) -> Array:
        """Return the pose of the object in the world (4, 4)."""
        return pose(self.pos_w, axis_angle_to_matrix(np.array([0.0, 0.0, 1.0]), self.yaw_rad))

    def as_dict(self) -> dict[str, Any]:
        """Return the fields for JSON."""
        return asdict(self)


def grasped(asset: Asset, joint: str, placement: ObjectPlacement) -> Asset:
    """Return ``asset`` with the handle of ``joint`` as it is held in ``placement``."""
    if placement.handle is not None:
        asset = asset.with_handle(placement.handle)
    asset = tilted(asset, joint, placement.tilt_rad)
    handle = asset.handle_of(joint)
    if handle is None or placement.beside_m == placement.deeper_m == 0.0:
        return asset
    x, y, z = handle_frame(handle)[:3] @ [0.0, placement.beside_m, placement.deeper_m, 1.0]
    return asset.with_handle(replace(handle, pos_l=(float(x), float(y), float(z))))


def tilted(asset: Asset, joint: str, tilt_rad: float) -> Asset:
    """Return ``asset`` with the handle of ``joint`` rotated by ``tilt_rad`` about its long axis.

    Fingers can hold a bar from slightly above or from the side. On a part that rotates, a grasp
    that begins rotated the other way can follow further. The thickness between the fingers is then
    that of the section of the handle that the short pads reach.
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


class HandlePath(NamedTuple):
    """Path of a handle in the frame of its object, as numbers for row functions."""

    hinge: bool
    """True if the joint rotates, False if it slides."""
    axis_o: Array
    """Axis of the joint (3,)."""
    pivot_o: Array
    """Point on that axis (3,) [m]."""
    T_oh: Array
    """Pose of the handle with the joint at 0 (4, 4)."""
    closed: float
    """Position of the joint in the closed state [m or rad]."""
    span: float
    """Signed travel to the open state [m or rad]."""

    def at(self, opened: Array) -> Array:
        """Return the poses ``T_oh`` (..., 4, 4) at fractions ``opened`` (...)."""
        opened = np.asarray(opened, dtype=np.float64)
        return self.in_world(T_wo=np.eye(4), scale=np.ones(opened.shape), opened=opened)

    def in_world(self, *, T_wo: Array, scale: Array, opened: Array) -> Array:
        """Return the poses ``T_wh`` (N, 4, 4) at fractions ``opened`` (N,).

        Args:
            T_wo: Poses of the objects in the world (N, 4, 4) or (4, 4).
            scale: Sizes of the objects (N,).
            opened: Fractions open (N,).
        """
        opened = np.asarray(opened, dtype=np.float64)
        out = np.empty((4, 4, *opened.shape))
        write_handle_pose(self, np.moveaxis(T_wo, (-2, -1), (0, 1)), scale, opened, out)
        return np.ascontiguousarray(np.moveaxis(out, (0, 1), (-2, -1)))


@row_function
def write_handle_pose(path: HandlePath, T_wo: Any, scale: Any, opened: Any, out: Array) -> None:
    """Write the pose of a handle in the world.

    Args:
        path: Path of the handle.
        T_wo: Pose of the object in the world (4, 4, ...).
        scale: Size of the object, a number or an array (...).
        opened: Fraction open, a number or an array (...).
        out: Output (4, 4, ...).
    """
    q, T = path.closed + opened * path.span, path.T_oh
    ax, ay, az = path.axis_o[0], path.axis_o[1], path.axis_o[2]
    px, py, pz = path.pivot_o[0], path.pivot_o[1], path.pivot_o[2]
    c, s = np.cos(q), np.sin(q)
    d = 1.0 - c
    for j in range(4):
        a, b, e = T[0, j], T[1, j], T[2, j]
        if path.hinge:  # Rodrigues about the pivot
            if j == 3:
                a, b, e = a - px, b - py, e - pz
            x = (c + ax * ax * d) * a + (ax * ay * d - az * s) * b + (ax * az * d + ay * s) * e
            y = (ay * ax * d + az * s) * a + (c + ay * ay * d) * b + (ay * az * d - ax * s) * e
            z = (az * ax * d - ay * s) * a + (az * ay * d + ax * s) * b + (c + az * az * d) * e
            if j == 3:
                x, y, z = x + px, y + py, z + pz
        elif j == 3:
            x, y, z = a + q * ax, b + q * ay, e + q * az
        else:
            x, y, z = a + 0.0 * q, b + 0.0 * q, e + 0.0 * q
        if j == 3:
            x, y, z = scale * x, scale * y, scale * z
        for r in range(3):
            total = T_wo[r, 0] * x + T_wo[r, 1] * y + T_wo[r, 2] * z
            out[r, j] = total + T_wo[r, 3] if j == 3 else total
    out[3, 0] = out[3, 1] = out[3, 2] = 0.0
    out[3, 3] = 1.0


def handle_path_of(asset: Asset, joint: str, *, flip: bool = False) -> HandlePath:
    """Return the path of the handle of ``joint``.

    Args:
        asset: Object.
        joint: Joint that moves the handle.
        flip: Use the handle frame of a gripper that is rotated by 180 degrees.
    """
    T_oh = asset.T_oh(joint, 0.0)
    if flip:
        T_oh = T_oh @ pose(np.zeros(3), np.diag([-1.0, -1.0, 1.0]))
    moving = asset.joint(joint)
    return HandlePath(
        hinge=moving.kind != "slide",
        axis_o=np.array(moving.axis_o, dtype=np.float64),
        pivot_o=np.array(moving.pivot_o, dtype=np.float64),
        T_oh=np.ascontiguousarray(T_oh, dtype=np.float64),
        closed=float(moving.closed),
        span=float(moving.span),
    )


def handle_poses(asset: Asset, joint: str, opened: Array, *, flip: bool = False) -> Array:
    """Return the handle poses ``T_oh`` (..., 4, 4) in the object frame at fractions (...)."""
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
    """Return the handle poses ``T_wh`` (N, 4, 4) of objects of sizes (N,) at ``T_wo`` (N, 4, 4)."""
    return handle_path_of(asset, joint, flip=flip).in_world(T_wo=T_wo, scale=scale, opened=opened)


def object_pose(
    asset: Asset, joint: str, place: ObjectPlacement, *, scale: Array, shift: Array, yaw: Array
) -> Array:
    """Return the poses ``T_wo`` (N, 4, 4) that leave the closed handle in place but for the shift.

    This holds as seen from above: the object keeps its floor, so at another size its handle is
    higher or lower.

    Args:
        asset: The object.
        joint: Joint of the task.
        place: Nominal placement.
        scale: Sizes (N,).
        shift: Shift of the closed handle along world x and y (N, 2) [m].
        yaw: Rotation about the vertical through the closed handle (N,) [rad].
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
