"""Control step of the batched engine: targets, physics and episode monitor, without the GIL.

``step`` advances environments by one control step. It calls ``mj_step`` of MuJoCo's library through
its address and reads MuJoCo's arrays in place, so several Python threads run it side by side.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from articulate.jit import row_function
from articulate.robot.contact import contact_wrench
from articulate.robot.control import (
    ActionDelay,
    FingerParams,
    ForceLimits,
    GripperParams,
    GripperState,
    TargetParams,
    TargetWorkspace,
    apply_gripper_latency,
    delay_action,
    exceeds_force_limit,
    filter_step,
    finger_start,
    finger_step,
    send_gripper_command,
    sum_pending,
    target_workspace,
    update_targets,
)
from articulate.robot.kinematics import ArmGeometry, write_frames
from articulate.task.episode_monitor import MonitorParams, monitor_sample
from articulate.task.object_placement import HandlePath, write_handle_pose
from articulate.task.randomization import COLUMNS, push_is_active
from articulate.task.task import fraction_open
from articulate.transforms import Array, Ints, Mask
from articulate_envs.compiled.entry_points import entry_point
from articulate_envs.compiled.pointers import array_at, call, copy_numbers, test_and_set
from articulate_envs.compiled.rows import path_of

DIVERGED = 1e10
"""Speed from which a state counts as diverged [rad/s or m/s]; MuJoCo's ``mjMAXVAL``."""
_LATENCY = COLUMNS.index("gripper_latency_s")
_FORCE_BIAS, _PUSH = COLUMNS.index("force_bias_x_n"), COLUMNS.index("push_x_n")


class Buffers(NamedTuple):
    """State of N environments beside MuJoCo's."""

    filter: Array
    """States of the set-point filters (N, 7, 3)."""
    target: Array
    """Targets (N, 7) [rad]."""
    gripper: GripperState
    """Commands and motion of the grippers."""
    finger: Array
    """Set points of a finger (N,) [m]."""
    push: Array
    """Force on the moving part (N, 3) [N]."""
    samples: Array
    """Rows of the episode monitor (N, WIDTH)."""
    torque: Array
    """Torques of the last sample (N, 7) [Nm]."""
    q: Array
    """Joint angles (N, 7) [rad]."""
    dq: Array
    """Joint speeds (N, 7) [rad/s]."""
    gripper_width: Array
    """Openings between the fingers (N,) [m]."""
    part_pos: Array
    """Positions of the task's joint (N,) [m or rad]."""
    part_vel: Array
    """Speeds of the task's joint (N,) [m/s or rad/s]."""
    alive: Array
    """1 until the environment diverges, then 0 (N,)."""


class PreStepParams(NamedTuple):
    """Constants of :func:`pre_step`."""

    gripper: GripperParams
    force: ForceLimits
    step_s: float
    episode_s: float


class Poses(NamedTuple):
    """Poses of tools and handles of N environments."""

    path: HandlePath
    """Paths of the handles, stacked (:func:`.rows.stack_rows`)."""
    T_wo: Array
    """Poses of the objects in the world (N, 4, 4)."""
    scale: Array
    """Sizes of the objects (N,)."""
    joint_scale: Array
    """Factor of the joint's positions (N,): the size for slides, else 1."""
    opened: Array
    """Fractions open (N,)."""
    T_wh: Array
    """Poses of the handles in the world (N, 4, 4)."""
    T_wt: Array
    """Poses of the tools at the joints (N, 4, 4)."""
    T_wt_target: Array
    """Poses of the tools at the targets (N, 4, 4)."""


class ModelLayout(NamedTuple):
    """Sizes of MuJoCo's arrays of a scene and indices into them."""

    nq: int
    nv: int
    arm_q: int
    finger_q: int
    arm_ctrl: int
    finger_ctrl: int
    part_q: int
    part_v: int
    push_row: int
    tool_site: int
    gripper_sensor: int
    floor_sensor: int
    robot_sensor: int


class SubstepParams(NamedTuple):
    """Constants of a physics step."""

    substeps: int
    """Physics steps in a control step."""
    A: Array
    """Matrix of the set-point filter (3, 3)."""
    B: Array
    """Its input (3,)."""
    finger: FingerParams
    monitor: MonitorParams


class EnvironmentPointers(NamedTuple):
    """Addresses of the arrays that each of N environments keeps between control steps."""

    scene: Ints
    """Index of the scene (N,)."""
    model: Ints
    """Index of the model: of the scene and its size (N,)."""
    counts: Ints
    """Numbers in each of the F arrays in which models of one size differ (N, F)."""
    sampled: Ints
    """Addresses of those arrays (N, F)."""
    qpos: Ints
    qvel: Ints
    warm: Ints
    ctrl: Ints
    xfrc: Ints


class ThreadWorkspaces(NamedTuple):
    """Addresses of the models and data with which each of T threads steps environments in turn.

    A thread has one ``mjData`` of each of S scenes and one model of each of their sizes, M in all.
    The state of an environment is copied in and out, so all that a step reads and computes stays in
    the cache of a core. MuJoCo's time is not kept: nothing depends on it.
    """

    model: Ints
    """(T, M)."""
    sampled: Ints
    """(T, M, F)."""
    data: Ints
    """(T, S), as all that follow."""
    qpos: Ints
    qvel: Ints
    warm: Ints
    ctrl: Ints
    xfrc: Ints
    torque: Ints
    sensors: Ints
    site: Ints


@row_function
def layout_of(layouts: Ints, scene: int) -> ModelLayout:
    """Return row ``scene`` of ``layouts`` (S, 13), whose columns are those of a layout."""
    row = layouts[scene]
    return ModelLayout(
        row[0], row[1], row[2], row[3], row[4], row[5], row[6], row[7], row[8], row[9], row[10],
        row[11], row[12],
    )  # fmt: skip


@row_function
def pre_step(
    action: Array,
    delay: ActionDelay,
    retract: Mask,
    values: Array,
    step: Ints,
    params: PreStepParams,
    b: Buffers,
) -> None:
    """Take in actions and write all that is constant during a control step.

    Args:
        action: Actions of the policy (N, 8).
        delay: Motions that act later.
        retract: Output (N,): True where the force limit is exceeded.
        values: Episode parameters (N, columns).
        step: Control steps since the episode began (N,).
        params: Constants.
        b: Gripper commands, fingers and pushes are updated.
    """
    for i in range(len(action)):
        delay_action(delay, i, action[i])
        width = b.gripper_width[i]
        sent = send_gripper_command(b.gripper, i, action[i, 7], width, params.gripper)
        apply_gripper_latency(b.gripper, i, sent, values[i, _LATENCY], params.step_s)
        retract[i] = exceeds_force_limit(
            b.samples[i, 0] + values[i, _FORCE_BIAS],
            b.samples[i, 1] + values[i, _FORCE_BIAS + 1],
            b.samples[i, 2] + values[i, _FORCE_BIAS + 2],
            b.gripper.command[i],
            width,
            params.force,
        )
        b.finger[i] = finger_start(b.finger[i], width, b.gripper.closing[i])
        active = push_is_active(values[i], step[i] * params.step_s, params.episode_s)
        for k in range(3):
            b.push[i, k] = values[i, _PUSH + k] if active else 0.0


@row_function
def update_tool_poses(
    i: int, b: Buffers, geometry: ArmGeometry, frames: Array, poses: Poses
) -> None:
    """Write the poses of the tool of environment ``i`` at its joints and at its targets."""
    write_frames(b.q[i], geometry, frames, poses.T_wt[i])
    write_frames(b.target[i], geometry, frames, poses.T_wt_target[i])


@row_function
def update_handle_pose(i: int, b: Buffers, poses: Poses) -> None:
    """Write the fraction open and the pose of the handle of environment ``i``."""
    path, factor = path_of(poses.path, i), poses.joint_scale[i]
    opened = fraction_open(b.part_pos[i], factor * path.closed, factor * path.span)
    poses.opened[i] = opened
    write_handle_pose(path, poses.T_wo[i], poses.scale[i], opened, poses.T_wh[i])


@row_function
def refresh(
    rows: Ints, b: Buffers, delay: ActionDelay, geometry: ArmGeometry, poses: Poses
) -> None:
    """Write what the buffers of environments ``rows`` (M,) determine: poses, pending sums."""
    frames = np.zeros((7, 12))
    for i in rows:
        update_tool_poses(i, b, geometry, frames, poses)
        update_handle_pose(i, b, poses)
        sum_pending(delay, i)


@row_function
def pre_substep(i: int, ctrl: Array, at: ModelLayout, params: SubstepParams, b: Buffers) -> None:
    """Advance filter and fingers of environment ``i`` by a physics step and write its controls."""
    filter_step(b.filter[i], b.target[i], params.A, params.B)
    for k in range(7):
        ctrl[at.arm_ctrl + k] = b.filter[i, k, 0]
    b.finger[i] = finger_step(b.finger[i], b.gripper.closing[i], params.finger)
    ctrl[at.finger_ctrl] = b.finger[i]
    ctrl[at.finger_ctrl + 1] = -b.finger[i]


@row_function
def post_substep(
    i: int,
    qvel: Array,
    torque: Array,
    sensors: Array,
    tool_w: Array,
    at: ModelLayout,
    params: SubstepParams,
    b: Buffers,
    wrench: Array,
) -> bool:
    """Monitor a physics step of environment ``i``; return False if it has diverged.

    A diverged environment keeps its last finite state, and a NaN in its samples marks it.
    """
    for k in range(max(at.part_v, at.finger_q + 1) + 1):
        if not abs(qvel[k]) < DIVERGED:
            b.alive[i] = 0.0
            b.samples[i, 0] = np.nan  # not a peak: peaks stay valid
            return False
    contact = contact_wrench(
        sensors, at.gripper_sensor, at.floor_sensor, at.robot_sensor, tool_w, wrench
    )
    arm_v = at.arm_q
    monitor_sample(
        b.samples[i],
        qvel[arm_v : arm_v + 7],
        torque[arm_v : arm_v + 7],
        b.torque[i],
        wrench,
        contact,
        params.monitor,
    )
    return True


@row_function
def read_state(i: int, qpos: Array, qvel: Array, at: ModelLayout, b: Buffers) -> None:
    """Copy the state of environment ``i`` at the end of a control step into the buffers."""
    for k in range(7):
        b.q[i, k] = qpos[at.arm_q + k]
        b.dq[i, k] = qvel[at.arm_q + k]
    b.gripper_width[i] = qpos[at.finger_q] - qpos[at.finger_q + 1]
    b.part_pos[i] = qpos[at.part_q]
    b.part_vel[i] = qvel[at.part_v]


@row_function
def _simulate(
    i: int,
    thread: int,
    scene: int,
    model: int,
    mj_step: int,
    workspaces: ThreadWorkspaces,
    at: ModelLayout,
    params: SubstepParams,
    b: Buffers,
) -> None:
    """Run the physics steps of environment ``i`` in the workspace of a thread."""
    ctrl = array_at(workspaces.ctrl[thread, scene], at.finger_ctrl + 2)
    qpos = array_at(workspaces.qpos[thread, scene], at.nq)
    qvel = array_at(workspaces.qvel[thread, scene], at.nv)
    torque = array_at(workspaces.torque[thread, scene], at.arm_q + 7)
    sensors = array_at(workspaces.sensors[thread, scene], at.robot_sensor + 1)
    tool_w = array_at(workspaces.site[thread, scene] + 24 * at.tool_site, 3)
    wrench = np.zeros(6)
    for _ in range(params.substeps):
        pre_substep(i, ctrl, at, params, b)
        call(mj_step, model, workspaces.data[thread, scene])
        if not post_substep(i, qvel, torque, sensors, tool_w, at, params, b, wrench):
            return
    read_state(i, qpos, qvel, at, b)


@row_function
def _step_one(
    i: int,
    thread: int,
    mj_step: int,
    environments: EnvironmentPointers,
    workspaces: ThreadWorkspaces,
    layouts: Ints,
    params: SubstepParams,
    b: Buffers,
) -> None:
    """Copy environment ``i`` into the workspace of a thread, simulate it, and copy it back."""
    if b.alive[i] == 0.0:
        return
    scene, model = environments.scene[i], environments.model[i]
    at = layout_of(layouts, scene)
    for f in range(environments.counts.shape[1]):
        copy_numbers(
            environments.sampled[i, f],
            workspaces.sampled[thread, model, f],
            environments.counts[i, f],
        )
    copy_numbers(environments.qpos[i], workspaces.qpos[thread, scene], at.nq)
    copy_numbers(environments.qvel[i], workspaces.qvel[thread, scene], at.nv)
    copy_numbers(environments.warm[i], workspaces.warm[thread, scene], at.nv)
    push = array_at(environments.xfrc[i] + 48 * at.push_row, 3)
    for k in range(3):
        push[k] = b.push[i, k]
    copy_numbers(
        environments.xfrc[i] + 48 * at.push_row,
        workspaces.xfrc[thread, scene] + 48 * at.push_row,
        3,
    )
    address = workspaces.model[thread, model]
    _simulate(i, thread, scene, address, mj_step, workspaces, at, params, b)
    copy_numbers(workspaces.qpos[thread, scene], environments.qpos[i], at.nq)
    copy_numbers(workspaces.qvel[thread, scene], environments.qvel[i], at.nv)
    copy_numbers(workspaces.warm[thread, scene], environments.warm[i], at.nv)
    copy_numbers(workspaces.ctrl[thread, scene], environments.ctrl[i], at.finger_ctrl + 2)


@row_function
def step(
    thread: int,
    first: int,
    order: Ints,
    claimed: Ints,
    mj_step: int,
    environments: EnvironmentPointers,
    workspaces: ThreadWorkspaces,
    layouts: Ints,
    params: SubstepParams,
    targets: TargetParams,
    motion: Array,
    retract: Mask,
    b: Buffers,
    poses: Poses,
) -> None:
    """Advance all environments that no other thread has claimed by one control step.

    Args:
        thread: Index of this thread's workspace.
        first: Position in ``order`` from which this thread begins; a thread that is done helps the
            others.
        order: Environments (N,), those that read the same arrays side by side.
        claimed: 1 where a thread has claimed an environment (N,).
        mj_step: Address of MuJoCo's function.
        environments: Arrays of the environments.
        workspaces: Arrays of the threads.
        layouts: Sizes of MuJoCo's arrays of each scene and indices into them (S, 13).
        params: Constants of a physics step.
        targets: Constants of the targets.
        motion: Motions that act now (N, 7).
        retract: True where the force limit is exceeded (N,).
        b: Buffers, updated.
        poses: Poses, updated.
    """
    work: TargetWorkspace = target_workspace()
    n = len(claimed)
    for k in range(n):
        i = order[(first + k) % n]
        if claimed[i] != 0 or test_and_set(claimed.ctypes.data + 8 * i) != 0:
            continue
        update_targets(b.target[i], motion[i], b.q[i], retract[i], targets, work)
        _step_one(i, thread, mj_step, environments, workspaces, layouts, params, b)
        update_tool_poses(i, b, targets.geometry, work.frames, poses)
        update_handle_pose(i, b, poses)


compiled_pre_step = entry_point(pre_step)
compiled_step = entry_point(step)
compiled_refresh = entry_point(refresh)
compiled_workspace = entry_point(target_workspace)
compiled_update_targets = entry_point(update_targets)
compiled_pre_substep = entry_point(pre_substep)
compiled_post_substep = entry_point(post_substep)
