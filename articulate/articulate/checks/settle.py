"""Clause: left alone, the object comes to rest, stays there, and makes no energy."""

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
"""Longest time that the object is given to come to rest [s]: a light pedal that its damping holds
back takes 14."""
STILL_S = 0.25
"""It rests once nothing moved by more than ``STILL`` of its range for this long [s]."""
STILL = 1e-4
STEADY = 0.05
"""A slip is steady if its speed changes by at most this share in that time."""
REST_S = 2.0
"""So long it must stay [s]."""
DRIFT = 0.01
"""Largest share of its range by which a joint may stray meanwhile."""
ENERGY = 0.01
"""Largest rise of mechanical energy as a share of m g height."""
SAID = 0.02
"""A joint that settles farther from closed than this share of its range is named."""
CHECK_STEPS = 10
"""Energy and positions are looked at every so many steps."""


@dataclass(frozen=True, kw_only=True)
class Trace:
    """What an object did when left alone."""

    times_s: Array
    """Times looked at (T,) [s]."""
    positions: Array
    """Positions of the joints (T, J) [m or rad], in the order of the asset."""
    energy_j: Array
    """Mechanical energy (T,) [J]."""
    diverged: bool
    """The engine met values that are not finite, or far too large, and gave up."""
    data: Data
    """State at the end."""

    @property
    def rise_j(self) -> float:
        """Greatest rise of mechanical energy above that at the start [J]."""
        return float(max(self.energy_j.max() - self.energy_j[0], 0.0))


def check_settling(asset: Asset, model: ObjectModel) -> tuple[Check, ...]:
    """Clauses ``check_settling`` of every joint and ``energy`` of the object."""
    if not asset.joints:
        return ()
    plant = with_energy(model.model)
    start = mujoco.MjData(plant)
    for name, position in model.closed.items():
        start.qpos[model.qpos_address(name)] = position
    fall = until_still(model, plant, start)
    traces = [fall] if fall.diverged else [fall, *_rests(model, plant, fall.data)]
    checks = [_stays(joint, j, model, traces) for j, joint in enumerate(asset.joints)]
    return (*checks, _energy(traces, _weight_j(asset, model)))


def with_energy(model: Model) -> Model:
    """A copy of the model that keeps account of energy."""
    plant = copy.copy(model)
    plant.opt.enableflags |= int(mujoco.mjtEnableBit.mjENBL_ENERGY)
    return plant


def simulate(model: ObjectModel, plant: Model, data: Data, time_s: float) -> Trace:
    """Let ``data`` go on for ``time_s`` [s]."""
    return _traced(model, plant, data, time_s, still=False)


def until_still(model: ObjectModel, plant: Model, data: Data) -> Trace:
    """Let ``data`` go on until nothing moves any more, ``SETTLE_S`` at most."""
    return _traced(model, plant, data, SETTLE_S, still=True)


def _traced(model: ObjectModel, plant: Model, data: Data, time_s: float, *, still: bool) -> Trace:
    address = [model.qpos_address(joint.name) for joint in model.asset.joints]
    spans = np.array([span_of(model, joint.name) for joint in model.asset.joints])
    mujoco.mj_forward(plant, data)
    blocks = math.ceil(time_s / (plant.opt.timestep * CHECK_STEPS))
    window = max(1, math.ceil(STILL_S / (plant.opt.timestep * CHECK_STEPS)))
    times, positions, energy = [data.time], [data.qpos[address].copy()], [data.energy.sum()]
    diverged = False
    for _ in range(blocks):
        mujoco.mj_step(plant, data, CHECK_STEPS)
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
    """Whether each joint slips steadily (J,) under a load that its dry friction exceeds.

    Friction in MuJoCo is soft: what it holds goes on slipping at a speed that depends on its
    ``solreffriction`` and ``solimpfriction`` and on the load, not on how much friction there is.

    Args:
        model: The object.
        data: Its state.
        positions: Positions at equal intervals (T, J), T odd.
    """
    dofs = [model.dof_address(joint.name) for joint in model.asset.joints]
    held = np.abs(data.qfrc_bias[dofs]) <= model.model.dof_frictionloss[dofs]
    before, after = np.diff(positions[[0, len(positions) // 2, -1]], axis=0)
    return np.asarray(held & (np.abs(after - before) <= STEADY * np.abs(after)))


def has_diverged(data: Data) -> bool:
    """Whether the engine gave up on a state: it resets it and counts a warning."""
    bad = (
        mujoco.mjtWarning.mjWARN_BADQPOS,
        mujoco.mjtWarning.mjWARN_BADQVEL,
        mujoco.mjtWarning.mjWARN_BADQACC,
    )
    return any(int(data.warning[int(kind)].number) > 0 for kind in bad)


def span_of(model: ObjectModel, joint: str) -> float:
    """Range of a joint, a whole turn if it has no limits [m or rad]."""
    low, high = model.limits(joint)
    return max(high - low, 1e-9)


def _rests(model: ObjectModel, plant: Model, settled: Data) -> list[Trace]:
    """What happens from the settled pose at the time step as it is and at half of it."""
    shipped = plant.opt.timestep
    out = []
    for share in (1.0, 0.5):
        plant.opt.timestep = share * shipped
        data = mujoco.MjData(plant)
        data.qpos[:] = settled.qpos
        out.append(simulate(model, plant, data, REST_S))
    plant.opt.timestep = shipped
    return out


def _weight_j(asset: Asset, model: ObjectModel) -> float:
    """Mass of the moving parts times gravity times height of the object [J].

    The fixed body never moves: with its mass a light part could be thrown out unnoticed.
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
    rest = _rest_in_words(joint, traces[0].positions[:, j], span)
    message = f"{rest}; {_let_go_in_words(joint, model)}"
    if drift > DRIFT:
        which = "half the time step" if drifts[1] > drifts[0] else "its time step"
        message += (
            f"; from there it strays by {100.0 * drift:.1f} % of its range in {REST_S:g} s at "
            f"{which}: {_mend(joint, j, model, traces)}"
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


def _mend(joint: Joint, j: int, model: ObjectModel, traces: list[Trace]) -> str:
    """What would keep the joint where it settles."""
    shipped = traces[1]
    recent = shipped.positions[-(len(shipped.positions) // 4 * 2 + 1) :]
    if _creeps(model, shipped.data, recent)[j]:
        return (
            "its dry friction would hold it but gives way; set solreffriction and solimpfriction "
            'of the joint to stiffer values, such as "0.004 1" and "0.99 0.999 0.001"'
        )
    return "look for contacts that push, and at its damping and inertia"


def _rest_in_words(joint: Joint, positions: Array, span: float) -> str:
    """Where the joint came to rest."""
    moved = float(positions[-1] - joint.closed) / span
    if abs(moved) <= SAID:
        if float(np.abs(positions - joint.closed).max()) / span > SAID:
            return "moves and falls shut again"
        return "stays closed"
    share = (float(positions[-1]) - joint.closed) / joint.span
    if share > 0.0:
        return f"falls open under gravity, to {100.0 * min(share, 1.0):.0f} % of its way"
    return f"sags past closed under gravity, by {100.0 * abs(moved):.0f} % of its range"


def _let_go_in_words(joint: Joint, model: ObjectModel) -> str:
    """What gravity does to the joint half open, against its dry friction."""
    data = model.data()
    model.set_joints(data, {joint.name: joint.closed + joint.span / 2.0})
    mujoco.mj_forward(model.model, data)
    dof = model.dof_address(joint.name)
    push = -float(data.qfrc_bias[dof]) * math.copysign(1.0, joint.span)
    if abs(push) <= float(model.model.dof_frictionloss[dof]):
        return "stays where it is let go half open"
    return f"falls {'open' if push > 0.0 else 'shut'} when it is let go half open"


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
