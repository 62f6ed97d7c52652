"""Episodes of a deployment: which parameters they have, the same for every robot."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from articulate.errors import ConfigError
from articulate.task.manifest import Manifest
from articulate.task.randomization import EpisodeParams, at_size, sample_episode_params_each
from articulate.task.randomization_config import NO_RANDOMIZATION, RandomizationConfig
from articulate_deploy.bundle import Bundle
from articulate_deploy.time_scale import check_speed_scale


@dataclass(frozen=True)
class EpisodeRequest:
    """Episodes to run on each robot; see :func:`articulate_deploy.deploy.deploy`."""

    episodes: int
    seed: int | None
    randomise: bool
    speed_scale: float = 1.0

    def __post_init__(self) -> None:
        if self.episodes < 1:
            raise ConfigError(f"episodes is {self.episodes}; it must be at least 1")
        if self.seed is not None and self.seed < 0:
            raise ConfigError(f"seed is {self.seed}; it must be 0 or more")
        check_speed_scale(self.speed_scale)


@dataclass(frozen=True)
class Plan:
    """Sampled parameters of the episodes of one deployment, the same for every robot."""

    config: RandomizationConfig
    """Ranges of the noise within an episode."""
    episode_params: EpisodeParams
    """One row an episode."""
    seed: int
    """Seed of the noise, and of the parameters unless they are the bundle's."""
    from_bundle: bool
    """True for the parameters of the bundle."""

    def params(self, k: int) -> EpisodeParams:
        """Return the parameters of episode ``k``, one row."""
        return EpisodeParams(self.episode_params.values[k : k + 1].copy())

    def noise(self, k: int) -> np.random.Generator:
        """Return the generator of the noise within episode ``k``."""
        return np.random.default_rng(np.random.SeedSequence([self.seed, k, 1]))


def make_plan(bundle: Bundle, episodes: int, *, seed: int | None, randomise: bool) -> Plan:
    """Return the parameters of ``episodes`` episodes; see :func:`articulate_deploy.deploy.deploy`.

    Raises:
        ConfigError: There are more episodes than rows in the bundle, and no seed.
    """
    manifest = bundle.manifest
    config = one_size(manifest) if randomise else start_only(manifest)
    from_bundle = seed is None and randomise
    seed = manifest.episodes.seed if seed is None else seed
    if not from_bundle:
        rows = sample_episode_params_each(config, seed, episodes, begin=manifest.task.begin)
        return Plan(config, rows, seed, from_bundle)
    if episodes > manifest.episodes.count:
        raise ConfigError(
            f"episodes is {episodes}; the bundle has {manifest.episodes.count}: "
            "run fewer, or give a seed to sample others"
        )
    rows = EpisodeParams(bundle.episode_params.values[:episodes])
    return Plan(config, rows, seed, from_bundle)


def start_only(manifest: Manifest) -> RandomizationConfig:
    """Return the randomization of the arm's start only; without it all episodes would be equal."""
    return replace(NO_RANDOMIZATION, start_rad=manifest.randomization.start_rad)


def one_size(manifest: Manifest) -> RandomizationConfig:
    """Return the randomization of training with the object at the size of the bundle's scene."""
    return at_size(manifest.randomization, manifest.scene.scale)
