"""What gymnasium and robosuite share: what users ask for, checked, and what they are told."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from articulate.errors import EngineError, nearest
from articulate.task.episode_monitor import REASONS, EpisodeMonitor, opened_at_end, verdict
from articulate.task.observation import ACTION
from articulate.task.randomization import COLUMNS, EpisodeParams
from articulate.task.randomization_config import FACTORS, MAX_DELAY_TICKS
from articulate.task.task import Task
from articulate.transforms import Array
from articulate_envs.engine import Start, State
from articulate_envs.initial_states import home_start
from articulate_envs.scene import Scene

OPTIONS = {
    "draw": "a mapping of columns of a draw to numbers",
    "q": "seven joint angles [rad]",
    "opened": "the fraction open, in [0, 1]",
    "width": "the opening between the fingers [m]",
    "closing": "1 for a hand told to close, -1 for one told to open",
}
"""What may be asked of a reset; each replaces what was drawn."""
WHOLE = ("delay_ticks", "estimate_delay_ticks")
"""Columns of a draw that are whole numbers of ticks."""


def checked_action(action: Any, n: int | None = None) -> Array:
    """``action`` as float64 of shape (8,), or (``n``, 8).

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


def start_asked_for(options: Mapping[str, Any] | None, start: Start, scene: Scene) -> Start:
    """``start``, as drawn for N episodes, with what ``options`` (:data:`OPTIONS`) ask for.

    Raises:
        EngineError: An option is not known, or its value is not accepted.
    """
    options = options or {}
    for name in options:
        if name not in OPTIONS:
            raise EngineError(f"reset: no option {name!r}{nearest(name, OPTIONS)}")
    if "draw" in options:
        start = _drawn(options["draw"], start, scene)
    low, high = scene.arm.bounds()
    widest = scene.arm.hand.max_width_m
    bounds: dict[str, tuple[Any, Any]] = {"q": (low, high), "opened": (0.0, 1.0)}
    bounds |= {"width": (0.0, widest), "closing": (-1.0, 1.0)}
    asked: dict[str, Any] = {}
    for name, (least, most) in bounds.items():
        if name in options:
            value = _numbers(name, options[name], np.shape(least))
            if np.any(value < least) or np.any(value > most):
                raise EngineError(
                    f"reset: {name} is {_shown(value)}; it must lie within "
                    f"{_shown(least)} and {_shown(most)}"
                )
            if name == "closing":
                value = np.where(value > 0.0, 1.0, -1.0)
            asked[name] = np.broadcast_to(value, getattr(start, name).shape)
    if "opened" in asked and "part_open" not in options.get("draw", {}):
        values = start.draw.values.copy()
        values[:, COLUMNS.index("part_open")] = asked["opened"]
        asked["draw"] = EpisodeParams(values)
    return replace(start, **asked)


def _drawn(asked: Any, start: Start, scene: Scene) -> Start:
    if not isinstance(asked, Mapping):
        raise EngineError(f"reset: draw is {asked!r}; it must be {OPTIONS['draw']}")
    values = start.draw.values.copy()
    for name, value in asked.items():
        if name not in COLUMNS:
            raise EngineError(f"reset: a draw has no column {name!r}{nearest(str(name), COLUMNS)}")
        number = float(_numbers(f"draw.{name}", value, ()))
        if name == "scale":
            number = _size(number, scene)
        elif name in FACTORS and number <= 0.0:
            raise EngineError(f"reset: draw.{name} is {number}; factors must be above 0")
        elif name == "part_open" and not 0.0 <= number <= 1.0:
            raise EngineError(f"reset: draw.part_open is {number}; it must lie within 0 and 1")
        elif name in WHOLE and number not in range(MAX_DELAY_TICKS + 1):
            raise EngineError(
                f"reset: draw.{name} is {number}; it must be a whole number up to {MAX_DELAY_TICKS}"
            )
        values[:, COLUMNS.index(name)] = number
    drawn = EpisodeParams(values)
    within, k = values.copy(), COLUMNS.index("part_open")
    within[:, k] = np.clip(values[:, k], *scene.task.begin)
    home, at_home = home_start(scene, EpisodeParams(within)), start.home
    return replace(
        start,
        draw=drawn,
        q=np.where(at_home[:, None], home.q, start.q),
        opened=np.where(at_home, drawn["part_open"], start.opened),
    )


def _size(number: float, scene: Scene) -> float:
    """The prepared size that ``number`` is."""
    sizes = np.asarray(scene.scales)
    k = int(np.argmin(np.abs(sizes - number)))
    if abs(sizes[k] - number) > 1e-6:
        known = ", ".join(f"{size:.6g}" for size in sizes)
        raise EngineError(f"reset: draw.scale is {number}; sizes that are prepared: {known}")
    return float(sizes[k])


def _numbers(name: str, value: Any, shape: tuple[int, ...]) -> Array:
    try:
        out = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError):
        out = np.full(1, np.nan)
    if out.shape != shape or not np.isfinite(out).all():
        what = f"{shape[0]} finite numbers" if shape else "a finite number"
        raise EngineError(f"reset: {name} is {value!r}; it must be {what}")
    return out


def _shown(value: Any) -> str:
    return " ".join(f"{v:.4g}" for v in np.ravel(value))


def told(judgement: EpisodeMonitor, task: Task, state: State) -> dict[str, Array]:
    """What users are told of N episodes, as if they ended at this tick.

    ``success``, ``reason`` (:data:`articulate.task.episode_monitor.REASONS`), ``opened`` (rests at the target,
    limits aside) and ``open_fraction``.
    """
    code = verdict(judgement, task)
    return {
        "success": code == 0,
        "reason": np.array([REASONS[int(c)] for c in code], dtype=object),
        "opened": opened_at_end(judgement, task),
        "open_fraction": state.opened.copy(),
    }


def drawn_numbers(drawn: EpisodeParams, i: int = 0) -> dict[str, float]:
    """Row ``i`` of a draw by the names of its columns."""
    return {name: float(value) for name, value in zip(COLUMNS, drawn.values[i], strict=True)}
