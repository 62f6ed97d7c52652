"""Episode parameters: the randomized numbers of an episode, recorded with it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from articulate.jit import row_function
from articulate.task.randomization_config import NO_RANDOMIZATION, RandomizationConfig, Range
from articulate.transforms import Array

PUSH_S = 0.2
"""Duration of a push [s]."""
PUSHED = (0.0, 0.9)
"""Range of the beginning of a push, as shares of an episode."""
PUSHED_OPEN = (0.5, 0.9)
"""The same for a part that is open when the episode begins: before it is grasped, 5 N would push a
light door out of reach."""

COLUMNS = (
    "friction", "joint_damping", "joint_friction", "armature", "mass", "stiffness", "damping",
    "scale", "x_m", "y_m", "yaw_rad",
    "start_1", "start_2", "start_3", "start_4", "start_5", "start_6", "start_7",
    "delay_steps", "gripper_latency_s", "bias_x_m", "bias_y_m", "bias_z_m", "bias_yaw_rad",
    "estimate_delay_steps", "push_x_n", "push_y_n", "push_z_n", "push_time", "part_open",
    "force_bias_x_n", "force_bias_y_n", "force_bias_z_n",
)  # fmt: skip
"""Names of the numbers; ``part_open`` is the fraction open at which the part begins."""
BLOCKS = {
    "start": slice(11, 18), "bias": slice(20, 23), "push": slice(25, 28),
    "force_bias": slice(30, 33),
}  # fmt: skip
"""Columns that belong together."""

_PUSH_TIME = COLUMNS.index("push_time")


@dataclass(frozen=True)
class EpisodeParams:
    """Sampled numbers of N episodes, one row each with the columns :data:`COLUMNS`."""

    values: Array

    def __getitem__(self, name: str) -> Array:
        """Return column ``name`` (N,), or the block (N, k) of a name in :data:`BLOCKS`."""
        if name in BLOCKS:
            return np.asarray(self.values[:, BLOCKS[name]])
        return np.asarray(self.values[:, COLUMNS.index(name)])


def sample_episode_params(
    config: RandomizationConfig, rng: np.random.Generator, n: int = 1, *, begin: Range = (0.0, 0.0)
) -> EpisodeParams:
    """Sample the parameters of N episodes.

    Args:
        config: Ranges.
        rng: Random generator.
        n: Number of episodes.
        begin: Range of the fraction open at the beginning. It belongs to the task, not to the
            randomization; equal ends sample nothing.
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


@row_function
def push_is_active(values: Array, time_s: float, episode_s: float) -> bool:
    """Return True while the push of an episode acts.

    Args:
        values: Episode parameters (columns,).
        time_s: Time since the episode began [s].
        episode_s: Length of the episode [s].
    """
    begin = values[_PUSH_TIME] * episode_s
    return bool(begin <= time_s < begin + PUSH_S)


def randomize_model(
    model: Any,
    value: Mapping[str, float],
    *,
    arm_v: Any,
    arm_u: Any,
    finger_geoms: Any,
    object_v: Any,
    moving_bodies: Any,
) -> None:
    """Multiply the numbers of a MuJoCo model by the sampled factors, in place.

    Args:
        model: An ``mjModel`` with nominal numbers.
        value: Factors by name.
        arm_v: Indices of the arm's degrees of freedom (7,).
        arm_u: Indices of its actuators (7,).
        finger_geoms: Indices of the geoms of the fingers.
        object_v: Indices of the object's degrees of freedom.
        moving_bodies: Indices of its moving bodies.
    """
    model.geom_friction[finger_geoms, 0] *= value["friction"]
    model.dof_damping[object_v] *= value["joint_damping"]
    model.dof_frictionloss[object_v] *= value["joint_friction"]
    model.dof_armature[arm_v] *= value["armature"]
    model.body_mass[moving_bodies] *= value["mass"]
    model.body_inertia[moving_bodies] *= value["mass"]
    model.actuator_gainprm[arm_u, 0] *= value["stiffness"]
    model.actuator_biasprm[arm_u, 1] *= value["stiffness"]
    model.actuator_biasprm[arm_u, 2] *= value["damping"]


def at_size(config: RandomizationConfig, scale: float) -> RandomizationConfig:
    """Return ``config`` with the object at one size."""
    return replace(config, scale=(scale, scale), scales=1)


def sample_episode_params_each(
    config: RandomizationConfig, seed: int, n: int, *, begin: Range = (0.0, 0.0), first: int = 0
) -> EpisodeParams:
    """Sample N episodes, each from a separate generator: row k is equal for every N.

    Args:
        config: Ranges.
        seed: Determines all numbers.
        n: Number of episodes.
        begin: As in :func:`sample_episode_params`.
        first: Index of the first episode.
    """
    rows = [
        sample_episode_params(
            config, np.random.default_rng(np.random.SeedSequence([seed, k])), begin=begin
        ).values
        for k in range(first, first + n)
    ]
    return EpisodeParams(np.concatenate(rows))


def nominal_params(n: int = 1, *, begin: Range = (0.0, 0.0)) -> EpisodeParams:
    """Return N episodes without randomization; parts begin in the middle of ``begin``."""
    middle = sum(begin) / 2.0
    return sample_episode_params(
        NO_RANDOMIZATION, np.random.default_rng(0), n, begin=(middle, middle)
    )
