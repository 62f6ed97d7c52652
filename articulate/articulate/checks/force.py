"""Checks ``opening`` and ``closing``: a bounded force opens every joint and closes it again.

The force is ``FORCE_N`` at standstill and decreases with speed, to 0 at the speed at which the
full travel takes ``PACE_S``. It never exceeds that value, and does not throw the part open.
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
"""Largest applied force [N]."""
TIME_S = 3.0
"""Time limit of opening, and of closing [s]."""
PACE_S = 0.5
"""Time of the full travel without resistance [s]."""
REQUIRED = 0.9
"""Fraction of the travel that must be opened, and closed again."""
ENOUGH = 0.99
"""Fraction of the travel at which the simulation ends."""
STALLED_S = 0.5
"""Time without motion after which the simulation ends [s]."""
STALLED = 1e-4
"""Fraction of the travel that counts as motion."""
MIN_LEVER = 0.1
"""A handle nearer to the axis than this fraction of the farthest point is replaced by it."""
MIN_TRAVEL_SHARE = 1e-6
"""Joints with less travel are not opened [m or rad]."""
CHECK_STEPS = 10
"""Physics steps between two evaluations of the state."""


@dataclass(frozen=True, kw_only=True)
class Pull:
    """Force on one joint."""

    joint: Joint
    effort: float
    """Force, or torque about the axis, at standstill [N or Nm]."""
    travel: float
    """Travel to open [m or rad], positive."""
    where: str
    """Description of the point of application."""

    @property
    def pace(self) -> float:
        """Speed at which the force is 0 [m/s or rad/s]."""
        return self.travel / PACE_S


@dataclass(frozen=True, kw_only=True)
class PullResult:
    """Result of pulling at one joint."""

    share: float
    """Largest fraction of the travel that was opened, or closed again."""
    time_s: float
    """Duration [s]."""
    data: Data
    """State at the end."""
    diverged: bool = False


def check_opening(
    asset: Asset, model: ObjectModel, joints: Sequence[JointCheck]
) -> tuple[tuple[Check, ...], tuple[JointCheck, ...]]:
    """Run the checks ``opening`` and ``closing`` on every joint that is no mimic joint.

    Args:
        asset: Object to check.
        model: Its compiled model.
        joints: Results of the sweep, with the joints that others require to be open.

    Returns:
        The checks, and ``joints`` with the fraction that each was opened.
    """
    checks: list[Check] = []
    out = []
    for joint_check in joints:
        if joint_check.name not in model.free_joints:
            out.append(joint_check)
            continue
        pull = pull_of(asset, model, joint_check.name)
        if pull.travel < MIN_TRAVEL_SHARE:
            checks.append(_no_travel(pull))
            out.append(dataclasses.replace(joint_check, opened=0.0))
            continue
        sim_model = restrained_model(model, joint_check)
        opened = move(model, sim_model, pull, _start(model, sim_model, joint_check), closing=False)
        checks.append(_check_of("opening", pull, opened, model, sim_model, joint_check))
        if opened.share >= REQUIRED:
            closed, shut = _close(asset, model, sim_model, pull, opened.data)
            checks.append(_check_of("closing", pull, closed, model, sim_model, joint_check, shut))
        out.append(dataclasses.replace(joint_check, opened=opened.share))
    return tuple(checks), tuple(out)


def pull_of(asset: Asset, model: ObjectModel, name: str) -> Pull:
    """Return the force on the joint called ``name``."""
    joint = asset.joint(name)
    handle = asset.handle_of(name)
    travel = abs(joint.span)
    if joint.kind == "slide":
        where = "the handle" if handle is not None else "the part"
        return Pull(joint=joint, effort=FORCE_N, travel=travel, where=where)
    farthest = float(levers(model, name, _points_w(model, joint.link)).max(initial=0.0))
    lever, where = farthest, "the farthest point"
    if handle is not None:
        data = model.data()
        body = model.bodies[handle.link]
        pos_w = data.xmat[body].reshape(3, 3) @ np.asarray(handle.pos_l) + data.xpos[body]
        own = float(levers(model, name, pos_w[None])[0])
        if own >= MIN_LEVER * farthest:
            lever, where = own, "the handle"
    return Pull(
        joint=joint,
        effort=FORCE_N * lever,
        travel=min(travel, math.pi / 2.0),
        where=f"{where}, {1e3 * lever:.0f} mm from the axis",
    )


def levers(model: ObjectModel, joint: str, points_w: Array) -> Array:
    """Return distances (P,) of points (P, 3) from the axis of ``joint``, all joints closed [m]."""
    data = model.data()
    index = model.joints[joint]
    body = int(model.model.jnt_bodyid[index])
    turn = data.xmat[body].reshape(3, 3)
    pivot_w = data.xpos[body] + turn @ model.model.jnt_pos[index]
    axis_w = turn @ model.model.jnt_axis[index]
    return np.asarray(np.linalg.norm(np.cross(points_w - pivot_w, axis_w), axis=1))


def _points_w(model: ObjectModel, link: str) -> Array:
    """Return corners (P, 3) of the collision shapes of ``link``, all joints closed [m]."""
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


def restrained_model(model: ObjectModel, joint_check: JointCheck) -> Model:
    """Copy the model with required joints fixed open and joints of parent links fixed closed."""
    sim_model = copy.copy(model.model)
    asset = model.asset
    at = {name: asset.joint(name).closed for name in _carriers(asset, joint_check.name)}
    at.update({name: asset.joint(name).open for name in joint_check.needs})
    for name, position in at.items():
        _lock_joint(model, sim_model, name, position)
    return sim_model


def _lock_joint(model: ObjectModel, sim_model: Model, name: str, position: float) -> None:
    """Fix the joint called ``name`` at ``position`` [m or rad] in ``sim_model``."""
    index = model.joints[name]
    sim_model.jnt_limited[index] = 1
    sim_model.jnt_range[index] = position  # both limits at once: it cannot leave


def _carriers(asset: Asset, name: str) -> list[str]:
    """Return the joints between the root and the parent link of ``name``."""
    by_link = {joint.link: joint for joint in asset.joints}
    parents = {link.name: link.parent for link in asset.links}
    out = []
    link = parents[asset.joint(name).link]
    while link is not None:
        if link in by_link:
            out.append(by_link[link].name)
        link = parents[link]
    return out


def _start(model: ObjectModel, sim_model: Model, joint_check: JointCheck) -> Data:
    data = mujoco.MjData(sim_model)
    q = {name: model.asset.joint(name).open for name in joint_check.needs}
    for name, position in model.apply_mimics({**model.closed, **q}).items():
        data.qpos[model.qpos_address(name)] = position
    return data


def move(
    model: ObjectModel, sim_model: Model, pull: Pull, start: Data, *, closing: bool
) -> PullResult:
    """Pull at a joint until it is open, or closed, or stops moving.

    Args:
        model: Addresses of joints.
        sim_model: Model to simulate.
        pull: Force on the joint.
        start: Initial state, without its velocity; it is not changed.
        closing: Close the joint instead of opening it.
    """
    sign = math.copysign(1.0, pull.joint.span)
    address, dof = model.qpos_address(pull.joint.name), model.dof_address(pull.joint.name)
    data = mujoco.MjData(sim_model)
    data.qpos[:] = start.qpos
    data.qfrc_applied[dof] = pull.effort * (-sign if closing else sign)
    passive = float(sim_model.dof_damping[dof])
    sim_model.dof_damping[dof] = passive + pull.effort / pull.pace  # the force decreases with speed
    begin = sign * (float(data.qpos[address]) - pull.joint.closed) / pull.travel
    shares = [1.0 if closing and begin <= 1.0 - REQUIRED else 0.0]  # it may have closed by itself
    window = math.ceil(STALLED_S / (sim_model.opt.timestep * CHECK_STEPS))
    while data.time < TIME_S and not has_diverged(data):
        mujoco.mj_step(sim_model, data, CHECK_STEPS)
        at = sign * (float(data.qpos[address]) - pull.joint.closed) / pull.travel
        shares.append((begin - at) / max(begin, MIN_TRAVEL_SHARE) if closing else at)
        if shares[-1] >= ENOUGH:
            break
        if len(shares) > window and np.ptp(shares[-window:]) < STALLED:
            break
    sim_model.dof_damping[dof] = passive
    return PullResult(
        share=float(np.clip(max(shares), 0.0, 1.0)),
        time_s=float(data.time),
        data=data,
        diverged=has_diverged(data),
    )


def _close(
    asset: Asset, model: ObjectModel, sim_model: Model, pull: Pull, opened: Data
) -> tuple[PullResult, tuple[str, ...]]:
    """Close the joint; if that fails, first close the joints that opened along with it.

    A leaf that overlaps another one opens it as well, and a flap may hang open by its weight
    once the part above it has moved; neither can be passed.

    Args:
        asset: Object to check.
        model: Its compiled model.
        sim_model: Model to simulate.
        pull: Force on the joint.
        opened: State with the joint open.

    Returns:
        The result, and the joints that were kept closed for it.
    """
    closed = move(model, sim_model, pull, opened, closing=True)
    along = () if closed.share >= REQUIRED else _along(model, sim_model, pull.joint.name, opened)
    data, other_closed = opened, copy.copy(sim_model)
    for name in along:
        moved = move(model, other_closed, pull_of(asset, model, name), data, closing=True)
        if moved.share < REQUIRED:
            return closed, ()
        data = moved.data
        _lock_joint(model, other_closed, name, asset.joint(name).closed)
    again = move(model, other_closed, pull, data, closing=True) if along else closed
    return (again, along) if again.share > closed.share else (closed, ())


def _along(model: ObjectModel, sim_model: Model, opened: str, state: Data) -> tuple[str, ...]:
    """Return free joints other than ``opened`` that are open in ``state`` and not fixed."""
    out = []
    for name in model.free_joints:
        joint, index = model.asset.joint(name), model.joints[name]
        is_held = bool(sim_model.jnt_limited[index]) and not np.ptp(sim_model.jnt_range[index])
        offset = float(state.qpos[model.qpos_address(name)]) - joint.closed
        if name != opened and not is_held and abs(offset) > (1.0 - REQUIRED) * abs(joint.span):
            out.append(name)
    return tuple(out)


def _no_travel(pull: Pull) -> Check:
    return Check(
        name="opening",
        outcome="failed",
        subject=pull.joint.name,
        measured=0.0,
        allowed=REQUIRED,
        unit="1",
        message="there is no travel between closed and open: look at its limits",
    )


def _check_of(
    name: str,
    pull: Pull,
    moved: PullResult,
    model: ObjectModel,
    sim_model: Model,
    joint_check: JointCheck,
    shut: tuple[str, ...] = (),
) -> Check:
    passed = moved.share >= REQUIRED and not moved.diverged
    verb = "closes" if name == "closing" else "opens"
    with_ = f" with {' and '.join(joint_check.needs)} open" if joint_check.needs else ""
    with_ += f", {' and '.join(shut)} kept closed" if shut else ""
    message = (
        f"{FORCE_N:g} N at {pull.where} {verb} {100.0 * moved.share:.0f} % of the travel in "
        f"{moved.time_s:.1f} s{with_}"
    )
    if moved.diverged:
        message += "; the simulation blew up: look at masses, inertias and overlaps"
    elif not passed:
        message += f"; {_why(pull, moved, model, sim_model)}"
    return Check(
        name=name,
        outcome="passed" if passed else "failed",
        subject=pull.joint.name,
        measured=moved.share,
        allowed=REQUIRED,
        unit="1",
        message=message,
    )


def _why(pull: Pull, moved: PullResult, model: ObjectModel, sim_model: Model) -> str:
    """Return what blocks the joint in the final state."""
    if pull.effort <= 0.0:
        return "all points of the part are on its axis: look at the axis and the geometry"
    data = moved.data
    mujoco.mj_forward(sim_model, data)
    dof = model.dof_address(pull.joint.name)
    strongest, names = 0.0, ""
    wrench = np.zeros(6)
    for i in range(data.ncon):
        mujoco.mj_contactForce(sim_model, data, i, wrench)
        bodies = [int(sim_model.geom_bodyid[g]) for g in data.contact[i].geom]
        if wrench[0] > strongest:
            strongest = float(wrench[0])
            names = " against ".join(sim_model.body(b).name for b in bodies)
    load = abs(float(data.qfrc_bias[dof])) + float(sim_model.dof_frictionloss[dof])
    if load > pull.effort:
        unit = "N" if pull.joint.kind == "slide" else "Nm"
        return (
            f"weight and dry friction resist with {load:.3g} {unit}, and the force gives "
            f"{pull.effort:.3g} {unit}: look at its mass and friction"
        )
    if names:
        return f"it is stopped by {names} ({strongest:.3g} N): look at their collision shapes"
    return "its damping or inertia is too large for that time"
