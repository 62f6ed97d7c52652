"""Deployment of a bundle: some episodes on one robot or on several."""

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
from articulate_deploy.recording import claimed_folders, write_episode, write_report
from articulate_deploy.report import DeployReport, Transfer
from articulate_deploy.robots import robot_named
from articulate_deploy.robots.robot import SimulatedRobot

_Callback = Callable[[str, int, EpisodeResult], None]
_SCALE_NOTE = "the object's size is not randomised: a bundle has its scene at one size"


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
    """Run the bundle at ``path`` and return the report.

    Args:
        path: The bundle.
        robot: Name of the robot.
        episodes: Number of episodes.
        seed: Seed of the episode parameters; None uses those of the bundle. Episode k is the same
            for any number of episodes and for every robot.
        randomise: Sample as in training, at one size of the object; otherwise only the start of
            the arm is sampled.
        out: Folder for recordings; None writes none.
        on_episode: Called with the number and the result of each episode.

    Raises:
        BundleError: The bundle is invalid.
        ConfigError: The robot is unknown, or a number is not accepted.
        UsageError: ``out`` cannot be written.
    """
    callback = None if on_episode is None else lambda _, k, result: on_episode(k, result)
    (report,) = _deploy(path, {robot: out}, _Request(episodes, seed, randomise), callback)
    return report


@dataclass(frozen=True)
class _Request:
    """Episodes to run on each robot; see :func:`deploy`."""

    episodes: int
    seed: int | None
    randomise: bool

    def __post_init__(self) -> None:
        if self.episodes < 1:
            raise ConfigError(f"episodes is {self.episodes}; it must be at least 1")
        if self.seed is not None and self.seed < 0:
            raise ConfigError(f"seed is {self.seed}; it must be 0 or more")


def _deploy(
    path: Path, folders: Mapping[str, Path | None], request: _Request, on_episode: _Callback | None
) -> tuple[DeployReport, ...]:
    """Return the reports of the robots in ``folders``; all are made before the first runs."""
    bundle = load_bundle(path)
    policy = Policy(bundle)
    plan = make_plan(bundle, request.episodes, seed=request.seed, randomise=request.randomise)
    robots = {name: robot_named(name, bundle) for name in folders}
    with claimed_folders([folder for folder in folders.values() if folder is not None]):
        reports = []
        for name, out in folders.items():
            callback = None if on_episode is None else partial(on_episode, name)
            results = _run(policy, bundle, robots[name], plan, out, callback)
            report = _report(path, bundle, robots[name], plan, request, results)
            if out is not None:
                write_report(out, report)
            reports.append(report)
        return tuple(reports)


def _run(
    policy: Policy,
    bundle: Bundle,
    robot: SimulatedRobot,
    plan: Plan,
    out: Path | None,
    on_episode: Callable[[int, EpisodeResult], None] | None,
) -> tuple[EpisodeResult, ...]:
    """Return the results of the episodes of ``plan`` on one robot, one after another."""
    manifest, results = bundle.manifest, []
    with robot:
        for k in range(len(plan.episode_params.values)):
            params, noise = plan.params(k), plan.noise(k)
            robot.set_episode_params(params, force_noise_n=plan.config.force_noise_n, noise=noise)
            robot.reset_to(start_of(manifest, params), manifest.start.gripper_width_m)
            recording = None if out is None else Recording()
            result = run_episode(
                policy,
                robot,
                TruthEstimator(robot, plan.config, manifest.task, params, noise),
                manifest,
                delay_steps=int(params["delay_steps"][0]),
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
    robot: SimulatedRobot,
    plan: Plan,
    request: _Request,
    results: tuple[EpisodeResult, ...],
) -> DeployReport:
    manifest = bundle.manifest
    return DeployReport(
        bundle=str(path),
        robot=robot.name,
        task=manifest.task.name,
        joint=manifest.task.joint,
        seed=plan.seed,
        from_bundle=plan.from_bundle,
        randomised=request.randomise,
        results=results,
        episode_params=tuple(plan.params(k) for k in range(len(results))),
        notes=(*_scale_notes(manifest, request.randomise), *robot.notes),
    )


@dataclass(frozen=True)
class Plan:
    """Sampled parameters of the episodes of one deployment, the same for every robot."""

    config: RandomizationConfig
    """Ranges of the noise within an episode."""
    episode_params: EpisodeParams
    """One row an episode."""
    seed: int
    """Seed of the noise, and of the parameters unless they are the bundle's."""
    from_bundle: bool
    """True for the parameters of the bundle."""

    def params(self, k: int) -> EpisodeParams:
        """Return the parameters of episode ``k``, one row."""
        return EpisodeParams(self.episode_params.values[k : k + 1].copy())

    def noise(self, k: int) -> np.random.Generator:
        """Return the generator of the noise within episode ``k``."""
        return np.random.default_rng(np.random.SeedSequence([self.seed, k, 1]))


def make_plan(bundle: Bundle, episodes: int, *, seed: int | None, randomise: bool) -> Plan:
    """Return the parameters of ``episodes`` episodes; see :func:`deploy`.

    Raises:
        ConfigError: There are more episodes than rows in the bundle, and no seed.
    """
    manifest = bundle.manifest
    config = one_size(manifest) if randomise else start_only(manifest)
    from_bundle = seed is None and randomise
    seed = manifest.episodes.seed if seed is None else seed
    if not from_bundle:
        rows = sample_episode_params_each(config, seed, episodes, begin=manifest.task.begin)
        return Plan(config, rows, seed, from_bundle)
    if episodes > manifest.episodes.count:
        raise ConfigError(
            f"episodes is {episodes}; the bundle has {manifest.episodes.count}: "
            "run fewer, or give a seed to sample others"
        )
    rows = EpisodeParams(bundle.episode_params.values[:episodes])
    return Plan(config, rows, seed, from_bundle)


def start_only(manifest: Manifest) -> RandomizationConfig:
    """Return the randomization of the arm's start only; without it all episodes would be equal."""
    return replace(NO_RANDOMIZATION, start_rad=manifest.randomization.start_rad)


def one_size(manifest: Manifest) -> RandomizationConfig:
    """Return the randomization of training with the object at the size of the bundle's scene."""
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
    """Run the bundle at ``path`` on several robots with the same parameters and compare them.

    Args:
        path: The bundle.
        robots: Names of the robots; the others are compared with the first.
        episodes: Number of episodes on each.
        seed: As in :func:`deploy`.
        randomise: As in :func:`deploy`.
        out: Folder for recordings, with a folder for each robot; None writes none.
        on_episode: Called with the robot, the number and the result of each episode.

    Raises:
        ConfigError: A robot is given twice; and the errors of :func:`deploy`, for all robots
            before the first runs.
    """
    duplicates = [name for k, name in enumerate(robots) if name in robots[:k]]
    if duplicates:
        raise ConfigError(f"--robot {duplicates[0]} given twice; name each robot once")
    folders = {name: None if out is None else out / name for name in robots}
    return Transfer(_deploy(path, folders, _Request(episodes, seed, randomise), on_episode))


def _scale_notes(manifest: Manifest, randomise: bool) -> tuple[str, ...]:
    return (_SCALE_NOTE,) if randomise and manifest.randomization.scale_values != (1.0,) else ()
