"""Where the object stands: the reach test."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from articulate.assets.asset import Asset
from articulate.errors import ReachError
from articulate.robot.arm import Arm
from articulate.robot.config import ControlConfig
from articulate.robot.kinematics import joint_poses, manipulability, solve_ik, tool_pose
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

__all__ = ["ObjectPlacement", "find_placement", "handle_in_world", "handle_way", "object_pose"]

STANDOFF_M = 0.13
"""Wished distance from the start pose's tool to the handle as an episode begins [m].

About the sum of the draws of the arm's start and the object's place: hardly an episode begins in
contact.
"""
FAR_M = 0.20
"""The same for an arm that starts farther back to be clear of what is drawn [m]."""
STANDOFF_WEIGHT = 3.0
"""What a metre off that costs; the margin counts 1 per radian up to 0.5, the singular value 2."""
X_M = np.arange(0.50, 0.81, 0.025)
Y_M = np.array([0.0, -0.15, 0.15])
Z_M = np.array([0.70, 0.75, 0.80, 0.65, 0.60, 0.85])
"""Places of the handle as an episode begins that are tried, in the world frame [m]."""
MIN_DRAWN_SHARE = 0.99
"""Share of drawn poses and sizes at which the arm must reach the whole way."""
CLEAR_M = 0.06
"""Wished distance between the arm at its start and the object [m]."""
DRAWN_CLEAR_M = (0.04, 0.09)
"""The same of the nearest of the drawn places and sizes, to open and to close [m]: the start is
drawn too, and what stands open turns by the whole of its way when it is drawn. A hand that begins
beside what it is to close, and not before it, pushes it shut with a finger on its front."""
ALIKE_M = 0.045
"""Places nearer to each other than this are tried once [m]."""
MAX_TRIES = 10
"""So many places are tried at most for what is drawn."""
REACH = 100.0
"""What reaching all that is drawn counts, where being clear of the object counts 1 as it is meant
to stand and 1 as it is drawn."""
FOLLOWED = 10.0
"""What following all that is drawn without letting go counts beside that."""
GOOD = REACH + FOLLOWED + 2.0
"""Of a place that is clear and from which all that is drawn can be reached and followed."""
FOLLOW_STEPS, FOLLOW_ITERATIONS = 24, 4
"""A way is followed in so many steps, of so many iterations of inverse kinematics each."""
FOLLOW_M = 0.03
"""A hand that is farther from the handle has not followed it [m]."""
FOLLOW_S = 4.0
"""The arm can have followed it in that time at its fastest [s]: of an episode's ten policies take 4
to 4.5 until they hold the handle, and the part rests for 0.5 at their end."""
PACE = ControlConfig()
"""How fast that is, for hand and joints."""
WIDE_X_M = np.array([0.50, 0.55, 0.60, 0.65, 0.70, 0.75, 0.80, 0.40, 0.45])
WIDE_Z_M = np.array([0.80, 0.70, 0.60, 0.50, 0.40, 0.30, 0.20])
"""Places that are tried where those do not suffice: handles that rise begin lower [m]."""

STEEP = 0.7
"""Level part of an approach below which it counts as one from above."""
HAND_POINTS = np.array(
    [(0.0, y, z) for y, z in ((0.04, 0.0), (0.10, -0.05), (0.10, -0.10)) for y in (-y, 0.0, y)]
)
"""Points on fingers and hand in the tool frame [m]."""
MIN_JOINT_MARGIN_RAD = 0.10
"""Distance to the joint limits that must be left along the nominal way [rad]."""
MIN_MANIPULABILITY = 0.04
"""Smallest singular value of the Jacobian that must be left along the nominal way."""


@dataclass(frozen=True)
class SearchStage:
    """Places that are tried together."""

    back_m: float
    """How far back from home the arm starts [m]."""
    x_m: Array
    """Distances of the handle as an episode begins, for an arm that starts at home [m]."""
    z_m: Array
    """Its heights [m]."""
    tilts_rad: tuple[float, ...] = (0.0,)
    """How the handle is held; see :func:`articulate.task.object_placement.tilted` [rad]."""
    standoff_m: float = STANDOFF_M
    """Wished distance from the start pose's tool to the handle as an episode begins [m]."""


TILTS_RAD = (-0.3, 0.3, -0.6, 0.6)
"""Tilts that are tried where none will do."""
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
"""Tried in this order; the first that holds a good place is the last."""


def find_placement(
    asset: Asset, task: Task, arm: Arm, config: RandomizationConfig
) -> ObjectPlacement:
    """The best place for the object, tested from closed to the farthest that the task asks for.

    The object is turned so that its closed handle faces the arm; the robot's base or the object
    is raised as needed (the object's floor may lie above or below the robot's). Places come by
    their score; the first is taken from which the drawn ones can be reached too and where the arm
    at its start is clear of the object as it is when an episode begins. Where there is none, the
    arm starts farther back.

    Raises:
        ReachError: There is none; the message says what would help.
    """
    way = np.linspace(*opening_range(task), 5)
    best: tuple[float, ObjectPlacement] | None = None
    for stage in SEARCH_STAGES:
        places = [
            found
            for tilt_rad in stage.tilts_rad
            for flip in (False, True)
            for yaw in _yaws(handle_poses(asset, task.joint, np.zeros(()))[:3, 2])
            for y in Y_M
            for found in _places(
                tilted(asset, task.joint, tilt_rad), task, arm, way, stage, flip, yaw, y, tilt_rad
            )
        ]
        places.sort(key=lambda found: -found[0])
        found = _first_good(asset, task, arm, config, [place for _, place in places])
        if found is not None and (best is None or found[0] > best[0]):
            best = found
        if best is not None and best[0] >= GOOD:
            break
    if best is None:
        handles = handle_poses(asset, task.joint, way)[:, :3, 3]
        travel = float(np.linalg.norm(np.ptp(handles, axis=0)))
        raise ReachError(
            f"{asset.name}: the handle of {task.joint} cannot be followed over its {travel:.2f} m "
            "between closed and open with the hand facing it; try a smaller --size or "
            "another --joint"
        )
    return best[1]


def _yaws(approach: Array) -> list[float]:
    """Turns of an object whose closed handle is approached along ``approach`` (3,) that are tried.

    One that is approached from above may stand any way round.
    """
    yaw = -float(np.arctan2(approach[1], approach[0]))
    if np.hypot(approach[0], approach[1]) >= STEEP:
        return [yaw]
    return [k * np.pi / 2 for k in range(4)]


def opening_range(task: Task) -> tuple[float, float]:
    """The least and the farthest open fraction between which the handle must be followed."""
    return min(task.target, task.begin[0]), task.far


def _first_good(
    asset: Asset, task: Task, arm: Arm, config: RandomizationConfig, places: list[ObjectPlacement]
) -> tuple[float, ObjectPlacement] | None:
    """The first of ``places`` that is :data:`GOOD`, else the one nearest to it, and how good."""
    best: tuple[float, ObjectPlacement] | None = None
    tried: list[ObjectPlacement] = []
    for place in places:
        if any(_alike(place, other) for other in tried):
            continue
        tried.append(place)
        value = _clear(asset, task, arm, config, place) + FOLLOWED
        if best is None or value + REACH > best[0]:  # else no share could make it better
            least = 0.0 if best is None else (best[0] - value) / REACH * MIN_DRAWN_SHARE
            share = _drawn_share(asset, task, arm, config, place, least)
            value += REACH * min(share / MIN_DRAWN_SHARE, 1.0)
            if best is None or value > best[0]:
                value -= FOLLOWED * (1.0 - _followed_share(asset, task, arm, config, place))
            if best is None or value > best[0]:
                best = (value, replace(place, reachable_share=share))
        if best[0] >= GOOD or len(tried) == MAX_TRIES:
            break
    return best


def _alike(a: ObjectPlacement, b: ObjectPlacement) -> bool:
    """Whether two places are so near to each other that one speaks for both."""
    distance = float(np.linalg.norm(np.subtract(a.pos_w, b.pos_w)))
    return a.flip == b.flip and distance < ALIKE_M


def _places(
    asset: Asset,
    task: Task,
    arm: Arm,
    way: Array,
    stage: SearchStage,
    flip: bool,
    yaw: float,
    y: float,
    tilt_rad: float,
) -> list[tuple[float, ObjectPlacement]]:
    """Places from which the whole way can be followed, with their scores."""
    closed, first = handle_poses(asset, task.joint, np.array([0.0, task.begin[1]]), flip=flip)
    turn = axis_angle_to_matrix(np.array([0.0, 0.0, 1.0]), yaw)
    start_q = _start(arm, turn @ closed[:3, :3], stage.back_m)
    grid = np.array([(x - stage.back_m, y, z) for z in stage.z_m for x in stage.x_m])
    way_o = handle_poses(asset, task.joint, way, flip=flip)
    way_o[:, :3, 3] -= first[:3, 3]
    score, margin, able = _scored(arm, way_o, turn, grid, start_q, stage.standoff_m)
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


def _clear(
    asset: Asset, task: Task, arm: Arm, config: RandomizationConfig, place: ObjectPlacement
) -> float:
    """How clear the arm at its start is of the object, as it is meant to stand and as drawn."""
    scale, T_wo = _corners(asset, task, config, place)
    drawn = start_clearance(asset, task, arm, place, scale=scale, T_wo=T_wo)
    meant = start_clearance(asset, task, arm, place)
    return min(meant / CLEAR_M, 1.0) + min(drawn / DRAWN_CLEAR_M[task.closes], 1.0)


def start_clearance(
    asset: Asset,
    task: Task,
    arm: Arm,
    place: ObjectPlacement,
    *,
    scale: Array | None = None,
    T_wo: Array | None = None,
) -> float:
    """Distance [m] between the arm at its start and the boxes about the object's links.

    The part is where an episode may begin; it is 0 where the arm is within a box, which may still
    be empty there. Of several sizes ``scale`` (M,) and poses ``T_wo`` (M, 4, 4) the nearest counts.
    """
    scale = np.ones(1) if scale is None else scale
    T_wo = place.T_wo()[None] if T_wo is None else T_wo
    q = np.asarray(place.start_q)
    T_wt = tool_pose(arm, q)
    gripper = HAND_POINTS @ T_wt[:3, :3].T + T_wt[:3, 3]
    points = np.concatenate([gripper, joint_poses(q)[3:, :3, 3]])
    T_ow = inverse(T_wo)
    points = points @ np.swapaxes(T_ow[:, :3, :3], 1, 2) + T_ow[:, None, :3, 3]
    points = points / scale[:, None, None]  # where they are seen from an object of its own size
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
            inside = inverse(T_ol)
            own = points @ inside[:3, :3].T + inside[:3, 3]
            out = np.maximum(np.maximum(low - own, own - high), 0.0)
            away = scale * np.linalg.norm(out, axis=-1).min(axis=-1)
            nearest = min(nearest, float(away.min()))
    return nearest


def _triple(v: Array) -> tuple[float, float, float]:
    return (float(v[0]), float(v[1]), float(v[2]))


def _start(arm: Arm, rotation: Array, back_m: float) -> Array:
    """Home with the last joint turned so that the hand's axes lie nearest to the handle's.

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
    arm: Arm, way_o: Array, turn: Array, first: Array, start_q: Array, standoff_m: float
) -> tuple[Array, Array, Array]:
    """Score, margin and manipulability (M,) of places of the handle as an episode begins (M, 3).

    ``way_o`` are the handle's poses on its way, seen from there. The score is -inf where the way
    cannot be followed. Best is ``standoff_m`` ahead of the start pose's tool.
    """
    rel = np.einsum("ij,kj->ki", turn, way_o[:, :3, 3])
    turned = np.broadcast_to(turn @ way_o[:, :3, :3], (len(first), len(way_o), 3, 3))
    goals = pose(first[:, None] + rel, turned)
    margin, able = np.full(len(first), -np.inf), np.zeros(len(first))
    rows = np.arange(len(first))
    low, high = arm.bounds()
    for steps in ([0, -1], range(len(way_o))):  # most fail at an end
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
    wish = tool + np.array([standoff_m, 0.0, 0.0])
    score = np.minimum(margin, 0.5) + 2.0 * np.minimum(able, 0.15)
    score -= STANDOFF_WEIGHT * np.linalg.norm(first - wish, axis=1)
    out = np.full(len(first), -np.inf)
    out[rows] = score[rows]
    return out, margin, able


def _corners(
    asset: Asset, task: Task, config: RandomizationConfig, place: ObjectPlacement
) -> tuple[Array, Array]:
    """Sizes (16,) and poses (16, 4, 4) of the object at the corners of what is drawn."""
    signs = np.array(np.meshgrid(*([[-1.0, 1.0]] * 3))).reshape(3, -1)
    scale = np.repeat(config.scale, signs.shape[1])
    signs = np.tile(signs, 2)
    T_wo = object_pose(
        asset,
        task.joint,
        place,
        scale=scale,
        shift=config.position_m * signs[:2].T,
        yaw=config.yaw_rad * signs[2],
    )
    return scale, T_wo


def _goals(
    asset: Asset, task: Task, place: ObjectPlacement, scale: Array, T_wo: Array, opened: float
) -> Array:
    """Poses of the handle (M, 4, 4) of objects of those sizes and poses, all as far open."""
    return handle_in_world(
        asset,
        task.joint,
        T_wo=T_wo,
        scale=scale,
        opened=np.full(len(scale), opened),
        flip=place.flip,
    )


def _drawn_share(
    asset: Asset,
    task: Task,
    arm: Arm,
    config: RandomizationConfig,
    place: ObjectPlacement,
    least: float,
) -> float:
    """Share of the corners of the drawn box of poses and sizes at which the way can be reached.

    Where it is not above ``least``, it may be told too high.
    """
    asset = tilted(asset, task.joint, place.tilt_rad)
    scale, T_wo = _corners(asset, task, config, place)
    ok = np.ones(len(scale), dtype=bool)
    for opened in np.linspace(*opening_range(task), 3)[[0, 2, 1]]:
        goals = _goals(asset, task, place, scale, T_wo, float(opened))
        ok &= solve_ik(arm, goals, np.asarray(place.start_q), iterations=80).reached
        if ok.mean() <= least:
            break
    return float(ok.mean())


def _followed_share(
    asset: Asset, task: Task, arm: Arm, config: RandomizationConfig, place: ObjectPlacement
) -> float:
    """Share of the same corners at which a hand that holds the handle can go with it in time.

    All of a way may be reached and yet not be followed: where the upper arm comes to stand upright
    (joint 2 near 0), joints 1 and 3 turn about one line, and what they have turned to there decides
    on which side of the arm the elbow goes on; on one of them a limit ends the way. And where
    joints turn far for little of the way, the hand waits for them.
    """
    asset = tilted(asset, task.joint, place.tilt_rad)
    scale, T_wo = _corners(asset, task, config, place)
    begins = task.begin[1] if task.closes else task.begin[0]
    q, last = np.asarray(place.start_q), None
    ok, ticks = np.ones(len(scale), dtype=bool), np.zeros(len(scale))
    step_rad = PACE.step_rad * np.asarray(arm.ddq_max) / min(arm.ddq_max)
    for opened in np.linspace(begins, task.target, FOLLOW_STEPS + 1):
        goals = _goals(asset, task, place, scale, T_wo, float(opened))
        found = solve_ik(arm, goals, q, iterations=80 if last is None else FOLLOW_ITERATIONS)
        if last is not None:
            moved = np.linalg.norm((goals - last)[:, :3, 3], axis=1) / PACE.move_m
            ticks += np.maximum(moved, (np.abs(found.q - q) / step_rad).max(axis=1))
        q, last, ok = found.q, goals, ok & (found.pos_error < FOLLOW_M)
    ok &= ticks <= FOLLOW_S * PACE.rate_hz
    return float(ok.mean())
