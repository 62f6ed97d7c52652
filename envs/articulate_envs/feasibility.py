"""Estimate of whether a task can be learned at all, before any time is spent on training.

The scripted expert acts on the estimated state of the object, with the errors and delays of the
randomization, as a policy does: an edge that must be held within a few millimetres is easy with the
true state and hard for any policy. A low success rate points at the handle, the placement or the
limits of the task. The estimate takes seconds.
"""

from __future__ import annotations

import os
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from articulate.errors import ConfigError
from articulate.task.episode_monitor import REASONS
from articulate.task.observation import expert_action
from articulate.task.randomization_config import RandomizationConfig
from articulate.transforms import Ints
from articulate_envs.episodes import Episodes
from articulate_envs.rewards import RewardConfig
from articulate_envs.scene import Scene
from articulate_envs.threaded_engine import ThreadEngine

N_EPISODES = 64
"""Episodes of an estimate; the standard error of a rate of 50 % is then 6 %."""


@dataclass(frozen=True)
class Feasibility:
    """Outcome of the scripted expert on sampled episodes of a scene."""

    success: float
    """Success rate, in [0, 1]."""
    n_episodes: int
    """Number of sampled episodes."""
    dominant_failure: str | None
    """Most frequent reason of the failed episodes; None if all succeeded."""

    def to_dict(self) -> dict[str, Any]:
        """Return the fields as a JSON object."""
        return asdict(self)


def estimate_feasibility(
    scene: Scene,
    *,
    n_episodes: int = N_EPISODES,
    seed: int = 0,
    n_threads: int | None = None,
    randomization: RandomizationConfig | None = None,
) -> Feasibility:
    """Run the scripted expert with estimated state on sampled episodes of ``scene``.

    Args:
        scene: Compiled scene; its task gives the length of an episode and the success criteria.
        n_episodes: Number of episodes, simulated as one batch.
        seed: Seed of the episode parameters and of the noise; the number of threads changes
            nothing.
        n_threads: Threads of the engine; by default all available processors.
        randomization: Ranges of the episode parameters. By default the ranges of training, at the
            sizes of the scene.

    Raises:
        ConfigError: ``n_episodes`` is below 1.
    """
    if n_episodes < 1:
        raise ConfigError(f"n_episodes is {n_episodes}; it must be at least 1")
    episodes = Episodes(
        ThreadEngine(scene, n_episodes, threads=n_threads or _n_processors()),
        randomization=randomization or _default_randomization(scene),
        reward=RewardConfig(),
        initial_states=None,
        seed=seed,
        renew=False,
    )
    try:
        codes = _run(episodes)
    finally:
        episodes.engine.close()
    failures = codes[codes != 0]
    return Feasibility(
        success=float(np.mean(codes == 0)),
        n_episodes=n_episodes,
        dominant_failure=REASONS[np.bincount(failures).argmax()] if len(failures) else None,
    )


def _run(episodes: Episodes) -> Ints:
    """Return the code of each episode (N,) after the scripted expert has acted to its end.

    An episode that diverges ends early; its first code counts.
    """
    scene = episodes.engine.scene
    codes = np.full(episodes.engine.n_envs, -1, dtype=np.int64)
    observed = episodes.reset()
    for _ in range(scene.n_steps):
        step = episodes.step(expert_action(observed))
        observed = step.observation
        if step.ended is not None:
            new = codes[step.ended.rows] < 0
            codes[step.ended.rows[new]] = step.ended.code[new]
    return codes


def _default_randomization(scene: Scene) -> RandomizationConfig:
    sizes = scene.scales
    return RandomizationConfig(scale=(min(sizes), max(sizes)), scales=len(sizes))


def _n_processors() -> int:
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
