"""Study of the joint impedance: force on the hand against stiffness and damping.

A hand that already holds the handle is led along the drawer's way by inverse kinematics, on a
path that is wrong as estimates are (drawn bias of place and yaw) and as policies are (each
joint's target off by a constant), at a pulling speed that policies reach. Nothing is learnt here.
For each share of libfranka's stiffness the table gives the filtered force on the hand, how far
the drawer came, and how far joints lag behind their targets. ``damping`` is the factor on
libfranka's damping times the root of the share; at the chosen share it is varied.

    python benchmarks/gains.py --json
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from articulate.robot.arm import (
    LIBFRANKA_DAMPING,
    LIBFRANKA_STIFFNESS,
    PANDA,
    STIFFNESS_SHARE,
    Arm,
    Seven,
)
from articulate.robot.config import ControlConfig
from articulate.robot.kinematics import self_motion, solve_ik, tool_jacobian_t
from articulate.task.object_placement import handle_in_world
from articulate.task.randomization import EpisodeParams
from articulate.task.randomization_config import RandomizationConfig
from articulate.transforms import Array, axis_angle_to_matrix
from articulate_envs.config import StartConfig
from articulate_envs.initial_states import bank_of_starts
from articulate_envs.joint_selection import choose_joint
from articulate_envs.physics import PhysicsConfig
from articulate_envs.scene import Scene, build_scene
from articulate_envs.threaded_engine import ThreadEngine
from articulate_train.config import TrainConfig
from articulate_train.run import prepare_asset

SHARES = (1.0, 0.5, 0.3, 0.2, 0.15, 0.1, 0.06)
PULL_M_S = 0.12
MISFIT_RAD = 0.04
"""Standard deviation of a constant error of each joint's target: policies are not exact."""
EPISODES = 128


def _times(factor: float, values: Seven) -> Seven:
    a, b, c, d, e, f, g = (factor * v for v in values)
    return (a, b, c, d, e, f, g)


def arm_of(share: float, damping: float) -> Arm:
    """The Panda at a share of libfranka's stiffness, damping at ``damping`` times its root."""
    return replace(
        PANDA,
        stiffness=_times(share, LIBFRANKA_STIFFNESS),
        damping=_times(damping * share**0.5, LIBFRANKA_DAMPING),
    )


def path(scene: Scene, drawn: EpisodeParams, opened: Array, q: Array) -> Array:
    """Angles (T, N, 7) along the way as an estimate with the drawn errors shows it."""
    task, place = scene.task, scene.place
    ticks = int(abs(task.span) * task.target / PULL_M_S * scene.follow.rate_hz)
    T_wo = scene.T_wo(drawn)
    turn = axis_angle_to_matrix(np.array([[0.0, 0.0, 1.0]]), drawn["bias_yaw_rad"])
    out = np.empty((ticks, len(q), 7))
    for t in range(ticks):
        way = opened + (task.target - opened) * (t + 1) / ticks
        goal = handle_in_world(
            scene.asset,
            task.joint,
            T_wo=T_wo,
            scale=drawn["scale"],
            opened=way,
            flip=place.flip,
        )
        goal[:, :3, :3] = turn @ goal[:, :3, :3]
        goal[:, :3, 3] += drawn["bias"] * min(1.0, t / 10)
        q = solve_ik(scene.arm, goal, q, iterations=4, rest_gain=0.0).q
        out[t] = q
    return out


def motion_to(scene: Scene, target: Array, goal: Array) -> Array:
    """The motion (N, 7) that carries targets (N, 7) to goals (N, 7) [rad], clipped as a whole."""
    follow = scene.follow
    jacobian, step = tool_jacobian_t(scene.arm, target), goal - target
    twist = np.einsum("nij,nj->ni", jacobian, step)
    elbow = np.einsum("nj,nj->n", self_motion(jacobian), step)
    unit = np.repeat([follow.move_m, follow.turn_rad], 3)
    motion = np.column_stack([twist / unit, elbow / follow.step_rad])
    return np.asarray(motion / np.maximum(np.abs(motion).max(axis=1, keepdims=True), 1.0))


def measure(scene: Scene, draws: RandomizationConfig) -> dict[str, float]:
    """Forces and openings of the led hand."""
    rng = np.random.default_rng(0)
    bank = bank_of_starts(scene, StartConfig(grip_share=1.0, bank=EPISODES), draws, rng)
    n = len(bank.q)
    engine = ThreadEngine(scene, n)
    wanted = path(scene, bank.draw, bank.opened, bank.q)
    wanted += (
        MISFIT_RAD
        * rng.normal(size=(n, 7))
        * np.minimum(np.arange(len(wanted)) / 20, 1.0)[:, None, None]
    )
    engine.reset(np.arange(n), bank)
    force = np.zeros((len(wanted), n))
    lag = np.zeros((len(wanted), n))
    for t, goal in enumerate(wanted):
        state = engine.state()
        state = engine.step(np.column_stack([motion_to(scene, state.target, goal), np.ones(n)]))
        force[t] = np.linalg.norm(state.samples[:, :3], axis=1)
        lag[t] = np.abs(state.target - state.q).max(axis=1)
    opened = engine.state().opened / scene.task.target
    engine.close()
    peak = force.max(axis=0)
    return {
        "peak_median_n": float(np.median(peak)),
        "peak_p95_n": float(np.quantile(peak, 0.95)),
        "over_limit": float((peak > scene.task.limits.force_n).mean()),
        "opened_median": float(np.median(opened)),
        "lag_median_rad": float(np.median(lag)),
    }


def study(asset_path: Path, folder: Path) -> list[dict[str, Any]]:
    """One row per share and damping."""
    draws = RandomizationConfig(push_n=(0.0, 0.0), delay_ticks=(0, 0))
    config = TrainConfig(asset=str(asset_path), draw=draws)
    asset = prepare_asset(config, folder / "cache")
    task, place = choose_joint(config, asset)
    rows = []
    for share in SHARES:
        for damping in (0.5, 1.0, 1.5, 2.5) if share == STIFFNESS_SHARE else (1.5,):
            scene = build_scene(
                asset,
                task,
                arm=arm_of(share, damping),
                follow=ControlConfig(),
                physics=PhysicsConfig(),
                place=place,
                scales=draws.scale_values,
            )
            rows.append({"share": share, "damping": damping, **measure(scene, draws)})
            sys.stderr.write(f"{rows[-1]}\n")
    return rows


def main() -> int:
    """Print the table."""
    from articulate.library.procedural.cabinet import embedded_cabinet

    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--asset", type=Path)
    parser.add_argument("--json", action="store_true")
    flags = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        rows = study(flags.asset or embedded_cabinet(folder / "cabinet"), folder)
    print(json.dumps(rows, indent=1) if flags.json else "\n".join(map(str, rows)))
    return 0


if __name__ == "__main__":
    sys.exit(main())
