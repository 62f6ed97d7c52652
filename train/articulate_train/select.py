"""Which state of a training is kept: those of its second half are judged, and the best is taken.

What is learnt can be lost again while training goes on: a seed that succeeds in 98 of 100 episodes
in the middle may end at 93. Judged are episodes from home with the run's own randomisation, under
seeds that neither training nor evaluation use, so that the evaluation stays what it is: figures of
one policy that was fixed before.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from articulate_train.config import SelectConfig
from articulate_train.evaluate import run_episodes
from articulate_train.policy import policy_of, read_checkpoint, trained_steps, write_state
from articulate_train.ppo import SELECTION
from articulate_train.run import Run

STATES = "states"
"""Folder in a seed's folder that holds states of its policy while it is trained."""


@dataclass
class Judged:
    """How one state did so far."""

    steps: int
    """Ticks of experience it was made after."""
    episodes: int = 0
    """Episodes it was judged on."""
    successes: int = 0
    """Those that were successes."""

    @property
    def rate(self) -> float:
        """Share of successes; 0 before it was judged."""
        return self.successes / max(self.episodes, 1)


def keep_state(folder: Path, content: dict[str, Any]) -> None:
    """Keep a state, as :meth:`.Members.acting` says it, in a seed's folder until the end."""
    path = folder / STATES / f"{trained_steps(content)}.pt"
    path.parent.mkdir(exist_ok=True)
    write_state(path, content)


def is_due(config: SelectConfig, total: int, before: int, now: int) -> bool:
    """Whether one of the moments of a training of ``total`` ticks lies in (``before``, ``now``]."""
    return any(before < moment <= now for moment in config.moments(total))


def choose_state(
    run: Run, seed: int, *, threads: int, goes_on: Callable[[], bool] = lambda: True
) -> tuple[dict[str, Any], list[Judged]] | None:
    """The best of the states that a seed's folder keeps, and how all did; None if stopped.

    All are judged on the same draws. States as good as the last finalist are judged once more, as
    states that are lost later on are often as good at first; what is then still equal goes to the
    later one.

    Args:
        run: The run.
        seed: Its seed.
        threads: Threads of the engine.
        goes_on: Asked before each state is judged.
    """
    config, folder = run.config.select, run.seed_folder(seed) / STATES
    judged = [Judged(steps) for steps in _kept(folder) if steps >= config.since * run.config.steps]
    if len(judged) == 1:
        return read_checkpoint(folder, f"{judged[0].steps}.pt"), judged
    scene, left = run.scene(), judged

    def judge(states: list[Judged], episodes: int, k: int) -> bool:
        stream = [run.config.evaluation_seed, seed, SELECTION, k]
        for state in states if len(states) > 1 else ():
            if not goes_on():
                return False
            policy = policy_of(read_checkpoint(folder, f"{state.steps}.pt"))
            ended, _ = run_episodes(
                scene,
                policy,
                run.config.draw,
                np.random.SeedSequence(stream),
                episodes=episodes,
                threads=threads,
            )
            state.episodes += episodes
            state.successes += int((ended.code == 0).sum())
        return True

    # Draws of the first and the last round are numbered 0 and 1, those of the one for ties 2.
    if not judge(left, config.episodes, 0):
        return None
    left = _not_worse(left, config.finalists)
    if len(left) > config.finalists and not judge(left, config.episodes, 2):
        return None
    left = _best(left, config.finalists)
    if not judge(left, config.more, 1):
        return None
    return read_checkpoint(folder, f"{_best(left, 1)[0].steps}.pt"), judged


def _kept(folder: Path) -> list[int]:
    """Ticks of the states that a folder holds, growing."""
    return sorted(int(path.stem) for path in folder.glob("*.pt"))


def _not_worse(judged: list[Judged], most: int) -> list[Judged]:
    """What was judged no worse than the last of the ``most`` best."""
    last = _best(judged, most)[-1].rate
    return [j for j in judged if j.rate >= last]


def _best(judged: list[Judged], most: int) -> list[Judged]:
    """At most ``most`` of what was judged, the best first; of equals the later."""
    return sorted(judged, key=lambda j: (j.rate, j.steps), reverse=True)[:most]


def told(judged: list[Judged]) -> list[dict[str, int]]:
    """What is written of the states that were judged."""
    return [asdict(j) for j in judged]
