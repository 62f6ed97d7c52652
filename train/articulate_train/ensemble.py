"""Ensemble of independently trained policies; their mean action is used.

Independent policies make different errors, mostly at states that neither has visited often. So the
control steps of a seed are divided among the members. Members have separate environments, networks
and normalization; they share the processor and update in turn.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import chain
from pathlib import Path
from statistics import fmean
from typing import Any

from articulate_envs.scene import Scene
from articulate_train.config import TrainConfig
from articulate_train.policy import OTHER_MEMBERS, ensemble_of
from articulate_train.ppo import Learner, write_checkpoint
from articulate_train.vecenv import Finished


class Ensemble:
    """Training of all ensemble members of one seed."""

    def __init__(self, scene: Scene, config: TrainConfig, seed: int, *, threads: int) -> None:
        """Build all members without stepping."""
        self.config = config
        # The first is built last: all seed the global generators of torch and numpy.
        learners = [
            Learner(scene, config, seed, threads=threads, member=k)
            for k in reversed(range(config.ensemble_size))
        ]
        self.learners: list[Learner] = learners[::-1]

    @property
    def steps(self) -> int:
        """Control steps of experience of all members."""
        return sum(learner.model.num_timesteps for learner in self.learners)

    @property
    def updates(self) -> int:
        """Number of completed rounds of updates."""
        return int(self.learners[0].model._n_updates) // self.config.ppo.n_epochs

    @property
    def round_steps(self) -> int:
        """Control steps of one round of updates."""
        return len(self.learners) * self.config.ppo.n_envs * self.config.ppo.n_steps

    @property
    def is_done(self) -> bool:
        """True after all members have their control steps."""
        return all(learner.is_done for learner in self.learners)

    def run(self, on_round: Callable[[Ensemble], bool]) -> None:
        """Update the members in turn until all are done.

        Args:
            on_round: Called after each round of updates; returning False stops.

        Raises:
            DivergedError: A weight is no longer finite.
        """
        for learner in self.learners:
            learner.begin()
        while not self.is_done:
            for learner in self.learners:
                learner.update()
            if not on_round(self):
                return

    def finished(self) -> list[Finished]:
        """Return the episodes that ended since the last call."""
        out = list(chain.from_iterable(learner.envs.finished for learner in self.learners))
        for learner in self.learners:
            learner.envs.finished.clear()
        return out

    def figures(self) -> dict[str, float]:
        """Return the statistics of the last update, averaged over the members."""
        rows = [learner.update_figures() for learner in self.learners]
        names = [name for name in rows[0] if all(name in row for row in rows)]
        return {name: fmean(row[name] for row in rows) for name in names}

    def log_std(self) -> float:
        """Return the mean logarithm of the action noise."""
        return fmean(float(one.model.policy.log_std.detach().mean()) for one in self.learners)

    def save(self, folder: Path) -> None:
        """Write ``checkpoint.pt`` with the complete state of all members, atomically."""
        write_checkpoint(folder, _joined([learner.state_dict() for learner in self.learners]))

    def policy_state(self) -> dict[str, Any]:
        """Return the part of a checkpoint that :func:`.policy.policy_of` reads."""
        return _joined([learner.policy_state() for learner in self.learners])

    def restore(self, content: dict[str, Any]) -> None:
        """Continue from a checkpoint of :meth:`save`.

        Raises:
            ValueError: The checkpoint has another number of members.
        """
        states = ensemble_of(content)
        if len(states) != len(self.learners):
            raise ValueError(f"{len(states)} ensemble members, not {len(self.learners)}")
        pairs = list(zip(self.learners, states, strict=True))
        for learner, state in reversed(pairs):  # the first last: it sets torch's generators
            learner.restore(state)

    def diverged(self) -> Learner:
        """Return the first member whose weights are not finite, or the first of all."""
        broken = (learner for learner in self.learners if not learner.is_finite())
        return next(broken, self.learners[0])

    def close(self) -> None:
        """Release the engines."""
        for learner in self.learners:
            learner.close()


def _joined(states: list[dict[str, Any]]) -> dict[str, Any]:
    first, *rest = states
    return first | {OTHER_MEMBERS: rest} if rest else first
