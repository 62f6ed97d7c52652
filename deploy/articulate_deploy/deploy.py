"""A bundle on a robot for some episodes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from articulate.draw import NO_DRAW, DrawConfig, draw
from articulate.errors import ConfigError
from articulate.manifest import Manifest
from articulate_deploy.bundle import load_bundle
from articulate_deploy.episode import EpisodeResult, Recording, run_episode, start_of
from articulate_deploy.estimators.truth import TruthEstimator
from articulate_deploy.policy import Policy
from articulate_deploy.record import new_folder, write_episode, write_report
from articulate_deploy.report import DeployReport
from articulate_deploy.robots import robot_named

_SCALE_NOTE = "the object's size is not randomised: a bundle holds its scene at one size"


def deploy(
    path: Path,
    *,
    robot: str = "mujoco",
    episodes: int = 20,
    seed: int = 0,
    randomise: bool = True,
    out: Path | None = None,
    on_episode: Callable[[int, EpisodeResult], None] | None = None,
) -> DeployReport:
    """Run the bundle at ``path`` and say how it went.

    Args:
        path: The bundle.
        robot: Name of the robot.
        episodes: How many episodes.
        seed: Decides all that is drawn; episode k is the same for any number of episodes.
        randomise: Draw as in training, the object's size aside; else the start of the arm alone.
        out: Folder for recordings; None keeps none.
        on_episode: Told of each episode as it ends.

    Raises:
        BundleError: The bundle is not sound.
        ConfigError: The robot is not known, or a number not accepted.
        UsageError: ``out`` cannot be written.
    """
    if episodes < 1:
        raise ConfigError(f"episodes is {episodes}; it must be at least 1")
    if seed < 0:
        raise ConfigError(f"seed is {seed}; it must be 0 or more")
    bundle = load_bundle(path)
    manifest, policy = bundle.manifest, Policy(bundle)
    config = one_size(manifest) if randomise else still(manifest)
    results, draws = [], []
    stand_in = robot_named(robot, bundle)
    if out is not None:
        new_folder(out)
    with stand_in:
        for k in range(episodes):
            rng = np.random.default_rng(np.random.SeedSequence([seed, k]))
            drawn = draw(config, rng, begin=manifest.task.begin)
            stand_in.set_draw(drawn)
            stand_in.reset_to(start_of(manifest, drawn), manifest.start.hand_width_m)
            recording = None if out is None else Recording()
            result = run_episode(
                policy,
                stand_in,
                TruthEstimator(stand_in, config, manifest.task, drawn, rng),
                manifest,
                delay_ticks=int(drawn["delay_ticks"][0]),
                recording=recording,
            )
            if out is not None and recording is not None:
                write_episode(out, k, recording)
            results.append(result)
            draws.append(drawn)
            if on_episode is not None:
                on_episode(k, result)
    report = DeployReport(
        bundle=str(path),
        robot=robot,
        task=manifest.task.name,
        joint=manifest.task.joint,
        seed=seed,
        randomised=randomise,
        results=tuple(results),
        draws=tuple(draws),
        notes=(_SCALE_NOTE,) if randomise and manifest.draw.scale_values != (1.0,) else (),
    )
    if out is not None:
        write_report(out, report)
    return report


def still(manifest: Manifest) -> DrawConfig:
    """No randomisation but that of the start, without which all episodes would be the same."""
    return replace(NO_DRAW, start_rad=manifest.draw.start_rad)


def one_size(manifest: Manifest) -> DrawConfig:
    """The randomisation of training with the object at the size of the bundle's scene."""
    scale = manifest.scene.scale
    return replace(manifest.draw, scale=(scale, scale), scales=1)
