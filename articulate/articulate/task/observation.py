"""Observations and actions of a policy: the same functions in every engine and on the robot."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from articulate.assets.asset import Asset
from articulate.jit import row_function
from articulate.robot.config import ControlConfig
from articulate.robot.control import GripperState
from articulate.robot.kinematics import write_small_twist
from articulate.task.layout import Field, Layout
from articulate.task.object_placement import ObjectPlacement
from articulate.task.randomization_config import GOAL_ERROR_RANGE
from articulate.task.scripted_expert import ExpertParams, expert_params, write_expert_action
from articulate.task.task import Task, goal_error
from articulate.transforms import Array

TRACKING_UNIT_M, TRACKING_UNIT_RAD = 0.05, 0.2
"""Units of ``tracking_error``."""
JOINT_TRACKING_UNIT_RAD = 0.1
"""Unit of ``joint_tracking_error`` [rad]."""
GOAL_ERROR_UNIT = 0.05
"""Unit of ``goal_error_fine``, as a fraction of the part's travel."""
HANDLE_UNIT_M = 0.2
"""Unit of ``handle_pos`` and ``handle_pos_predicted`` [m]."""
FINE_UNIT_M = 0.02
"""Unit of ``handle_pos_fine`` and ``handle_pos_predicted_fine`` [m]."""
PART_SPEED_UNIT = 0.1
"""Unit of ``part_speed`` [m/s or rad/s]."""
WIDTH_UNIT_M = 0.05
"""Unit of ``gripper_width`` and ``release_width`` [m]."""
GRIPPER_SPEED_UNIT_M_S = 0.1
"""Unit of ``gripper_speed`` [m/s]."""
FORCE_UNIT_N = 10.0
"""Unit of ``measured_force`` [N]."""
COMMAND_TIME_S = 2.0
"""Saturation of the time since a gripper command [s]: above its latency and its dwell."""
ROTATION_UNIT_RAD_M = 5.0
"""Unit of ``path_rotation`` [rad/m]."""
SIZE_UNIT_M = 0.05
"""Unit of ``handle_size`` [m]."""
MIN_RADIUS_M = 1e-3
"""Least radius of a handle's path about a hinge [m]."""

OBSERVATION = Layout(
    (
        Field(name="joint_pos", size=7, unit="rad", frame="-", source="robot"),
        Field(name="joint_vel", size=7, unit="rad/s", frame="-", source="robot"),
        Field(name="joint_tracking_error", size=7, unit="0.1 rad", frame="-", source="controller"),
        Field(
            name="tracking_error", size=6, unit="0.05 m, 0.2 rad", frame="tool",
            source="controller",
        ),
        Field(name="handle_pos", size=3, unit="0.2 m", frame="tool", source="estimator"),
        Field(
            name="handle_pos_fine", size=3, unit="0.02 m", frame="tool", source="estimator",
            low=-1.5, high=1.5,
        ),
        Field(
            name="handle_pos_predicted", size=3, unit="0.2 m", frame="target", source="estimator"
        ),
        Field(
            name="handle_pos_predicted_fine", size=3, unit="0.02 m", frame="target",
            source="estimator", low=-1.5, high=1.5,
        ),
        Field(name="handle_axes", size=6, unit="1", frame="tool", source="estimator"),
        Field(name="part_open", size=1, unit="1", frame="-", source="estimator"),
        Field(
            name="goal_error_fine", size=1, unit="0.05", frame="-", source="estimator",
            low=GOAL_ERROR_RANGE[0] / GOAL_ERROR_UNIT, high=GOAL_ERROR_RANGE[1] / GOAL_ERROR_UNIT,
        ),
        Field(
            name="part_speed", size=1, unit="0.1 m/s or 0.1 rad/s", frame="-", source="estimator",
        ),
        Field(name="gripper_width", size=1, unit="0.05 m", frame="-", source="robot"),
        Field(name="gripper_speed", size=1, unit="0.1 m/s", frame="-", source="robot"),
        Field(name="measured_force", size=3, unit="10 N", frame="tool", source="robot"),
        Field(name="gripper_command", size=3, unit="1", frame="-", source="controller"),
        Field(name="release_width", size=1, unit="0.05 m", frame="-", source="controller"),
        Field(
            name="pending_actions", size=7, unit="move_m, turn_rad, step_rad", frame="tool",
            source="controller",
        ),
        Field(name="last_action", size=8, unit="1", frame="-", source="policy", low=-1, high=1),
        Field(name="time_left", size=1, unit="1", frame="-", source="clock", low=0, high=1),
        Field(name="path_direction", size=3, unit="1", frame="tool", source="estimator"),
        Field(name="path_rotation", size=3, unit="5 rad/m", frame="tool", source="estimator"),
        Field(name="path_left", size=1, unit="0.2 m", frame="-", source="estimator"),
        Field(
            name="path_left_fine", size=1, unit="0.02 m", frame="-", source="estimator",
            low=-1.5, high=1.5,
        ),
        Field(name="handle_size", size=3, unit="0.05 m", frame="-", source="estimator"),
        Field(
            name="expert_action", size=8, unit="1", frame="tool", source="expert", low=-1, high=1
        ),
    )
)  # fmt: skip
"""Inputs of a policy, in order.

``handle_pos_fine`` repeats ``handle_pos`` at a finer scale near the handle: inputs are normalised
by their range over an episode, of which the centimetre that decides a grasp is too small a part.
``handle_pos_predicted`` is the handle relative to the tool once all requests have been executed:
from the tool's target, less the pending actions. The arm is compliant and the link late, so the
tool lags by up to half a second, and steering by its present position overshoots (the predictor of
O. J. M. Smith, 1957, without its model of the controlled system, as targets are known).
``goal_error_fine`` repeats ``part_open`` relative to the task's target, at a finer scale near it;
it is above 0 beyond the target, for opening and closing tasks.
``measured_force`` is the net force of the surroundings on the gripper as the arm measures it, under
the filter of the episode monitor (50 ms): the tracking error cannot distinguish contact from the
arm's own friction.
``release_width`` is the opening between the fingers at the last command to open. It distinguishes a
grasp that slipped off from one that was blocked.
``pending_actions`` is the sum of the motions that were requested and have not acted yet: without
it a policy cannot predict the tool under action latency. Latency that the controller does not
know about is not in it.
``path_direction`` is the direction in which the handle moves towards the target, ``path_rotation``
the rotation of the part per metre of that motion (0 for slides), ``path_left`` the length of the
path to the target and ``handle_size`` the extent of the handle along its long axis, between the
fingers and along the approach. They describe the task without the identity of the object, at its
nominal size.
``expert_action`` is the action of the scripted expert at the estimated state
(:mod:`articulate.task.scripted_expert`), with the layout :data:`ACTION`. It operates most objects;
a policy corrects it.
"""

ACTION = Layout(
    (
        Field(name="move", size=3, unit="move_m", frame="tool", source="policy", low=-1, high=1),
        Field(name="turn", size=3, unit="turn_rad", frame="tool", source="policy", low=-1, high=1),
        Field(name="elbow", size=1, unit="step_rad", frame="-", source="policy", low=-1, high=1),
        Field(name="gripper", size=1, unit="1", frame="-", source="policy", low=-1, high=1),
    )
)
"""Outputs of a policy: motion of tool and elbow, and a number whose sign closes the gripper."""

_SIZE, _LOW, _HIGH = OBSERVATION.size, OBSERVATION.low, OBSERVATION.high
(
    _JOINT_POS, _JOINT_VEL, _JOINT_TRACKING, _TRACKING, _HANDLE, _HANDLE_FINE, _PREDICTED,
    _PREDICTED_FINE, _AXES, _OPEN, _GOAL_ERROR, _PART_SPEED, _WIDTH, _GRIPPER_SPEED, _FORCE,
    _COMMAND, _RELEASE, _PENDING, _LAST_ACTION, _TIME_LEFT, _DIRECTION, _ROTATION, _LEFT,
    _LEFT_FINE, _HANDLE_SIZE, _EXPERT,
) = (OBSERVATION.slice(f.name).start for f in OBSERVATION.fields)  # fmt: skip


@dataclass(frozen=True)
class Estimate:
    """Estimated state of N objects: the simulator's state with noise, or from sensors."""

    T_wh: Array
    """Pose of the handle in the world (N, 4, 4): z towards the object, y the closing axis."""
    opened: Array
    """Fraction open (N,)."""
    speed: Array
    """Speed of the part, positive opening (N,) [m/s or rad/s]."""


class ObservationInputs(NamedTuple):
    """State of robot and controller of N environments that observations are made of."""

    q: Array
    """Joint angles (N, 7) [rad]."""
    dq: Array
    """Joint speeds (N, 7) [rad/s]."""
    target: Array
    """Targets (N, 7) [rad]."""
    T_wt: Array
    """Poses of the tool at ``q`` (N, 4, 4)."""
    T_wt_target: Array
    """Poses of the tool at ``target`` (N, 4, 4)."""
    gripper: GripperState
    """Commands of the gripper."""
    gripper_width: Array
    """Opening between the fingers (N,) [m]."""
    last_gripper_width: Array
    """Opening one control step earlier (N,) [m]; its change separates grasping from closing."""
    pending_actions: Array
    """Sum of the motions that were requested and have not acted yet (N, 7)."""
    last_action: Array
    """Last action of the policy (N, 8)."""


class ObservationParams(NamedTuple):
    """Constants of :func:`write_observation`."""

    step_s: float
    """Length of a control step [s]."""
    move_m: float
    """Motion of the tool along an axis for an action of 1 [m]."""
    target: float
    """Fraction open of the task's target."""
    closes: bool
    """True if the task moves the part towards its closed end."""
    direction_h: Array
    """Direction of the handle's motion towards the target, in its frame (3,)."""
    rotation_h: Array
    """Rotation of the part per metre of that motion, in the same frame (3,) [rad/m]."""
    travel_m: float
    """Length of the handle's path from closed to open [m]."""
    handle_size: Array
    """Extent of the handle (3,) [m]; see :attr:`articulate.assets.asset.Handle.extent`."""
    expert: ExpertParams
    """Constants of the scripted expert."""


def observation_params(
    control: ControlConfig, task: Task, asset: Asset, placement: ObjectPlacement
) -> ObservationParams:
    """Return the constants of the observations of one task.

    Args:
        control: Control stack.
        task: Task.
        asset: Object with its handle as it is held (:func:`.object_placement.grasped`); without a
            handle, all constants of the handle are 0.
        placement: Placement of the object.
    """
    expert, handle = expert_params(control, task, asset, placement), asset.handle_of(task.joint)
    motion, turn = expert.path.axis_o, np.zeros(3)  # per unit of the joint, in the handle's frame
    if expert.path.hinge:
        motion, turn = np.cross(motion, -expert.path.pivot_o), motion
    radius = max(float(np.linalg.norm(motion)), MIN_RADIUS_M)
    sign = np.sign(task.span) * (-1.0 if task.closes else 1.0) / radius
    return ObservationParams(
        step_s=control.step_s,
        move_m=control.move_m,
        target=float(task.target),
        closes=task.closes,
        direction_h=sign * motion,
        rotation_h=sign * turn,
        travel_m=0.0 if handle is None else radius * abs(task.span),
        handle_size=np.zeros(3) if handle is None else np.array(handle.extent, dtype=np.float64),
        expert=expert,
    )


@row_function
def _write_path(
    T_wt: Array, T_wh: Array, opened: float, params: ObservationParams, out: Array
) -> None:
    """Write the path and the size of a handle at ``T_wh`` (4, 4) for a tool at ``T_wt`` (4, 4)."""
    for r in range(3):
        along = around = 0.0
        for j in range(3):
            for k in range(3):
                along += T_wt[j, r] * T_wh[j, k] * params.direction_h[k]
                around += T_wt[j, r] * T_wh[j, k] * params.rotation_h[k]
        out[_DIRECTION + r] = along
        out[_ROTATION + r] = around / ROTATION_UNIT_RAD_M
        out[_HANDLE_SIZE + r] = params.handle_size[r] / SIZE_UNIT_M
    left = -params.travel_m * goal_error(opened, params.target, params.closes)
    out[_LEFT] = left / HANDLE_UNIT_M
    out[_LEFT_FINE] = left / FINE_UNIT_M


@row_function
def write_observation(
    inputs: ObservationInputs,
    i: int,
    T_wh: Array,
    opened: float,
    speed: float,
    force_w: Array,
    time_left: float,
    params: ObservationParams,
    out: Array,
) -> None:
    """Write the observation of environment ``i``.

    Args:
        inputs: State of robot and controller.
        i: Index of the environment.
        T_wh: Estimated pose of the handle in the world (4, 4).
        opened: Estimated fraction open.
        speed: Estimated speed of the part, positive opening [m/s or rad/s].
        force_w: Measured net force on the gripper, filtered, world axes (3,) [N].
        time_left: Share of the episode that is left.
        params: Scales and target.
        out: Output (size of :data:`OBSERVATION`,), clipped to the layout's bounds.
    """
    T, T_target = inputs.T_wt[i], inputs.T_wt_target[i]
    for j in range(7):
        q = inputs.q[i, j]
        out[_JOINT_POS + j] = q
        out[_JOINT_VEL + j] = inputs.dq[i, j]
        out[_JOINT_TRACKING + j] = (inputs.target[i, j] - q) / JOINT_TRACKING_UNIT_RAD
    write_small_twist(T, T_target, out[_TRACKING : _TRACKING + 6])
    for r in range(3):
        out[_TRACKING + r] /= TRACKING_UNIT_M
        out[_TRACKING + 3 + r] /= TRACKING_UNIT_RAD
    for r in range(3):
        pos = predicted = z = x = force = 0.0
        for j in range(3):
            pos += T[j, r] * (T_wh[j, 3] - T[j, 3])
            predicted += T_target[j, r] * (T_wh[j, 3] - T_target[j, 3])
            z += T[j, r] * T_wh[j, 2]
            x += T[j, r] * T_wh[j, 0]
            force += T[j, r] * force_w[j]
        predicted -= params.move_m * inputs.pending_actions[i, r]
        out[_HANDLE + r] = pos / HANDLE_UNIT_M
        out[_HANDLE_FINE + r] = pos / FINE_UNIT_M
        out[_PREDICTED + r] = predicted / HANDLE_UNIT_M
        out[_PREDICTED_FINE + r] = predicted / FINE_UNIT_M
        out[_AXES + r] = z
        out[_AXES + 3 + r] = x
        out[_FORCE + r] = force / FORCE_UNIT_N
    out[_OPEN] = opened
    out[_GOAL_ERROR] = goal_error(opened, params.target, params.closes) / GOAL_ERROR_UNIT
    out[_PART_SPEED] = speed * (1.0 / PART_SPEED_UNIT)
    width = inputs.gripper_width[i]
    out[_WIDTH] = width / WIDTH_UNIT_M
    out[_GRIPPER_SPEED] = (
        (width - inputs.last_gripper_width[i]) / params.step_s / GRIPPER_SPEED_UNIT_M_S
    )
    out[_COMMAND] = inputs.gripper.smooth[i]
    out[_COMMAND + 1] = inputs.gripper.command[i]
    out[_COMMAND + 2] = min(inputs.gripper.since_s[i], COMMAND_TIME_S) / COMMAND_TIME_S
    out[_RELEASE] = inputs.gripper.release_width[i] / WIDTH_UNIT_M
    for j in range(7):
        out[_PENDING + j] = inputs.pending_actions[i, j]
    for j in range(8):
        out[_LAST_ACTION + j] = inputs.last_action[i, j]
    out[_TIME_LEFT] = time_left
    _write_path(T, T_wh, opened, params, out)
    write_expert_action(inputs, i, T_wh, opened, force_w, params.expert, out[_EXPERT:])
    for j in range(_SIZE):  # comparisons, which keep a NaN
        if out[j] < _LOW[j]:
            out[j] = _LOW[j]
        elif out[j] > _HIGH[j]:
            out[j] = _HIGH[j]


def observation(
    inputs: ObservationInputs,
    estimate: Estimate,
    measured_force: Array,
    time_left: float,
    params: ObservationParams,
) -> Array:
    """Return the observations (N, size of :data:`OBSERVATION`).

    Args:
        inputs: State of robot and controller of N environments.
        estimate: Estimated state of their objects.
        measured_force: Net force of the surroundings on the gripper, world axes (N, 3) [N].
        time_left: Share of the episode that is left.
        params: Scales and target.
    """
    out = np.empty((len(inputs.q), _SIZE))
    for i, row in enumerate(out):
        write_observation(
            inputs,
            i,
            estimate.T_wh[i],
            estimate.opened[i],
            estimate.speed[i],
            measured_force[i],
            time_left,
            params,
            row,
        )
    return out


def expert_action(observation: Any) -> Array:
    """Return the actions (N, 8) of the scripted expert in observations (N, size)."""
    return np.asarray(observation[:, _EXPERT : _EXPERT + ACTION.size], dtype=np.float64)
