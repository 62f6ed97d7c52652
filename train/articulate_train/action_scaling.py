"""Action scaling near the handle and compensation of tracking error at the goal.

An action is eight numbers in [-1, 1]; the unit of a motion is the largest motion of a control step.
Within centimetres of the handle, where 5 mm decide a grasp, motions are scaled down by the handle's
predicted position (``handle_pos_predicted``) and the state of the gripper. The gripper lags by up
to 1 s, so an open-loop delay pulls too early; scaling holds until the fingers have closed. Motions
are scaled down again where the part is at its goal. Training and the exported network apply the
same formula, so engines and robots need not.

If the stop of a part is near its target, the excess of the tracking error is compensated as well
(:func:`lead_compensation`). A drawer that arrives at 0.16 m/s leads by 6 cm, which would
run it shut, and small actions would add up to a force at the stop.
"""

from __future__ import annotations

from functools import reduce
from typing import Any

from articulate.task.observation import (
    ACTION,
    GOAL_ERROR_UNIT,
    GRIPPER_SPEED_UNIT_M_S,
    HANDLE_UNIT_M,
    JOINT_TRACKING_UNIT_RAD,
    OBSERVATION,
    TRACKING_UNIT_M,
    WIDTH_UNIT_M,
)
from articulate_train.config import ActionScalingConfig

_HANDLE = OBSERVATION.slice("handle_pos_predicted")
_JOINT_ERROR, N_JOINTS = OBSERVATION.slice("joint_tracking_error"), 7
_TOOL_ERROR = OBSERVATION.slice("tracking_error")
_GOAL_ERROR = OBSERVATION.slice("goal_error_fine")
_COMMAND_START = OBSERVATION.slice("gripper_command").start
_COMMAND = slice(_COMMAND_START + 1, _COMMAND_START + 2)
_WIDTH, _SPEED = OBSERVATION.slice("gripper_width"), OBSERVATION.slice("gripper_speed")
FADE_IN = 0.1
"""Fraction of ``goal_range`` over which the compensation fades in."""
EPSILON = 1e-6
"""Added to tracking errors before division [m and rad]."""
ELBOW = ACTION.size - 2
"""Index of the elbow motion in an action; the numbers before it move and turn the tool."""
MOTIONS = ELBOW + 1
"""Number of motions in an action; the gripper command follows."""


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
    done = _fraction_of(observation, config.goal_range)
    return (1.0 - near * cut) * (1.0 - done * (1.0 - config.at_goal))


def lead_compensation(config: ActionScalingConfig, observation: Any) -> Any:
    """Return the tool motions (N, 6) subtracted from actions at raw observations (N, size)."""
    lead, bent = observation[:, _TOOL_ERROR], observation[:, _JOINT_ERROR]
    done = _fraction_of(observation, config.goal_range)
    stopped = _fraction_of(observation, config.stop_range)
    moved = (lead[:, :3] * lead[:, :3]).sum(-1, keepdims=True) ** 0.5 * TRACKING_UNIT_M
    turned = (
        reduce(_larger, (abs(bent[:, k : k + 1]) for k in range(N_JOINTS)))
        * JOINT_TRACKING_UNIT_RAD
    )
    excess: Any = 0.0
    for error, (first, last) in ((moved, config.max_lead_m), (turned, config.max_lead_rad)):
        allowed = (first + done * (last - first)) * (1.0 - stopped)
        excess = _larger(excess, (1.0 - allowed / (error + EPSILON)).clip(0.0, 1.0))
    return lead * config.lead_gain * excess * (done / FADE_IN).clip(0.0, 1.0)


def _larger(a: Any, b: Any) -> Any:
    """Elementwise maximum of arrays or tensors."""
    return (a + b + abs(a - b)) / 2.0


def _fraction_of(observation: Any, fractions: tuple[float, float]) -> Any:
    """Position of the part between two fractions of its travel (N, 1), clipped to [0, 1]."""
    first, last = fractions
    beyond = observation[:, _GOAL_ERROR] * GOAL_ERROR_UNIT
    return ((beyond - first) / (last - first)).clip(0.0, 1.0)
