"""Checks of actions and reset options, and the info of steps, for Gymnasium and robosuite."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from articulate.errors import EngineError, nearest, quote
from articulate.task.episode_monitor import REASONS, EpisodeMonitor, failure_reason, goal_held
from articulate.task.observation import ACTION
from articulate.task.randomization import COLUMNS, EpisodeParams
from articulate.task.randomization_config import FACTORS, MAX_DELAY_STEPS
from articulate.task.task import Task
from articulate.transforms import Array
from articulate_envs.engine import Start, State
from articulate_envs.initial_states import home_start
from articulate_envs.scene import Scene

OPTIONS = {
    "episode_params": "a mapping of names of episode parameters to numbers",
    "q": "seven joint angles [rad]",
    "opened": "the fraction open, in [0, 1]",
    "width": "the opening between the fingers [m]",
    "closing": "1 for a closed gripper command, -1 for an open one",
}
"""Options of a reset; each replaces a sampled value."""
DELAYS = ("delay_steps", "estimate_delay_steps")
"""Episode parameters that are integers: numbers of control steps."""


def checked_action(action: Any, n: int | None = None) -> Array:
    """Return ``action`` as float64 of shape (8,), or (``n``, 8).

    Raises:
        EngineError: It has another shape, or a number in it is not finite.
    """
    shape = (ACTION.size,) if n is None else (n, ACTION.size)
    try:
        values = np.asarray(action, dtype=np.float64)
    except (TypeError, ValueError):
        raise EngineError(f"action is {type(action).__name__}; it must hold numbers") from None
    if values.shape != shape:
        parts = ", ".join(f"{f.name} {f.size}" for f in ACTION.fields)
        raise EngineError(f"action has shape {values.shape}; it must be {shape}: {parts}")
    if not np.isfinite(values).all():
        where = np.argwhere(~np.isfinite(values))[0]
        value = values[tuple(where)]
        at = ", ".join(map(str, where))
        raise EngineError(f"action[{at}] is {value}; every number must be finite, in [-1, 1]")
    return values


def apply_options(options: Mapping[str, Any] | None, start: Start, scene: Scene) -> Start:
    """Return the sampled ``start`` of N episodes with the values of ``options``.

    Args:
        options: Values by the names of :data:`OPTIONS`, the same for all N episodes.
        start: Sampled initial states.
        scene: Scene of the episodes; it gives the bounds of the values.

    Raises:
        EngineError: An option is not known, or its value is not accepted.
    """
    options = options or {}
    for name in options:
        if name not in OPTIONS:
            raise EngineError(f"reset: no option {quote(name)}{nearest(str(name), OPTIONS)}")
    if "episode_params" in options:
        start = _with_params(options["episode_params"], start, scene)
    low, high = scene.arm.bounds()
    widest = scene.arm.gripper.max_width_m
    bounds: dict[str, tuple[Any, Any]] = {"q": (low, high), "opened": (0.0, 1.0)}
    bounds |= {"width": (0.0, widest), "closing": (-1.0, 1.0)}
    changes: dict[str, Any] = {}
    for name, (least, most) in bounds.items():
        if name in options:
            value = _numbers(name, options[name], np.shape(least))
            if np.any(value < least) or np.any(value > most):
                raise EngineError(
                    f"reset: {name} is {_format(value)}; it must lie within "
                    f"{_format(least)} and {_format(most)}"
                )
            if name == "closing":
                value = np.where(value > 0.0, 1.0, -1.0)
            changes[name] = np.broadcast_to(value, getattr(start, name).shape)
    if "opened" in changes and "part_open" not in options.get("episode_params", {}):
        values = start.params.values.copy()
        values[:, COLUMNS.index("part_open")] = changes["opened"]
        changes["params"] = EpisodeParams(values)
    return replace(start, **changes)


def _with_params(changes: Any, start: Start, scene: Scene) -> Start:
    if not isinstance(changes, Mapping):
        raise EngineError(
            f"reset: episode_params is {quote(changes)}; it must be {OPTIONS['episode_params']}"
        )
    values = start.params.values.copy()
    for name, value in changes.items():
        if name not in COLUMNS:
            raise EngineError(
                f"reset: episode_params has no entry {quote(name)}{nearest(str(name), COLUMNS)}"
            )
        number = float(_numbers(f"episode_params.{name}", value, ()))
        if name == "scale":
            number = _size(number, scene)
        else:
            _check_param(name, number)
        values[:, COLUMNS.index(name)] = number
    params = EpisodeParams(values)
    within, k = values.copy(), COLUMNS.index("part_open")
    within[:, k] = np.clip(values[:, k], *scene.task.begin)
    home, at_home = home_start(scene, EpisodeParams(within)), start.home
    return replace(
        start,
        params=params,
        q=np.where(at_home[:, None], home.q, start.q),
        opened=np.where(at_home, params["part_open"], start.opened),
    )


def _check_param(name: str, number: float) -> None:
    accepted = ""
    if name in FACTORS and number <= 0.0:
        accepted = "factors must be above 0"
    elif name == "part_open" and not 0.0 <= number <= 1.0:
        accepted = "it must lie within 0 and 1"
    elif name in DELAYS and number not in range(MAX_DELAY_STEPS + 1):
        accepted = f"it must be an integer up to {MAX_DELAY_STEPS}"
    if accepted:
        raise EngineError(f"reset: episode_params.{name} is {number}; {accepted}")


def _size(number: float, scene: Scene) -> float:
    """Return the compiled size that equals ``number``."""
    sizes = np.asarray(scene.scales)
    k = int(np.argmin(np.abs(sizes - number)))
    if abs(sizes[k] - number) > 1e-6:
        known = ", ".join(f"{size:.6g}" for size in sizes)
        raise EngineError(
            f"reset: episode_params.scale is {number}; sizes that are compiled: {known}"
        )
    return float(sizes[k])


def _numbers(name: str, value: Any, shape: tuple[int, ...]) -> Array:
    try:
        out = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError):
        out = np.full(1, np.nan)
    if out.shape != shape or not np.isfinite(out).all():
        accepted = f"{shape[0]} finite numbers" if shape else "a finite number"
        raise EngineError(f"reset: {name} is {quote(value)}; it must be {accepted}")
    return out


def _format(value: Any) -> str:
    return " ".join(f"{v:.4g}" for v in np.ravel(value))


def episode_info(monitor: EpisodeMonitor, task: Task, state: State) -> dict[str, Array]:
    """Return the info of N episodes as if they ended at this control step.

    Args:
        monitor: Episode monitor of N episodes.
        task: Target and limits.
        state: State of the N environments.

    Returns:
        Arrays (N,): ``success`` (boolean), ``reason`` (a name of
        :data:`articulate.task.episode_monitor.REASONS`), ``opened`` (boolean: the goal is held,
        limits aside) and ``open_fraction`` (dimensionless).
    """
    code = failure_reason(monitor, task)
    return {
        "success": code == 0,
        "reason": np.array([REASONS[int(c)] for c in code], dtype=object),
        "opened": goal_held(monitor, task),
        "open_fraction": state.opened.copy(),
    }


def params_dict(params: EpisodeParams, i: int = 0) -> dict[str, float]:
    """Return row ``i`` of ``params`` by the names of its columns."""
    return {name: float(value) for name, value in zip(COLUMNS, params.values[i], strict=True)}
