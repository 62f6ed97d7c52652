"""Object placement at a pose that the user gives: reach of the arm there, and the nearest pose.

The search of :mod:`articulate_envs.placement_search` chooses the pose of the object. Here the pose
of the object is fixed, and the start of the arm and the grasp are chosen for it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from articulate.assets.asset import Asset
from articulate.errors import ReachError
from articulate.robot.arm import Arm
from articulate.robot.kinematics import manipulability, tool_pose
from articulate.task.floor_pose import FloorPose
from articulate.task.object_placement import ObjectPlacement, handle_poses, tilted
from articulate.task.randomization_config import RandomizationConfig
from articulate.task.task import Task
from articulate.transforms import Array, axis_angle_to_matrix
from articulate_envs.compiled.inverse_kinematics import solve_ik
from articulate_envs.placement_search import (
    FOLLOWED,
    MIN_JOINT_MARGIN_RAD,
    MIN_MANIPULABILITY,
    MIN_SAMPLED_SHARE,
    REACH,
    STANDOFF_M,
    STANDOFF_WEIGHT,
    TILTS_RAD,
    clearance_score,
    followed_share,
    opening_range,
    sampled_share,
    start_angles,
)

BACK_M = (0.0, 0.08, 0.16)
"""Distances of the arm's start behind home [m]."""
MAX_TURN_RAD = 2.4
"""Largest rotation of the arm's start about the vertical [rad]; joint 1 turns 2.9."""
N_RATED = 6
"""Candidates whose sampled poses are tried."""
PATH_POSES = 5
"""Poses on the path of the handle that must be reachable."""
SHOULDER_W = np.array([0.0, 0.0, 0.333])
"""Shoulder of the arm [m]."""
REACH_M = (0.25, 0.95)
"""Distances of the tool from the shoulder that are tried [m]."""
GRID_M = 0.1
"""Spacing of the search of the nearest placement [m]; the result is refined by bisection."""
BISECTIONS = 3
"""Bisections of the shift."""
GRID_RADIUS_M = 1.2
"""Radius of that search [m]."""
TURNS_DEG = (0.0, -15.0, 15.0, -30.0, 30.0, -45.0, 45.0, -90.0, 90.0, 135.0, 180.0)
"""Rotations of the object that are tried [degrees]."""
RAISES_M = (0.0, 0.1, -0.1, 0.2, -0.2, 0.3, -0.3, 0.4, -0.4, 0.5, 0.6, 0.7, 0.8)
"""Changes of its height that are tried where none is reachable on its floor [m]."""
ENOUGH_M = 0.6
"""Shift below which no rotation is tried [m]."""
N_NEAREST = 8
"""Placements whose sampled poses are tried, the nearest first."""


@dataclass(frozen=True)
class _Grasp:
    """Choice of the grasp and of the start of the arm."""

    flip: bool
    tilt_rad: float
    back_m: float
    turn_rad: float


def placement_at(
    asset: Asset,
    task: Task,
    arm: Arm,
    config: RandomizationConfig,
    at: FloorPose,
    *,
    with_nearest: bool = True,
) -> ObjectPlacement:
    """Return the placement of an object at a given pose, with the best start of the arm.

    Args:
        asset: Object.
        task: Task; it gives the joint and the range of open fractions.
        arm: Kinematics and limits.
        config: Randomization of placement and size.
        at: Pose of the object in the base frame.
        with_nearest: Search the nearest reachable pose for the message of an error, which takes
            seconds.

    Raises:
        ReachError: The handle cannot be followed there; the message names the nearest pose at
            which it can.
    """
    found = _best(asset, task, arm, config, at)
    if found is not None and found.reachable_share >= MIN_SAMPLED_SHARE:
        return found
    where = f"{asset.name}: with --placement {at.words()}"
    reason = f"the arm cannot follow the handle of {task.joint} to the target"
    if found is not None:
        reason = (
            f"the arm follows the handle of {task.joint} at only {found.reachable_share:.0%} of "
            "the sampled poses and sizes"
        )
    if not with_nearest:
        raise ReachError(f"{where} {reason}")
    raise ReachError(f"{where} {reason}; {describe_nearest(asset, task, arm, config, at)}")


def describe_nearest(
    asset: Asset, task: Task, arm: Arm, config: RandomizationConfig, at: FloorPose
) -> str:
    """Return a text about the motion to the nearest pose; see :func:`nearest_placement`."""
    near = nearest_placement(asset, task, arm, config, at)
    if near is None:
        return (
            f"there is no reachable placement within {GRID_RADIUS_M:g} m; try another --joint or "
            "a smaller --size"
        )
    return _describe_move(at, near)


def nearest_placement(
    asset: Asset, task: Task, arm: Arm, config: RandomizationConfig, at: FloorPose
) -> FloorPose | None:
    """Return the nearest pose of the object at which the handle can be followed, or None.

    Shifts on the floor are tried first, then rotations and heights. All sampled poses and sizes
    must be reachable there, too.

    Args:
        asset: Object.
        task: Task.
        arm: Kinematics and limits.
        config: Randomization of placement and size.
        at: Pose from which the distance counts.
    """
    best: tuple[float, FloorPose] | None = None
    for turn_deg in TURNS_DEG:
        cost = 0.3 * abs(np.radians(turn_deg))
        if best is not None and best[0] <= max(ENOUGH_M, cost):
            break
        turned = replace(at, yaw_deg=_wrapped_deg(at.yaw_deg + turn_deg))
        found = _nearest_shift(asset, task, arm, config, turned)
        if found is not None and (best is None or cost + found[0] < best[0]):
            best = (cost + found[0], found[1])
    if best is not None:
        return best[1]
    for rise_m in RAISES_M[1:]:
        found = _nearest_shift(asset, task, arm, config, replace(at, z_m=at.z_m + rise_m))
        if found is not None:
            return found[1]
    return None


def _describe_move(at: FloorPose, near: FloorPose) -> str:
    dx, dy, dz = near.x_m - at.x_m, near.y_m - at.y_m, near.z_m - at.z_m
    turn = _wrapped_deg(near.yaw_deg - at.yaw_deg)
    text = f"move the object by {100 * np.hypot(dx, dy):.0f} cm ({dx:+.2f} {dy:+.2f} m)"
    if abs(turn) > 0.5:
        text += f", turn it by {turn:+.0f} degrees"
    if abs(dz) > 0.005:
        text += f", {'raise' if dz > 0 else 'lower'} it by {100 * abs(dz):.0f} cm"
    return f"{text}: the nearest reachable pose is --placement {near.words()}"


def _wrapped_deg(angle: float) -> float:
    """Return an angle in (-180, 180] [degrees]."""
    return -((180.0 - angle) % 360.0 - 180.0)


def _nearest_shift(
    asset: Asset, task: Task, arm: Arm, config: RandomizationConfig, at: FloorPose
) -> tuple[float, FloorPose] | None:
    """Return distance [m] and pose of the nearest reachable shift on the floor."""
    n = int(GRID_RADIUS_M / GRID_M)
    steps = GRID_M * np.arange(-n, n + 1)
    shifts = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
    distance = np.linalg.norm(shifts, axis=1)
    order = np.argsort(distance, kind="stable")
    shifts = shifts[order[distance[order] <= GRID_RADIUS_M]]
    good = np.zeros(len(shifts), dtype=bool)
    for flip in (False, True):
        rows = np.flatnonzero(~good)
        good[rows] |= _reachable(asset, task, arm, at, shifts[rows], flip)
    for k in np.flatnonzero(good)[:N_NEAREST]:
        moved = replace(at, x_m=at.x_m + float(shifts[k, 0]), y_m=at.y_m + float(shifts[k, 1]))
        if _reaches(asset, task, arm, config, moved):
            return _shortened(asset, task, arm, config, at, moved)
    return None


def _reaches(
    asset: Asset, task: Task, arm: Arm, config: RandomizationConfig, at: FloorPose
) -> bool:
    """Return whether all sampled poses are reachable, without tilted grasps."""
    candidates = sorted(_candidates(asset, task, arm, at, 0.0), key=lambda item: -item[0])
    return any(
        sampled_share(asset, task, arm, config, placement, 0.0) >= MIN_SAMPLED_SHARE
        for _, placement in candidates[:2]
    )


def _shortened(
    asset: Asset,
    task: Task,
    arm: Arm,
    config: RandomizationConfig,
    at: FloorPose,
    moved: FloorPose,
) -> tuple[float, FloorPose]:
    """Return the shift from ``at`` to the reachable pose ``moved``, shortened by bisection."""
    shift = np.array([moved.x_m - at.x_m, moved.y_m - at.y_m])
    low, high, best = 0.0, 1.0, moved
    for _ in range(BISECTIONS):
        share = 0.5 * (low + high)
        x, y = np.round(share * shift, 2)
        nearer = replace(at, x_m=at.x_m + float(x), y_m=at.y_m + float(y))
        if _reaches(asset, task, arm, config, nearer):
            high, best = share, nearer
        else:
            low = share
    return float(np.hypot(best.x_m - at.x_m, best.y_m - at.y_m)), best


def _reachable(
    asset: Asset, task: Task, arm: Arm, at: FloorPose, shifts: Array, flip: bool
) -> Array:
    """Return whether the path of the handle is reachable with the object shifted (M, 2) [m]."""
    path_w = at.T_wo() @ handle_poses(
        asset, task.joint, np.linspace(*opening_range(task), PATH_POSES), flip=flip
    )
    goals = np.repeat(path_w[None], len(shifts), axis=0)
    goals[:, :, :2, 3] += shifts[:, None]
    away = np.linalg.norm(goals[..., :3, 3] - SHOULDER_W, axis=-1)
    ok = ((away > REACH_M[0]) & (away < REACH_M[1])).all(axis=1)
    first = goals[:, 0]  # a gripper does not approach towards its base
    outwards = (first[:, :2, 2] * first[:, :2, 3]).sum(axis=1)
    ok &= outwards > -0.5 * np.linalg.norm(first[:, :2, 3], axis=1)
    low, high = arm.bounds()
    for steps in ([0, PATH_POSES - 1], range(1, PATH_POSES - 1)):  # most fail at an end
        rows = np.flatnonzero(ok)
        if not rows.size:
            break
        part = goals[rows][:, list(steps)]
        seeds = _seeds(arm, part[:, 0])
        result = solve_ik(
            arm, part.reshape(-1, 4, 4), np.repeat(seeds, len(list(steps)), axis=0), iterations=50
        )
        margin = np.minimum(result.q - low, high - result.q).min(axis=1)
        good = result.reached & (margin >= MIN_JOINT_MARGIN_RAD)
        good &= manipulability(arm, result.q) >= MIN_MANIPULABILITY
        ok[rows] = good.reshape(len(rows), -1).all(axis=1)
    return np.asarray(ok)


def _seeds(arm: Arm, goals: Array) -> Array:
    """Return initial angles (M, 7) [rad] for goals (M, 4, 4): home, turned towards each."""
    azimuth = np.arctan2(goals[:, 1, 3], goals[:, 0, 3])
    turns = np.clip(azimuth, -MAX_TURN_RAD, MAX_TURN_RAD)
    back = axis_angle_to_matrix(np.array([0.0, 0.0, 1.0]), -turns)
    out = np.empty((len(goals), 7))
    cached: dict[tuple[float, ...], Array] = {}
    for k, rotation in enumerate(back @ goals[:, :3, :3]):
        key = tuple(np.round(rotation[:, 0], 1).tolist())
        if key not in cached:
            cached[key] = start_angles(arm, rotation, 0.0)
        out[k] = cached[key]
    out[:, 0] += turns
    return out


def _best(
    asset: Asset, task: Task, arm: Arm, config: RandomizationConfig, at: FloorPose
) -> ObjectPlacement | None:
    """Return the best placement at a pose; None if the nominal path is out of reach."""
    rated: list[tuple[float, ObjectPlacement]] = []
    for tilts in ((0.0,), TILTS_RAD):
        candidates = [
            candidate
            for tilt_rad in tilts
            for candidate in _candidates(
                tilted(asset, task.joint, tilt_rad), task, arm, at, tilt_rad
            )
        ]
        candidates.sort(key=lambda item: -item[0])
        for _, placement in candidates[:N_RATED]:
            share = sampled_share(asset, task, arm, config, placement, 0.0)
            value = REACH * min(share / MIN_SAMPLED_SHARE, 1.0)
            value += clearance_score(asset, task, arm, config, placement)
            value += FOLLOWED * followed_share(asset, task, arm, config, placement)
            rated.append((value, replace(placement, reachable_share=share)))
        if rated and max(value for value, _ in rated) >= REACH + 0.9 * FOLLOWED:
            break
    return max(rated, key=lambda item: item[0])[1] if rated else None


def _candidates(
    asset: Asset, task: Task, arm: Arm, at: FloorPose, tilt_rad: float
) -> list[tuple[float, ObjectPlacement]]:
    """Return the starts and grasps from which the nominal path is reachable, with scores."""
    out = []
    fractions = np.linspace(*opening_range(task), PATH_POSES)
    for flip in (False, True):
        path_w = at.T_wo() @ handle_poses(asset, task.joint, fractions, flip=flip)
        away = np.linalg.norm(path_w[:, :3, 3] - SHOULDER_W, axis=1)
        if not (REACH_M[0] < away.min() and away.max() < REACH_M[1]):
            return []
        first = at.T_wo() @ handle_poses(asset, task.joint, np.asarray(task.begin[1]), flip=flip)
        for turn_rad in _turns(first):
            for back_m in BACK_M:
                grasp = _Grasp(flip, tilt_rad, back_m, turn_rad)
                found = _rated(arm, path_w, first, at, grasp)
                if found is not None:
                    out.append(found)
    return out


def _turns(first: Array) -> list[float]:
    """Return rotations of the arm's start: to the handle (4, 4), along its approach, between."""
    to_handle = float(np.arctan2(first[1, 3], first[0, 3]))
    turns = [to_handle]
    if np.hypot(first[0, 2], first[1, 2]) > 0.5:
        along = float(np.arctan2(first[1, 2], first[0, 2]))
        turns += [along, to_handle + 0.5 * float(np.angle(np.exp(1j * (along - to_handle))))]
    rounded = {round(turn, 3) for turn in turns if abs(turn) <= MAX_TURN_RAD}
    return sorted(rounded, key=abs)


def _rated(
    arm: Arm, path_w: Array, first: Array, at: FloorPose, grasp: _Grasp
) -> tuple[float, ObjectPlacement] | None:
    """Return score and placement for one grasp and start; None if the path is out of reach."""
    back = axis_angle_to_matrix(np.array([0.0, 0.0, 1.0]), -grasp.turn_rad)
    start_q = start_angles(arm, back @ first[:3, :3], grasp.back_m)
    start_q[0] += grasp.turn_rad
    low, high = arm.bounds()
    result = solve_ik(arm, path_w, start_q, iterations=50)
    margin = float(np.minimum(result.q - low, high - result.q).min())
    able = float(manipulability(arm, result.q).min())
    if not result.reached.all() or margin < MIN_JOINT_MARGIN_RAD or able < MIN_MANIPULABILITY:
        return None
    tool = tool_pose(arm, start_q)[:3, 3]
    error = first[:3, 3] - (tool + STANDOFF_M * first[:3, 2])
    score = min(margin, 0.5) + 2.0 * min(able, 0.15)
    score -= STANDOFF_WEIGHT * float(np.linalg.norm(error))
    placement = ObjectPlacement(
        pos_w=(at.x_m, at.y_m, at.z_m),
        yaw_rad=at.yaw_rad,
        flip=grasp.flip,
        start_q=tuple(float(v) for v in start_q),
        joint_margin_rad=margin,
        manipulability=able,
        reachable_share=0.0,
        tilt_rad=grasp.tilt_rad,
    )
    return score, placement
