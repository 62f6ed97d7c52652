"""Evaluation during training that ends it once the target success is met.

The policy of a training is evaluated in regular intervals on episodes from home with the run's
randomization. Each evaluation has new episodes, which neither training nor checkpoint selection nor
the final evaluation uses. A few episodes come first; only a policy that is good enough on them is
evaluated on all.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch

from articulate.files import read_json_object
from articulate.statistics import wilson
from articulate_envs.scene import Scene
from articulate_train.config import TrainConfig
from articulate_train.evaluate import run_episodes
from articulate_train.policy import policy_of
from articulate_train.ppo import TARGET

FIRST_MARGIN = 0.02
"""Difference to the target success up to which the first episodes call for the others."""
KEY = "target_evaluation"
"""Key of ``done.json`` with the evaluation that ended the training."""


@dataclass(frozen=True, kw_only=True)
class TargetEvaluation:
    """Success of the policy of a training on held-out episodes."""

    steps: int
    """Control steps of experience of the policy."""
    target: float
    """Success rate to reach."""
    episodes: int
    """Number of held-out episodes."""
    successes: int
    """Number of successes among them."""
    low: float
    """Lower end of the 95 % Wilson interval of the success rate."""
    high: float
    """Upper end of it."""
    is_complete: bool
    """True if all episodes of the evaluation were run, not only the first ones."""

    @property
    def is_reached(self) -> bool:
        """True if the success rate of a complete evaluation is at least the target."""
        return self.is_complete and self.successes >= self.target * self.episodes

    def text(self) -> str:
        """Describe the evaluation in one phrase."""
        rate = self.successes / self.episodes
        return (
            f"{rate:.1%} of {self.episodes} held-out episodes after {self.steps / 1e6:.2f}M steps "
            f"(target {self.target:.1%})"
        )

    def as_dict(self) -> dict[str, Any]:
        """Return the fields as a JSON object."""
        return asdict(self)


def is_evaluation_due(config: TrainConfig, before: int, now: int) -> bool:
    """Return whether the target is evaluated in (``before``, ``now``] control steps of a seed.

    The end of a training is left to the checkpoint selection.
    """
    every = config.early_stopping.every
    return config.target_success > 0.0 and now // every > before // every and now < config.steps


def evaluate_target(
    scene: Scene, config: TrainConfig, seed: int, state: dict[str, Any], steps: int, threads: int
) -> TargetEvaluation:
    """Evaluate the policy ``state`` of a training after ``steps`` control steps.

    Args:
        scene: Compiled scene of the run.
        config: Configuration of the run.
        seed: Seed of the training.
        state: Result of :meth:`.Ensemble.policy_state`.
        steps: Control steps of experience; their number chooses the episodes.
        threads: Threads of the engine.
    """
    stopping = config.early_stopping
    stream = np.random.SeedSequence([config.evaluation_seed, seed, TARGET, steps])
    with torch.random.fork_rng(devices=[]):  # building a module samples weights
        policy = policy_of(state)
    n = hits = 0
    for episodes in (stopping.first_episodes, stopping.episodes):
        ended, _ = run_episodes(
            scene, policy, config.randomization, stream, episodes=episodes, threads=threads
        )
        n, hits = n + episodes, hits + int((ended.code == 0).sum())
        if hits < (config.target_success - FIRST_MARGIN) * n:
            break
    interval = wilson(hits, n)
    return TargetEvaluation(
        steps=steps,
        target=config.target_success,
        episodes=n,
        successes=hits,
        low=interval.low,
        high=interval.high,
        is_complete=n == stopping.first_episodes + stopping.episodes,
    )


def target_episodes(config: TrainConfig) -> int:
    """Return the largest number of episodes of a seed's evaluations that do not end it early."""
    stopping = config.early_stopping
    count = max(-(-config.steps // stopping.every) - 1, 0) if config.target_success else 0
    return count * (stopping.first_episodes + stopping.episodes)


def reached_target(path: Path) -> TargetEvaluation | None:
    """Return the evaluation that ended a training; None if its control steps ended it.

    Args:
        path: ``done.json`` of the seed.
    """
    content = read_json_object(path).get(KEY)
    if not isinstance(content, Mapping):
        return None
    try:
        return TargetEvaluation(**content)
    except TypeError:  # damaged
        return None
