"""How episodes begin: from home, or along the task while learning; and when these are cut."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from articulate.robot.kinematics import solve_ik
from articulate.task.object_placement import handle_in_world
from articulate.task.randomization import COLUMNS, EpisodeParams, sample_episode_params
from articulate.task.randomization_config import RandomizationConfig
from articulate.transforms import Array, pose
from articulate_envs.config import InitialStatesConfig
from articulate_envs.engine import Start

if TYPE_CHECKING:  # configurations are light to import, scenes are not
    from articulate_envs.scene import Scene


def home_start(scene: Scene, drawn: EpisodeParams) -> Start:
    """Starts from home plus the drawn offsets, hand open and empty, part where it was drawn."""
    n, opened = len(drawn.values), drawn["part_open"].copy()
    first, last = scene.task.begin
    assert np.all((opened >= first) & (opened <= last)), "drawn without the task's begin"
    low, high = scene.arm.bounds(scene.control.margin_rad)
    return Start(
        params=drawn,
        q=np.clip(np.asarray(scene.place.start_q) + drawn["start"], low, high),
        opened=opened,
        width=np.full(n, scene.arm.gripper.max_width_m),
        closing=-np.ones(n),
        home=np.ones(n, dtype=bool),
    )


def precompute_states(
    scene: Scene, config: InitialStatesConfig, draws: RandomizationConfig, rng: np.random.Generator
) -> Start:
    """Starts along the task whose arm poses were found by inverse kinematics."""
    n = config.n_precomputed
    task = scene.task
    drawn = sample_episode_params(draws, rng, n, begin=task.begin)
    grip = rng.random(n) < config.grip_share
    on_way = task.begin[1] + (task.target - task.begin[1]) * rng.random(n)
    opened = np.where(grip, on_way, drawn["part_open"])
    T_wo = scene.T_wo(drawn)
    goals = handle_in_world(
        scene.asset,
        scene.task.joint,
        T_wo=T_wo,
        scale=drawn["scale"],
        opened=opened,
        flip=scene.place.flip,
    )
    empty = ~grip & (rng.random(n) < config.empty_grasp_share)
    back = np.where(grip, 0.0, config.standoff_m * rng.random(n) ** 2)
    back = np.where(empty, np.maximum(back, config.empty_grasp_m), back)
    astray = ~grip & (rng.random(n) < config.off_target_share)
    nearest, aside = config.off_target_m
    back = np.where(astray, nearest + (config.standoff_m - nearest) * rng.random(n), back)
    sides = np.where(astray, aside, 0.0) * rng.uniform(-1.0, 1.0, (2, n))
    closing = ~(grip | empty | astray) & (rng.random(n) < config.closing_share)
    back = np.where(closing, 0.0, back)
    goals = goals @ pose(np.stack([*sides, -back], axis=1))
    found = solve_ik(scene.arm, goals, np.asarray(scene.place.start_q), iterations=80)
    handle = scene.asset.handle_of(scene.task.joint)
    thick = handle.extent[1] if handle is not None else 0.02
    held = np.clip(thick * drawn["scale"], 0.0, scene.arm.gripper.max_width_m)
    ok = found.reached
    if not ok.any():
        ok[:] = True
    return Start(
        params=EpisodeParams(drawn.values[ok]),
        q=found.q[ok],
        opened=opened[ok],
        width=np.select([grip, empty], [held, 0.0 * held], scene.arm.gripper.max_width_m)[ok],
        closing=np.where(grip | empty | closing, 1.0, -1.0)[ok],
        home=np.zeros(int(ok.sum()), dtype=bool),
    )


PLACED = ("scale", "x_m", "y_m", "yaw_rad", "part_open")
"""Drawn numbers on which a prepared arm pose depends."""


def mix_starts(
    scene: Scene, bank: Start, drawn: EpisodeParams, share: float, rng: np.random.Generator
) -> Start:
    """Home starts, of which ``share`` are replaced by rows of ``bank``."""
    home = home_start(scene, drawn)
    n = len(drawn.values)
    along = rng.random(n) < share
    pick = rng.integers(len(bank.q), size=n)
    values = drawn.values.copy()
    columns = np.array([COLUMNS.index(name) for name in PLACED])
    values[np.ix_(along, columns)] = bank.params.values[pick[along]][:, columns]

    def choose(a: Array, b: Array) -> Array:
        mask = along if a.ndim == 1 else along[:, None]
        return np.where(mask, b[pick], a)

    return Start(
        params=EpisodeParams(values),
        q=choose(home.q, bank.q),
        opened=choose(home.opened, bank.opened),
        width=choose(home.width, bank.width),
        closing=choose(home.closing, bank.closing),
        home=~along,
    )
