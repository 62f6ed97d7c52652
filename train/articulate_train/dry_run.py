"""Dry run of a training: scene, reachability, feasibility, time and disk space, in seconds."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from articulate.cache import cache_in_use
from articulate.errors import MissingError, RunError
from articulate.files import write_bytes
from articulate.task.observation import ACTION
from articulate.transforms import Array
from articulate_envs.engines import describe_engine
from articulate_envs.episodes import Episodes
from articulate_envs.feasibility import Feasibility
from articulate_envs.grasp_clearance import check_grasp
from articulate_envs.rewards import RewardConfig
from articulate_envs.scene import PREFIX, Scene
from articulate_envs.threaded_engine import ThreadEngine
from articulate_envs.video import render_png
from articulate_train.checkpoint_selection import selection_episodes
from articulate_train.config import TrainConfig
from articulate_train.evaluate import MAX_NOMINAL
from articulate_train.evaluate_run import describe_target
from articulate_train.feasibility_check import best_scene, describe_feasibility, feasibility_of
from articulate_train.ppo import Learner
from articulate_train.run import prepare_asset, run_bytes
from articulate_train.seed_runner import processors
from articulate_train.target_evaluation import target_episodes

MEASURED_S = 3.0
"""Duration of the measurement of training speed, after a first update [s]."""
EVALUATION_STEPS = 20
"""Control steps of the measurement of evaluation speed."""


@dataclass(frozen=True, kw_only=True)
class DryRun:
    """Result of a dry run."""

    asset: str
    task: str
    joint: str
    target: str
    """Description of the goal."""
    reachable_share: float
    """Fraction of the randomized poses and sizes at which the arm reaches the entire path."""
    overlap_m: float
    """Overlap of the open gripper at the handle with the object [m]; small values are enough."""
    feasibility: Feasibility
    """Success rate of the scripted expert."""
    engine: str
    """Engine of the training and its device."""
    seeds: int
    steps: int
    """Control steps of each seed."""
    steps_per_s: float
    """Measured control steps of one seed per second."""
    minutes: float
    """Estimated time of training, checkpoint selection and evaluation [min]."""
    selection_minutes: float
    """Estimated time of checkpoint and ensemble selection in it [min]."""
    evaluation_minutes: float
    """Estimated time of the final evaluation in it [min]."""
    target_success: float
    """Success rate at which training ends earlier; 0 if it does not."""
    target_minutes: float
    """Longest time of the evaluations of the target success in it [min]."""
    disk_bytes: int
    """Upper bound of the run folder [bytes]."""
    image: Path | None
    """Image of the initial scene; None if it cannot be rendered."""
    note: str
    """Reason for a missing image."""

    def as_dict(self) -> dict[str, Any]:
        """Return the fields as a JSON object."""
        path = None if self.image is None else str(self.image)
        return {**vars(self), "image": path, "feasibility": self.feasibility.to_dict()}

    def text(self) -> str:
        """Return a summary for the terminal."""
        seeds = f"{self.seeds} seed{'s' * (self.seeds != 1)}"
        lines = [
            f"{self.task} of {self.asset}, joint {self.joint}",
            f"  goal     {self.target}",
            f"  reach    {self.reachable_share:.0%} of the randomized poses and sizes; the open "
            f"gripper overlaps the object by {max(0.0, 1000 * self.overlap_m):.1f} mm",
            f"  expert   {describe_feasibility(self.feasibility)}",
            f"  engine   {self.engine}",
            f"  time     about {self.minutes:.0f} min for {seeds} of {self.steps / 1e6:g}M steps "
            f"({self.steps_per_s:.0f} steps/s measured); {self.selection_minutes:.0f} min of it "
            f"for checkpoint selection, {self.evaluation_minutes:.0f} min for the evaluation",
            *self._target_lines(),
            f"  disk     up to {self.disk_bytes / 1e6:.0f} MB",
            f"  image    {self.image or self.note}",
        ]
        return "\n".join(lines)

    def _target_lines(self) -> list[str]:
        if not self.target_success:
            return []
        return [
            f"  stop     this is the longest time: training ends at {self.target_success:.1%} "
            f"success on held-out episodes, whose evaluation takes {self.target_minutes:.0f} min "
            "of it"
        ]


def dry_run(
    config: TrainConfig,
    cache: Path,
    file: Path,
    show_progress: Callable[[str], None] = lambda _: None,
) -> DryRun:
    """Prepare a training under ``config``, measure its speed and estimate its time.

    Args:
        config: Configuration of the training.
        cache: Cache folder.
        file: Image to write (PNG).
        show_progress: Called with one line before each further grasp, handle, target or joint.

    Raises:
        RunError: ``file`` exists.
        UsageError: The object cannot be read or reached.
    """
    if file.exists():
        raise RunError(f"{file}: exists; choose another --out")
    engine = describe_engine(config.engine)
    with cache_in_use(cache):
        asset = prepare_asset(config, cache)
        scene = best_scene(config, asset, show_progress)
        task, placement = scene.task, scene.placement
        overlap_m = check_grasp(scene)
        feasibility = feasibility_of(scene, config)
        jobs = min(config.jobs or processors(), len(config.seeds))
        threads = max(1, processors() // jobs)
        rate = _steps_per_s(scene, config, threads=threads)
        episode_rate = _evaluation_steps_per_s(scene, config, threads=threads) / scene.n_steps
        image, note = _write_image(scene, file)
    rounds = math.ceil(len(config.seeds) / jobs)
    selected = selection_episodes(config.checkpoint_selection, config.ensemble_size)
    selection_s = rounds * selected / episode_rate
    evaluated = config.episodes + min(config.episodes, MAX_NOMINAL)
    evaluation_s = len(config.seeds) * evaluated / (episode_rate * processors() / threads)
    training_s = rounds * config.steps / rate
    target_s = rounds * target_episodes(config) / episode_rate
    return DryRun(
        asset=asset.name,
        task=task.name,
        joint=task.joint,
        target=describe_target(task),
        reachable_share=placement.reachable_share,
        overlap_m=overlap_m,
        feasibility=feasibility,
        engine=engine,
        seeds=len(config.seeds),
        steps=config.steps,
        steps_per_s=round(rate, 1),
        minutes=round((training_s + selection_s + evaluation_s + target_s) / 60.0, 2),
        selection_minutes=round(selection_s / 60.0, 2),
        evaluation_minutes=round(evaluation_s / 60.0, 2),
        target_success=config.target_success,
        target_minutes=round(target_s / 60.0, 2),
        disk_bytes=run_bytes(config, asset),
        image=image,
        note=note,
    )


def _steps_per_s(scene: Scene, config: TrainConfig, *, threads: int) -> float:
    """Measure the control steps per second of training, after a first update."""
    learner = Learner(scene, config, config.seeds[0], threads=threads)
    begin = steps = 0.0

    def after_update(learner: Learner) -> bool:
        nonlocal begin, steps
        if not begin:
            begin, steps = time.monotonic(), learner.model.num_timesteps
            return True
        return time.monotonic() - begin < MEASURED_S

    try:
        started = time.monotonic()
        learner.run(after_update)
        done = learner.model.num_timesteps
    finally:
        learner.close()
    if done == steps:  # the training has one update only
        begin, steps = started, 0.0
    return float((done - steps) / max(time.monotonic() - begin, 1e-9))


def _evaluation_steps_per_s(scene: Scene, config: TrainConfig, *, threads: int) -> float:
    """Measure the control steps per second of episodes without learning."""
    n = config.ppo.n_envs
    env = Episodes(
        ThreadEngine(scene, n, threads=threads),
        randomization=config.randomization,
        reward=RewardConfig(),
        initial_states=None,
        seed=config.seeds[0],
    )
    try:
        env.reset()
        begin = time.monotonic()
        for _ in range(EVALUATION_STEPS):
            env.step(np.zeros((n, ACTION.size)))
        return n * EVALUATION_STEPS / max(time.monotonic() - begin, 1e-9)
    finally:
        env.engine.close()


def _write_image(scene: Scene, file: Path) -> tuple[Path | None, str]:
    """Write an image of the initial scene; return its path, or the reason why there is none."""
    try:
        write_bytes(file, render_png(scene, start_qpos(scene)))
    except MissingError as error:
        return None, str(error)
    return file, ""


def start_qpos(scene: Scene) -> Array:
    """Return the initial positions (nq,) of the scene's model [m or rad].

    The arm is at home and parts are closed; a part to close is at its largest initial opening.
    """
    model, at = scene.nominal, scene.at
    qpos = np.array(model.qpos0, dtype=np.float64)
    for joint in scene.asset.joints:
        begin = scene.task.begin[1] if joint.name == scene.task.joint else 0.0
        qpos[model.joint(PREFIX + joint.name).qposadr[0]] = joint.closed + begin * joint.span
    half = scene.arm.gripper.max_width_m / 2.0
    qpos[at.arm_q : at.arm_q + 7] = scene.placement.start_q
    qpos[at.finger_q : at.finger_q + 2] = (half, -half)
    return qpos
