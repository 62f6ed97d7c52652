"""Initial states of episodes: at home, or along the task during training."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from articulate.task.grasp import grasp_of
from articulate.task.object_placement import handle_in_world
from articulate.task.randomization import COLUMNS, EpisodeParams, sample_episode_params
from articulate.task.randomization_config import RandomizationConfig
from articulate.transforms import Array, Ints, pose
from articulate_envs.compiled.inverse_kinematics import solve_ik
from articulate_envs.config import InitialStatesConfig
from articulate_envs.engine import Start

if TYPE_CHECKING:  # configurations are light to import, scenes are not
    from articulate_envs.scene import Scene


def home_start(scene: Scene, params: EpisodeParams) -> Start:
    """Return starts at home with sampled offsets, an open gripper and the sampled open fraction.

    Args:
        scene: Scene of the episodes.
        params: Sampled parameters of N episodes.
    """
    n, opened = len(params.values), params["part_open"].copy()
    first, last = scene.task.begin
    assert np.all((opened >= first) & (opened <= last)), (
        "sampled without the initial range of the task"
    )
    low, high = scene.arm.bounds(scene.control.margin_rad)
    return Start(
        params=params,
        q=np.clip(np.asarray(scene.placement.start_q) + params["start"], low, high),
        opened=opened,
        width=np.full(n, scene.arm.gripper.max_width_m),
        closing=-np.ones(n),
        home=np.ones(n, dtype=bool),
    )


def precompute_states(
    scene: Scene,
    config: InitialStatesConfig,
    randomization: RandomizationConfig,
    rng: np.random.Generator,
) -> Start:
    """Return starts along the task, with poses of the arm from inverse kinematics."""
    n = config.n_precomputed
    task = scene.task
    params = sample_episode_params(randomization, rng, n, begin=task.begin)
    grip = rng.random(n) < config.grip_share
    moved = task.begin[1] + (task.target - task.begin[1]) * rng.random(n)
    opened = np.where(grip, moved, params["part_open"])
    T_wo = scene.T_wo(params)
    goals = handle_in_world(
        scene.asset,
        scene.task.joint,
        T_wo=T_wo,
        scale=params["scale"],
        opened=opened,
        flip=scene.placement.flip,
    )
    empty = ~grip & (rng.random(n) < config.empty_grasp_share)
    back = np.where(grip, 0.0, config.standoff_m * rng.random(n) ** 2)
    back = np.where(empty, np.maximum(back, config.empty_grasp_m), back)
    off_target = ~grip & (rng.random(n) < config.off_target_share)
    nearest, aside = config.off_target_m
    back = np.where(off_target, nearest + (config.standoff_m - nearest) * rng.random(n), back)
    sides = np.where(off_target, aside, 0.0) * rng.uniform(-1.0, 1.0, (2, n))
    closing = ~(grip | empty | off_target) & (rng.random(n) < config.closing_share)
    back = np.where(closing, 0.0, back)
    handle = scene.asset.handle_of(scene.task.joint)
    sides[1] += np.where(grip, grasp_of(handle, scene.placement).beside_m, 0.0)
    goals = goals @ pose(np.stack([*sides, -back], axis=1))
    found = solve_ik(scene.arm, goals, np.asarray(scene.placement.start_q), iterations=80)
    thick = handle.extent[1] if handle is not None else 0.02
    held = np.clip(thick * params["scale"], 0.0, scene.arm.gripper.max_width_m)
    ok = found.reached
    if not ok.any():
        ok[:] = True
    return Start(
        params=EpisodeParams(params.values[ok]),
        q=found.q[ok],
        opened=opened[ok],
        width=np.select([grip, empty], [held, 0.0 * held], scene.arm.gripper.max_width_m)[ok],
        closing=np.where(grip | empty | closing, 1.0, -1.0)[ok],
        home=np.zeros(int(ok.sum()), dtype=bool),
    )


PLACED = ("scale", "x_m", "y_m", "yaw_rad", "part_open")
"""Episode parameters on which a precomputed pose of the arm depends."""


def mix_starts(
    scene: Scene, precomputed: Start, params: EpisodeParams, share: float, rng: np.random.Generator
) -> Start:
    """Return starts at home, of which ``share`` are replaced by rows of ``precomputed``.

    Args:
        scene: Scene of the episodes.
        precomputed: Starts of :func:`precompute_states`.
        params: Sampled parameters of N episodes.
        share: Share of replaced starts, in [0, 1].
        rng: Generator of the choice.
    """
    home = home_start(scene, params)
    n = len(params.values)
    along = rng.random(n) < share
    pick = rng.integers(len(precomputed.q), size=n)
    values = params.values.copy()
    columns = np.array([COLUMNS.index(name) for name in PLACED])
    values[np.ix_(along, columns)] = precomputed.params.values[pick[along]][:, columns]

    def choose(a: Array, b: Array) -> Array:
        mask = along if a.ndim == 1 else along[:, None]
        return np.where(mask, b[pick], a)

    return Start(
        params=EpisodeParams(values),
        q=choose(home.q, precomputed.q),
        opened=choose(home.opened, precomputed.opened),
        width=choose(home.width, precomputed.width),
        closing=choose(home.closing, precomputed.closing),
        home=~along,
    )


def concatenate_starts(starts: Sequence[Start], order: Ints) -> Start:
    """Return the rows of all ``starts`` in ``order`` (M,), indices."""

    def stacked(name: str) -> Any:
        return np.concatenate([getattr(start, name) for start in starts])[order]

    values = np.concatenate([start.params.values for start in starts])[order]
    names = ("q", "opened", "width", "closing", "home")
    return Start(params=EpisodeParams(values), **{name: stacked(name) for name in names})
