"""Compiled MJCF of a single asset, with access by name."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from articulate.assets.asset import Asset
from articulate.assets.asset_files import check_asset_files
from articulate.errors import AssetError, nearest, shorten
from articulate.simulator import mujoco
from articulate.transforms import Array, Ints, inverse, pose

# MuJoCo ships neither annotations nor stubs.
Model = Any
Data = Any

MOVABLE = (int(mujoco.mjtJoint.mjJNT_SLIDE), int(mujoco.mjtJoint.mjJNT_HINGE))
"""Joint types with one number of position. Compared as int: the enum's own == changed in 3.12."""


@dataclass(frozen=True, kw_only=True)
class Follower:
    """Joint whose position is a polynomial of that of another joint."""

    joint: str
    leader: str
    coefficients: tuple[float, ...]
    """Constant first, five of them."""

    def position(self, leader: float) -> float:
        """Return the position of the joint for that of its leader [m or rad]."""
        return float(np.polynomial.polynomial.polyval(leader, np.array(self.coefficients)))


class ObjectModel:
    """Single compiled asset: addresses, geoms, mimic joints, positions and poses.

    Args:
        asset: Content of asset.json.
        model: Its compiled MJCF.

    Raises:
        AssetError: A link or joint of the asset is not in the model.
    """

    def __init__(self, asset: Asset, model: Model) -> None:
        self.asset = asset
        self.model = model
        self.bodies = {model.body(b).name: b for b in range(1, model.nbody)}
        """Address of each body by name, the world left out."""
        self.joints = {
            model.joint(j).name: j for j in range(model.njnt) if int(model.jnt_type[j]) in MOVABLE
        }
        """Address of each slide or hinge by name."""
        self._check(asset)
        self.followers = _followers(model)
        """Joints that follow others, every leader before those that follow it."""
        following = {f.joint for f in self.followers}
        self.free_joints = tuple(j.name for j in asset.joints if j.name not in following)
        """Joints of the asset that move by themselves."""
        self.closed = {joint.name: joint.closed for joint in asset.joints}
        """Closed position of each joint [m or rad], those that follow as their leaders are."""
        self.closed.update(self.apply_mimics(self.closed))

    def _check(self, asset: Asset) -> None:
        where = asset.mjcf_path
        for link in asset.links:
            if link.name not in self.bodies:
                hint = nearest(link.name, self.bodies)
                raise AssetError(f"{where}: link {link.name!r} of asset.json has no body{hint}")
        for joint in asset.joints:
            if joint.name not in self.joints:
                hint = nearest(joint.name, self.joints)
                raise AssetError(f"{where}: joint {joint.name!r} of asset.json is absent{hint}")
        known = {joint.name for joint in asset.joints}
        for name in _all_joints(self.model):
            if name not in known:  # no measurement would move it
                raise AssetError(
                    f"{where}: joint {name!r} is not in asset.json; make the folder again"
                )

    @property
    def root(self) -> str:
        """Name of the root link."""
        return self.asset.links[0].name

    def qpos_address(self, joint: str) -> int:
        """Return the index of ``joint`` in ``qpos``."""
        return int(self.model.jnt_qposadr[self.joints[joint]])

    def dof_address(self, joint: str) -> int:
        """Return the index of ``joint`` in ``qvel`` and ``qfrc_applied``."""
        return int(self.model.jnt_dofadr[self.joints[joint]])

    def limits(self, joint: str) -> tuple[float, float]:
        """Return the range of ``joint`` [m or rad]; half a turn to both sides if it has none."""
        index = self.joints[joint]
        if not self.model.jnt_limited[index]:
            return -math.pi, math.pi
        low, high = self.model.jnt_range[index]
        return float(low), float(high)

    def collision_geoms(self, link: str) -> Ints:
        """Return the geoms of ``link`` that can collide: their masks are not all 0."""
        return self._geoms(link, colliding=True)

    def visual_geoms(self, link: str) -> Ints:
        """Return the geoms of ``link`` that cannot collide: they are visible only."""
        return self._geoms(link, colliding=False)

    def _geoms(self, link: str, *, colliding: bool) -> Ints:
        m = self.model
        touches = (m.geom_contype != 0) | (m.geom_conaffinity != 0)
        own = m.geom_bodyid == self.bodies[link]
        return np.flatnonzero(own & (touches == colliding)).astype(np.int64)

    def apply_mimics(self, q: Mapping[str, float]) -> dict[str, float]:
        """Return ``q`` [m or rad] with the positions of mimic joints that their leaders imply."""
        out = dict(q)
        for follower in self.followers:
            leader = out.get(follower.leader, self.closed.get(follower.leader, 0.0))
            out[follower.joint] = follower.position(leader)
        return out

    def data(self) -> Data:
        """Return a state of the model with every joint closed, at rest."""
        data = mujoco.MjData(self.model)
        self.set_joints(data, {})
        return data

    def set_joints(self, data: Data, q: Mapping[str, float]) -> None:
        """Set the joints to ``q`` [m or rad], at rest, and compute poses of bodies and geoms.

        Joints that ``q`` does not name are closed; mimic joints follow their leaders.
        """
        for name, position in self.apply_mimics({**self.closed, **q}).items():
            data.qpos[self.qpos_address(name)] = position
        data.qvel[:] = 0.0
        mujoco.mj_kinematics(self.model, data)

    def T_ol(self, data: Data, link: str) -> Array:
        """Return the pose (4, 4) of ``link`` in the object frame, that of the root body."""
        return inverse(_T_wb(data, self.bodies[self.root])) @ _T_wb(data, self.bodies[link])

    def random_joints(self, rng: np.random.Generator) -> dict[str, float]:
        """Sample uniform positions of all joints within their limits [m or rad]."""
        q = {name: float(rng.uniform(*self.limits(name))) for name in self.free_joints}
        return self.apply_mimics({**self.closed, **q})


def load_model(asset: Asset) -> ObjectModel:
    """Compile the MJCF of an asset.

    Raises:
        AssetError: MuJoCo does not accept it, or it lacks a link or joint of the asset.
    """
    path = asset.mjcf_path
    check_asset_files(asset.folder)
    if not path.is_file():
        raise AssetError(f"{path}: does not exist; make the asset again with check-asset")
    try:
        model = mujoco.MjModel.from_xml_path(str(path))
    except (ValueError, mujoco.FatalError) as error:
        reason = shorten(" ".join(str(error).split()))
        raise AssetError(f"{path}: MuJoCo rejects it: {reason}") from None
    return ObjectModel(asset, model)


def _T_wb(data: Data, body: int) -> Array:
    return pose(data.xpos[body], np.reshape(data.xmat[body], (3, 3)))


def _all_joints(model: Model) -> list[str]:
    """Return the names of joints of all types."""
    return [model.joint(j).name for j in range(model.njnt)]


def _followers(model: Model) -> tuple[Follower, ...]:
    """Return joint equalities between two joints, leaders first."""
    found: dict[str, Follower] = {}
    for e in range(model.neq):
        one, two = int(model.eq_obj1id[e]), int(model.eq_obj2id[e])
        if int(model.eq_type[e]) != int(mujoco.mjtEq.mjEQ_JOINT) or two < 0:
            continue
        name = model.joint(one).name
        found[name] = Follower(
            joint=name,
            leader=model.joint(two).name,
            coefficients=tuple(float(c) for c in model.eq_data[e][:5]),
        )
    ordered: list[Follower] = []
    waiting = dict(found)
    while waiting:
        ready = [f for f in waiting.values() if f.leader not in waiting]
        if not ready:  # a cycle: there is no leader
            break
        for follower in ready:
            ordered.append(follower)
            del waiting[follower.joint]
    return tuple(ordered)
