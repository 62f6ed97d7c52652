"""Check of the clearance of gripper and arm in the compiled scene."""

from __future__ import annotations

import numpy as np

from articulate.errors import PathError, ReachError
from articulate.simulator import mujoco
from articulate.task.object_placement import handle_in_world
from articulate.transforms import Array
from articulate_envs.compiled.inverse_kinematics import solve_ik
from articulate_envs.panda import BASE_BODY, GRIPPER_BODY
from articulate_envs.placement_search import MIN_SAMPLED_SHARE, opening_range
from articulate_envs.scene import PREFIX, Scene

MAX_OVERLAP_M = 0.003
"""Overlap of collision shapes of gripper and object that is accepted [m]."""
BACK_M = (0.0, 0.005, 0.01, 0.015)
"""Distances by which the gripper may stay behind the middle of the handle [m]."""


def check_grasp(scene: Scene) -> float:
    """Return the largest overlap [m] of an open gripper at the handle along the path.

    Of the positions :data:`BACK_M` at the handle the one with the least overlap counts.

    Raises:
        ReachError: There is no room for the fingers, sampled poses are out of reach, or the arm at
            its start collides with the object.
    """
    asset, task, placement = scene.asset, scene.task, scene.placement
    if placement.reachable_share < MIN_SAMPLED_SHARE:
        raise PathError(
            f"{asset.name}: the handle of {task.joint} can be followed to the target at only "
            f"{placement.reachable_share:.0%} of the sampled poses and sizes; try a smaller --size "
            "or smaller randomization ranges"
        )
    best = max(
        min(_overlap(scene, opened, back) for back in BACK_M)
        for opened in np.linspace(*opening_range(task), 3)
    )
    if best > MAX_OVERLAP_M:
        raise ReachError(
            f"{asset.name}: no room for the fingers at the handle of {task.joint}: an open gripper "
            f"overlaps the object by {1000 * best:.0f} mm; select another --joint or model a handle"
        )
    for opened in task.begin:
        if _deepest(scene, np.asarray(placement.start_q), opened, BASE_BODY) > 0.0:
            raise ReachError(
                f"{asset.name}: the arm at its start collides with the object when {task.joint} is "
                f"{opened:.0%} open; select another --joint or try a smaller --size"
            )
    return best


def _overlap(scene: Scene, opened: float, back_m: float) -> float:
    """Return the deepest contact [m] of the gripper, ``back_m`` behind the handle."""
    placement = scene.placement
    T_wh = handle_in_world(
        scene.asset,
        scene.task.joint,
        T_wo=placement.T_wo()[None],
        scale=np.ones(1),
        opened=np.full(1, opened),
        flip=placement.flip,
    )
    T_wh[:, :3, 3] -= back_m * T_wh[:, :3, 2]
    q = solve_ik(scene.arm, T_wh, np.asarray(placement.start_q), iterations=80).q[0]
    return _deepest(scene, q, opened, GRIPPER_BODY)


def _deepest(scene: Scene, q: Array, opened: float, above: str) -> float:
    """Return the deepest contact [m] of bodies from ``above`` on with the object at ``q`` (7,)."""
    model, at = scene.nominal, scene.at
    data = mujoco.MjData(model)
    for joint in scene.asset.joints:
        part = opened if joint.name == scene.task.joint else 0.0
        data.joint(PREFIX + joint.name).qpos[0] = joint.closed + part * joint.span
    handle = scene.asset.handle_of(scene.task.joint)
    pushes = handle is not None and handle.kind == "push"
    half = 0.0 if pushes else scene.arm.gripper.max_width_m / 2.0
    data.qpos[at.arm_q : at.arm_q + 7] = q
    data.qpos[at.finger_q : at.finger_q + 2] = (half, -half)
    mujoco.mj_forward(model, data)
    first = model.body(above).id
    deepest = 0.0
    for contact in data.contact:
        bodies = model.geom_bodyid[contact.geom]
        names = [model.body(b).name for b in bodies]
        on_gripper = [_below(model, int(b), first) for b in bodies]
        if any(on_gripper) and any(n.startswith(PREFIX) for n in names):
            deepest = max(deepest, -float(contact.dist))
    return deepest


def _below(model: mujoco.MjModel, body: int, ancestor: int) -> bool:
    while body:
        if body == ancestor:
            return True
        body = int(model.body_parentid[body])
    return False
