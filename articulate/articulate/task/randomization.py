"""Draws: what was randomised in an episode, recorded with it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from articulate.task.randomization_config import NO_RANDOMIZATION, RandomizationConfig, Range
from articulate.transforms import Array

PUSH_S = 0.2
"""How long a push lasts [s]."""
PUSHED = (0.0, 0.9)
"""Shares of an episode between which a push begins."""
PUSHED_OPEN = (0.5, 0.9)
"""The same of a part that stands open as the episode begins: nothing holds it before a hand has
come, and 5 N fling a light door past where any hand can reach it."""

COLUMNS = (
    "friction", "joint_damping", "joint_friction", "armature", "mass", "stiffness", "damping",
    "scale", "x_m", "y_m", "yaw_rad",
    "start_1", "start_2", "start_3", "start_4", "start_5", "start_6", "start_7",
    "delay_steps", "gripper_latency_s", "bias_x_m", "bias_y_m", "bias_z_m", "bias_yaw_rad",
    "estimate_delay_steps", "push_x_n", "push_y_n", "push_z_n", "push_time", "part_open",
    "force_bias_x_n", "force_bias_y_n", "force_bias_z_n",
)  # fmt: skip
"""Names of a draw's numbers; ``part_open`` is the fraction open at which the part begins."""
BLOCKS = {
    "start": slice(11, 18), "bias": slice(20, 23), "push": slice(25, 28),
    "force_bias": slice(30, 33),
}  # fmt: skip
"""Columns that belong together."""


@dataclass(frozen=True)
class EpisodeParams:
    """What was drawn for N episodes, one row each with the columns :data:`COLUMNS`."""

    values: Array

    def __getitem__(self, name: str) -> Array:
        """Column ``name`` (N,); names of :data:`BLOCKS` give their blocks."""
        if name in BLOCKS:
            return np.asarray(self.values[:, BLOCKS[name]])
        return np.asarray(self.values[:, COLUMNS.index(name)])


def sample_episode_params(
    config: RandomizationConfig, rng: np.random.Generator, n: int = 1, *, begin: Range = (0.0, 0.0)
) -> EpisodeParams:
    """Draw the parameters of N episodes from ``rng``.

    Args:
        config: Ranges.
        rng: Where the numbers come from.
        n: How many episodes.
        begin: Fractions between which the part is at their beginning, as the task says; part of
            the task and no randomisation. Nothing is drawn where both are the same.
    """

    def log_uniform(bounds: Range) -> Array:
        return np.exp(rng.uniform(np.log(bounds[0]), np.log(bounds[1]), n))

    scales = np.asarray(config.scale_values)
    direction = rng.normal(size=(n, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    push = direction * rng.uniform(*config.push_n, n)[:, None]
    columns: list[Array] = [
        rng.uniform(*config.friction, n),
        log_uniform(config.joint_damping),
        log_uniform(config.joint_friction),
        log_uniform(config.armature),
        rng.uniform(*config.mass, n),
        rng.uniform(*config.stiffness, n),
        rng.uniform(*config.damping, n),
        scales[rng.integers(len(scales), size=n)],
        config.position_m * rng.uniform(-1.0, 1.0, n),
        config.position_m * rng.uniform(-1.0, 1.0, n),
        config.yaw_rad * rng.uniform(-1.0, 1.0, n),
        *(config.start_rad * rng.uniform(-1.0, 1.0, (7, n))),
        rng.integers(config.delay_steps[0], config.delay_steps[1] + 1, n).astype(float),
        rng.uniform(*config.gripper_latency_s, n),
        *(config.estimate_bias_m * rng.normal(size=(3, n))),
        config.estimate_yaw_rad * rng.normal(size=n),
        rng.integers(config.estimate_delay_steps[0], config.estimate_delay_steps[1] + 1, n).astype(
            float
        ),
        *push.T,
        rng.uniform(*(PUSHED_OPEN if begin[0] < begin[1] else PUSHED), n),
        rng.uniform(*begin, n) if begin[0] < begin[1] else np.full(n, begin[0]),
        *(config.force_bias_n * rng.normal(size=(3, n))),
    ]
    return EpisodeParams(np.stack(columns, axis=1))


def at_size(config: RandomizationConfig, scale: float) -> RandomizationConfig:
    """``config`` with the object at one size."""
    return replace(config, scale=(scale, scale), scales=1)


def sample_episode_params_each(
    config: RandomizationConfig, seed: int, n: int, *, begin: Range = (0.0, 0.0), first: int = 0
) -> EpisodeParams:
    """Draw N episodes, each from a generator of its own: row k is the same for every N.

    Args:
        config: Ranges.
        seed: Decides all that is drawn.
        n: How many episodes.
        begin: As in :func:`sample_episode_params`.
        first: Number of the first episode.
    """
    rows = [
        sample_episode_params(config, np.random.default_rng(np.random.SeedSequence([seed, k])), begin=begin).values
        for k in range(first, first + n)
    ]
    return EpisodeParams(np.concatenate(rows))


def nominal_params(n: int = 1, *, begin: Range = (0.0, 0.0)) -> EpisodeParams:
    """N episodes in which nothing is randomised; parts begin in the middle of ``begin``."""
    middle = sum(begin) / 2.0
    return sample_episode_params(NO_RANDOMIZATION, np.random.default_rng(0), n, begin=(middle, middle))
