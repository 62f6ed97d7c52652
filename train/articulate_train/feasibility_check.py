"""Feasibility check before training: success rate of the scripted expert."""

from __future__ import annotations

from collections.abc import Callable, Hashable

from articulate.assets.asset import Asset
from articulate.errors import UsageError
from articulate.task.task import make_task
from articulate_envs.feasibility import Feasibility, estimate_feasibility
from articulate_envs.joint_selection import choose_scene
from articulate_envs.scene import Scene
from articulate_train.config import TrainConfig

WARN_BELOW, STOP_BELOW = 0.8, 0.2
"""Success rates of the expert below which training is doubtful and is not started."""


def best_scene(
    config: TrainConfig, asset: Asset, show_progress: Callable[[str], None] = lambda _: None
) -> Scene:
    """Return the scene of ``config`` in which the scripted expert succeeds.

    Joints, handles and grasps are tried in the order of :func:`choose_scene`.

    Args:
        config: Configuration of the training.
        asset: Object.
        show_progress: Called with one line before each estimate after the first.

    Raises:
        AssetError: The joint does not exist, or none matches the task.
        ReachError: None is reachable.
    """
    best = -1.0

    def rate(scene: Scene) -> float:
        nonlocal best
        if best >= 0.0:
            show_progress(
                f"{asset.name}: best success of the scripted expert so far {best:.0%}; "
                f"trying another grasp, handle or target of joint {scene.task.joint}"
            )
        success = feasibility_of(scene, config).success
        best = max(best, success)
        return success

    return choose_scene(config, asset, rate)


_estimates: dict[Hashable, Feasibility] = {}


def feasibility_of(scene: Scene, config: TrainConfig) -> Feasibility:
    """Estimate the success rate of the scripted expert under the randomization of ``config``.

    Estimates are kept, so that the one of :func:`best_scene` is not repeated.
    """
    key = (scene.asset, scene.task, scene.placement, config.randomization, config.evaluation_seed)
    if key not in _estimates:
        _estimates[key] = estimate_feasibility(
            scene, seed=config.evaluation_seed, randomization=config.randomization
        )
    return _estimates[key]


def check_feasibility(
    scene: Scene,
    config: TrainConfig,
    *,
    force: bool,
    show_progress: Callable[[str], None],
    warn: Callable[[str], None],
) -> None:
    """Report the feasibility of a training; raise if it is hopeless.

    Args:
        scene: Compiled scene.
        config: Configuration of the training.
        force: Only warn if the success rate is below :data:`STOP_BELOW`.
        show_progress: Called with the result.
        warn: Called with a warning instead if the success rate is below :data:`WARN_BELOW`.

    Raises:
        UsageError: The success rate is below :data:`STOP_BELOW` and ``force`` is off.
    """
    found = feasibility_of(scene, config)
    smaller = smaller_target(scene, config)
    if smaller:
        warn(f"warning: {smaller}")
    name = f"{scene.asset.name}, joint {scene.task.joint}"
    text = f"{name}: {describe_feasibility(found)}"
    if found.success < STOP_BELOW and not force:
        raise UsageError(
            f"{text}; training is unlikely to succeed: choose another joint or object "
            "(train --list-joints ASSET), or train anyway with --force"
        )
    if found.success < WARN_BELOW:
        warn(f"warning: {text}; a trained policy will rarely be better")
    else:
        show_progress(text)


def smaller_target(scene: Scene, config: TrainConfig) -> str:
    """Return a note that the target was made smaller to be in reach; empty if it was not."""
    task = scene.task
    usual = make_task(task.name, scene.asset, task.joint)
    if config.target_open is not None or task.far >= usual.far:
        return ""
    return (
        f"{scene.asset.name}: the arm cannot follow {task.joint} to {usual.far:.0%} of its range; "
        f"the largest opening in reach, {task.far:.0%}, is used (--target-open sets another)"
    )


def describe_feasibility(found: Feasibility) -> str:
    """Describe the result in one phrase."""
    most = f" (most failures: {found.dominant_failure})" if found.dominant_failure else ""
    return (
        f"the scripted expert succeeds in {found.success:.0%} of {found.n_episodes} episodes{most}"
    )
