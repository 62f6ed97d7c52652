"""A bundle on a robot for some episodes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from articulate.draw import NO_DRAW, Draw, DrawConfig, at_size, drawn_one_by_one
from articulate.errors import ConfigError
from articulate.manifest import Manifest
from articulate_deploy.bundle import Bundle, load_bundle
from articulate_deploy.episode import EpisodeResult, Recording, run_episode, start_of
from articulate_deploy.estimators.truth import TruthEstimator
from articulate_deploy.policy import Policy
from articulate_deploy.record import new_folder, write_episode, write_report
from articulate_deploy.report import DeployReport, Transfer
from articulate_deploy.robots import robot_named

_SCALE_NOTE = "the object's size is not randomised: a bundle holds its scene at one size"


def deploy(
    path: Path,
    *,
    robot: str = "mujoco",
    episodes: int = 20,
    seed: int | None = None,
    randomise: bool = True,
    out: Path | None = None,
    on_episode: Callable[[int, EpisodeResult], None] | None = None,
) -> DeployReport:
    """Run the bundle at ``path`` and say how it went.

    Args:
        path: The bundle.
        robot: Name of the robot.
        episodes: How many episodes.
        seed: Decides all that is drawn; None takes the draws that the bundle carries. Episode k is
            the same for any number of episodes and for every robot.
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
    if seed is not None and seed < 0:
        raise ConfigError(f"seed is {seed}; it must be 0 or more")
    bundle = load_bundle(path)
    manifest, policy = bundle.manifest, Policy(bundle)
    plan = plan_of(bundle, episodes, seed=seed, randomise=randomise)
    results, draws = [], []
    stand_in = robot_named(robot, bundle)
    if out is not None:
        new_folder(out)
    with stand_in:
        for k in range(episodes):
            drawn = plan.draw(k)
            stand_in.set_draw(drawn)
            stand_in.reset_to(start_of(manifest, drawn), manifest.start.hand_width_m)
            recording = None if out is None else Recording()
            result = run_episode(
                policy,
                stand_in,
                TruthEstimator(stand_in, plan.config, manifest.task, drawn, plan.noise(k)),
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
        seed=plan.seed,
        carried=plan.carried,
        randomised=randomise,
        results=tuple(results),
        draws=tuple(draws),
        notes=(*_scale_notes(manifest, randomise), *stand_in.notes),
    )
    if out is not None:
        write_report(out, report)
    return report


@dataclass(frozen=True)
class Plan:
    """What is drawn for the episodes of one call, the same for every robot."""

    config: DrawConfig
    """Ranges of the noise within an episode."""
    draws: Draw
    """A row for each episode."""
    seed: int
    """Decides the noise, and the draws unless the bundle carries them."""
    carried: bool
    """Whether the draws are the bundle's."""

    def draw(self, k: int) -> Draw:
        """The draw of episode ``k``, one row."""
        return Draw(self.draws.values[k : k + 1].copy())

    def noise(self, k: int) -> np.random.Generator:
        """What the noise within episode ``k`` is drawn from."""
        return np.random.default_rng(np.random.SeedSequence([self.seed, k, 1]))


def plan_of(bundle: Bundle, episodes: int, *, seed: int | None, randomise: bool) -> Plan:
    """What is drawn for ``episodes`` episodes; see :func:`deploy`.

    Raises:
        ConfigError: There are more episodes than draws in the bundle, and no seed to draw from.
    """
    manifest = bundle.manifest
    config = one_size(manifest) if randomise else still(manifest)
    carried = seed is None and randomise
    seed = manifest.draws.seed if seed is None else seed
    if not carried:
        rows = drawn_one_by_one(config, seed, episodes, begin=manifest.task.begin)
        return Plan(config, rows, seed, carried)
    if episodes > manifest.draws.count:
        raise ConfigError(
            f"episodes is {episodes}; the bundle carries {manifest.draws.count} draws: "
            "run fewer, or give a seed to draw others"
        )
    return Plan(config, Draw(bundle.draws.values[:episodes]), seed, carried)


def still(manifest: Manifest) -> DrawConfig:
    """No randomisation but that of the start, without which all episodes would be the same."""
    return replace(NO_DRAW, start_rad=manifest.draw.start_rad)


def one_size(manifest: Manifest) -> DrawConfig:
    """The randomisation of training with the object at the size of the bundle's scene."""
    return at_size(manifest.draw, manifest.scene.scale)


def transfer(
    path: Path,
    robots: Sequence[str],
    *,
    episodes: int = 20,
    seed: int | None = None,
    randomise: bool = True,
    out: Path | None = None,
    on_episode: Callable[[str, int, EpisodeResult], None] | None = None,
) -> Transfer:
    """Run the bundle at ``path`` on several robots under the same draws, and compare.

    Args:
        path: The bundle.
        robots: Their names; the first is the one that the others are compared with.
        episodes: How many episodes on each.
        seed: As in :func:`deploy`.
        randomise: As in :func:`deploy`.
        out: Folder for recordings, a folder in it for each robot; None keeps none.
        on_episode: Told of the robot and of each episode as it ends.

    Raises:
        ConfigError: A robot is named twice; and what :func:`deploy` raises.
    """
    twice = [name for k, name in enumerate(robots) if name in robots[:k]]
    if twice:
        raise ConfigError(f"--robot {twice[0]} stands twice; name each robot once")
    reports = []
    for name in robots:
        told = None if on_episode is None else partial(on_episode, name)
        report = deploy(
            path,
            robot=name,
            episodes=episodes,
            seed=seed,
            randomise=randomise,
            out=None if out is None else out / name,
            on_episode=told,
        )
        reports.append(report)
    return Transfer(tuple(reports))


def _scale_notes(manifest: Manifest, randomise: bool) -> tuple[str, ...]:
    return (_SCALE_NOTE,) if randomise and manifest.draw.scale_values != (1.0,) else ()
