"""Evaluation: fresh episodes from home, with the draws of the run and without any."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from articulate.task.episode_monitor import COLUMN, REASONS
from articulate.task.randomization import COLUMNS, EpisodeParams, draw
from articulate.task.randomization_config import NO_RANDOMIZATION, RandomizationConfig
from articulate.transforms import Array
from articulate_envs.config import RewardConfig
from articulate_envs.episodes import Ended, Episodes
from articulate_envs.initial_states import home_start
from articulate_envs.scene import Scene
from articulate_envs.threaded_engine import ThreadEngine
from articulate_train.policy import Policy, checkpoint_sha256, load_policy
from articulate_train.ppo import EVALUATION
from articulate_train.report import SeedEvaluation, Timeline
from articulate_train.run import Run

NOMINAL = 200
"""At most so many episodes are run without randomisation."""
SIDE_BY_SIDE = 1000
"""So many episodes are in memory at once, at 1 MB each; more run one lot after another."""
Watch = Callable[[int, slice, ThreadEngine], None]
"""Told a tick, the episodes that are at it, and their engine."""


@dataclass(frozen=True)
class Traces:
    """What was recorded of E episodes at each of T ticks."""

    qpos: Array
    """Positions of the model (T, E, nq)."""
    force: Array
    """Filtered force on the hand (T, E) [N]."""
    speed_share: Array
    """Largest joint speed as a share of its limit (T, E)."""
    opened: Array
    """Fraction open (T, E)."""


@dataclass(frozen=True)
class Rollout:
    """E episodes from home."""

    ended: Ended
    """Their ends, one row per episode."""
    draws: EpisodeParams
    """What was drawn for them."""
    traces: Traces
    """What happened."""
    poses: Array
    """Where the objects stood, ``T_wo`` (E, 4, 4)."""


def evaluate_seed(
    run: Run, seed: int, *, episodes: int, threads: int
) -> tuple[SeedEvaluation, Rollout]:
    """Evaluate the policy of one seed on ``episodes`` drawn episodes and nominal ones.

    Nominal episodes keep only the noise of the start pose, without which they would all be the
    same; they are so alike that :data:`NOMINAL` are enough.

    Raises:
        RunError: There is no checkpoint.
    """
    # Before it is read: a checkpoint that is replaced meanwhile must not pass as the one judged.
    judged = checkpoint_sha256(run.seed_folder(seed))
    policy = load_policy(run.seed_folder(seed))
    config = run.config
    stream = np.random.SeedSequence([config.evaluation_seed, seed, EVALUATION])
    drawn = roll_out(run.scene(), policy, config.draw, stream, episodes=episodes, threads=threads)
    still = replace(NO_RANDOMIZATION, start_rad=config.draw.start_rad)
    nominal = roll_out(
        run.scene((1.0,)), policy, still, stream, episodes=min(episodes, NOMINAL), threads=threads
    )
    result = SeedEvaluation(
        seed=seed,
        codes=drawn.ended.code,
        opened=drawn.ended.opened,
        peaks=drawn.ended.peaks,
        draws=drawn.draws.values,
        nominal_codes=nominal.ended.code,
        nominal_opened=nominal.ended.opened,
        checkpoint_sha256=judged,
        policy_steps=policy.steps,
        alone=policy.alone,
    )
    return result, drawn


def roll_out(
    scene: Scene,
    policy: Policy,
    draws: RandomizationConfig,
    stream: np.random.SeedSequence,
    *,
    episodes: int,
    threads: int,
) -> Rollout:
    """Run ``episodes`` episodes from home, with the policy's mean action."""
    qpos = np.zeros((scene.ticks, episodes, scene.nominal.nq))
    force, speed, opened = (np.zeros((scene.ticks, episodes)) for _ in range(3))

    def trace(t: int, which: slice, engine: ThreadEngine) -> None:
        state = engine.state()
        for i in range(engine.n_envs):
            qpos[t, which.start + i] = engine.physics_state(i)[1].qpos
        force[t, which] = np.linalg.norm(state.samples[:, :3], axis=1)
        speed[t, which] = np.max(np.abs(state.dq) / scene.arm.dq_max, axis=1)
        opened[t, which] = state.opened

    ended, drawn = run_episodes(
        scene, policy, draws, stream, episodes=episodes, threads=threads, after_tick=trace
    )
    T_wo = scene.T_wo(drawn)
    for array in (qpos, force, speed, opened):
        array[-1] = array[-2]
    return Rollout(
        ended=ended,
        draws=drawn,
        traces=Traces(qpos=qpos, force=force, speed_share=speed, opened=opened),
        poses=T_wo,
    )


def run_episodes(
    scene: Scene,
    policy: Policy,
    draws: RandomizationConfig,
    stream: np.random.SeedSequence,
    *,
    episodes: int,
    threads: int,
    after_tick: Watch = lambda *_: None,
) -> tuple[Ended, EpisodeParams]:
    """Ends of ``episodes`` episodes from home with the policy's mean action, and their draws.

    Args:
        scene: Where.
        policy: Whose actions.
        draws: Randomisation.
        stream: Decides what is drawn; each call with it draws anew.
        episodes: How many.
        threads: Threads of the engine.
        after_tick: Told each tick but the last, which begins episodes anew.
    """
    first, second = stream.spawn(2)
    drawn = draw(draws, np.random.default_rng(first), episodes, begin=scene.task.begin)
    ended = run_drawn(scene, policy, draws, drawn, second, threads=threads, after_tick=after_tick)
    return ended, drawn


def run_drawn(
    scene: Scene,
    policy: Policy,
    draws: RandomizationConfig,
    drawn: EpisodeParams,
    stream: np.random.SeedSequence,
    *,
    threads: int,
    after_tick: Watch = lambda *_: None,
    side_by_side: int = SIDE_BY_SIDE,
) -> Ended:
    """Ends of one episode from home for each row of ``drawn``, with the policy's mean action.

    Args:
        scene: Where.
        policy: Whose actions.
        draws: Randomisation, for the noise of what is observed.
        drawn: What is drawn, a row an episode.
        stream: Decides that noise; up to ``side_by_side`` episodes it is theirs alone.
        threads: Threads of the engine.
        after_tick: Told each tick but the last, which begins episodes anew.
        side_by_side: At most so many run at once.

    Raises:
        ValueError: The object was drawn in a size that ``scene`` is not compiled for.
    """
    if not np.isclose(drawn["scale"][:, None], scene.scales).any(axis=1).all():
        raise ValueError(f"sizes are drawn of which the scene has none: it has {scene.scales}")
    count = len(drawn.values)
    ended: list[Ended] = []
    for begin in range(0, count, side_by_side):
        which = slice(begin, min(begin + side_by_side, count))
        some = EpisodeParams(drawn.values[which])
        engine = ThreadEngine(scene, len(some.values), threads=threads)
        noise = stream if begin == 0 else stream.spawn(1)[0]
        env = Episodes(engine, draws=draws, reward=RewardConfig(), starts=None, seed=noise)
        try:
            seen = env.reset(start=home_start(scene, some))
            for t in range(scene.ticks):
                tick = env.step(policy.act(seen))
                seen = tick.observation
                if tick.ended is not None:
                    ended.append(replace(tick.ended, rows=tick.ended.rows + begin))
                if t + 1 < scene.ticks:
                    after_tick(t, which, engine)
        finally:
            engine.close()
    return first_ends(ended, count)


def first_ends(ended: list[Ended], episodes: int) -> Ended:
    """The first end of each environment, in their order (a diverged one begins anew)."""
    rows = np.concatenate([e.rows for e in ended])
    _, where = np.unique(rows, return_index=True)
    assert len(where) == episodes

    def take(name: str) -> Any:
        return np.asarray(np.concatenate([getattr(e, name) for e in ended])[where])

    return Ended(
        rows=take("rows"),
        code=take("code"),
        opened=take("opened"),
        from_home=take("from_home"),
        terms=take("terms"),
        peaks=take("peaks"),
        observation=take("observation"),
        cut=take("cut"),
        privileged=take("privileged"),
    )


def timelines(rollout: Rollout, tick_s: float) -> list[tuple[Timeline, int]]:
    """The first success and the first failure, with their episodes' numbers."""
    out = []
    t = np.arange(1, len(rollout.traces.force) + 1, dtype=np.float64) * tick_s
    for name, mask in (("success", rollout.ended.code == 0), ("failure", rollout.ended.code != 0)):
        if not mask.any():
            continue
        k = int(np.argmax(mask))
        line = Timeline(
            name=name,
            reason=REASONS[int(rollout.ended.code[k])],
            t=t,
            force_n=rollout.traces.force[:, k],
            speed_share=rollout.traces.speed_share[:, k],
            opened=rollout.traces.opened[:, k],
            drawn=dict(zip(COLUMNS, map(float, rollout.draws.values[k]), strict=True)),
        )
        out.append((line, k))
    return out


def peak(ended: Ended, field: str) -> Array:
    """One column of the episodes' peaks (E,)."""
    return np.asarray(ended.peaks[:, COLUMN[field]])
