"""Actions as corrections of the scripted expert, scaled near the handle and at the goal.

A policy does not begin from nothing: the action of the scripted expert is part of its observation,
and the network's eight numbers in [-1, 1] are added to it (residual policy learning: Silver et al.
2018, arXiv:1812.06298; Johannink et al. 2019, arXiv:1812.03201). A network that returns 0 acts as
the expert.

The unit of a motion is the largest motion of a control step. Within centimetres of the handle,
where 5 mm decide a grasp, corrections are scaled down by the handle's predicted position
(``handle_pos_predicted``) and the state of the gripper, which lags by up to 1 s. They are scaled
down again where the part is at its goal. Training and the exported network apply the same formula,
so engines and robots need not.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import torch

from articulate.task.observation import (
    ACTION,
    GOAL_ERROR_UNIT,
    GRIPPER_SPEED_UNIT_M_S,
    HANDLE_UNIT_M,
    OBSERVATION,
    WIDTH_UNIT_M,
)
from articulate_train.config import ActionScalingConfig

_HANDLE = OBSERVATION.slice("handle_pos_predicted")
_GOAL_ERROR = OBSERVATION.slice("goal_error_fine")
_COMMAND_START = OBSERVATION.slice("gripper_command").start
_COMMAND = slice(_COMMAND_START + 1, _COMMAND_START + 2)
_WIDTH, _SPEED = OBSERVATION.slice("gripper_width"), OBSERVATION.slice("gripper_speed")
_EXPERT = OBSERVATION.slice("expert_action")
GRIPPER_GAIN = 2.0
"""Factor on the correction of the gripper, so that it can reverse the expert's command."""
MIN_SCALE = 0.3
"""Lower bound of the scale when a correction is computed: a waiting gripper must not correct
millimetres with its largest motion."""
_IS_GRIPPER = (0.0,) * (ACTION.size - 1) + (1.0,)


def action_scales(config: ActionScalingConfig, observation: Any) -> Any:
    """Return the scales (N, 1) of motions, in [0, 1], at raw observations (N, size).

    Works on NumPy arrays and torch tensors.
    """
    handle = observation[:, _HANDLE] * HANDLE_UNIT_M
    distance = (handle * handle).sum(-1, keepdims=True) ** 0.5
    near = ((config.far_m - distance) / (config.far_m - config.near_m)).clip(0.0, 1.0)
    closing = observation[:, _COMMAND].clip(0.0, 1.0)
    begin, end = config.closed_width_m
    narrow = ((end - observation[:, _WIDTH] * WIDTH_UNIT_M) / (end - begin)).clip(0.0, 1.0)
    change = abs(observation[:, _SPEED]) * GRIPPER_SPEED_UNIT_M_S
    closed = narrow * (1.0 - change / config.closed_speed_m_s).clip(0.0, 1.0)
    cut = (1.0 - closing) * (1.0 - config.near_handle)
    cut = cut + closing * (1.0 - closed) * (1.0 - config.while_closing)
    first, last = config.goal_range
    beyond = observation[:, _GOAL_ERROR] * GOAL_ERROR_UNIT
    done = ((beyond - first) / (last - first)).clip(0.0, 1.0)
    return (1.0 - near * cut) * (1.0 - done * (1.0 - config.at_goal))


def corrected_action(config: ActionScalingConfig, observation: Any, correction: Any) -> Any:
    """Return the actions (N, 8) in [-1, 1]: those of the expert, and the policy's corrections.

    Works on NumPy arrays and torch tensors.

    Args:
        config: Scales.
        observation: Raw observations (N, size).
        correction: Outputs of the network (N, 8), in [-1, 1].
    """
    gains = _gains(action_scales(config, observation))
    return (observation[:, _EXPERT] + gains * correction).clip(-1.0, 1.0)


def correction_to(config: ActionScalingConfig, observation: Any, target: Any) -> Any:
    """Return the corrections (N, 8) in [-1, 1] that result in the actions ``target`` (N, 8)."""
    scale = action_scales(config, observation).clip(MIN_SCALE, None)
    return ((target - observation[:, _EXPERT]) / _gains(scale)).clip(-1.0, 1.0)


def _gains(scale: Any) -> Any:
    """Return the factors (N, 8) on corrections for the scales (N, 1) of motions."""
    tensor = isinstance(scale, torch.Tensor)
    is_gripper: Any = torch.tensor(_IS_GRIPPER) if tensor else np.array(_IS_GRIPPER)
    return scale + (GRIPPER_GAIN - scale) * is_gripper
