"""The handle of each joint of a converted object."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np
import trimesh

from articulate.assets.asset import Asset, Handle, Joint, Vec3
from articulate.conversion.write_asset import Body
from articulate.formats.load_meshes import joined
from articulate.formats.repairs import Repairs
from articulate.geometry.collision import is_handle
from articulate.geometry.grasp import Grasp, best_grasp, outermost_point
from articulate.transforms import Array, angle_between, inverse, normalised

SNAP_RAD = 0.6
"""A hinge's opening direction is turned to an axis of the object within this angle [rad]."""
ALL_ROUND = 1e-6
"""Largest mean offset of the outermost points of a part from its axis, as a share of its radius,
with which the part is symmetric about it."""
UPRIGHT = 0.9
"""Cosine of the angle to the vertical from which an axis is taken for upright."""


def handles_of(
    asset: Asset, bodies: Sequence[Body], repairs: Repairs
) -> tuple[tuple[Handle, ...], tuple[Vec3, Vec3]]:
    """Find handles, at most one for each joint, and the bounds of the closed object.

    Places to hold are looked for on the collision shapes: those are what fingers will meet.
    """
    poses = closed_poses(asset)
    meshes, owners, named, corners = [], [], [], []
    for b, body in enumerate(bodies):
        T_ob = poses[body.name]
        corners += [trimesh.transform_points(p.mesh.vertices, T_ob) for p in body.visuals]
        for shape in body.shapes:
            mesh = shape.mesh.copy()
            mesh.apply_transform(T_ob)
            meshes.append(mesh)
            owners.append(np.full(len(mesh.faces), b))
            named.append(np.full(len(mesh.faces), is_handle(shape.piece)))
    surface = joined(meshes)
    owner, is_named = np.concatenate(owners), np.concatenate(named)
    handles = []
    for b, body in enumerate(bodies):
        if body.joint is None:
            continue
        moved = np.isin(owner, _carried(bodies, b))
        who = np.where(owner == b, np.where(is_named, 2, 1), np.where(moved, 1, 0))
        if not (owner == b).any():
            continue
        handle = _handle(body.joint, surface, who, poses, repairs)
        if handle is not None:
            handles.append(handle)
    low = np.min([c.min(axis=0) for c in corners], axis=0)
    high = np.max([c.max(axis=0) for c in corners], axis=0)
    return tuple(handles), (_vec(low), _vec(high))


def closed_poses(asset: Asset) -> dict[str, Array]:
    """Pose of every link in the object frame with every joint closed (4, 4)."""
    poses: dict[str, Array] = {asset.links[0].name: np.eye(4)}
    at_zero = {link.name: _rest(asset, link.name) for link in asset.links}
    by_link = {joint.link: joint for joint in asset.joints}
    for link in asset.links[1:]:
        joint = by_link[link.name]
        T_parent = poses[joint.parent] @ inverse(at_zero[joint.parent])
        poses[link.name] = T_parent @ asset.T_ol(joint.name, joint.closed)
    return poses


def _rest(asset: Asset, name: str) -> Array:
    for joint in asset.joints:
        if joint.link == name:
            return asset.T_ol(joint.name, 0.0)
    return np.eye(4)


def _carried(bodies: Sequence[Body], b: int) -> list[int]:
    """Bodies that move with body ``b``, itself not counted."""
    names = {bodies[b].name}
    out = []
    for i, body in enumerate(bodies):
        if body.parent in names:
            names.add(body.name)
            out.append(i)
    return out


def _handle(
    joint: Joint, surface: trimesh.Trimesh, owner: Array, poses: dict[str, Array], repairs: Repairs
) -> Handle | None:
    own = surface.vertices[np.unique(surface.faces[owner == (2 if (owner == 2).any() else 1)])]
    opening, far_from = opening_direction(joint, own)
    grasp = best_grasp(surface, owner, opening=opening, far_from=far_from)
    if grasp is None:
        grasp = outermost_point(own, opening)
        repairs.add(f"joint {joint.name}: no graspable handle; its outermost point is used")
    elif (owner == 2).any() and not grasp.named:
        repairs.add(
            f"joint {joint.name}: the piece named as a handle cannot be grasped; another place is "
            "used"
        )
    return handle_from_grasp(grasp, joint, poses[joint.link])


def handle_from_grasp(grasp: Grasp, joint: Joint, T_ol: Array) -> Handle:
    """Return ``grasp`` as the handle of ``joint``, whose closed link has the pose ``T_ol``."""
    R_lo = T_ol[:3, :3].T
    source: Literal["name", "geometry", "edge"] = "name" if grasp.named else "geometry"
    if not grasp.named and grasp.kind in ("edge", "none"):
        source = "edge"
    return Handle(
        name=f"handle_{joint.name}",
        link=joint.link,
        joint=joint.name,
        pos_l=_vec(R_lo @ (grasp.pos_o - T_ol[:3, 3])),
        normal_l=_vec(_clean(R_lo @ grasp.normal_o)),
        along_l=_vec(_clean(R_lo @ grasp.along_o)),
        extent=grasp.extent,
        kind=grasp.kind,
        source=source,
    )


def opening_direction(joint: Joint, points: Array) -> tuple[Array, Array | None]:
    """Return the direction in which a part begins to open, and a hinge's point and axis.

    Args:
        joint: Joint of the part.
        points: Points of the closed part in the object frame (N, 3) [m].
    """
    sign = 1.0 if joint.span >= 0.0 else -1.0
    axis = np.asarray(joint.axis_o)
    if joint.kind == "slide":
        return sign * axis, None
    pivot = np.asarray(joint.pivot_o)
    offset = points - pivot
    radial = offset - (offset @ axis)[:, None] * axis
    reach = np.linalg.norm(radial, axis=1)
    side = radial[reach >= 0.9 * reach.max()].mean(axis=0)
    if np.linalg.norm(side) <= ALL_ROUND * reach.max():  # alike to all sides: any of them will do
        side = np.eye(3)[2 if abs(axis[2]) < UPRIGHT else 0]
    tangent = normalised(np.cross(sign * axis, side))
    axes = np.vstack([np.eye(3), -np.eye(3)])
    angles = angle_between(axes, tangent[None])
    k = int(np.argmin(angles))
    direction = axes[k] if angles[k] < SNAP_RAD else tangent
    return direction, np.stack([pivot, axis])


def _clean(v: Array) -> Array:
    """Return the unit vector without the last digits that rotations leave."""
    return normalised(np.where(np.abs(v) < 1e-9, 0.0, v))


def _vec(v: Array) -> Vec3:
    return (float(v[0]), float(v[1]), float(v[2]))
