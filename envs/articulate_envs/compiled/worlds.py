"""Host side of a control step on a device: controls of all physics steps, samples of all of them.

Set-point filters and fingers do not depend on the physics, and the episode monitor does not change
it. So the functions of :mod:`.step` run before and after the physics steps instead of between them.
"""

from __future__ import annotations

import numpy as np

from articulate.jit import row_function
from articulate.robot.control import TargetParams, TargetWorkspace, target_workspace, update_targets
from articulate.transforms import Array, Mask
from articulate_envs.compiled.entry_points import entry_point
from articulate_envs.compiled.step import (
    Buffers,
    ModelLayout,
    Poses,
    SubstepParams,
    post_substep,
    pre_substep,
    read_state,
    update_handle_pose,
    update_tool_poses,
)


@row_function
def write_controls(
    first: int,
    last: int,
    controls: Array,
    at: ModelLayout,
    params: SubstepParams,
    targets: TargetParams,
    motion: Array,
    retract: Mask,
    b: Buffers,
) -> None:
    """Write the controls of environments ``first`` to ``last`` - 1 for all physics steps.

    Args:
        first: First environment.
        last: Environment after the last.
        controls: Output (substeps, N, nu).
        at: Indices into MuJoCo's arrays.
        params: Constants of a physics step.
        targets: Constants of the targets.
        motion: Motions that act now (N, 7).
        retract: True where the force limit is exceeded (N,).
        b: Targets, filters and fingers are updated.
    """
    work: TargetWorkspace = target_workspace()
    ctrl = np.zeros(controls.shape[2])
    for i in range(first, last):
        update_targets(b.target[i], motion[i], b.q[i], retract[i], targets, work)
        if b.alive[i] == 0.0:
            continue
        for s in range(len(controls)):
            pre_substep(i, ctrl, at, params, b)
            for k in range(len(ctrl)):
                controls[s, i, k] = ctrl[k]


@row_function
def read_samples(
    first: int,
    last: int,
    samples: Array,
    qpos: Array,
    at: ModelLayout,
    params: SubstepParams,
    targets: TargetParams,
    b: Buffers,
    poses: Poses,
) -> None:
    """Monitor all physics steps of environments ``first`` to ``last`` - 1 and read their states.

    Args:
        first: First environment.
        last: Environment after the last.
        samples: For each physics step the velocities, actuator forces, sensors and position of the
            tool, in this order (substeps, N, 2 nv + nsensordata + 3).
        qpos: Positions at the end of the control step (N, nq).
        at: Indices into MuJoCo's arrays.
        params: Constants of a physics step.
        targets: Constants of the targets, with the geometry of the arm.
        b: Buffers, updated.
        poses: Poses, updated.
    """
    row, position = np.zeros(samples.shape[2]), np.zeros(qpos.shape[1])
    wrench, frames = np.zeros(6), np.zeros((7, 12))
    qvel, torque = row[: at.nv], row[at.nv : 2 * at.nv]
    sensors, tool_w = row[2 * at.nv : len(row) - 3], row[len(row) - 3 :]
    for i in range(first, last):
        if b.alive[i] != 0.0:
            for s in range(len(samples)):
                for k in range(len(row)):
                    row[k] = samples[s, i, k]
                if not post_substep(i, qvel, torque, sensors, tool_w, at, params, b, wrench):
                    break
            else:
                for k in range(len(position)):
                    position[k] = qpos[i, k]
                read_state(i, position, qvel, at, b)
        update_tool_poses(i, b, targets.geometry, frames, poses)
        update_handle_pose(i, b, poses)


compiled_write_controls = entry_point(write_controls)
compiled_read_samples = entry_point(read_samples)
