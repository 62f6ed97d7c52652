"""Rows of constants that differ between the environments of a batch.

Environments of one engine can have different scenes. Each constant is then stacked: a named tuple
of arrays, first axis N, from which compiled functions take the row of an environment.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, TypeVar

import numpy as np

from articulate.jit import row_function
from articulate.task.object_placement import HandlePath
from articulate.task.observation import ObservationParams
from articulate.task.scripted_expert import ExpertParams
from articulate.task.task import GoalParams
from articulate_envs.rewards import RewardTask

Row = TypeVar("Row", bound=tuple[Any, ...])


def stack_rows(rows: Sequence[Row]) -> Row:
    """Return one named tuple whose fields are arrays: those of N named tuples, first axis N.

    Fields that are named tuples themselves are stacked in the same way.
    """
    fields = zip(*rows, strict=True)
    return type(rows[0])(
        *(stack_rows(f) if isinstance(f[0], tuple) else np.array(f) for f in fields)
    )


@row_function
def reward_task_of(rows: RewardTask, i: int) -> RewardTask:
    """Return row ``i`` of stacked constants."""
    return RewardTask(
        rows.closes[i],  # type: ignore[index]
        rows.first[i],  # type: ignore[index]
        rows.target[i],  # type: ignore[index]
        rows.stop[i],  # type: ignore[index]
        rows.length_m[i],  # type: ignore[index]
        rows.along_m[i],  # type: ignore[index]
        rows.thick_m[i],  # type: ignore[index]
        rows.beside_m[i],  # type: ignore[index]
        rows.pad_m[i],  # type: ignore[index]
    )


@row_function
def goal_of(rows: GoalParams, i: int) -> GoalParams:
    """Return row ``i`` of stacked success criteria."""
    return GoalParams(rows.closes[i], rows.target[i], rows.slow[i])  # type: ignore[index]


@row_function
def observation_params_of(rows: ObservationParams, i: int) -> ObservationParams:
    """Return row ``i`` of stacked constants."""
    return ObservationParams(
        rows.step_s[i],  # type: ignore[index]
        rows.move_m[i],  # type: ignore[index]
        rows.target[i],  # type: ignore[index]
        rows.closes[i],  # type: ignore[index]
        rows.direction_h[i],
        rows.rotation_h[i],
        rows.travel_m[i],  # type: ignore[index]
        rows.handle_size[i],
        expert_params_of(rows.expert, i),
    )


@row_function
def expert_params_of(rows: ExpertParams, i: int) -> ExpertParams:
    """Return row ``i`` of stacked constants."""
    return ExpertParams(
        rows.move_m[i],  # type: ignore[index]
        rows.turn_rad[i],  # type: ignore[index]
        path_of(rows.path, i),
        rows.along_m[i],  # type: ignore[index]
        rows.thick_m[i],  # type: ignore[index]
        rows.deep_m[i],  # type: ignore[index]
        rows.beside_m[i],  # type: ignore[index]
        rows.shut[i],  # type: ignore[index]
        rows.hooks[i],  # type: ignore[index]
        rows.aim[i],  # type: ignore[index]
    )


@row_function
def path_of(paths: HandlePath, i: int) -> HandlePath:
    """Return row ``i`` of stacked paths."""
    return HandlePath(
        paths.hinge[i],  # type: ignore[index]
        paths.axis_o[i],
        paths.pivot_o[i],
        paths.T_oh[i],
        paths.closed[i],  # type: ignore[index]
        paths.span[i],  # type: ignore[index]
    )
