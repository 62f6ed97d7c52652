"""What a training would be like, found out in seconds: scene, reach, time and disk."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from articulate.cache import cache_in_use
from articulate.errors import MissingError, RunError
from articulate.files import write_bytes
from articulate.robot.arm import PANDA
from articulate.transforms import Array
from articulate_envs.grasp_clearance import check_grasp
from articulate_envs.joint_selection import choose_joint
from articulate_envs.scene import PREFIX, Scene, build_scene
from articulate_envs.video import picture
from articulate_train.config import TrainConfig
from articulate_train.evaluate_run import describe_target
from articulate_train.ppo import Learner
from articulate_train.run import prepare_asset, run_bytes
from articulate_train.seed_runner import processors

MEASURED_S = 3.0
"""So long training is measured at least, after one update that does not count [s]."""


@dataclass(frozen=True, kw_only=True)
class DryRun:
    """What was found out."""

    asset: str
    task: str
    joint: str
    target: str
    """What counts as done, in words."""
    reachable_share: float
    """Share of the drawn poses and sizes at which the arm reaches the whole way."""
    overlap_m: float
    """Overlap of an open hand at the handle with the object [m]; little is room enough."""
    seeds: int
    steps: int
    """Ticks for each seed."""
    steps_per_s: float
    """Ticks of one seed in a second, measured."""
    minutes: float
    """Estimated time of the training, without conversion and evaluation [min]."""
    disk_bytes: int
    """What the run folder takes at most [bytes]."""
    picture: Path | None
    """The scene at its start; None where nothing can be drawn."""
    note: str
    """Why there is no picture."""

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        path = None if self.picture is None else str(self.picture)
        return {**vars(self), "picture": path}

    def text(self) -> str:
        """A few lines for people."""
        seeds = f"{self.seeds} seed{'s' * (self.seeds != 1)}"
        lines = [
            f"{self.task} of {self.asset}, joint {self.joint}",
            f"  target   {self.target}",
            f"  reach    at {self.reachable_share:.0%} of the drawn poses and sizes; an open hand "
            f"overlaps the object by {1000 * self.overlap_m:.1f} mm",
            f"  time     about {self.minutes:.0f} min for {seeds} of {self.steps / 1e6:g}M steps "
            f"({self.steps_per_s:.0f} steps/s measured)",
            f"  disk     up to {self.disk_bytes / 1e6:.0f} MB",
            f"  picture  {self.picture or self.note}",
        ]
        return "\n".join(lines)


def dry_run(config: TrainConfig, cache: Path, file: Path) -> DryRun:
    """Find out what training under ``config`` would be like.

    Args:
        config: What would be trained.
        cache: Cache folder.
        file: Picture to write (PNG).

    Raises:
        RunError: ``file`` exists.
        UsageError: The object cannot be read or reached.
    """
    if file.exists():
        raise RunError(f"{file}: exists; choose another --out")
    with cache_in_use(cache):
        asset = prepare_asset(config, cache)
        task, place = choose_joint(config, asset)
        scene = build_scene(
            asset,
            task,
            arm=PANDA,
            control=config.control,
            physics=config.physics,
            place=place,
            scales=config.randomization.scale_values,
        )
        overlap_m = check_grasp(scene)
        jobs = min(config.jobs or processors(), len(config.seeds))
        rate = _steps_per_s(scene, config, threads=max(1, processors() // jobs))
        drawn, note = _drawn(scene, file)
    rounds = math.ceil(len(config.seeds) / jobs)
    return DryRun(
        asset=asset.name,
        task=task.name,
        joint=task.joint,
        target=describe_target(task),
        reachable_share=place.reachable_share,
        overlap_m=overlap_m,
        seeds=len(config.seeds),
        steps=config.steps,
        steps_per_s=round(rate, 1),
        minutes=round(rounds * config.steps / rate / 60.0, 2),
        disk_bytes=run_bytes(config, asset),
        picture=drawn,
        note=note,
    )


def _steps_per_s(scene: Scene, config: TrainConfig, *, threads: int) -> float:
    """Ticks in a second while collecting and learning, after one update that does not count."""
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
    if done == steps:  # one update is all that is asked for
        begin, steps = started, 0.0
    return float((done - steps) / max(time.monotonic() - begin, 1e-9))


def _drawn(scene: Scene, file: Path) -> tuple[Path | None, str]:
    """Write a picture of the scene's start; its path, or why there is none."""
    try:
        write_bytes(file, picture(scene, start_qpos(scene)))
    except MissingError as error:
        return None, str(error)
    return file, ""


def start_qpos(scene: Scene) -> Array:
    """Positions (nq,) of the scene's model as an episode begins: the arm home, parts closed.

    A part that is to be closed is as far open as it may begin.
    """
    model, at = scene.nominal, scene.at
    qpos = np.array(model.qpos0, dtype=np.float64)
    for joint in scene.asset.joints:
        begin = scene.task.begin[1] if joint.name == scene.task.joint else 0.0
        qpos[model.joint(PREFIX + joint.name).qposadr[0]] = joint.closed + begin * joint.span
    half = scene.arm.gripper.max_width_m / 2.0
    qpos[at.arm_q : at.arm_q + 7] = scene.place.start_q
    qpos[at.finger_q : at.finger_q + 2] = (half, -half)
    return qpos
