"""A seed's members: trainings of its own that take turns, and act as the mean of what they say.

What one policy has learnt differs from what another has, most of all where neither has been much:
where one of them errs, the other rarely does the same. So a seed's ticks are shared out. Members
have their own environments, networks and normalisation, and learn nothing of each other; only the
processor is theirs in turn, an update each.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import chain
from pathlib import Path
from statistics import fmean
from typing import Any

from articulate_envs.scene import Scene
from articulate_train.config import TrainConfig
from articulate_train.policy import FURTHER, members_of
from articulate_train.ppo import Learner, write_checkpoint
from articulate_train.vecenv import Finished


class Members:
    """One seed's training."""

    def __init__(self, scene: Scene, config: TrainConfig, seed: int, *, threads: int) -> None:
        """Build all members; nothing is stepped yet."""
        self.config = config
        # The first is made last: all seed the generators of torch and numpy, which are but one.
        made = [
            Learner(scene, config, seed, threads=threads, member=k)
            for k in reversed(range(config.members))
        ]
        self.learners: list[Learner] = made[::-1]

    @property
    def steps(self) -> int:
        """Ticks of experience of all of them."""
        return sum(learner.model.num_timesteps for learner in self.learners)

    @property
    def updates(self) -> int:
        """Rounds of updates that were made."""
        return int(self.learners[0].model._n_updates) // self.config.ppo.n_epochs

    @property
    def round_steps(self) -> int:
        """Ticks of a round of updates."""
        return len(self.learners) * self.config.ppo.n_envs * self.config.ppo.n_steps

    @property
    def is_done(self) -> bool:
        """Whether all have their ticks."""
        return all(learner.is_done for learner in self.learners)

    def run(self, on_round: Callable[[Members], bool]) -> None:
        """Update each in turn until all are done.

        Args:
            on_round: Called after each has made an update; returning False stops.

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
        """Episodes that ended since this was asked last."""
        out = list(chain.from_iterable(learner.envs.finished for learner in self.learners))
        for learner in self.learners:
            learner.envs.finished.clear()
        return out

    def figures(self) -> dict[str, float]:
        """Means over the members of what is told of their last update."""
        told = [learner.update_figures() for learner in self.learners]
        names = [name for name in told[0] if all(name in row for row in told)]
        return {name: fmean(row[name] for row in told) for name in names}

    def log_std(self) -> float:
        """Mean logarithm of the noise of actions."""
        return fmean(float(one.model.policy.log_std.detach().mean()) for one in self.learners)

    def save(self, folder: Path) -> None:
        """Write ``checkpoint.pt`` whole: all that each of them has."""
        write_checkpoint(folder, _together([learner.content() for learner in self.learners]))

    def acting(self) -> dict[str, Any]:
        """What a checkpoint holds of the policy alone, for :func:`.policy.policy_of`."""
        return _together([learner.acting() for learner in self.learners])

    def restore(self, content: dict[str, Any]) -> None:
        """Continue from what :meth:`save` wrote.

        Raises:
            ValueError: It has another number of members.
        """
        kept = members_of(content)
        if len(kept) != len(self.learners):
            raise ValueError(f"{len(kept)} members, not {len(self.learners)}")
        pairs = list(zip(self.learners, kept, strict=True))
        for learner, own in reversed(pairs):  # the first last: it sets torch's generators
            learner.restore(own)

    def diverged(self) -> Learner:
        """The first whose weights are not finite; the first of all if they are."""
        broken = (learner for learner in self.learners if not learner.is_finite())
        return next(broken, self.learners[0])

    def close(self) -> None:
        """Give back the engines."""
        for learner in self.learners:
            learner.close()


def _together(contents: list[dict[str, Any]]) -> dict[str, Any]:
    first, *rest = contents
    return first | {FURTHER: rest} if rest else first
