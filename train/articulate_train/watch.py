"""Roll out one episode of a run's policy for playback."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from articulate.render.playback import EpisodePlayback
from articulate.task.episode_monitor import REASONS
from articulate.task.randomization_config import NO_RANDOMIZATION
from articulate_envs.video import visual_model, write_episode_video
from articulate_train.evaluate import roll_out
from articulate_train.export import select_seed
from articulate_train.policy import load_policy
from articulate_train.ppo import EVALUATION
from articulate_train.run import open_run


def watch_run(path: Path, *, seed: int | None, episode: int, randomise: bool) -> EpisodePlayback:
    """Run one episode from home with a policy of the run at ``path``.

    Args:
        path: Folder of the run.
        seed: Seed of the policy; None selects the best.
        episode: Index of the episode; its parameters are not used in training.
        randomise: Sample parameters as in training; otherwise the start pose of the arm only.

    Raises:
        RunError: It is not a run, or the seed was not trained.
    """
    run = open_run(path)
    selected, _, _ = select_seed(run, seed)
    policy = load_policy(run.seed_folder(selected))
    ranges = run.config.randomization
    ranges = ranges if randomise else replace(NO_RANDOMIZATION, start_rad=ranges.start_rad)
    scene = run.scene(ranges.scale_values)
    stream = np.random.SeedSequence([run.config.evaluation_seed, selected, EVALUATION, episode])
    rollout = roll_out(scene, policy, ranges, stream, episodes=1, threads=1)
    scale, T_wo = float(rollout.params["scale"][0]), rollout.poses[0]
    qpos, step_s = rollout.traces.qpos[:, 0], run.config.control.step_s

    def write_clip(file: Path) -> Path:
        return write_episode_video(file, scene, qpos, scale=scale, T_wo=T_wo, step_s=step_s)

    return EpisodePlayback(
        title=f"{run.task.name} of {run.asset.name} ({run.task.joint}), seed {selected}",
        reason=REASONS[int(rollout.ended.code[0])],
        model=visual_model(scene, scale=scale, T_wo=T_wo),
        qpos=qpos,
        step_s=step_s,
        curves={
            "opened": rollout.traces.opened[:, 0],
            "force_n": rollout.traces.force[:, 0],
            "speed_share": rollout.traces.speed_share[:, 0],
        },
        write_video=write_clip,
    )
