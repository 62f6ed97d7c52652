"""Observations and actions: the same functions in every engine and on the robot."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from articulate.robot.arm import Arm
from articulate.robot.control import GripperState
from articulate.robot.kinematics import relative, small_twist, tool_pose
from articulate.task.layout import Field, Layout
from articulate.task.randomization_config import GOAL_ERROR_RANGE
from articulate.task.task import beyond
from articulate.transforms import Array

LEAD_UNIT_M, LEAD_UNIT_RAD = 0.05, 0.2
"""Units of ``tracking_error``."""
BENT_UNIT_RAD = 0.1
"""Unit of ``joint_tracking_error``."""
BEYOND_UNIT = 0.05
"""Unit of ``goal_error_fine``, as a fraction of the part's way."""

OBSERVATION = Layout(
    (
        Field(name="joint_pos", size=7, unit="rad", frame="-", source="robot"),
        Field(name="joint_vel", size=7, unit="rad/s", frame="-", source="robot"),
        Field(name="joint_tracking_error", size=7, unit="0.1 rad", frame="-", source="plant"),
        Field(name="tracking_error", size=6, unit="0.05 m, 0.2 rad", frame="tool", source="plant"),
        Field(name="handle_pos", size=3, unit="0.2 m", frame="tool", source="estimator"),
        Field(
            name="handle_pos_fine", size=3, unit="0.02 m", frame="tool", source="estimator",
            low=-1.5, high=1.5,
        ),
        Field(name="handle_pos_predicted", size=3, unit="0.2 m", frame="target", source="estimator"),
        Field(
            name="handle_pos_predicted_fine", size=3, unit="0.02 m", frame="target", source="estimator",
            low=-1.5, high=1.5,
        ),
        Field(name="handle_axes", size=6, unit="1", frame="tool", source="estimator"),
        Field(name="part_open", size=1, unit="1", frame="-", source="estimator"),
        Field(
            name="goal_error_fine", size=1, unit="0.05", frame="-", source="estimator",
            low=GOAL_ERROR_RANGE[0] / BEYOND_UNIT, high=GOAL_ERROR_RANGE[1] / BEYOND_UNIT,
        ),
        Field(
            name="part_speed", size=1, unit="0.1 m/s or 0.1 rad/s", frame="-", source="estimator",
        ),
        Field(name="gripper_width", size=1, unit="0.05 m", frame="-", source="robot"),
        Field(name="gripper_speed", size=1, unit="0.1 m/s", frame="-", source="robot"),
        Field(name="measured_force", size=3, unit="10 N", frame="tool", source="robot"),
        Field(name="gripper_command", size=3, unit="1", frame="-", source="plant"),
        Field(
            name="pending_actions", size=7, unit="move_m, turn_rad, step_rad", frame="tool",
            source="plant",
        ),
        Field(name="last_action", size=8, unit="1", frame="-", source="policy", low=-1, high=1),
        Field(name="time_left", size=1, unit="1", frame="-", source="clock", low=0, high=1),
    )
)  # fmt: skip
"""What a policy sees.

``handle_pos_fine`` is ``handle_pos`` again, finer and only near the handle: of what an episode spans,
and a policy's input is normalised by, the centimetre that decides a grasp is too small a part.
``handle_pos_predicted`` is where the handle will be in the hand once all that was said has been done: from
the tool's target, and less the motions that are due. The arm is soft and the link late, so that
the hand is up to half a second behind; one who steers by where it *is* comes too far (the
predictor of O. J. M. Smith, 1957, without its model of the plant, as targets are known).
``goal_error_fine`` is ``part_open`` again, by how much the part is beyond the task's target, finer and
only near it, for the same reason; it is above 0 where the task is done, whichever way that is.
``measured_force`` is the net force of the surroundings on the hand as the arm feels it, filtered as
the judgement filters it (50 ms): an arm that stands a little ahead of its joints may be pressing,
or held by its own friction, and only this tells which.
``pending_actions`` is the sum of the motions that were said but not used yet, as they come late:
without it a policy cannot tell where its own words will lead the hand. What keeps them waiting
counts them; a link that is slow without saying so is not seen in it.
"""

ACTION = Layout(
    (
        Field(name="move", size=3, unit="move_m", frame="tool", source="policy", low=-1, high=1),
        Field(name="turn", size=3, unit="turn_rad", frame="tool", source="policy", low=-1, high=1),
        Field(name="elbow", size=1, unit="step_rad", frame="-", source="policy", low=-1, high=1),
        Field(name="hand", size=1, unit="1", frame="-", source="policy", low=-1, high=1),
    )
)
"""What a policy says: how the tool and the elbow move, and a number whose sign closes the hand."""

HANDLE_UNIT_M = 0.2
"""Unit of ``handle_pos`` and ``handle_pos_predicted`` [m]."""
NEAR_UNIT_M = 0.02
"""Unit of ``handle_pos_fine`` and ``handle_pos_predicted_fine`` [m]."""
WIDTH_UNIT_M = 0.05
"""Unit of ``gripper_width`` [m]."""
SPEED_UNIT_M_S = 0.1
"""Unit of ``gripper_speed`` [m/s]."""
FORCE_UNIT_N = 10.0
"""Unit of ``measured_force`` [N]."""
SINCE_S = 2.0
"""Time after a hand's command that is told apart [s]: its latency and its dwell lie within."""


@dataclass(frozen=True)
class Estimate:
    """What is known of N objects: from the simulator's truth plus noise, or from sensors."""

    T_wh: Array
    """Pose of the handle in the world (N, 4, 4): z towards the object, y the closing axis."""
    opened: Array
    """Fraction open (N,)."""
    speed: Array
    """Speed of the part, positive opening (N,) [m/s or rad/s]."""


def observation(
    arm: Arm,
    *,
    q: Array,
    dq: Array,
    target: Array,
    gripper_width: Array,
    gripper_speed: Array,
    measured_force: Array,
    gripper: GripperState,
    estimate: Estimate,
    last_action: Array,
    pending_actions: Array,
    move_m: float,
    time_left: Array,
    goal: float,
    closes: bool,
    T_wt: Array | None = None,
    T_wt_target: Array | None = None,
) -> Array:
    """Observations (N, size of :data:`OBSERVATION`).

    Args:
        arm: For its forward kinematics.
        q: Joint angles (N, 7) [rad].
        dq: Joint speeds (N, 7) [rad/s].
        target: Targets of the tick (N, 7) [rad].
        gripper_width: Opening between the fingers (N,) [m].
        gripper_speed: Its change over the last tick, positive opening (N,) [m/s]; it tells a hand
            that has closed on something from one that is still closing.
        measured_force: Net force of the surroundings on the hand, filtered, world axes (N, 3) [N].
        hand: What the hand was told.
        estimate: The object.
        last_action: The policy's last action (N, 8).
        pending_actions: Sum of the motions that were said but have not been used yet (N, 7).
        move_m: How far the tool goes along an axis for each 1 of them [m].
        time_left: Share of the episode that is left (N,).
        goal: Fraction open of the task's target.
        closes: Whether the part is moved towards its closed end.
        T_wt: Poses of the tool at ``q`` (N, 4, 4), where they are known already.
        T_wt_target: Those at ``target`` (N, 4, 4), likewise.
    """
    if T_wt is None:
        T_wt = tool_pose(arm, q)
    if T_wt_target is None:
        T_wt_target = tool_pose(arm, target)
    T_th = relative(T_wt, estimate.T_wh)
    lead = small_twist(relative(T_wt, T_wt_target))
    aimed = relative(T_wt_target, estimate.T_wh)[:, :3, 3] - move_m * pending_actions[:, :3]
    axes = np.concatenate([T_th[:, :3, 2], T_th[:, :3, 0]], axis=1)
    since = np.minimum(gripper.since_s, SINCE_S) / SINCE_S
    return OBSERVATION.pack(
        {
            "joint_pos": q,
            "joint_vel": dq,
            "joint_tracking_error": (target - q) / BENT_UNIT_RAD,
            "tracking_error": lead / np.repeat([LEAD_UNIT_M, LEAD_UNIT_RAD], 3),
            "handle_pos": T_th[:, :3, 3] / HANDLE_UNIT_M,
            "handle_pos_fine": T_th[:, :3, 3] / NEAR_UNIT_M,
            "handle_pos_predicted": aimed / HANDLE_UNIT_M,
            "handle_pos_predicted_fine": aimed / NEAR_UNIT_M,
            "handle_axes": axes,
            "part_open": estimate.opened,
            "goal_error_fine": beyond(estimate.opened, goal, closes=closes) / BEYOND_UNIT,
            "part_speed": 10.0 * estimate.speed,
            "gripper_width": gripper_width / WIDTH_UNIT_M,
            "gripper_speed": gripper_speed / SPEED_UNIT_M_S,
            "measured_force": np.einsum("nji,nj->ni", T_wt[:, :3, :3], measured_force) / FORCE_UNIT_N,
            "gripper_command": np.stack([gripper.smooth, gripper.wish, since], axis=1),
            "pending_actions": pending_actions,
            "last_action": last_action,
            "time_left": time_left,
        }
    )
