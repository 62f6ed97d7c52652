"""Clause: a hand's force opens every joint, and closes it again, with contacts as they are.

The hand gives ``FORCE_N`` to what stands still and less to what moves, down to none at the
speed at which the whole way takes ``PACE_S``. So it never gives more than that force, and what
it opens it does not throw.
"""

from __future__ import annotations

import copy
import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from articulate.assets.asset import Asset, Joint
from articulate.assets.check_report import Check, JointCheck
from articulate.checks.model import Data, Model, ObjectModel
from articulate.checks.settle import has_diverged
from articulate.simulator import mujoco
from articulate.transforms import Array

FORCE_N = 30.0
"""Most that the hand gives [N]."""
TIME_S = 3.0
"""So long it may take one way [s]."""
PACE_S = 0.5
"""A joint without any resistance takes this long [s]."""
WANTED = 0.9
"""Share of the way that must be opened, and closed again."""
ENOUGH = 0.99
"""Nothing more is tried beyond this share."""
STALLED_S = 0.5
"""Given up when nothing moved for this long [s]."""
STALLED = 1e-4
"""Moving means by more than this share of the way."""
LEAST_LEVER = 0.1
"""A handle nearer to the axis than this share of the farthest point is turned by that point."""
LEAST_WAY = 1e-6
"""A joint that goes less far is not opened [m or rad]."""
CHECK_STEPS = 10
"""The state is looked at every so many steps."""


@dataclass(frozen=True, kw_only=True)
class Pull:
    """What a hand does to one joint."""

    joint: Joint
    effort: float
    """Force, or torque about the axis, at standstill [N or Nm]."""
    way: float
    """How far it is to be opened [m or rad], positive."""
    where: str
    """Where the hand holds, in words."""

    @property
    def pace(self) -> float:
        """Speed at which the hand gives nothing any more [m/s or rad/s]."""
        return self.way / PACE_S


@dataclass(frozen=True, kw_only=True)
class Moved:
    """What came of it."""

    share: float
    """Greatest share of the way that was opened, or closed again."""
    time_s: float
    """Time it took [s]."""
    data: Data
    """State at the end."""
    diverged: bool = False


def check_opening(
    asset: Asset, model: ObjectModel, joints: Sequence[JointCheck]
) -> tuple[tuple[Check, ...], tuple[JointCheck, ...]]:
    """Clauses ``open`` and ``close`` of every joint that moves by itself.

    Args:
        asset: The object.
        model: Its model.
        joints: What the sweep found out; for the joints that others need open.

    Returns:
        The clauses, and ``joints`` with how far each was opened.
    """
    checks: list[Check] = []
    out = []
    for joint_check in joints:
        if joint_check.name not in model.free_joints:
            out.append(joint_check)
            continue
        pull = pull_of(asset, model, joint_check.name)
        if pull.way < LEAST_WAY:
            checks.append(_no_way(pull))
            out.append(dataclasses.replace(joint_check, opened=0.0))
            continue
        plant = held(model, joint_check)
        opened = move(model, plant, pull, _start(model, plant, joint_check), closing=False)
        checks.append(_clause("opening", pull, opened, model, plant, joint_check))
        if opened.share >= WANTED:
            closed, shut = _close(asset, model, plant, pull, opened.data)
            checks.append(_clause("closing", pull, closed, model, plant, joint_check, shut))
        out.append(dataclasses.replace(joint_check, opened=opened.share))
    return tuple(checks), tuple(out)


def pull_of(asset: Asset, model: ObjectModel, name: str) -> Pull:
    """What the hand does to the joint called ``name``."""
    joint = asset.joint(name)
    handle = asset.handle_of(name)
    way = abs(joint.span)
    if joint.kind == "slide":
        where = "the handle" if handle is not None else "the part"
        return Pull(joint=joint, effort=FORCE_N, way=way, where=where)
    farthest = float(levers(model, name, _points_w(model, joint.link)).max(initial=0.0))
    lever, where = farthest, "the farthest point"
    if handle is not None:
        data = model.data()
        body = model.bodies[handle.link]
        pos_w = data.xmat[body].reshape(3, 3) @ np.asarray(handle.pos_l) + data.xpos[body]
        own = float(levers(model, name, pos_w[None])[0])
        if own >= LEAST_LEVER * farthest:
            lever, where = own, "the handle"
    return Pull(
        joint=joint,
        effort=FORCE_N * lever,
        way=min(way, math.pi / 2.0),
        where=f"{where}, {1e3 * lever:.0f} mm from the axis",
    )


def levers(model: ObjectModel, joint: str, points_w: Array) -> Array:
    """Distances (P,) of points (P, 3) from the axis of ``joint``, everything closed [m]."""
    data = model.data()
    index = model.joints[joint]
    body = int(model.model.jnt_bodyid[index])
    turn = data.xmat[body].reshape(3, 3)
    pivot_w = data.xpos[body] + turn @ model.model.jnt_pos[index]
    axis_w = turn @ model.model.jnt_axis[index]
    return np.asarray(np.linalg.norm(np.cross(points_w - pivot_w, axis_w), axis=1))


def _points_w(model: ObjectModel, link: str) -> Array:
    """Corners (P, 3) [m] of the collision shapes of ``link``, everything closed."""
    m, data = model.model, model.data()
    out = [np.zeros((0, 3))]
    signs = np.array(np.meshgrid(*[(-1.0, 1.0)] * 3)).reshape(3, -1).T
    for geom in model.collision_geoms(link):
        points = m.geom_aabb[geom, :3] + signs * m.geom_aabb[geom, 3:]
        mesh = int(m.geom_dataid[geom])
        if mesh >= 0:
            first = int(m.mesh_vertadr[mesh])
            points = m.mesh_vert[first : first + int(m.mesh_vertnum[mesh])]
        out.append(points @ data.geom_xmat[geom].reshape(3, 3).T + data.geom_xpos[geom])
    return np.vstack(out)


def held(model: ObjectModel, joint_check: JointCheck) -> Model:
    """A copy of the model in which what the joint needs is held open, what it moves on closed."""
    plant = copy.copy(model.model)
    asset = model.asset
    at = {name: asset.joint(name).closed for name in _carriers(asset, joint_check.name)}
    at.update({name: asset.joint(name).open for name in joint_check.needs})
    for name, position in at.items():
        _hold(model, plant, name, position)
    return plant


def _hold(model: ObjectModel, plant: Model, name: str, position: float) -> None:
    """Hold the joint called ``name`` at ``position`` in ``plant``."""
    index = model.joints[name]
    plant.jnt_limited[index] = 1
    plant.jnt_range[index] = position  # both limits at once: it cannot leave


def _carriers(asset: Asset, name: str) -> list[str]:
    """Joints between the root and the part that ``name`` moves against."""
    by_link = {joint.link: joint for joint in asset.joints}
    parents = {link.name: link.parent for link in asset.links}
    out = []
    link = parents[asset.joint(name).link]
    while link is not None:
        if link in by_link:
            out.append(by_link[link].name)
        link = parents[link]
    return out


def _start(model: ObjectModel, plant: Model, joint_check: JointCheck) -> Data:
    data = mujoco.MjData(plant)
    q = {name: model.asset.joint(name).open for name in joint_check.needs}
    for name, position in model.with_followers({**model.closed, **q}).items():
        data.qpos[model.qpos_address(name)] = position
    return data


def move(model: ObjectModel, plant: Model, pull: Pull, start: Data, *, closing: bool) -> Moved:
    """Pull at a joint from ``start`` on until it is open, or closed, or does not go on.

    Args:
        model: Where the joints are.
        plant: Model to simulate.
        pull: What the hand does.
        start: State to begin with, its velocity left out; it stays as it is.
        closing: Push it shut instead of open.
    """
    sign = math.copysign(1.0, pull.joint.span)
    address, dof = model.qpos_address(pull.joint.name), model.dof_address(pull.joint.name)
    data = mujoco.MjData(plant)
    data.qpos[:] = start.qpos
    data.qfrc_applied[dof] = pull.effort * (-sign if closing else sign)
    passive = float(plant.dof_damping[dof])
    plant.dof_damping[dof] = passive + pull.effort / pull.pace  # the hand gives less when it moves
    begin = sign * (float(data.qpos[address]) - pull.joint.closed) / pull.way
    shares = [1.0 if closing and begin <= 1.0 - WANTED else 0.0]  # it may have shut by itself
    window = math.ceil(STALLED_S / (plant.opt.timestep * CHECK_STEPS))
    while data.time < TIME_S and not has_diverged(data):
        mujoco.mj_step(plant, data, CHECK_STEPS)
        at = sign * (float(data.qpos[address]) - pull.joint.closed) / pull.way
        shares.append((begin - at) / max(begin, LEAST_WAY) if closing else at)
        if shares[-1] >= ENOUGH:
            break
        if len(shares) > window and np.ptp(shares[-window:]) < STALLED:
            break
    plant.dof_damping[dof] = passive
    return Moved(
        share=float(np.clip(max(shares), 0.0, 1.0)),
        time_s=float(data.time),
        data=data,
        diverged=has_diverged(data),
    )


def _close(
    asset: Asset, model: ObjectModel, plant: Model, pull: Pull, opened: Data
) -> tuple[Moved, tuple[str, ...]]:
    """Push the joint shut; where that fails, another hand shuts what has gone along and holds it.

    A leaf that overlaps another takes it along as it opens, and a flap may hang open by its weight
    once what lay over it has gone; neither can be passed.

    Args:
        asset: The object.
        model: Its model.
        plant: Model to simulate.
        pull: What the hand does.
        opened: State in which the joint has been opened.

    Returns:
        What came of it, and the joints that were held shut for it.
    """
    closed = move(model, plant, pull, opened, closing=True)
    along = () if closed.share >= WANTED else _along(model, plant, pull.joint.name, opened)
    data, two_handed = opened, copy.copy(plant)
    for name in along:
        moved = move(model, two_handed, pull_of(asset, model, name), data, closing=True)
        if moved.share < WANTED:
            return closed, ()
        data = moved.data
        _hold(model, two_handed, name, asset.joint(name).closed)
    again = move(model, two_handed, pull, data, closing=True) if along else closed
    return (again, along) if again.share > closed.share else (closed, ())


def _along(model: ObjectModel, plant: Model, opened: str, state: Data) -> tuple[str, ...]:
    """Free joints but ``opened`` that are open in ``state`` and held by nothing."""
    out = []
    for name in model.free_joints:
        joint, index = model.asset.joint(name), model.joints[name]
        is_held = bool(plant.jnt_limited[index]) and not np.ptp(plant.jnt_range[index])
        way = float(state.qpos[model.qpos_address(name)]) - joint.closed
        if name != opened and not is_held and abs(way) > (1.0 - WANTED) * abs(joint.span):
            out.append(name)
    return tuple(out)


def _no_way(pull: Pull) -> Check:
    return Check(
        name="opening",
        outcome="failed",
        subject=pull.joint.name,
        measured=0.0,
        allowed=WANTED,
        unit="1",
        message="there is no way between closed and open: look at its limits",
    )


def _clause(
    name: str,
    pull: Pull,
    moved: Moved,
    model: ObjectModel,
    plant: Model,
    joint_check: JointCheck,
    shut: tuple[str, ...] = (),
) -> Check:
    passed = moved.share >= WANTED and not moved.diverged
    verb = "closes" if name == "closing" else "opens"
    with_ = f" with {' and '.join(joint_check.needs)} open" if joint_check.needs else ""
    with_ += f", {' and '.join(shut)} held shut" if shut else ""
    message = (
        f"{FORCE_N:g} N at {pull.where} {verb} {100.0 * moved.share:.0f} % of the way in "
        f"{moved.time_s:.1f} s{with_}"
    )
    if moved.diverged:
        message += "; the simulation blew up: look at masses, inertias and overlaps"
    elif not passed:
        message += f"; {_why(pull, moved, model, plant)}"
    return Check(
        name=name,
        outcome="passed" if passed else "failed",
        subject=pull.joint.name,
        measured=moved.share,
        allowed=WANTED,
        unit="1",
        message=message,
    )


def _why(pull: Pull, moved: Moved, model: ObjectModel, plant: Model) -> str:
    """What holds the joint in the state in which it was given up."""
    if pull.effort <= 0.0:
        return "no point of the part is away from its axis: look at the axis and the geometry"
    data = moved.data
    mujoco.mj_forward(plant, data)
    dof = model.dof_address(pull.joint.name)
    strongest, names = 0.0, ""
    wrench = np.zeros(6)
    for i in range(data.ncon):
        mujoco.mj_contactForce(plant, data, i, wrench)
        bodies = [int(plant.geom_bodyid[g]) for g in data.contact[i].geom]
        if wrench[0] > strongest:
            strongest = float(wrench[0])
            names = " against ".join(plant.body(b).name for b in bodies)
    load = abs(float(data.qfrc_bias[dof])) + float(plant.dof_frictionloss[dof])
    if load > pull.effort:
        unit = "N" if pull.joint.kind == "slide" else "Nm"
        return (
            f"weight and dry friction hold it with {load:.3g} {unit} and the hand gives "
            f"{pull.effort:.3g} {unit}: look at its mass and friction"
        )
    if names:
        return f"it is stopped by {names} ({strongest:.3g} N): look at their collision shapes"
    return "its damping or inertia is too large for that time"
