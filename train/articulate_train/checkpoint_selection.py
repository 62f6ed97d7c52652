"""Selection of the checkpoint and of the active ensemble members, on evaluation episodes.

Success can fall again during training: a seed with 98 % in the middle may end at 93 %. And one
ensemble member may have learned much less than the others, which are better without it. Candidates
are evaluated on episodes from home with the run's randomization. Their random seeds are used by
neither training nor the final evaluation, whose figures are thus those of a fixed policy.
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
    ACTIVE_MEMBER,
    ensemble_of,
    policy_of,
    read_checkpoint,
    trained_steps,
    write_state,
)
from articulate_train.ppo import SELECTION
from articulate_train.run import Run

CANDIDATES = "candidates"
"""Folder in a seed's folder with candidate checkpoints during training."""
Progress = Callable[[str], None]
"""Called with one line before each evaluation."""


@dataclass
class CheckpointScore:
    """Evaluation of one candidate checkpoint so far."""

    steps: int
    """Control steps of experience at the checkpoint."""
    episodes: int = 0
    """Number of evaluation episodes."""
    successes: int = 0
    """Number of successes among them."""

    @property
    def rate(self) -> float:
        """Success rate; 0 before the first evaluation."""
        return self.successes / max(self.episodes, 1)


@dataclass
class MemberScore:
    """Evaluation of the ensemble or of one of its members."""

    member: int | None
    """Index of the member; None for the ensemble."""
    episodes: int = 0
    """Number of episodes with the run's randomization."""
    successes: int = 0
    """Number of successes among them."""
    ood_episodes: int = 0
    """Number of episodes with wider randomization."""
    ood_successes: int = 0
    """Number of successes among them."""


def keep_candidate(folder: Path, content: dict[str, Any]) -> None:
    """Keep a policy state of :meth:`.Ensemble.policy_state` until the end of the training."""
    path = folder / CANDIDATES / f"{trained_steps(content)}.pt"
    path.parent.mkdir(exist_ok=True)
    write_state(path, content)


def is_due(config: CheckpointSelectionConfig, total: int, before: int, now: int) -> bool:
    """Return whether a candidate of a training of ``total`` steps is in (``before``, ``now``]."""
    return any(before < step <= now for step in config.candidate_steps(total))


def select_checkpoint(
    run: Run,
    seed: int,
    *,
    threads: int,
    should_continue: Callable[[], bool] = lambda: True,
    on_progress: Progress = lambda _: None,
) -> tuple[dict[str, Any], list[CheckpointScore]] | None:
    """Return the best candidate of a seed and the scores of all; None if stopped.

    All candidates are evaluated on the same episodes. Candidates that tie with the last finalist
    are evaluated once more, since checkpoints that are worse in the end are often as good at
    first. Of remaining ties the later checkpoint wins.

    Args:
        run: The run.
        seed: One of its seeds.
        threads: Threads of the engine.
        should_continue: Called before each evaluation.
        on_progress: Called with one line before each evaluation.
    """
    config, folder = run.config.checkpoint_selection, run.seed_folder(seed) / CANDIDATES
    first_step = config.start_fraction * run.config.steps
    kept = _kept(folder)  # that of 0 steps is the policy from which the training started
    scores = [CheckpointScore(steps) for steps in kept if steps == 0 or steps >= first_step]
    if len(scores) == 1:
        return read_checkpoint(folder, f"{scores[0].steps}.pt"), scores
    scene = run.scene()

    def evaluate(candidates: list[CheckpointScore], episodes: int, k: int) -> bool:
        stream = [run.config.evaluation_seed, seed, SELECTION, k]
        for i, score in enumerate(candidates if len(candidates) > 1 else (), 1):
            if not should_continue():
                return False
            on_progress(
                f"checkpoint selection: {episodes} episodes of candidate {i} of {len(candidates)}"
            )
            policy = policy_of(read_checkpoint(folder, f"{score.steps}.pt"))
            ended, _ = run_episodes(
                scene,
                policy,
                run.config.randomization,
                np.random.SeedSequence(stream),
                episodes=episodes,
                threads=threads,
            )
            score.episodes += episodes
            score.successes += int((ended.code == 0).sum())
        return True

    # Random streams: 0 for the first stage, 1 for the final one, 2 for ties.
    if not evaluate(scores, config.episodes, 0):
        return None
    left = _not_worse(scores, config.finalists)
    if len(left) > config.finalists and not evaluate(left, config.episodes, 2):
        return None
    left = _best(left, config.finalists)
    if not evaluate(left, config.final_episodes, 1):
        return None
    return read_checkpoint(folder, f"{_best(left, 1)[0].steps}.pt"), scores


def select_active_members(
    run: Run,
    seed: int,
    state: dict[str, Any],
    *,
    threads: int,
    should_continue: Callable[[], bool] = lambda: True,
    on_progress: Progress = lambda _: None,
) -> tuple[dict[str, Any], list[MemberScore]] | None:
    """Return the selected policy, its active members set, and their scores; None if stopped.

    All members are active unless one of them has more successes than the ensemble on the same
    episodes, also with as many episodes of wider randomization counted too. The mean of several
    policies is mostly better than the best of them, above all outside the randomization of the
    training. A member that is ahead at first is evaluated on more episodes.

    Args:
        run: The run.
        seed: One of its seeds.
        state: The selected checkpoint of :func:`select_checkpoint`.
        threads: Threads of the engine.
        should_continue: Called before each evaluation.
        on_progress: Called with one line before each evaluation.
    """
    config = run.config.checkpoint_selection
    state = {k: v for k, v in state.items() if k != ACTIVE_MEMBER}
    count = len(ensemble_of(state))
    if count == 1 or config.member_episodes == 0:
        return state, []
    scene = run.scene()

    def successes(
        score: MemberScore, scene: Scene, ranges: RandomizationConfig, episodes: int, k: int
    ) -> int:
        who = "the ensemble" if score.member is None else f"member {score.member} of {count}"
        on_progress(f"ensemble evaluation: {episodes} episodes of {who}")
        policy = policy_of(state | {ACTIVE_MEMBER: score.member})
        stream = np.random.SeedSequence([run.config.evaluation_seed, seed, SELECTION, k])
        ended, _ = run_episodes(scene, policy, ranges, stream, episodes=episodes, threads=threads)
        return int((ended.code == 0).sum())

    def evaluate(which: list[MemberScore], k: int) -> bool:
        for score in which:
            if not should_continue():
                return False
            episodes, ranges = config.member_episodes, run.config.randomization
            score.episodes += episodes
            score.successes += successes(score, scene, ranges, episodes, k)
        return True

    # Random streams 0 to 2 belong to checkpoints.
    together, *others = scores = [MemberScore(None), *(MemberScore(k) for k in range(count))]
    if not evaluate(scores, 3):
        return None
    best = max(others, key=lambda score: score.successes)
    if best.successes <= together.successes:
        return state, scores
    if not evaluate([together, best], 4):
        return None
    if best.successes <= together.successes:
        return state, scores
    wide = _widened(run, config.ood_scale)
    wide_scene, ranges = wide.scene(), wide.config.randomization
    for score in (together, best):
        if not should_continue():
            return None
        score.ood_episodes = 2 * config.member_episodes
        score.ood_successes = successes(score, wide_scene, ranges, score.ood_episodes, 5)
    gained = best.successes - together.successes
    lost = together.ood_successes - best.ood_successes
    return state | ({ACTIVE_MEMBER: best.member} if gained > lost else {}), scores


def selection_episodes(config: CheckpointSelectionConfig, ensemble_size: int) -> int:
    """Return the number of episodes of a seed's selection if no candidate or member is ahead."""
    count = config.n_checkpoints
    episodes = 0
    if count > 1:
        episodes = count * config.episodes + min(count, config.finalists) * config.final_episodes
    if ensemble_size > 1:
        episodes += (1 + ensemble_size) * config.member_episodes
    return episodes


def score_rows(scores: list[CheckpointScore] | list[MemberScore]) -> list[dict[str, int | None]]:
    """Return the scores as rows of ``done.json``."""
    return [asdict(score) for score in scores]


def _widened(run: Run, factor: float) -> Run:
    """Return the run with ranges ``factor`` times as wide, or unchanged if they cannot be."""
    try:
        return run.widened(factor)
    except ConfigError:
        return run


def _kept(folder: Path) -> list[int]:
    """Return the control steps of the candidates in a folder, ascending."""
    return sorted(int(path.stem) for path in folder.glob("*.pt"))


def _not_worse(scores: list[CheckpointScore], most: int) -> list[CheckpointScore]:
    """Return the candidates that are at least as good as number ``most``."""
    last = _best(scores, most)[-1].rate
    return [score for score in scores if score.rate >= last]


def _best(scores: list[CheckpointScore], most: int) -> list[CheckpointScore]:
    """Return at most ``most`` candidates, the best first; of ties the later."""
    return sorted(scores, key=lambda score: (score.rate, score.steps), reverse=True)[:most]
