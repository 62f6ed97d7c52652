"""A bundle on a robot for some episodes."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from articulate.errors import ConfigError
from articulate.task.manifest import Manifest
from articulate.task.randomization import EpisodeParams, at_size, sample_episode_params_each
from articulate.task.randomization_config import NO_RANDOMIZATION, RandomizationConfig
from articulate_deploy.bundle import Bundle, load_bundle
from articulate_deploy.episode import EpisodeResult, Recording, run_episode, start_of
from articulate_deploy.estimators.truth import TruthEstimator
from articulate_deploy.policy_runner import Policy
from articulate_deploy.recording import give_back, new_folders, write_episode, write_report
from articulate_deploy.report import DeployReport, Transfer
from articulate_deploy.robots import robot_named
from articulate_deploy.robots.robot import SimulatedRobot

_Told = Callable[[str, int, EpisodeResult], None]
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
    told = None if on_episode is None else lambda _, k, result: on_episode(k, result)
    (report,) = _deploy(path, {robot: out}, _Asked(episodes, seed, randomise), told)
    return report


@dataclass(frozen=True)
class _Asked:
    """What is asked for on each robot; see :func:`deploy`."""

    episodes: int
    seed: int | None
    randomise: bool

    def __post_init__(self) -> None:
        if self.episodes < 1:
            raise ConfigError(f"episodes is {self.episodes}; it must be at least 1")
        if self.seed is not None and self.seed < 0:
            raise ConfigError(f"seed is {self.seed}; it must be 0 or more")


def _deploy(
    path: Path, folders: Mapping[str, Path | None], asked: _Asked, on_episode: _Told | None
) -> tuple[DeployReport, ...]:
    """Reports of the robots that ``folders`` names; all are looked for before the first runs."""
    bundle = load_bundle(path)
    policy = Policy(bundle)
    plan = plan_of(bundle, asked.episodes, seed=asked.seed, randomise=asked.randomise)
    stand_ins = {name: robot_named(name, bundle) for name in folders}
    claimed = [folder for folder in folders.values() if folder is not None]
    new_folders(claimed)
    try:
        reports = []
        for name, out in folders.items():
            told = None if on_episode is None else partial(on_episode, name)
            results = _run(policy, bundle, stand_ins[name], plan, out, told)
            report = _report(path, bundle, stand_ins[name], plan, asked, results)
            if out is not None:
                write_report(out, report)
            reports.append(report)
        return tuple(reports)
    finally:
        give_back(claimed)


def _run(
    policy: Policy,
    bundle: Bundle,
    stand_in: SimulatedRobot,
    plan: Plan,
    out: Path | None,
    on_episode: Callable[[int, EpisodeResult], None] | None,
) -> tuple[EpisodeResult, ...]:
    """The episodes of ``plan`` on one robot, one after another."""
    manifest, results = bundle.manifest, []
    with stand_in:
        for k in range(len(plan.draws.values)):
            drawn, noise = plan.draw(k), plan.noise(k)
            stand_in.set_episode_params(drawn, force_noise_n=plan.config.force_noise_n, noise=noise)
            stand_in.reset_to(start_of(manifest, drawn), manifest.start.gripper_width_m)
            recording = None if out is None else Recording()
            result = run_episode(
                policy,
                stand_in,
                TruthEstimator(stand_in, plan.config, manifest.task, drawn, noise),
                manifest,
                delay_steps=int(drawn["delay_steps"][0]),
                recording=recording,
            )
            if out is not None and recording is not None:
                write_episode(out, k, recording)
            results.append(result)
            if on_episode is not None:
                on_episode(k, result)
    return tuple(results)


def _report(
    path: Path,
    bundle: Bundle,
    stand_in: SimulatedRobot,
    plan: Plan,
    asked: _Asked,
    results: tuple[EpisodeResult, ...],
) -> DeployReport:
    manifest = bundle.manifest
    return DeployReport(
        bundle=str(path),
        robot=stand_in.name,
        task=manifest.task.name,
        joint=manifest.task.joint,
        seed=plan.seed,
        carried=plan.carried,
        randomised=asked.randomise,
        results=results,
        draws=tuple(plan.draw(k) for k in range(len(results))),
        notes=(*_scale_notes(manifest, asked.randomise), *stand_in.notes),
    )


@dataclass(frozen=True)
class Plan:
    """What is drawn for the episodes of one call, the same for every robot."""

    config: RandomizationConfig
    """Ranges of the noise within an episode."""
    draws: EpisodeParams
    """A row for each episode."""
    seed: int
    """Decides the noise, and the draws unless the bundle carries them."""
    carried: bool
    """Whether the draws are the bundle's."""

    def draw(self, k: int) -> EpisodeParams:
        """The draw of episode ``k``, one row."""
        return EpisodeParams(self.draws.values[k : k + 1].copy())

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
    seed = manifest.episodes.seed if seed is None else seed
    if not carried:
        rows = sample_episode_params_each(config, seed, episodes, begin=manifest.task.begin)
        return Plan(config, rows, seed, carried)
    if episodes > manifest.episodes.count:
        raise ConfigError(
            f"episodes is {episodes}; the bundle carries {manifest.episodes.count} draws: "
            "run fewer, or give a seed to draw others"
        )
    return Plan(config, EpisodeParams(bundle.draws.values[:episodes]), seed, carried)


def still(manifest: Manifest) -> RandomizationConfig:
    """No randomisation but that of the start, without which all episodes would be the same."""
    return replace(NO_RANDOMIZATION, start_rad=manifest.randomization.start_rad)


def one_size(manifest: Manifest) -> RandomizationConfig:
    """The randomisation of training with the object at the size of the bundle's scene."""
    return at_size(manifest.randomization, manifest.scene.scale)


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
        ConfigError: A robot is named twice; and what :func:`deploy` raises, for any of them
            before the first runs.
    """
    twice = [name for k, name in enumerate(robots) if name in robots[:k]]
    if twice:
        raise ConfigError(f"--robot {twice[0]} stands twice; name each robot once")
    folders = {name: None if out is None else out / name for name in robots}
    return Transfer(_deploy(path, folders, _Asked(episodes, seed, randomise), on_episode))


def _scale_notes(manifest: Manifest, randomise: bool) -> tuple[str, ...]:
    return (_SCALE_NOTE,) if randomise and manifest.randomization.scale_values != (1.0,) else ()
