"""Reward terms of one environment in a given state, for tests."""

from __future__ import annotations

import dataclasses
from typing import Any, cast

import numpy as np

from articulate.robot.arm import PANDA
from articulate.robot.control import GripperState
from articulate.robot.kinematics import tool_pose
from articulate.task.episode_monitor import COLUMN, WIDTH
from articulate.task.grasp import Grasp
from articulate.task.task import Task, goal_params
from articulate.transforms import axis_angle_to_matrix, pose
from articulate_envs.compiled.post_step import (
    PostStepParams,
    reward_inputs,
    write_rewards,
)
from articulate_envs.compiled.rows import stack_rows
from articulate_envs.engine import State
from articulate_envs.rewards import (
    TERMS,
    RewardConfig,
    as_numbers,
    reward_task,
    term_params,
)

DEFAULT = RewardConfig()


def configured(values, base=DEFAULT):
    """The configuration with ``values`` by dotted name."""
    for name, value in values.items():
        group, _, key = name.partition(".")
        part = dataclasses.replace(getattr(base, group), **{key: value}) if key else value
        base = dataclasses.replace(base, **{group: part})
    return base


UNCAPPED = {"lateral_offset.max_m": 1.0}
CONFIG = configured(UNCAPPED)
TASK = Task(name="open_drawer", joint="j", kind="slide", span=0.3, target=0.8)
HOME = np.asarray(PANDA.home)[None]
FAR_M = 10.0


def state(*, offset=None, turn=0.0, opened=0.0, speed=0.0, smooth=-1.0, closing=-1.0, **samples):
    """One environment at home whose handle lies ``offset`` [m] from the tool, turned about it."""
    offset = np.zeros(3) if offset is None else np.asarray(offset)
    T_wh = tool_pose(PANDA, HOME) @ pose(offset, axis_angle_to_matrix([0.0, 0.0, 1.0], turn))
    rows = np.zeros((1, WIDTH))
    for name, value in samples.items():
        rows[0, COLUMN[name]] = value
    one = np.ones(1)
    gripper = GripperState(smooth * one, closing * one, 10 * one, 0 * one, closing * one, one)
    return State(
        q=HOME,
        dq=np.zeros((1, 7)),
        target=HOME,
        gripper=gripper,
        gripper_width=0.08 * one,
        T_wt=tool_pose(PANDA, HOME),
        T_wt_target=tool_pose(PANDA, HOME),
        T_wh=T_wh,
        opened=opened * one,
        speed=speed * one,
        samples=rows,
        pending_actions=np.zeros((1, 7)),
    )


AWAY = state(offset=[0, 0, FAR_M])
IDLE = np.zeros((1, 8))
SHUT = np.array([[0.0] * 7 + [1.0]])
"""The hand is told to close."""


def terms(
    after, *, before=AWAY, action=IDLE, config=CONFIG, task=TASK, progress=0.0, along_m=0.0,
    thick_m=0.0,
):  # fmt: skip
    values = np.full((1, len(TERMS)), np.nan)
    params = PostStepParams(
        terms=term_params(config),
        travel=as_numbers(config.travel),
        task=stack_rows([reward_task(task, Grasp(along_m=along_m, thick_m=thick_m))]),
        goal=stack_rows([goal_params(task)]),
        observation=cast(Any, None),  # the reward reads neither
        estimator=cast(Any, None),
        force_noise_n=0.0,
        steps=1,
    )
    share = min(progress / config.until, 1.0)
    write_rewards(reward_inputs(before), reward_inputs(after), action, share, params, values)
    return dict(zip(TERMS, values[0], strict=True))
