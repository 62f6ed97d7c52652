"""Deployment of a bundle: some episodes on one robot or on several."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

from articulate.errors import ConfigError
from articulate_deploy.bundle import Bundle, load_bundle
from articulate_deploy.episode import EpisodeResult, run_episode, start_of
from articulate_deploy.episode_log import EpisodeLog
from articulate_deploy.estimators.truth import TruthEstimator
from articulate_deploy.plan import EpisodeRequest, Plan, make_plan
from articulate_deploy.policy_runner import Policy
from articulate_deploy.recording import claimed_folders, finish_episode, write_report
from articulate_deploy.report import DeployReport, Transfer, make_report
from articulate_deploy.robots import robot_named
from articulate_deploy.robots.robot import SimulatedRobot
from articulate_deploy.time_scale import scaled_manifest

_Callback = Callable[[str, int, EpisodeResult], None]


def deploy(
    path: Path,
    *,
    robot: str = "mujoco",
    episodes: int = 20,
    seed: int | None = None,
    randomise: bool = True,
    speed_scale: float = 1.0,
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
        speed_scale: Speed of the policy's clock, in [0.05, 1].
        out: Folder for recordings; None writes none.
        on_episode: Called with the number and the result of each episode.

    Raises:
        BundleError: The bundle is invalid.
        ConfigError: The robot is unknown, or a number is not accepted.
        UsageError: ``out`` cannot be written.
    """
    callback = None if on_episode is None else lambda _, k, result: on_episode(k, result)
    request = EpisodeRequest(episodes, seed, randomise, speed_scale)
    (report,) = _deploy(path, {robot: out}, request, callback)
    return report


def _deploy(
    path: Path,
    folders: Mapping[str, Path | None],
    request: EpisodeRequest,
    on_episode: _Callback | None,
) -> tuple[DeployReport, ...]:
    """Return the reports of the robots in ``folders``; all are made before the first runs."""
    bundle = load_bundle(path)
    policy = Policy(bundle)
    plan = make_plan(bundle, request.episodes, seed=request.seed, randomise=request.randomise)
    scaled = replace(bundle, manifest=scaled_manifest(bundle.manifest, request.speed_scale))
    robots = {name: robot_named(name, scaled) for name in folders}
    with claimed_folders([folder for folder in folders.values() if folder is not None]):
        reports = []
        for name, out in folders.items():
            callback = None if on_episode is None else partial(on_episode, name)
            results = _run(policy, scaled, robots[name], plan, request, out, callback)
            report = make_report(path, bundle, robots[name], plan, request, results)
            if out is not None:
                write_report(out, report)
            reports.append(report)
        return tuple(reports)


def _run(
    policy: Policy,
    bundle: Bundle,
    robot: SimulatedRobot,
    plan: Plan,
    request: EpisodeRequest,
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
            recording = None if out is None else EpisodeLog(out, k)
            result = run_episode(
                policy,
                robot,
                TruthEstimator(robot, plan.config, manifest.task, params, noise),
                manifest,
                delay_steps=int(params["delay_steps"][0]),
                recording=recording,
                speed_scale=request.speed_scale,
            )
            if recording is not None:
                finish_episode(recording)
            results.append(result)
            if on_episode is not None:
                on_episode(k, result)
    return tuple(results)


def transfer(
    path: Path,
    robots: Sequence[str],
    *,
    episodes: int = 20,
    seed: int | None = None,
    randomise: bool = True,
    speed_scale: float = 1.0,
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
        speed_scale: As in :func:`deploy`.
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
    request = EpisodeRequest(episodes, seed, randomise, speed_scale)
    return Transfer(_deploy(path, folders, request, on_episode))
