"""Guide: what a hand would do that sees everything as it is.

It goes before the handle, ahead onto it, closes, waits until the fingers hold, leads the part along
its way and stays at the target. It looks at nothing but the state of the tick, so that it can be
asked anywhere, and holds for every task, as tasks are data. Training begins with what it shows
(:mod:`articulate_train.imitation`); nothing of it is in a policy that is deployed.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from articulate.robot.kinematics import relative, small_twist
from articulate.task.object_placement import HandlePath, handle_path_of
from articulate.task.observation import ACTION
from articulate.task.randomization import EpisodeParams
from articulate.transforms import Array, Mask, pose, rotation_angle
from articulate_envs.compiled.reward import HELD_SHARE
from articulate_envs.engine import State
from articulate_envs.rewards import Grasp, grasp_of
from articulate_envs.scene import Scene

STRAIGHT_M, STRAIGHT_RAD = 0.004, 0.15
"""A hand so little beside the way to the handle, and turned so little otherwise, goes ahead."""
BACK = 2.5, 0.15
"""How far before the handle it waits else, for each metre beside the way and each radian [1, m]."""
MOST_BACK_M = 0.08
"""The farthest that is [m]."""
RETREAT_M = 0.05
"""How far before the handle a hand goes that has closed on nothing [m]."""
ALONG = 0.8
"""Share of what counts as a handle's middle at which the hand may hold it."""
AT_M = (0.014, 0.008, 0.015)
"""How far from where it wants to be a hand may be told to close, once all that was said has been
done: along the handle, across, ahead [m]."""
SOON_M = (0.02, 0.015, 0.04)
"""The same of the hand as it is: it acts later."""
AT_RAD = 0.2
"""The same of its turn [rad]."""
LOST_M = 0.03
"""A hand told to close that is farther away than this opens again [m]."""
SLOW = 0.6
"""Largest motion near the handle, as a share of the largest."""
HELD_M = 0.012
"""Fingers that are at most this wider apart than what they hold have it between them [m]."""
BESIDE_M = 0.01
"""A handle whose side is at most so far beside the middle of the hand may be between them [m]."""
SHUT_M = 0.04
"""Fingers nearer to each other than this that have no handle between them have closed on nothing
[m]."""
LEAD_M = 0.12
"""How far the hand leads a part that it moves [m]."""
BRAKE, LEAST_LEAD_M = 0.5, 0.004
"""Near the target it leads by this share of the way that is left, and so much more [m]."""
TOGETHER = 0.75
"""A hand that leads a part and has farther to turn than to move is slowed down by this share of how
much farther: what it holds would turn in its fingers else, and spread them."""
STEP = 0.01
"""Fraction of the part's way from which it is told how far the handle goes."""
SHUT, BEYOND = 0.2, 1.08
"""Where a part is led, as a share of the target: one that closes well within it, one that opens
beyond it, at most half the way to its stop."""


@dataclass(frozen=True)
class ScriptedExpert:
    """Knows a scene; :meth:`act` says what to do in it."""

    scene: Scene
    way: HandlePath
    grasp: Grasp
    aim: float
    """Fraction open to which the part is led."""

    def act(self, state: State, drawn: EpisodeParams) -> Array:
        """Actions (N, 8) for environments in ``state``, under what was ``drawn``."""
        control = self.scene.control
        unit = np.repeat([control.move_m, control.turn_rad], 3)
        T_ht = relative(state.T_wh, state.T_wt)
        T_wa = state.T_wt_target @ _small_pose(state.pending_actions[:, :6] * unit)
        T_ha = relative(state.T_wh, T_wa)
        held, empty = self._held(state, drawn, T_ht)
        near, at = self._at_handle(T_ht, T_ha)
        goal = self._before(T_ha, retreat=empty)
        T_goal = np.where(held[:, None, None], self._ahead(state, drawn, T_ht), state.T_wh @ goal)
        twist = small_twist(relative(T_wa, T_goal)) / unit
        told = state.gripper.wish > 0.0
        most = np.where(near & ~held, SLOW, 1.0)
        whole = np.abs(twist).max(axis=1)
        for part in (slice(0, 3), slice(3, 6)):
            own = np.abs(twist[:, part]).max(axis=1)
            size = np.where(held, np.maximum(own, TOGETHER * whole), own)
            twist[:, part] *= (most / np.maximum(size, most))[:, None]
        close = (held | at | (told & near)) & ~empty
        out = np.zeros((len(twist), ACTION.size))
        out[:, :6] = twist
        out[:, ACTION.slice("hand").start] = np.where(close, 1.0, -1.0)
        return out

    def _held(self, state: State, drawn: EpisodeParams, T_ht: Array) -> tuple[Mask, Mask]:
        """Whether closed fingers have the handle between them, and whether they have nothing."""
        thick = self.grasp.thick_m * drawn["scale"]
        closing, width = state.gripper.closing > 0.0, state.gripper_width
        between = np.abs(T_ht[:, 1, 3]) <= 0.5 * thick + BESIDE_M
        between &= np.abs(T_ht[:, 2, 3]) <= LOST_M
        empty = closing & (width < np.where(between, HELD_SHARE * thick, SHUT_M))
        held = closing & between & ~empty & (width <= thick + HELD_M)
        return held, empty

    def _at_handle(self, T_ht: Array, T_ha: Array) -> tuple[Mask, Mask]:
        """Whether the hand is about at the handle, and whether it may close there."""
        turned = rotation_angle(T_ht[:, :3, :3])
        off = np.abs(np.stack([self._beside(T_ht), self._beside(T_ha)]))
        near = (off[0] < LOST_M).all(axis=1) & (turned < 2.0 * AT_RAD)
        at = (off[1] < AT_M).all(axis=1) & (off[0] < SOON_M).all(axis=1)
        return near, at & (turned < AT_RAD)

    def _beside(self, T: Array) -> Array:
        """Places of tools in the handle's frame (N, 3), from the nearest point as good to hold."""
        off = T[:, :3, 3].copy()
        most = ALONG * self.grasp.along_m
        off[:, 0] -= np.clip(off[:, 0], -most, most)
        return off

    def _before(self, T_ha: Array, *, retreat: Mask) -> Array:
        """Where an open hand goes, in the handle's frame (N, 4, 4)."""
        off = self._beside(T_ha)
        lateral = np.linalg.norm(off[:, :2], axis=1)
        turned = rotation_angle(T_ha[:, :3, :3])
        back = BACK[0] * np.maximum(lateral - STRAIGHT_M, 0.0)
        back += BACK[1] * np.maximum(turned - STRAIGHT_RAD, 0.0)
        back = np.clip(np.where(retreat, RETREAT_M, back), 0.0, MOST_BACK_M)
        most = ALONG * self.grasp.along_m
        along = np.clip(T_ha[:, 0, 3], -most, most)
        return pose(np.stack([along, np.zeros_like(along), -back], axis=1))

    def _ahead(self, state: State, drawn: EpisodeParams, T_ht: Array) -> Array:
        """Where a hand goes that holds the handle (N, 4, 4): as it holds it, along the way."""
        scale, T_wo = drawn["scale"], self.scene.T_wo(drawn)
        left = self.aim - state.opened
        there = self.way.in_world(
            T_wo=T_wo, scale=scale, opened=state.opened + STEP * np.sign(left)
        )
        travel = np.linalg.norm((there - state.T_wh)[:, :3, 3], axis=1) / STEP
        lead = np.minimum(LEAD_M, BRAKE * np.abs(left) * travel + LEAST_LEAD_M)
        ahead = np.sign(left) * np.minimum(np.abs(left), lead / np.maximum(travel, 1e-6))
        goal = self.way.in_world(T_wo=T_wo, scale=scale, opened=state.opened + ahead)
        return np.asarray(goal @ T_ht)


def make_scripted_expert(scene: Scene) -> ScriptedExpert:
    """The guide of ``scene``."""
    task = scene.task
    way = handle_path_of(scene.asset, task.joint, flip=scene.place.flip)
    grasp = grasp_of(scene.asset.handle_of(task.joint))
    if task.closes:
        aim = SHUT * task.target
    else:
        stop = task.target * 1.1 if task.stop is None else 0.5 * (task.target + task.stop)
        aim = min(BEYOND * task.target, stop)
    return ScriptedExpert(scene, way, grasp, aim)


def _small_pose(twist: Array) -> Array:
    """Poses (N, 4, 4) of small motions (N, 6) [m, rad]: turns to first order."""
    out = np.tile(np.eye(4), (len(twist), 1, 1))
    x, y, z = twist[:, 3], twist[:, 4], twist[:, 5]
    out[:, 0, 1], out[:, 0, 2], out[:, 1, 2] = -z, y, -x
    out[:, 1, 0], out[:, 2, 0], out[:, 2, 1] = z, -y, x
    out[:, :3, 3] = twist[:, :3]
    return out
