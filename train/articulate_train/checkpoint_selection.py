"""Which state of a training is kept, and who of its members acts: both are judged on episodes.

What is learnt can be lost again while training goes on: a seed that succeeds in 98 of 100 episodes
in the middle may end at 93. And of a seed's members one may have learnt much less than the others,
which then do better without it. Judged are episodes from home with the run's own randomisation,
under seeds that neither training nor evaluation use, so that the evaluation stays what it is:
figures of one policy that was fixed before.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from articulate.errors import ConfigError
from articulate.task.randomization_config import RandomizationConfig
from articulate_envs.scene import Scene
from articulate_train.config import CheckpointSelectionConfig
from articulate_train.evaluate import run_episodes
from articulate_train.policy import (
    ACTS,
    members_of,
    policy_of,
    read_checkpoint,
    trained_steps,
    write_state,
)
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


@dataclass
class MemberScore:
    """How a state's members did, together or one of them alone."""

    alone: int | None
    """Number of the member that acts; None where all do."""
    episodes: int = 0
    """Episodes with the run's own randomisation that it was judged on."""
    successes: int = 0
    """Those that were successes."""
    wider_episodes: int = 0
    """Episodes with wider ranges that it was judged on."""
    wider_successes: int = 0
    """Those that were successes."""


def keep_state(folder: Path, content: dict[str, Any]) -> None:
    """Keep a state, as :meth:`.Members.acting` says it, in a seed's folder until the end."""
    path = folder / STATES / f"{trained_steps(content)}.pt"
    path.parent.mkdir(exist_ok=True)
    write_state(path, content)


def is_due(config: CheckpointSelectionConfig, total: int, before: int, now: int) -> bool:
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


def choose_acting(
    run: Run,
    seed: int,
    state: dict[str, Any],
    *,
    threads: int,
    goes_on: Callable[[], bool] = lambda: True,
) -> tuple[dict[str, Any], list[MemberScore]] | None:
    """The state with who acts, and how all did; None if stopped.

    All members act, unless one of them alone has more successes than all together on the same
    draws, and as well if as many draws from wider ranges are counted with them. The mean of several
    mostly does better than the best of them, and nearly always where more is drawn than they were
    trained on. The best alone is judged on more draws where it is ahead on the first of them.

    Args:
        run: The run.
        seed: Its seed.
        state: The state that was chosen, as :func:`choose_state` gives it.
        threads: Threads of the engine.
        goes_on: Asked before each judgement.
    """
    config = run.config.select
    state = {k: v for k, v in state.items() if k != ACTS}
    count = len(members_of(state))
    if count == 1 or config.alone == 0:
        return state, []
    scene = run.scene()

    def successes(
        acted: MemberScore, scene: Scene, draws: RandomizationConfig, episodes: int, k: int
    ) -> int:
        policy = policy_of(state | {ACTS: acted.alone})
        stream = np.random.SeedSequence([run.config.evaluation_seed, seed, SELECTION, k])
        ended, _ = run_episodes(scene, policy, draws, stream, episodes=episodes, threads=threads)
        return int((ended.code == 0).sum())

    def judge(which: list[MemberScore], k: int) -> bool:
        for acted in which:
            if not goes_on():
                return False
            acted.episodes += config.alone
            acted.successes += successes(acted, scene, run.config.draw, config.alone, k)
        return True

    # Draws of states are numbered 0 to 2.
    together, *others = judged = [MemberScore(None), *(MemberScore(k) for k in range(count))]
    if not judge(judged, 3):
        return None
    best = max(others, key=lambda acted: acted.successes)
    if best.successes <= together.successes:
        return state, judged
    if not judge([together, best], 4):
        return None
    if best.successes <= together.successes:
        return state, judged
    wide = _widened(run, config.wider)
    sizes = wide.scene()
    for acted in (together, best):
        if not goes_on():
            return None
        acted.wider_episodes = 2 * config.alone
        acted.wider_successes = successes(acted, sizes, wide.config.draw, acted.wider_episodes, 5)
    ahead = best.successes - together.successes
    lost = together.wider_successes - best.wider_successes
    return state | ({ACTS: best.alone} if ahead > lost else {}), judged


def _widened(run: Run, factor: float) -> Run:
    """The run with ranges ``factor`` times as wide, or as they are where they cannot be."""
    try:
        return run.widened(factor)
    except ConfigError:
        return run


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


def told(judged: list[Judged] | list[MemberScore]) -> list[dict[str, int | None]]:
    """What is written of the states, or of the members, that were judged."""
    return [asdict(j) for j in judged]
