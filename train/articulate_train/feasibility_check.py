"""Feasibility check before training: success rate of the scripted expert."""

from __future__ import annotations

from collections.abc import Callable

from articulate.errors import UsageError
from articulate_envs.feasibility import Feasibility, estimate_feasibility
from articulate_envs.scene import Scene
from articulate_train.config import TrainConfig

WARN_BELOW, STOP_BELOW = 0.8, 0.2
"""Success rates of the expert below which training is doubtful and is not started."""


def feasibility_of(scene: Scene, config: TrainConfig) -> Feasibility:
    """Estimate the success rate of the scripted expert under the randomization of ``config``."""
    return estimate_feasibility(
        scene, seed=config.evaluation_seed, randomization=config.randomization
    )


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


def describe_feasibility(found: Feasibility) -> str:
    """Describe the result in one phrase."""
    most = f" (most failures: {found.dominant_failure})" if found.dominant_failure else ""
    return (
        f"the scripted expert succeeds in {found.success:.0%} of {found.n_episodes} episodes{most}"
    )
