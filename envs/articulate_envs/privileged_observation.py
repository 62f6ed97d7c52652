"""What the value function sees beside the observation while learning: what is true and drawn.

A policy on a robot never sees it. The value function is only used in training, and judges better
when the latency, the masses and the true pose of the handle are known to it (asymmetric
actor-critic; Pinto et al. 2018, arXiv:1710.06542).
"""

from __future__ import annotations

import numpy as np

from articulate.task.episode_monitor import COLUMN, EpisodeMonitor
from articulate.task.layout import Field, Layout
from articulate.task.observation import BEYOND_UNIT, HANDLE_UNIT_M, NEAR_UNIT_M
from articulate.task.randomization import COLUMNS, EpisodeParams
from articulate.task.task import Task, beyond
from articulate.transforms import Array
from articulate_envs.engine import State

DRAWN = tuple(name for name in COLUMNS if name != "part_open")
"""What is told of the draws: all but where the part began, for it is seen where it is."""
_DRAWN = np.array([COLUMNS.index(name) for name in DRAWN])
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
        Field(name="gripper_closing", size=1, unit="1", frame="-", source="plant"),
        Field(name="gripper_latency_left", size=1, unit="s", frame="-", source="plant"),
        Field(name="force", size=3, unit="20 N", frame="world", source="robot"),
        Field(name="violated", size=1, unit="1", frame="-", source="plant"),
        Field(name="rest", size=1, unit="s", frame="-", source="plant"),
        Field(
            name="drawn", size=len(DRAWN), unit="as drawn", frame="-", source="plant",
            low=-100.0, high=100.0,
        ),
    )
)  # fmt: skip
"""Its fields, which follow those of the observation."""


def privileged(task: Task, state: State, judgement: EpisodeMonitor, drawn: EpisodeParams) -> Array:
    """The vectors (N, size of :data:`PRIVILEGED`) for N environments."""
    apart_w = state.T_wh[:, :3, 3] - state.T_wt[:, :3, 3]
    handle = np.einsum("nji,nj->ni", state.T_wt[:, :3, :3], apart_w)
    return PRIVILEGED.pack(
        {
            "handle_pos_true": handle / HANDLE_UNIT_M,
            "handle_pos_fine_true": handle / NEAR_UNIT_M,
            "part_open_true": state.opened,
            "goal_error_fine_true": beyond(state.opened, task.target, closes=task.closes)
            / BEYOND_UNIT,
            "gripper_closing": state.gripper.closing,
            "gripper_latency_left": state.gripper.wait_s,
            "force": np.nan_to_num(state.samples[:, 0:3]) / 20.0,
            "violated": (state.samples[:, COLUMN["code"]] > 0.0).astype(np.float64),
            "rest": np.minimum(judgement.rest_s, 1.0),
            "drawn": drawn.values[:, _DRAWN],
        }
    )
