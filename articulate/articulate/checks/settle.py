"""Checks ``settling`` and ``energy``: the object comes to rest and gains no energy."""

from __future__ import annotations

import copy
import math
from dataclasses import dataclass

import numpy as np

from articulate.assets.asset import Asset, Joint
from articulate.assets.check_report import Check
from articulate.checks.model import Data, Model, ObjectModel
from articulate.simulator import mujoco
from articulate.transforms import Array, Mask

SETTLE_S = 20.0
"""Time limit for coming to rest [s]: a light pedal with high damping takes 14."""
STILL_S = 0.25
"""Time without motion above ``STILL`` of the range that counts as rest [s]."""
STILL = 1e-4
STEADY = 0.05
"""Largest relative change of speed of a steady slip in that time."""
REST_S = 2.0
"""Time for which it must stay at rest [s]."""
DRIFT = 0.01
"""Largest drift of a joint in that time as a fraction of its range."""
ENERGY = 0.01
"""Largest rise of mechanical energy as a fraction of m g height."""
REPORTED = 0.02
"""Offset from closed after settling that is reported, as a fraction of the range."""
CHECK_STEPS = 10
"""Physics steps between two samples of energy and positions."""


@dataclass(frozen=True, kw_only=True)
class Trace:
    """Motion of an object under gravity."""

    times_s: Array
    """Sample times (T,) [s]."""
    positions: Array
    """Positions of the joints (T, J) [m or rad], in the order of the asset."""
    energy_j: Array
    """Mechanical energy (T,) [J]."""
    diverged: bool
    """True if the engine stopped at values that are not finite or far too large."""
    data: Data
    """State at the end."""

    @property
    def rise_j(self) -> float:
        """Largest rise of mechanical energy above its initial value [J]."""
        return float(max(self.energy_j.max() - self.energy_j[0], 0.0))


def check_settling(asset: Asset, model: ObjectModel) -> tuple[Check, ...]:
    """Run the checks ``settling`` of every joint and ``energy`` of the object."""
    if not asset.joints:
        return ()
    sim_model = with_energy(model.model)
    start = mujoco.MjData(sim_model)
    for name, position in model.closed.items():
        start.qpos[model.qpos_address(name)] = position
    fall = until_still(model, sim_model, start)
    traces = [fall] if fall.diverged else [fall, *_rests(model, sim_model, fall.data)]
    checks = [_stays(joint, j, model, traces) for j, joint in enumerate(asset.joints)]
    return (*checks, _energy(traces, _weight_j(asset, model)))


def with_energy(model: Model) -> Model:
    """Copy the model with the computation of energy enabled."""
    sim_model = copy.copy(model)
    sim_model.opt.enableflags |= int(mujoco.mjtEnableBit.mjENBL_ENERGY)
    return sim_model


def simulate(model: ObjectModel, sim_model: Model, data: Data, time_s: float) -> Trace:
    """Simulate ``data`` for ``time_s`` [s]."""
    return _traced(model, sim_model, data, time_s, still=False)


def until_still(model: ObjectModel, sim_model: Model, data: Data) -> Trace:
    """Simulate ``data`` until nothing moves, at most ``SETTLE_S``."""
    return _traced(model, sim_model, data, SETTLE_S, still=True)


def _traced(
    model: ObjectModel, sim_model: Model, data: Data, time_s: float, *, still: bool
) -> Trace:
    address = [model.qpos_address(joint.name) for joint in model.asset.joints]
    spans = np.array([span_of(model, joint.name) for joint in model.asset.joints])
    mujoco.mj_forward(sim_model, data)
    blocks = math.ceil(time_s / (sim_model.opt.timestep * CHECK_STEPS))
    window = max(1, math.ceil(STILL_S / (sim_model.opt.timestep * CHECK_STEPS)))
    times, positions, energy = [data.time], [data.qpos[address].copy()], [data.energy.sum()]
    diverged = False
    for _ in range(blocks):
        mujoco.mj_step(sim_model, data, CHECK_STEPS)
        if has_diverged(data):
            diverged = True
            break
        times.append(data.time)
        positions.append(data.qpos[address].copy())
        energy.append(data.energy.sum())
        if still and len(positions) > 2 * window:
            recent = np.array(positions[-2 * window - 1 :])
            rests = np.ptp(recent[window:], axis=0) / spans < STILL
            if (rests | _creeps(model, data, recent)).all():
                break
    return Trace(
        times_s=np.array(times),
        positions=np.array(positions),
        energy_j=np.array(energy),
        diverged=diverged,
        data=data,
    )


def _creeps(model: ObjectModel, data: Data, positions: Array) -> Mask:
    """Return a mask (J,) of joints that slip steadily under a load below their dry friction.

    Friction in MuJoCo is soft: a joint under load slips at a speed that depends on its
    ``solreffriction`` and ``solimpfriction`` and on the load, not on how much friction there is.

    Args:
        model: Compiled object.
        data: Its state.
        positions: Positions at equal intervals (T, J), T odd.
    """
    dofs = [model.dof_address(joint.name) for joint in model.asset.joints]
    restrained_model = np.abs(data.qfrc_bias[dofs]) <= model.model.dof_frictionloss[dofs]
    before, after = np.diff(positions[[0, len(positions) // 2, -1]], axis=0)
    return np.asarray(restrained_model & (np.abs(after - before) <= STEADY * np.abs(after)))


def has_diverged(data: Data) -> bool:
    """Return whether the engine reset a diverged state, which it counts as a warning."""
    bad = (
        mujoco.mjtWarning.mjWARN_BADQPOS,
        mujoco.mjtWarning.mjWARN_BADQVEL,
        mujoco.mjtWarning.mjWARN_BADQACC,
    )
    return any(int(data.warning[int(kind)].number) > 0 for kind in bad)


def span_of(model: ObjectModel, joint: str) -> float:
    """Return the range of a joint, a full turn without limits [m or rad]."""
    low, high = model.limits(joint)
    return max(high - low, 1e-9)


def _rests(model: ObjectModel, sim_model: Model, settled: Data) -> list[Trace]:
    """Simulate from the settled pose with the time step of the model and half of it."""
    shipped = sim_model.opt.timestep
    out = []
    for share in (1.0, 0.5):
        sim_model.opt.timestep = share * shipped
        data = mujoco.MjData(sim_model)
        data.qpos[:] = settled.qpos
        out.append(simulate(model, sim_model, data, REST_S))
    sim_model.opt.timestep = shipped
    return out


def _weight_j(asset: Asset, model: ObjectModel) -> float:
    """Return mass of the moving parts times gravity times height of the object [J].

    With the mass of the fixed body, a light part could be ejected unnoticed.
    """
    height = asset.bounds_o[1][2] - asset.bounds_o[0][2]
    mass = sum(float(model.model.body_mass[b]) for n, b in model.bodies.items() if n != model.root)
    return mass * float(np.linalg.norm(model.model.opt.gravity)) * height


def _stays(joint: Joint, j: int, model: ObjectModel, traces: list[Trace]) -> Check:
    span = span_of(model, joint.name)
    if any(trace.diverged for trace in traces):
        return Check(
            name="settling",
            outcome="failed",
            subject=joint.name,
            message="the simulation blew up: look at masses, inertias and overlaps at rest",
        )
    drifts = [float(np.abs(t.positions[:, j] - t.positions[0, j]).max()) for t in traces[1:]]
    drift = max(drifts) / span
    rest = _rest_description(joint, traces[0].positions[:, j], span)
    message = f"{rest}; {_release_description(joint, model)}"
    if drift > DRIFT:
        which = "half the time step" if drifts[1] > drifts[0] else "its time step"
        message += (
            f"; from there it drifts by {100.0 * drift:.1f} % of its range in {REST_S:g} s at "
            f"{which}: {_remedy(joint, j, model, traces)}"
        )
    return Check(
        name="settling",
        outcome="failed" if drift > DRIFT else "passed",
        subject=joint.name,
        measured=drift,
        allowed=DRIFT,
        unit="1",
        message=message,
    )


def _remedy(joint: Joint, j: int, model: ObjectModel, traces: list[Trace]) -> str:
    """Return a remedy for a joint that drifts."""
    shipped = traces[1]
    recent = shipped.positions[-(len(shipped.positions) // 4 * 2 + 1) :]
    if _creeps(model, shipped.data, recent)[j]:
        return (
            "its dry friction would hold it but gives way; set solreffriction and solimpfriction "
            'of the joint to stiffer values, such as "0.004 1" and "0.99 0.999 0.001"'
        )
    return "look for contacts that push, and at its damping and inertia"


def _rest_description(joint: Joint, positions: Array, span: float) -> str:
    """Describe the position in which the joint came to rest."""
    moved = float(positions[-1] - joint.closed) / span
    if abs(moved) <= REPORTED:
        if float(np.abs(positions - joint.closed).max()) / span > REPORTED:
            return "moves and falls shut again"
        return "stays closed"
    share = (float(positions[-1]) - joint.closed) / joint.span
    if share > 0.0:
        return f"falls open under gravity, to {100.0 * min(share, 1.0):.0f} % of its travel"
    return f"sags past closed under gravity, by {100.0 * abs(moved):.0f} % of its range"


def _release_description(joint: Joint, model: ObjectModel) -> str:
    """Describe the effect of gravity on the joint half open, against its dry friction."""
    data = model.data()
    model.set_joints(data, {joint.name: joint.closed + joint.span / 2.0})
    mujoco.mj_forward(model.model, data)
    dof = model.dof_address(joint.name)
    push = -float(data.qfrc_bias[dof]) * math.copysign(1.0, joint.span)
    if abs(push) <= float(model.model.dof_frictionloss[dof]):
        return "stays in place when released half open"
    return f"falls {'open' if push > 0.0 else 'shut'} when released half open"


def _energy(traces: list[Trace], weight_j: float) -> Check:
    if any(trace.diverged for trace in traces):
        return Check(name="energy", outcome="failed", message="the simulation blew up")
    rise = max(trace.rise_j for trace in traces)
    share = rise / weight_j if weight_j > 0.0 else math.inf
    message = f"energy rises by at most {rise:.2g} J of m g height = {weight_j:.3g} J"
    if share > ENERGY:
        message += ": overlapping parts throw each other; look at overlaps at rest"
    return Check(
        name="energy",
        outcome="failed" if share > ENERGY else "passed",
        measured=share,
        allowed=ENERGY,
        unit="1",
        message=message,
    )
