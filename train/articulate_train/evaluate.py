"""Evaluation on new episodes from home, with and without randomization."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from articulate.task.episode_monitor import COLUMN, REASONS
from articulate.task.randomization import COLUMNS, EpisodeParams, sample_episode_params
from articulate.task.randomization_config import NO_RANDOMIZATION, RandomizationConfig
from articulate.transforms import Array
from articulate_envs.episodes import Ended, Episodes
from articulate_envs.initial_states import home_start
from articulate_envs.rewards import RewardConfig
from articulate_envs.scene import Scene
from articulate_envs.threaded_engine import ThreadEngine
from articulate_train.policy import Policy, checkpoint_sha256, load_policy
from articulate_train.ppo import EVALUATION
from articulate_train.report import SeedEvaluation, Timeline
from articulate_train.run import Run

MAX_NOMINAL = 200
"""Largest number of episodes without randomization."""
BATCH_SIZE = 1000
"""Episodes in memory at once, of 1 MB each; more run in batches."""
StepCallback = Callable[[int, slice, ThreadEngine], None]
"""Called with the control step, the slice of episodes of the batch and their engine."""
Progress = Callable[[float], None]
"""Called with the completed fraction of an evaluation."""


@dataclass(frozen=True)
class Traces:
    """Recordings of E episodes at T control steps."""

    qpos: Array
    """Generalized positions of the model (T, E, nq) [m or rad]."""
    force: Array
    """Filtered force on the gripper (T, E) [N]."""
    speed_share: Array
    """Largest joint speed as a share of its limit (T, E)."""
    opened: Array
    """Fraction open (T, E)."""


@dataclass(frozen=True)
class Rollout:
    """E episodes from home."""

    ended: Ended
    """Outcomes, one row per episode."""
    params: EpisodeParams
    """Sampled parameters of the episodes."""
    traces: Traces
    """Recordings."""
    poses: Array
    """Poses ``T_wo`` of the objects (E, 4, 4) [m]."""


def evaluate_seed(
    run: Run,
    seed: int,
    *,
    episodes: int,
    threads: int,
    on_progress: Progress = lambda _: None,
) -> tuple[SeedEvaluation, Rollout]:
    """Evaluate the policy of one seed on ``episodes`` randomized episodes and on nominal ones.

    Nominal episodes keep the noise of the start pose, without which they would be equal;
    :data:`MAX_NOMINAL` of them are enough.

    Raises:
        RunError: There is no checkpoint.
    """
    # Before it is read: a file that is replaced meanwhile must not pass as the evaluated one.
    evaluated = checkpoint_sha256(run.seed_folder(seed))
    policy = load_policy(run.seed_folder(seed))
    config = run.config
    stream = np.random.SeedSequence([config.evaluation_seed, seed, EVALUATION])
    randomized = roll_out(
        run.scene(),
        policy,
        config.randomization,
        stream,
        episodes=episodes,
        threads=threads,
        on_progress=on_progress,
    )
    still = replace(NO_RANDOMIZATION, start_rad=config.randomization.start_rad)
    nominal = roll_out(
        run.scene((1.0,)),
        policy,
        still,
        stream,
        episodes=min(episodes, MAX_NOMINAL),
        threads=threads,
    )
    result = SeedEvaluation(
        seed=seed,
        codes=randomized.ended.code,
        opened=randomized.ended.opened,
        peaks=randomized.ended.peaks,
        params=randomized.params.values,
        nominal_codes=nominal.ended.code,
        nominal_opened=nominal.ended.opened,
        checkpoint_sha256=evaluated,
        policy_steps=policy.steps,
        active_member=policy.active_member,
    )
    return result, randomized


def roll_out(
    scene: Scene,
    policy: Policy,
    randomization: RandomizationConfig,
    stream: np.random.SeedSequence,
    *,
    episodes: int,
    threads: int,
    on_progress: Progress = lambda _: None,
) -> Rollout:
    """Run and record ``episodes`` episodes from home with the policy's mean action."""
    qpos = np.zeros((scene.n_steps, episodes, scene.nominal.nq))
    force, speed, opened = (np.zeros((scene.n_steps, episodes)) for _ in range(3))

    def trace(t: int, which: slice, engine: ThreadEngine) -> None:
        state = engine.state()
        for i in range(engine.n_envs):
            qpos[t, which.start + i] = engine.physics_state(i)[1].qpos
        force[t, which] = np.linalg.norm(state.samples[:, :3], axis=1)
        speed[t, which] = np.max(np.abs(state.dq) / scene.arm.dq_max, axis=1)
        opened[t, which] = state.opened
        on_progress((which.start + (which.stop - which.start) * (t + 1) / len(qpos)) / episodes)

    ended, params = run_episodes(
        scene, policy, randomization, stream, episodes=episodes, threads=threads, on_step=trace
    )
    T_wo = scene.T_wo(params)
    for array in (qpos, force, speed, opened):
        array[-1] = array[-2]
    return Rollout(
        ended=ended,
        params=params,
        traces=Traces(qpos=qpos, force=force, speed_share=speed, opened=opened),
        poses=T_wo,
    )


def run_episodes(
    scene: Scene,
    policy: Policy,
    randomization: RandomizationConfig,
    stream: np.random.SeedSequence,
    *,
    episodes: int,
    threads: int,
    on_step: StepCallback = lambda *_: None,
) -> tuple[Ended, EpisodeParams]:
    """Run ``episodes`` episodes from home with the policy's mean action.

    Args:
        scene: Compiled scene.
        policy: Policy.
        randomization: Ranges of the episode parameters.
        stream: Random seed; it is advanced, so that a second call samples other episodes.
        episodes: Number of episodes.
        threads: Threads of the engine.
        on_step: Called after each control step but the last, which resets the episodes.

    Returns:
        The outcomes and the sampled parameters, one row per episode.
    """
    first, second = stream.spawn(2)
    params = sample_episode_params(
        randomization, np.random.default_rng(first), episodes, begin=scene.task.begin
    )
    ended = run_with_params(
        scene, policy, randomization, params, second, threads=threads, on_step=on_step
    )
    return ended, params


def run_with_params(
    scene: Scene,
    policy: Policy,
    randomization: RandomizationConfig,
    params: EpisodeParams,
    stream: np.random.SeedSequence,
    *,
    threads: int,
    on_step: StepCallback = lambda *_: None,
    batch_size: int = BATCH_SIZE,
) -> Ended:
    """Run one episode from home for each row of ``params`` with the policy's mean action.

    Args:
        scene: Compiled scene.
        policy: Policy.
        randomization: Ranges of the observation noise.
        params: Parameters of the episodes, one row each.
        stream: Random seed of the observation noise.
        threads: Threads of the engine.
        on_step: Called after each control step but the last, which resets the episodes.
        batch_size: Largest number of episodes that run at once.

    Raises:
        ValueError: ``scene`` is not compiled for a size in ``params``.
    """
    if not np.isclose(params["scale"][:, None], scene.scales).any(axis=1).all():
        raise ValueError(f"object sizes outside those of the scene: {scene.scales}")
    count = len(params.values)
    ended: list[Ended] = []
    for begin in range(0, count, batch_size):
        which = slice(begin, min(begin + batch_size, count))
        batch = EpisodeParams(params.values[which])
        engine = ThreadEngine(scene, len(batch.values), threads=threads)
        noise = stream if begin == 0 else stream.spawn(1)[0]
        env = Episodes(
            engine,
            randomization=randomization,
            reward=RewardConfig(),
            initial_states=None,
            seed=noise,
        )
        try:
            observation = env.reset(start=home_start(scene, batch))
            for t in range(scene.n_steps):
                step = env.step(policy.act(observation))
                observation = step.observation
                if step.ended is not None:
                    ended.append(replace(step.ended, rows=step.ended.rows + begin))
                if t + 1 < scene.n_steps:
                    on_step(t, which, engine)
        finally:
            engine.close()
    return first_ends(ended, count)


def first_ends(ended: list[Ended], episodes: int) -> Ended:
    """Return the first outcome of each environment, in order (a diverged one restarts)."""
    rows = np.concatenate([e.rows for e in ended])
    _, first = np.unique(rows, return_index=True)
    assert len(first) == episodes
    columns: dict[str, Any] = {
        f.name: np.concatenate([getattr(e, f.name) for e in ended])[first] for f in fields(Ended)
    }
    return Ended(**columns)


def timelines(rollout: Rollout, step_s: float) -> list[tuple[Timeline, int]]:
    """Return the first success and the first failure, with the indices of their episodes."""
    out = []
    t = np.arange(1, len(rollout.traces.force) + 1, dtype=np.float64) * step_s
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
            params=dict(zip(COLUMNS, map(float, rollout.params.values[k]), strict=True)),
        )
        out.append((line, k))
    return out


def peak(ended: Ended, field: str) -> Array:
    """Return one column of the episodes' peaks (E,), in the unit of the field."""
    return np.asarray(ended.peaks[:, COLUMN[field]])
