"""Actions as corrections of the scripted expert, scaled at the goal.

A policy does not begin from nothing: the action of the scripted expert is part of its observation,
and the network's eight numbers in [-1, 1] are added to it (residual policy learning: Silver et al.
2018, arXiv:1812.06298; Johannink et al. 2019, arXiv:1812.03201). A network that returns 0 acts as
the expert.

The unit of a motion is the largest motion of a control step. Corrections of motions are scaled down
where the part is at its goal. Training and the exported network apply the same formula, so engines
and robots need not.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import torch

from articulate.task.observation import ACTION, GOAL_ERROR_UNIT, OBSERVATION
from articulate_train.config import ActionScalingConfig

_GOAL_ERROR = OBSERVATION.slice("goal_error_fine")
_EXPERT = OBSERVATION.slice("expert_action")
GRIPPER_GAIN = 2.0
"""Factor on the correction of the gripper, so that it can reverse the expert's command."""
_IS_GRIPPER = (0.0,) * (ACTION.size - 1) + (1.0,)


def action_scales(config: ActionScalingConfig, observation: Any) -> Any:
    """Return the scales (N, 1) of motions, in [0, 1], at raw observations (N, size).

    Works on NumPy arrays and torch tensors.
    """
    first, last = config.goal_range
    beyond = observation[:, _GOAL_ERROR] * GOAL_ERROR_UNIT
    done = ((beyond - first) / (last - first)).clip(0.0, 1.0)
    return 1.0 - done * (1.0 - config.at_goal)


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
    gains = _gains(action_scales(config, observation))
    return ((target - observation[:, _EXPERT]) / gains).clip(-1.0, 1.0)


def _gains(scale: Any) -> Any:
    """Return the factors (N, 8) on corrections for the scales (N, 1) of motions."""
    tensor = isinstance(scale, torch.Tensor)
    is_gripper: Any = torch.tensor(_IS_GRIPPER) if tensor else np.array(_IS_GRIPPER)
    return scale + (GRIPPER_GAIN - scale) * is_gripper
