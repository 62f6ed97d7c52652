"""Privileged inputs of the value function: true state and sampled parameters, in training only.

A policy on a robot never gets them. The value function is more accurate if it knows the latency,
the masses and the true pose of the handle (asymmetric actor-critic; Pinto et al. 2018,
arXiv:1710.06542).
"""

from __future__ import annotations

import numpy as np

from articulate.task.episode_monitor import COLUMN, EpisodeMonitor
from articulate.task.layout import Field, Layout
from articulate.task.observation import FINE_UNIT_M, GOAL_ERROR_UNIT, HANDLE_UNIT_M
from articulate.task.randomization import COLUMNS, EpisodeParams
from articulate.task.task import GoalParams
from articulate.transforms import Array
from articulate_envs.engine import State

SAMPLED = tuple(name for name in COLUMNS if name != "part_open")
"""Episode parameters in the vector: all but where the part began, which is observed."""
_SAMPLED = np.array([COLUMNS.index(name) for name in SAMPLED])
PRIVILEGED = Layout(
    (
        Field(name="handle_pos_true", size=3, unit="0.2 m", frame="tool", source="estimator"),
        Field(
            name="handle_pos_fine_true", size=3, unit="0.02 m", frame="tool", source="estimator",
            low=-1.5, high=1.5,
        ),
        Field(name="part_open_true", size=1, unit="1", frame="-", source="estimator"),
        Field(
            name="goal_error_fine_true", size=1, unit="0.05", frame="-", source="estimator",
            low=-4.0, high=2.0,
        ),
        Field(name="gripper_closing", size=1, unit="1", frame="-", source="controller"),
        Field(name="gripper_latency_left", size=1, unit="s", frame="-", source="controller"),
        Field(name="force", size=3, unit="20 N", frame="world", source="robot"),
        Field(name="violated", size=1, unit="1", frame="-", source="controller"),
        Field(name="rest", size=1, unit="s", frame="-", source="controller"),
        Field(
            name="episode_params", size=len(SAMPLED), unit="as sampled", frame="-",
            source="controller", low=-100.0, high=100.0,
        ),
    )
)  # fmt: skip
"""Fields of the vector, which follow those of the observation."""


def privileged(
    goal: GoalParams, state: State, monitor: EpisodeMonitor, params: EpisodeParams
) -> Array:
    """Return the vectors (N, size of :data:`PRIVILEGED`) for N environments.

    Args:
        goal: Success criteria of each environment, arrays (N,).
        state: State of the environments.
        monitor: Monitor of their episodes.
        params: Parameters of their episodes.
    """
    beyond = np.where(
        goal.closes, goal.target - np.abs(state.opened), state.opened - goal.target
    )  # goal_error for rows of several tasks
    offset_w = state.T_wh[:, :3, 3] - state.T_wt[:, :3, 3]
    handle = np.einsum("nji,nj->ni", state.T_wt[:, :3, :3], offset_w)
    return PRIVILEGED.pack(
        {
            "handle_pos_true": handle / HANDLE_UNIT_M,
            "handle_pos_fine_true": handle / FINE_UNIT_M,
            "part_open_true": state.opened,
            "goal_error_fine_true": beyond / GOAL_ERROR_UNIT,
            "gripper_closing": state.gripper.closing,
            "gripper_latency_left": state.gripper.latency_left_s,
            "force": np.nan_to_num(state.samples[:, 0:3]) / 20.0,
            "violated": (state.samples[:, COLUMN["code"]] > 0.0).astype(np.float64),
            "rest": np.minimum(monitor.rest_s, 1.0),
            "episode_params": params.values[:, _SAMPLED],
        }
    )
