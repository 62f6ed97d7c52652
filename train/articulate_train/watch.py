"""One episode of a run's policy, to be watched."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from articulate.render.playback import EpisodePlayback
from articulate.task.episode_monitor import REASONS
from articulate.task.randomization_config import NO_RANDOMIZATION
from articulate_envs.video import drawn_model, write_film
from articulate_train.evaluate import roll_out
from articulate_train.export import select_seed
from articulate_train.policy import load_policy
from articulate_train.ppo import EVALUATION
from articulate_train.run import open_run


def watch_run(path: Path, *, seed: int | None, episode: int, randomise: bool) -> EpisodePlayback:
    """Let a policy of the run at ``path`` act for one episode from home.

    Args:
        path: Folder of the run.
        seed: Whose policy; None takes the best.
        episode: Decides the draw, which is none of training's.
        randomise: Draw as in training; else the start of the arm alone.

    Raises:
        RunError: It is no run, or the seed was not trained.
    """
    run = open_run(path)
    chosen, _, _ = select_seed(run, seed)
    policy = load_policy(run.seed_folder(chosen))
    draws = run.config.randomization
    draws = draws if randomise else replace(NO_RANDOMIZATION, start_rad=draws.start_rad)
    scene = run.scene(draws.scale_values)
    stream = np.random.SeedSequence([run.config.evaluation_seed, chosen, EVALUATION, episode])
    acted = roll_out(scene, policy, draws, stream, episodes=1, threads=1)
    scale, T_wo = float(acted.draws["scale"][0]), acted.poses[0]
    qpos, step_s = acted.traces.qpos[:, 0], run.config.control.step_s

    def write_clip(file: Path) -> Path:
        return write_film(file, scene, qpos, scale=scale, T_wo=T_wo, step_s=step_s)

    return EpisodePlayback(
        title=f"{run.task.name} of {run.asset.name} ({run.task.joint}), seed {chosen}",
        reason=REASONS[int(acted.ended.code[0])],
        model=drawn_model(scene, scale=scale, T_wo=T_wo),
        qpos=qpos,
        step_s=step_s,
        curves={
            "opened": acted.traces.opened[:, 0],
            "force_n": acted.traces.force[:, 0],
            "speed_share": acted.traces.speed_share[:, 0],
        },
        write_video=write_clip,
    )
