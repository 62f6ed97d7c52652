"""Check of the clearance of gripper and arm in the compiled scene."""

from __future__ import annotations

from copy import copy

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
ENOUGH_M = 0.006
"""Clearance of an open gripper at the handle from which it is centred on the handle [m]: the
position of a handle is estimated to 4 mm."""
BESIDE_M = (0.006, -0.006, 0.012, -0.012, 0.018, -0.018)
"""Shifts of the grasp across the handle in the order of preference [m]."""
GAIN_M = 0.001
"""Clearance that a larger shift must gain [m]."""
TOUCH_M = 0.0005
"""Overlap from which closing fingers meet something [m]."""
SPACE_M, SWEEP_STEPS = 0.001, 6
"""Distance between a finger and the handle that it reaches [m], and steps on the way there."""
FINGER_ROOM_M = 0.010
"""Least distance of the handle's side from a finger of the shifted gripper [m]."""


def shift_beside(scene: Scene) -> float:
    """Return the shift of the grasp [m] at which an open gripper is clear of the object.

    Open fingers reach 55 mm to either side of a handle, often onto the handle of the next door. The
    shift is 0 where the centred gripper has room, or where none of :data:`BESIDE_M` gives it room;
    see :attr:`.ObjectPlacement.beside_m`.

    Args:
        scene: Scene with the grasp in the middle of the handle.
    """
    handle = scene.asset.handle_of(scene.task.joint)
    if handle is None or handle.shut or handle.kind == "none":
        return 0.0
    best_m, shift_m = _clearance(scene, 0.0), 0.0
    if best_m >= ENOUGH_M:
        return 0.0
    most_m = (scene.arm.gripper.max_width_m - handle.extent[1]) / 2.0 - FINGER_ROOM_M
    best_m = max(best_m, 0.0)
    for beside_m in BESIDE_M:
        if abs(beside_m) > most_m or not _can_close(scene, beside_m, handle.extent[1]):
            continue
        if (found_m := _clearance(scene, beside_m)) > best_m + GAIN_M:
            best_m, shift_m = found_m, beside_m
    return shift_m


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


def _can_close(scene: Scene, beside_m: float, thick_m: float) -> bool:
    """Return True if the far finger meets nothing on its way to the handle.

    The near finger touches the handle first and moves the gripper there.
    """
    half, off = scene.arm.gripper.max_width_m / 2.0, abs(beside_m)
    near, nearest = min(off + thick_m / 2.0 + SPACE_M, half), thick_m / 2.0 - off + SPACE_M
    positive = (beside_m < 0.0) != scene.placement.flip  # the handle is towards +y of the gripper
    opened = opening_range(scene.task)[0]
    return all(
        _overlap(scene, opened, 0.0, beside_m, fingers=(near, -far) if positive else (far, -near))
        <= TOUCH_M
        for far in np.linspace(half, nearest, SWEEP_STEPS)
    )


def _clearance(scene: Scene, beside_m: float) -> float:
    """Return the clearance [m] of an open gripper along the path, at most :data:`ENOUGH_M`."""
    path = np.linspace(*opening_range(scene.task), 3)
    return -max(_overlap(scene, opened, 0.0, beside_m, margin_m=ENOUGH_M) for opened in path)


def _overlap(
    scene: Scene,
    opened: float,
    back_m: float,
    beside_m: float = 0.0,
    *,
    margin_m: float = 0.0,
    fingers: tuple[float, float] | None = None,
) -> float:
    """Return the deepest contact [m] of the gripper, ``back_m`` behind and beside the handle.

    Distances up to ``margin_m`` count as negative contacts. ``fingers`` are the positions of both
    on the closing axis [m]; by default they are open.
    """
    placement = scene.placement
    T_wh = handle_in_world(
        scene.asset,
        scene.task.joint,
        T_wo=placement.T_wo()[None],
        scale=np.ones(1),
        opened=np.full(1, opened),
        flip=placement.flip,
    )
    across_m = -beside_m if placement.flip else beside_m
    T_wh[:, :3, 3] += across_m * T_wh[:, :3, 1] - back_m * T_wh[:, :3, 2]
    q = solve_ik(scene.arm, T_wh, np.asarray(placement.start_q), iterations=80).q[0]
    return _deepest(scene, q, opened, GRIPPER_BODY, margin_m, fingers)


def _deepest(
    scene: Scene,
    q: Array,
    opened: float,
    above: str,
    margin_m: float = 0.0,
    fingers: tuple[float, float] | None = None,
) -> float:
    """Return the deepest contact [m] of bodies from ``above`` on with the object at ``q`` (7,).

    It is negative where they are apart, at least ``-margin_m``.
    """
    model, at = scene.nominal, scene.at
    if margin_m:
        model = copy(model)
        model.geom_margin[:] = margin_m
    data = mujoco.MjData(model)
    for joint in scene.asset.joints:
        part = opened if joint.name == scene.task.joint else 0.0
        data.joint(PREFIX + joint.name).qpos[0] = joint.closed + part * joint.span
    handle = scene.asset.handle_of(scene.task.joint)
    half = 0.0 if handle is not None and handle.shut else scene.arm.gripper.max_width_m / 2.0
    data.qpos[at.arm_q : at.arm_q + 7] = q
    data.qpos[at.finger_q : at.finger_q + 2] = fingers or (half, -half)
    mujoco.mj_forward(model, data)
    first = model.body(above).id
    deepest = -margin_m
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
