"""Search of an object placement from which the arm reaches the complete path of the handle."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from articulate.assets.asset import Asset
from articulate.errors import PathError
from articulate.robot.arm import Arm
from articulate.robot.config import ControlConfig
from articulate.robot.kinematics import joint_poses, manipulability, tool_pose
from articulate.task.object_placement import (
    ObjectPlacement,
    handle_in_world,
    handle_poses,
    object_pose,
    tilted,
)
from articulate.task.randomization_config import RandomizationConfig
from articulate.task.task import Task
from articulate.transforms import Array, axis_angle_to_matrix, inverse, pose, quat_to_matrix
from articulate_envs.compiled.inverse_kinematics import solve_ik

STANDOFF_M = 0.13
"""Desired distance from the tool at its start to the handle as an episode begins [m].

About the sum of the randomization of the arm's start and of the placement, so that hardly an
episode begins in contact.
"""
FAR_M = 0.20
"""The same for an arm that starts farther back, clear of all sampled objects [m]."""
STANDOFF_WEIGHT = 3.0
"""Cost of a metre of deviation; the joint margin counts 1 per radian up to 0.5, the singular
value 2."""
X_M = np.arange(0.50, 0.81, 0.025)
Y_M = np.array([0.0, -0.15, 0.15])
Z_M = np.array([0.70, 0.75, 0.80, 0.65, 0.60, 0.85])
"""Candidate positions of the handle as an episode begins, in the world frame [m]."""
MIN_SAMPLED_SHARE = 0.99
"""Share of sampled poses and sizes at which the arm must reach the complete path."""
CLEAR_M = 0.06
"""Desired distance between the arm at its start and the object [m]."""
SAMPLED_CLEAR_M = (0.04, 0.09)
"""The same for the nearest sampled placement and size, for opening and closing [m]. The start is
randomized too, and an open part moves far with the yaw of the object. A gripper that begins beside
a part to close, and not in front of it, would push it shut with a finger on its front."""
SIMILAR_M = 0.045
"""Of candidates nearer to each other than this one is tried [m]."""
MAX_TRIES = 10
"""Most candidates whose sampled poses are tried."""
REACH = 100.0
"""Weight of reaching all samples; clearance counts 1 at the nominal placement and 1 at samples."""
FOLLOWED = 10.0
"""Weight of following all samples without releasing the handle."""
GOOD = REACH + FOLLOWED + 2.0
"""Score of a clear placement from which all samples can be reached and followed."""
FOLLOW_STEPS, FOLLOW_ITERATIONS = 24, 4
"""Steps of a followed path, and iterations of inverse kinematics in each."""
FOLLOW_M = 0.03
"""Position error above which the gripper has not followed the handle [m]."""
FOLLOW_S = 4.0
"""Longest time to follow the path at full speed [s]. Of the 10 s of an episode, policies take 4 to
4.5 s until they hold the handle, and the part is at rest for the last 0.5 s."""
PACE = ControlConfig()
"""Full speed of gripper and joints."""
WIDE_X_M = np.array([0.50, 0.55, 0.60, 0.65, 0.70, 0.75, 0.80, 0.40, 0.45])
WIDE_Z_M = np.array([0.80, 0.70, 0.60, 0.50, 0.40, 0.30, 0.20])
"""Further candidates where those do not suffice; handles that rise begin lower [m]."""

STEEP = 0.7
"""Horizontal part of the approach direction below which it counts as one from above."""
GRIPPER_POINTS = np.array(
    [(0.0, y, z) for y, z in ((0.04, 0.0), (0.10, -0.05), (0.10, -0.10)) for y in (-y, 0.0, y)]
)
"""Points on fingers and gripper in the tool frame [m]."""
MIN_JOINT_MARGIN_RAD = 0.10
"""Least distance to the joint limits along the nominal path [rad]."""
MIN_MANIPULABILITY = 0.04
"""Least singular value of the Jacobian along the nominal path."""


@dataclass(frozen=True)
class SearchStage:
    """Candidates that are tried together."""

    back_m: float
    """Distance of the arm's start behind home [m]."""
    x_m: Array
    """Distances of the handle as an episode begins, for a start at home [m]."""
    z_m: Array
    """Heights of the handle [m]."""
    tilts_rad: tuple[float, ...] = (0.0,)
    """Tilts of the grasp [rad]; see :func:`articulate.task.object_placement.tilted`."""
    standoff_m: float = STANDOFF_M
    """Desired distance from the tool at its start to the handle as an episode begins [m]."""


TILTS_RAD = (-0.3, 0.3, -0.6, 0.6)
"""Tilts that are tried where none is reachable [rad]."""
SEARCH_STAGES = (
    SearchStage(0.0, X_M, Z_M),
    SearchStage(0.0, X_M[::2], WIDE_Z_M[:-1]),
    SearchStage(0.08, X_M[::2], WIDE_Z_M[:-1]),
    SearchStage(0.16, X_M[::2], WIDE_Z_M[:-1]),
    SearchStage(0.16, X_M, Z_M, standoff_m=FAR_M),
    SearchStage(0.22, X_M, Z_M, standoff_m=FAR_M),
    SearchStage(0.0, WIDE_X_M, WIDE_Z_M, TILTS_RAD),
    SearchStage(0.08, WIDE_X_M, WIDE_Z_M, TILTS_RAD),
)
"""Stages in order; the search ends with the first that contains a good placement."""


def find_placement(
    asset: Asset,
    task: Task,
    arm: Arm,
    config: RandomizationConfig,
    *,
    flips: Sequence[bool] = (False, True),
    tilts_rad: Sequence[float] | None = None,
) -> ObjectPlacement:
    """Return the best placement, tested from closed to the farthest open fraction of the task.

    The object is turned so that its closed handle faces the arm; the robot's base or the object is
    raised as needed (the object's floor may be above or below the robot's). Candidates are tried in
    order of their score. The first is returned from which the sampled placements are reachable too
    and where the arm at its start is clear of the object. If there is none, the arm starts farther
    back.

    Args:
        asset: Object.
        task: Task; it gives the joint and the range of open fractions.
        arm: Kinematics and limits.
        config: Randomization of placement and size.
        flips: Values of :attr:`.ObjectPlacement.flip` to try.
        tilts_rad: Tilts of the grasp to try [rad]; None: those of :data:`SEARCH_STAGES`.

    Raises:
        PathError: There is none; the message names what would help.
    """
    fractions = np.linspace(*opening_range(task), 5)
    best: tuple[float, ObjectPlacement] | None = None
    for stage in SEARCH_STAGES:
        candidates = [
            candidate
            for tilt_rad in (stage.tilts_rad if tilts_rad is None else tilts_rad)
            for flip in flips
            for yaw in _yaws(handle_poses(asset, task.joint, np.zeros(()))[:3, 2])
            for y in Y_M
            for candidate in _candidates(
                tilted(asset, task.joint, tilt_rad),
                task,
                arm,
                fractions,
                stage,
                flip,
                yaw,
                y,
                tilt_rad,
            )
        ]
        candidates.sort(key=lambda candidate: -candidate[0])
        found = _first_good(asset, task, arm, config, [placement for _, placement in candidates])
        if found is not None and (best is None or found[0] > best[0]):
            best = found
        if best is not None and best[0] >= GOOD:
            break
    if best is None:
        handles = handle_poses(asset, task.joint, fractions)[:, :3, 3]
        travel = float(np.linalg.norm(np.ptp(handles, axis=0)))
        raise PathError(
            f"{asset.name}: the handle of {task.joint} cannot be followed over its {travel:.2f} m "
            "between closed and open with the gripper facing it; try a smaller --size or "
            "another --joint"
        )
    return best[1]


def _yaws(approach: Array) -> list[float]:
    """Return candidate yaws [rad] of an object whose closed handle is approached along (3,).

    An object that is approached from above may have any yaw.
    """
    yaw = -float(np.arctan2(approach[1], approach[0]))
    if np.hypot(approach[0], approach[1]) >= STEEP:
        return [yaw]
    return [k * np.pi / 2 for k in range(4)]


def opening_range(task: Task) -> tuple[float, float]:
    """Return the open fractions between which the gripper has to follow the handle."""
    return min(task.target, task.begin[0]), task.far


def _first_good(
    asset: Asset,
    task: Task,
    arm: Arm,
    config: RandomizationConfig,
    candidates: list[ObjectPlacement],
) -> tuple[float, ObjectPlacement] | None:
    """Return the first candidate that is :data:`GOOD`, else the best, with its score."""
    best: tuple[float, ObjectPlacement] | None = None
    tried: list[ObjectPlacement] = []
    for placement in candidates:
        if any(_similar(placement, other) for other in tried):
            continue
        tried.append(placement)
        value = clearance_score(asset, task, arm, config, placement) + FOLLOWED
        if best is None or value + REACH > best[0]:  # otherwise no share could improve it
            least = 0.0 if best is None else (best[0] - value) / REACH * MIN_SAMPLED_SHARE
            share = sampled_share(asset, task, arm, config, placement, least)
            value += REACH * min(share / MIN_SAMPLED_SHARE, 1.0)
            if best is None or value > best[0]:
                value -= FOLLOWED * (1.0 - followed_share(asset, task, arm, config, placement))
            if best is None or value > best[0]:
                best = (value, replace(placement, reachable_share=share))
        if best[0] >= GOOD or len(tried) == MAX_TRIES:
            break
    return best


def _similar(a: ObjectPlacement, b: ObjectPlacement) -> bool:
    """Return whether two placements are so similar that one represents both."""
    distance = float(np.linalg.norm(np.subtract(a.pos_w, b.pos_w)))
    return a.flip == b.flip and distance < SIMILAR_M


def _candidates(
    asset: Asset,
    task: Task,
    arm: Arm,
    fractions: Array,
    stage: SearchStage,
    flip: bool,
    yaw: float,
    y: float,
    tilt_rad: float,
) -> list[tuple[float, ObjectPlacement]]:
    """Return placements from which the complete path is reachable, with their scores."""
    closed, first = handle_poses(asset, task.joint, np.array([0.0, task.begin[1]]), flip=flip)
    turn = axis_angle_to_matrix(np.array([0.0, 0.0, 1.0]), yaw)
    start_q = start_angles(arm, turn @ closed[:3, :3], stage.back_m)
    grid = np.array([(x - stage.back_m, y, z) for z in stage.z_m for x in stage.x_m])
    path_o = handle_poses(asset, task.joint, fractions, flip=flip)
    path_o[:, :3, 3] -= first[:3, 3]
    score, margin, able = _scored(arm, path_o, turn, grid, start_q, stage.standoff_m)
    return [
        (
            float(score[k]),
            ObjectPlacement(
                pos_w=_triple(grid[k] - turn @ first[:3, 3]),
                yaw_rad=yaw,
                flip=flip,
                start_q=tuple(float(v) for v in start_q),
                joint_margin_rad=float(margin[k]),
                manipulability=float(able[k]),
                reachable_share=0.0,
                tilt_rad=tilt_rad,
            ),
        )
        for k in np.argsort(-score, kind="stable")
        if np.isfinite(score[k])
    ]


def clearance_score(
    asset: Asset, task: Task, arm: Arm, config: RandomizationConfig, placement: ObjectPlacement
) -> float:
    """Return the clearance score of the arm at its start, nominal and over the samples."""
    scale, T_wo = _corners(asset, task, config, placement)
    sampled = start_clearance(asset, task, arm, placement, scale=scale, T_wo=T_wo)
    nominal = start_clearance(asset, task, arm, placement)
    return min(nominal / CLEAR_M, 1.0) + min(sampled / SAMPLED_CLEAR_M[task.closes], 1.0)


def start_clearance(
    asset: Asset,
    task: Task,
    arm: Arm,
    placement: ObjectPlacement,
    *,
    scale: Array | None = None,
    T_wo: Array | None = None,
) -> float:
    """Return the distance [m] between the arm at its start and the bounding boxes of all links.

    The distance is 0 inside a box, even where the box is empty. The part is at the open fractions
    at which an episode may begin.

    Args:
        asset: Object.
        task: Task.
        arm: Kinematics.
        placement: Placement of the object and start of the arm.
        scale: Size factors (M,); the nearest object counts.
        T_wo: Poses of the object in the world (M, 4, 4), homogeneous.
    """
    scale = np.ones(1) if scale is None else scale
    T_wo = placement.T_wo()[None] if T_wo is None else T_wo
    q = np.asarray(placement.start_q)
    T_wt = tool_pose(arm, q)
    gripper = GRIPPER_POINTS @ T_wt[:3, :3].T + T_wt[:3, 3]
    points = np.concatenate([gripper, joint_poses(arm, q)[3:, :3, 3]])
    T_ow = inverse(T_wo)
    points = points @ np.swapaxes(T_ow[:, :3, :3], 1, 2) + T_ow[:, None, :3, 3]
    points = points / scale[:, None, None]  # in the units of the unscaled object
    part = asset.joint(task.joint)
    nearest = np.inf
    for link in asset.links:
        moves = next((j for j in asset.joints if j.link == link.name), None)
        if moves is None:
            poses = pose(link.pos_o, quat_to_matrix(link.quat_o))[None]
        else:
            at = np.linspace(*task.begin, 3) if moves is part else np.zeros(1)
            poses = asset.T_ol(moves.name, moves.closed + at * moves.span)
        low, high = (np.asarray(corner) for corner in link.bounds_l)
        for T_ol in poses:
            T_lo = inverse(T_ol)
            points_l = points @ T_lo[:3, :3].T + T_lo[:3, 3]
            out = np.maximum(np.maximum(low - points_l, points_l - high), 0.0)
            away = scale * np.linalg.norm(out, axis=-1).min(axis=-1)
            nearest = min(nearest, float(away.min()))
    return nearest


def _triple(v: Array) -> tuple[float, float, float]:
    return (float(v[0]), float(v[1]), float(v[2]))


def start_angles(arm: Arm, rotation: Array, back_m: float) -> Array:
    """Return joint angles (7,) [rad] of home with the last joint turned towards the handle's axes.

    The tool is moved back from there by ``back_m`` along world x.
    """
    q = np.asarray(arm.home, dtype=np.float64)
    if back_m > 0.0:
        goal = tool_pose(arm, q)
        goal[0, 3] -= back_m
        q = solve_ik(arm, goal[None], q, iterations=80).q[0]
    low, high = arm.bounds(0.3)
    turns = np.linspace(low[6], high[6], 721)
    poses = np.repeat(q[None], len(turns), axis=0)
    poses[:, 6] = turns
    axes = tool_pose(arm, poses)[:, :3, 0]
    fit = axes @ rotation[:, 0] - 0.002 * np.abs(turns - q[6])
    return np.asarray(poses[int(np.argmax(fit))])


def _scored(
    arm: Arm, path_o: Array, turn: Array, first: Array, start_q: Array, standoff_m: float
) -> tuple[Array, Array, Array]:
    """Return score, joint margin [rad] and manipulability (M,) of positions of the handle (M, 3).

    ``path_o`` are the poses of the handle on its path relative to these positions. The score is
    -inf where the path is out of reach; best is ``standoff_m`` ahead of the tool at its start.
    """
    rel = np.einsum("ij,kj->ki", turn, path_o[:, :3, 3])
    turned = np.broadcast_to(turn @ path_o[:, :3, :3], (len(first), len(path_o), 3, 3))
    goals = pose(first[:, None] + rel, turned)
    margin, able = np.full(len(first), -np.inf), np.zeros(len(first))
    rows = np.arange(len(first))
    low, high = arm.bounds()
    for steps in ([0, -1], range(len(path_o))):  # most fail at an end
        if not rows.size:
            break
        part = goals[rows][:, list(steps)]
        result = solve_ik(arm, part.reshape(-1, 4, 4), start_q, iterations=50)
        nearest = np.minimum(result.q - low, high - result.q).min(axis=1)
        margin[rows] = nearest.reshape(len(rows), -1).min(axis=1)
        able[rows] = manipulability(arm, result.q).reshape(len(rows), -1).min(axis=1)
        ok = result.reached.reshape(len(rows), -1).all(axis=1)
        ok &= (margin[rows] >= MIN_JOINT_MARGIN_RAD) & (able[rows] >= MIN_MANIPULABILITY)
        rows = rows[ok]
    tool = tool_pose(arm, start_q)[:3, 3]
    best = tool + np.array([standoff_m, 0.0, 0.0])
    score = np.minimum(margin, 0.5) + 2.0 * np.minimum(able, 0.15)
    score -= STANDOFF_WEIGHT * np.linalg.norm(first - best, axis=1)
    out = np.full(len(first), -np.inf)
    out[rows] = score[rows]
    return out, margin, able


def _corners(
    asset: Asset, task: Task, config: RandomizationConfig, placement: ObjectPlacement
) -> tuple[Array, Array]:
    """Return sizes (16,) and poses (16, 4, 4) at the corners of the randomization ranges."""
    signs = np.array(np.meshgrid(*([[-1.0, 1.0]] * 3))).reshape(3, -1)
    scale = np.repeat(config.scale, signs.shape[1])
    signs = np.tile(signs, 2)
    T_wo = object_pose(
        asset,
        task.joint,
        placement,
        scale=scale,
        shift=config.position_m * signs[:2].T,
        yaw=config.yaw_rad * signs[2],
    )
    return scale, T_wo


def _goals(
    asset: Asset, task: Task, placement: ObjectPlacement, scale: Array, T_wo: Array, opened: float
) -> Array:
    """Return poses of the handle (M, 4, 4) of objects at one open fraction."""
    return handle_in_world(
        asset,
        task.joint,
        T_wo=T_wo,
        scale=scale,
        opened=np.full(len(scale), opened),
        flip=placement.flip,
    )


def sampled_share(
    asset: Asset,
    task: Task,
    arm: Arm,
    config: RandomizationConfig,
    placement: ObjectPlacement,
    least: float,
) -> float:
    """Return the share of corners of the randomization ranges at which the path is reachable.

    A share that is not above ``least`` is an upper bound.
    """
    asset = tilted(asset, task.joint, placement.tilt_rad)
    scale, T_wo = _corners(asset, task, config, placement)
    ok = np.ones(len(scale), dtype=bool)
    for opened in np.linspace(*opening_range(task), 3)[[0, 2, 1]]:
        goals = _goals(asset, task, placement, scale, T_wo, float(opened))
        ok &= solve_ik(arm, goals, np.asarray(placement.start_q), iterations=80).reached
        if ok.mean() <= least:
            break
    return float(ok.mean())


def followed_share(
    asset: Asset, task: Task, arm: Arm, config: RandomizationConfig, placement: ObjectPlacement
) -> float:
    """Return the share of the same corners at which the gripper can follow the handle in time.

    All poses of a path may be reachable although the path cannot be followed. With an upright upper
    arm (joint 2 near 0) joints 1 and 3 turn about one line; their angles there determine the side
    of the elbow, and on one side a limit ends the path. Where joints turn far for a short part of
    the path, the gripper waits for them.
    """
    asset = tilted(asset, task.joint, placement.tilt_rad)
    scale, T_wo = _corners(asset, task, config, placement)
    begins = task.begin[1] if task.closes else task.begin[0]
    q, last = np.asarray(placement.start_q), None
    ok, steps = np.ones(len(scale), dtype=bool), np.zeros(len(scale))
    step_rad = PACE.step_rad * np.asarray(arm.ddq_max) / min(arm.ddq_max)
    for opened in np.linspace(begins, task.target, FOLLOW_STEPS + 1):
        goals = _goals(asset, task, placement, scale, T_wo, float(opened))
        found = solve_ik(arm, goals, q, iterations=80 if last is None else FOLLOW_ITERATIONS)
        if last is not None:
            moved = np.linalg.norm((goals - last)[:, :3, 3], axis=1) / PACE.move_m
            steps += np.maximum(moved, (np.abs(found.q - q) / step_rad).max(axis=1))
        q, last, ok = found.q, goals, ok & (found.pos_error < FOLLOW_M)
    ok &= steps <= FOLLOW_S * PACE.rate_hz
    return float(ok.mean())
