"""Scripted expert: a controller that operates the task's part.

It moves in front of the handle, approaches it straight, grasps it, leads the part along its path
and stays at the target. Closed fingers push a part without a handle that is to be closed, and hook
one behind its edge that is to be opened. Its inputs are available on a robot: the state of arm,
gripper and controller, and the estimated state of an object of nominal size. It uses the current
control step and the opening at which the last grasp was released, so it can act from any state. A
grasp that slipped off is repeated deeper, a blocked one less deep.

Its action is a field of the observation (:mod:`articulate.task.observation`), which policies
correct.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from articulate.assets.asset import Asset, Handle
from articulate.jit import row_function
from articulate.robot.config import ControlConfig
from articulate.robot.control import WIDEST_M
from articulate.robot.kinematics import write_small_twist
from articulate.task.grasp import HELD_SHARE, grasp_of
from articulate.task.object_placement import (
    HandlePath,
    ObjectPlacement,
    handle_path_of,
    write_handle_pose,
)
from articulate.task.task import Task
from articulate.transforms import Array, matrix_angle

if TYPE_CHECKING:
    from articulate.task.observation import ObservationInputs

STRAIGHT_M, STRAIGHT_RAD = (0.004, 0.010), 0.15
"""Lateral error of the gripper below which it approaches the handle straight, between thick and
thin handles, and angular error. The error of the estimated position should not keep it back."""
BACK = 2.5, 0.15
"""Distance before the handle at larger errors, per metre and per radian beyond them [1, m]."""
MAX_BACK_M = 0.08
"""Largest such distance [m]."""
RETREAT_M = 0.05
"""Distance before the handle to which a gripper retreats that has closed on nothing [m]."""
DEEP_M, TIP_M = 0.003, 0.010
"""Largest distance beyond a knob's middle at which the fingers close, and half the length of a
finger along the approach, which must fit behind it [m]."""
ALONG = 0.8
"""Graspable share of a handle's length."""
AT_M = (0.014, 0.008, 0.015)
"""Position error after all pending actions at which the gripper may close: along the handle,
across it, and in the direction of approach [m]."""
SOON_M = (0.02, 0.015, 0.04)
"""The same for the current position; the gripper closes with a latency."""
AT_RAD = 0.2
"""The same for the orientation [rad]."""
LOST_M = 0.03
"""A gripper with a close command that is farther away than this opens again [m]."""
SLOW = 0.6
"""Largest motion near the handle, as a share of the largest."""
HELD_M = 0.012
"""Excess of the finger opening over the handle's thickness up to which it counts as held [m]."""
LARGEST_SIZE = 1.15
"""Size of the largest object, relative to the nominal one whose handle's thickness is known."""
BESIDE_M = 0.02
"""Distance of the handle's side from the middle of the gripper up to which it may be between the
fingers [m]."""
BLOCKED_S = 2.0
"""Time since the command to close after which fingers at rest that hold nothing are blocked [s]:
the latency of a gripper and its longest travel."""
REST_M = 0.001
"""Change of the finger opening in a control step below which fingers are at rest [m]."""
DEEPER_M, SHALLOWER_M = 0.004, 0.006
"""Changes of the depth of a grasp, after one that slipped off and after one that was blocked
[m]."""
PRESS_N, BACK_OFF_M = 6.0, 0.010
"""Force against the approach above which the gripper backs off, and distance [N, m]: fingertips
that press on a part do not centre its handle."""
ROOM_M = 0.004
"""Least room between a finger and the side of a handle [m]."""
MOVED_M = 0.003
"""Distance by which fingers that hold something are closer together than open ones [m]."""
SHUT_M = 0.04
"""Finger opening below which a gripper without a handle has closed on nothing [m]."""
LEAD_M = 0.12
"""Distance by which the gripper leads a part that it moves [m]."""
BRAKE, MIN_LEAD_M = 0.5, 0.004
"""Near the target it leads by this share of the remaining path, and this much more [m]."""
TOGETHER = 0.75
"""While it leads a part, translation is slowed down by this share of the excess of rotation over
translation; otherwise the handle would turn in the fingers and spread them."""
STEP = 0.01
"""Step of the open fraction by which the travel of the handle is measured."""
PUSH_M = 0.012
"""Distance before a place to push at which closed fingers count as touching it [m]."""
HOOK_M = (0.03, 0.02, 0.008)
"""Largest distance from a place behind an edge at which closed fingers hook it: in the direction of
opening, across it, and in the direction of approach [m]."""
SHUT, BEYOND = 0.2, 1.08
"""Goal of the lead as a share of the target: well inside it for a part that closes, beyond it for
one that opens, at most half the way to its stop."""
HOOKED_BRAKE, HOOKED_BEYOND = 1.0, 1.15
"""``BRAKE`` and ``BEYOND`` for a part that is hooked: only its load holds it at the fingers, and
the arm yields to that load."""
HOOKED_M = 0.005
"""Distance by which fingers that pull are led deeper behind an edge, off which they slip [m]."""


class ExpertParams(NamedTuple):
    """Constants of the scripted expert for one task and handle."""

    move_m: float
    """Motion of the tool along an axis for an action of 1 [m]."""
    turn_rad: float
    """Rotation of the tool about an axis for an action of 1 [rad]."""
    path: HandlePath
    """Path of the handle in its own frame, where the axis of the joint is constant."""
    along_m: float
    """Distance from the handle's middle at which fingers may hold it [m]."""
    thick_m: float
    """Thickness of the handle between the fingers [m]."""
    deep_m: float
    """Distance beyond the middle of the handle at which the fingers close [m]."""
    beside_m: float
    """Position of the handle's middle along the closing axis [m]; the fingers may be centred
    anywhere from 0 to it."""
    shut: bool
    """True if closed fingers push or hook the part instead of holding it."""
    hooks: bool
    """True if they hook it."""
    aim: float
    """Open fraction to which the part is led."""


def expert_params(
    control: ControlConfig, task: Task, asset: Asset, placement: ObjectPlacement
) -> ExpertParams:
    """Return the constants of the scripted expert.

    Args:
        control: Control stack.
        task: Task.
        asset: Object with its handle as it is held (:func:`.object_placement.grasped`); without a
            handle, the expert goes to a point and stays there.
        placement: Placement of the object.
    """
    handle = asset.handle_of(task.joint)
    path = HandlePath(False, np.zeros(3), np.zeros(3), np.eye(4), 0.0, 0.0)
    if handle is not None:
        in_object = handle_path_of(asset, task.joint, flip=placement.flip)
        turn, pos = in_object.T_oh[:3, :3].T, in_object.T_oh[:3, 3]
        path = path._replace(
            hinge=bool(in_object.hinge),
            axis_o=turn @ in_object.axis_o,
            pivot_o=turn @ (in_object.pivot_o - pos),
            span=in_object.span,
        )
    grasp = grasp_of(handle, placement)
    return ExpertParams(
        move_m=control.move_m,
        turn_rad=control.turn_rad,
        path=path,
        along_m=grasp.along_m,
        thick_m=grasp.thick_m,
        deep_m=_deep_m(handle),
        beside_m=grasp.beside_m,
        shut=handle is not None and handle.shut,
        hooks=handle is not None and handle.kind == "hook",
        aim=_aim(task, handle),
    )


def _deep_m(handle: Handle | None) -> float:
    """Return the distance beyond the middle at which fingers close: a knob's front is round."""
    if handle is None or handle.kind != "knob":
        return 0.0
    return min(max(0.5 * handle.extent[2] - TIP_M, 0.0), DEEP_M)


def _aim(task: Task, handle: Handle | None) -> float:
    """Return the open fraction to which the part of ``task`` is led by ``handle``."""
    if task.closes:
        return SHUT * task.target
    stop = task.target * 1.1 if task.stop is None else 0.5 * (task.target + task.stop)
    hooks = handle is not None and handle.kind == "hook"
    return float(min((HOOKED_BEYOND if hooks else BEYOND) * task.target, stop))


@row_function
def write_expert_action(
    inputs: ObservationInputs,
    i: int,
    T_wh: Array,
    opened: float,
    force_w: Array,
    params: ExpertParams,
    out: Array,
) -> None:
    """Write the action of the expert in environment ``i``.

    Args:
        inputs: State of robot and controller.
        i: Index of the environment.
        T_wh: Estimated pose of the handle in the world (4, 4).
        opened: Estimated fraction open.
        force_w: Measured net force on the gripper, world axes (3,) [N].
        params: Constants.
        out: Output (8,); see :data:`.observation.ACTION`. The elbow does not move.
    """
    T_wa, T_ht, T_ha = np.empty((4, 4)), np.empty((4, 4)), np.empty((4, 4))
    _write_after_pending(inputs.T_wt_target[i], inputs.pending_actions[i], params, T_wa)
    _write_relative(T_wh, inputs.T_wt[i], T_ht)
    _write_relative(T_wh, T_wa, T_ha)
    commanded, width = inputs.gripper.command[i] > 0.0, inputs.gripper_width[i]
    between, empty = _between(T_ht, width, params)
    held = commanded and between and not empty
    held = held and width <= _widest_held(params)
    if params.shut:
        held, empty = _behind(T_ht) if params.hooks else _touching(T_ht), False
    at_rest = abs(width - inputs.last_gripper_width[i]) < REST_M and width < WIDEST_M - MOVED_M
    blocked = commanded and between and not held and not empty and not params.shut
    blocked = blocked and at_rest and inputs.gripper.since_s[i] >= BLOCKED_S
    near, at = _at_handle(T_ht, T_ha, params)
    T_goal = np.empty((4, 4))
    if held:
        _write_ahead(T_wh, T_ht, opened, params, T_goal)
    else:
        depth = _depth(inputs.gripper.release_width[i], params)
        if not params.shut and _pressing(inputs.T_wt[i], force_w) > PRESS_N:
            depth = min(depth, T_ht[2, 3] - BACK_OFF_M)
        _write_before(T_wh, T_ha, empty, depth, params, T_goal)
    write_small_twist(T_wa, T_goal, out[:6])
    _limit(out, SLOW if near and not held else 1.0, held, params)
    close = (held or at or (commanded and near)) and not (empty or blocked)
    out[6], out[7] = 0.0, 1.0 if close or params.shut else -1.0


@row_function
def _widest_held(params: ExpertParams) -> float:
    """Return the finger opening up to which the handle counts as held [m]."""
    return float(min(LARGEST_SIZE * params.thick_m + HELD_M, WIDEST_M - MOVED_M))


@row_function
def _depth(release_width: float, params: ExpertParams) -> float:
    """Return the depth of a grasp beyond the middle of the handle [m], after the last one."""
    if release_width < HELD_SHARE * params.thick_m:
        return params.deep_m + DEEPER_M
    if _widest_held(params) < release_width < WIDEST_M - MOVED_M:
        return params.deep_m - SHALLOWER_M
    return params.deep_m


@row_function
def _pressing(T_wt: Array, force_w: Array) -> float:
    """Return the force of the surroundings on the gripper against its approach [N]."""
    return -float(T_wt[0, 2] * force_w[0] + T_wt[1, 2] * force_w[1] + T_wt[2, 2] * force_w[2])


@row_function
def _write_after_pending(T_wt: Array, pending: Array, params: ExpertParams, out: Array) -> None:
    """Write the pose of a tool at ``T_wt`` (4, 4) after small motions ``pending`` (7,)."""
    x, y, z = pending[3] * params.turn_rad, pending[4] * params.turn_rad, pending[5]
    z *= params.turn_rad
    for r in range(3):
        a, b, c = T_wt[r, 0], T_wt[r, 1], T_wt[r, 2]
        out[r, 0] = a + b * z - c * y
        out[r, 1] = b - a * z + c * x
        out[r, 2] = c + a * y - b * x
        move = a * pending[0] + b * pending[1] + c * pending[2]
        out[r, 3] = T_wt[r, 3] + params.move_m * move
        out[3, r] = 0.0
    out[3, 3] = 1.0


@row_function
def _write_relative(T_wa: Array, T_wb: Array, out: Array) -> None:
    """Write the pose of frame b in frame a (4, 4)."""
    for r in range(3):
        for c in range(4):
            total = 0.0
            for j in range(3):
                value = T_wb[j, c] - T_wa[j, 3] if c == 3 else T_wb[j, c]
                total += T_wa[j, r] * value
            out[r, c] = total
        out[3, r] = 0.0
    out[3, 3] = 1.0


@row_function
def _write_product(T_wa: Array, T_ab: Array, out: Array) -> None:
    """Write the pose of frame b in the world (4, 4)."""
    for r in range(3):
        for c in range(4):
            total = T_wa[r, 3] if c == 3 else 0.0
            for j in range(3):
                total += T_wa[r, j] * T_ab[j, c]
            out[r, c] = total
        out[3, r] = 0.0
    out[3, 3] = 1.0


@row_function
def _between(T_ht: Array, width: float, params: ExpertParams) -> tuple[bool, bool]:
    """Return whether the handle is between the fingers, and whether they closed on nothing."""
    across = T_ht[1, 3]
    across -= min(max(across, min(params.beside_m, 0.0)), max(params.beside_m, 0.0))
    between = abs(across) <= 0.5 * params.thick_m + BESIDE_M and abs(T_ht[2, 3]) <= LOST_M
    return between, width < (HELD_SHARE * params.thick_m if between else SHUT_M)


@row_function
def _touching(T_ht: Array) -> bool:
    """Return whether closed fingers are at the place to push."""
    beside = np.sqrt(T_ht[0, 3] ** 2 + T_ht[1, 3] ** 2) < LOST_M
    return bool(beside and T_ht[2, 3] > -PUSH_M)


@row_function
def _behind(T_ht: Array) -> bool:
    """Return whether closed fingers are behind the edge that they hook."""
    beside = abs(T_ht[0, 3]) < HOOK_M[0] and abs(T_ht[1, 3]) < HOOK_M[1]
    return bool(beside and -T_ht[2, 3] < HOOK_M[2])


@row_function
def _beside(x: float, params: ExpertParams) -> float:
    """Return the distance from ``x`` to the graspable part of the handle along it [m]."""
    most = ALONG * params.along_m
    return x - min(max(x, -most), most)


@row_function
def _at_handle(T_ht: Array, T_ha: Array, params: ExpertParams) -> tuple[bool, bool]:
    """Return whether the gripper is near the handle, and whether it may close there."""
    turned = matrix_angle(T_ht)
    near, at = turned < 2.0 * AT_RAD, turned < AT_RAD
    for r in range(3):
        now, soon = T_ht[r, 3], T_ha[r, 3]
        if r == 0:
            now, soon = _beside(now, params), _beside(soon, params)
        near = near and abs(now) < LOST_M
        at = at and abs(soon) < AT_M[r] and abs(now) < SOON_M[r]
    return near, at


@row_function
def _write_before(
    T_wh: Array, T_ha: Array, retreat: bool, depth: float, params: ExpertParams, out: Array
) -> None:
    """Write the goal pose (4, 4) of an open gripper, ``depth`` [m] beyond the handle's middle."""
    beside = _beside(T_ha[0, 3], params)
    lateral = np.sqrt(beside**2 + T_ha[1, 3] ** 2)
    straight = 0.5 * (WIDEST_M - params.thick_m) - ROOM_M
    straight = min(max(straight, STRAIGHT_M[0]), STRAIGHT_M[1])
    if params.hooks:
        straight = STRAIGHT_M[0]
    back = BACK[0] * max(lateral - straight, 0.0)
    back += BACK[1] * max(matrix_angle(T_ha) - STRAIGHT_RAD, 0.0)
    back = min(RETREAT_M if retreat else back, MAX_BACK_M)
    T_hg = np.eye(4)
    T_hg[0, 3], T_hg[2, 3] = T_ha[0, 3] - beside, depth - back
    _write_product(T_wh, T_hg, out)


@row_function
def _write_ahead(T_wh: Array, T_ht: Array, opened: float, params: ExpertParams, out: Array) -> None:
    """Write the goal pose (4, 4) of a gripper that leads the part, grasp kept.

    Fingers that hook it stay as deep behind its edge as they should be.
    """
    T_hn, T_wn, left = np.empty((4, 4)), np.empty((4, 4)), params.aim - opened
    sign = 1.0 if left > 0.0 else -1.0
    write_handle_pose(params.path, np.eye(4), 1.0, STEP * sign, T_hn)
    travel = np.sqrt(T_hn[0, 3] ** 2 + T_hn[1, 3] ** 2 + T_hn[2, 3] ** 2) / STEP
    brake = HOOKED_BRAKE if params.hooks else BRAKE
    lead = min(LEAD_M, brake * abs(left) * travel + MIN_LEAD_M)
    ahead = sign * min(abs(left), lead / max(travel, 1e-6))
    write_handle_pose(params.path, T_wh, 1.0, ahead, T_wn)
    T_nt = T_ht
    if params.hooks:
        T_nt = np.eye(4)
        T_nt[0, 3], T_nt[2, 3] = T_ht[0, 3], HOOKED_M
    _write_product(T_wn, T_nt, out)


@row_function
def _limit(twist: Array, limit: float, held: bool, params: ExpertParams) -> None:
    """Turn a motion [m, rad] into an action with numbers up to ``limit``, its direction kept."""
    sizes = np.zeros(2)
    for k in range(6):
        twist[k] /= params.move_m if k < 3 else params.turn_rad
        sizes[k // 3] = max(sizes[k // 3], abs(twist[k]))
    largest = max(sizes[0], sizes[1])
    for k in range(6):
        size = sizes[k // 3]
        if held:
            size = max(size, TOGETHER * largest)
        twist[k] *= limit / max(size, limit)
