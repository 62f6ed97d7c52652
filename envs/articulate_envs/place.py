"""Where the object stands: the reach test."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from articulate.arm import Arm
from articulate.asset import Asset
from articulate.draw import DrawConfig
from articulate.errors import ReachError
from articulate.kinematics import manipulability, solve_ik, tool_pose
from articulate.placing import Place, handle_in_world, handle_way, object_pose
from articulate.task import Task
from articulate.transforms import Array, axis_angle_to_matrix, pose

__all__ = ["Place", "find_place", "handle_in_world", "handle_way", "object_pose"]

STANDOFF_M = 0.13
"""Wished distance from the start pose's tool to the closed handle [m].

About the sum of the draws of the arm's start and the object's place: hardly an episode begins in
contact.
"""
STANDOFF_WEIGHT = 3.0
"""What a metre off that costs; the margin counts 1 per radian up to 0.5, the singular value 2."""
X_M = np.arange(0.50, 0.81, 0.025)
Y_M = np.array([0.0, -0.15, 0.15])
Z_M = np.array([0.70, 0.75, 0.80, 0.65, 0.60, 0.85])
"""Places of the closed handle that are tried, in the world frame [m]."""
MIN_JOINT_MARGIN_RAD = 0.10
"""Distance to the joint limits that must be left along the nominal way [rad]."""
MIN_MANIPULABILITY = 0.04
"""Smallest singular value of the Jacobian that must be left along the nominal way."""


def find_place(asset: Asset, task: Task, arm: Arm, config: DrawConfig) -> Place:
    """The best place for the object, tested from closed to the task's target.

    The object is turned so that its handle faces the arm; the robot's base or the object is
    raised as needed (the object's floor may lie above or below the robot's).

    Raises:
        ReachError: There is none; the message says what would help.
    """
    opened = np.linspace(0.0, task.target, 5)
    best: tuple[float, Place] | None = None
    for flip in (False, True):
        way_o = handle_way(asset, task.joint, opened, flip=flip)
        approach = way_o[0, :3, 2]
        yaw = -float(np.arctan2(approach[1], approach[0]))
        turn = axis_angle_to_matrix(np.array([0.0, 0.0, 1.0]), yaw)
        start_q = _start(arm, turn @ way_o[0, :3, :3])
        for y in Y_M:
            grips = np.array([(x, y, z) for z in Z_M for x in X_M])
            found = _best_grip(arm, way_o, turn, grips, start_q)
            if found is not None and (best is None or found[0] > best[0]):
                pos = found[1] - turn @ way_o[0, :3, 3]
                best = (
                    found[0],
                    Place(
                        pos_w=_triple(pos),
                        yaw_rad=yaw,
                        flip=flip,
                        start_q=tuple(float(v) for v in start_q),
                        joint_margin_rad=found[2],
                        manipulability=found[3],
                        drawn_share=0.0,
                    ),
                )
    if best is None:
        travel = float(np.linalg.norm(np.ptp(way_o[:, :3, 3], axis=0)))
        raise ReachError(
            f"{asset.name}: the handle of {task.joint} cannot be followed over its {travel:.2f} m "
            "from closed to the target with the hand facing it; try a smaller --size or "
            "another --joint"
        )
    share = _drawn_share(asset, task, arm, config, best[1])
    return replace(best[1], drawn_share=share)


def _triple(v: Array) -> tuple[float, float, float]:
    return (float(v[0]), float(v[1]), float(v[2]))


def _start(arm: Arm, rotation: Array) -> Array:
    """Home with the last joint turned so that the hand's axes lie nearest to the handle's."""
    q = np.asarray(arm.home, dtype=np.float64)
    low, high = arm.bounds(0.3)
    turns = np.linspace(low[6], high[6], 721)
    poses = np.repeat(q[None], len(turns), axis=0)
    poses[:, 6] = turns
    axes = tool_pose(arm, poses)[:, :3, 0]
    fit = axes @ rotation[:, 0] - 0.002 * np.abs(turns - q[6])
    return np.asarray(poses[int(np.argmax(fit))])


def _best_grip(
    arm: Arm, way_o: Array, turn: Array, grips: Array, start_q: Array
) -> tuple[float, Array, float, float] | None:
    """Best of the closed handle's places (M, 3): its score, itself, margin, manipulability."""
    steps = len(way_o)
    rel = np.einsum("ij,kj->ki", turn, way_o[:, :3, 3] - way_o[0, :3, 3])
    goals = pose(
        (grips[:, None] + rel).reshape(-1, 3),
        np.tile(turn @ way_o[:, :3, :3], (len(grips), 1, 1)),
    )
    result = solve_ik(arm, goals, start_q, iterations=50)
    low, high = arm.bounds()
    margin = np.minimum(result.q - low, high - result.q).min(axis=1).reshape(-1, steps).min(axis=1)
    able = manipulability(arm, result.q).reshape(-1, steps).min(axis=1)
    ok = result.reached.reshape(-1, steps).all(axis=1)
    ok &= (margin >= MIN_JOINT_MARGIN_RAD) & (able >= MIN_MANIPULABILITY)
    if not ok.any():
        return None
    tool = tool_pose(arm, start_q)[:3, 3]
    wish = tool + np.array([STANDOFF_M, 0.0, 0.0])
    score = np.minimum(margin, 0.5) + 2.0 * np.minimum(able, 0.15)
    score -= STANDOFF_WEIGHT * np.linalg.norm(grips - wish, axis=1)
    score[~ok] = -np.inf
    k = int(np.argmax(score))
    return float(score[k]), grips[k], float(margin[k]), float(able[k])


def _drawn_share(asset: Asset, task: Task, arm: Arm, config: DrawConfig, place: Place) -> float:
    """Share of the corners of the drawn box of poses and sizes at which the way can be reached."""
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
    ok = np.ones(len(scale), dtype=bool)
    for opened in np.linspace(0.0, task.target, 3):
        goals = handle_in_world(
            asset,
            task.joint,
            T_wo=T_wo,
            scale=scale,
            opened=np.full(len(scale), opened),
            flip=place.flip,
        )
        ok &= solve_ik(arm, goals, np.asarray(place.start_q), iterations=80).reached
    return float(ok.mean())
