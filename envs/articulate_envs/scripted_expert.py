"""Scripted expert: a controller with privileged state that operates the task's part.

It moves in front of the handle, approaches it straight, grasps it, leads the part along its path
and stays at the target. Closed fingers push a part without a handle that is to be closed, and hook
one behind its edge that is to be opened. The expert uses only the state of the current control
step, so it can act from any state, and works for every task. Training begins by imitating it
(:mod:`articulate_train.imitation`); deployed policies contain nothing of it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from articulate.assets.asset import Handle
from articulate.robot.config import ControlConfig
from articulate.robot.kinematics import relative, small_twist
from articulate.task.object_placement import handle_path_of
from articulate.task.observation import ACTION
from articulate.task.randomization import EpisodeParams
from articulate.task.task import Task
from articulate.transforms import Array, Mask, axis_angle_to_matrix, pose, rotation_angle
from articulate_envs.engine import State
from articulate_envs.grasp import grasp_of
from articulate_envs.rewards import HELD_SHARE
from articulate_envs.scene import Scene

STRAIGHT_M, STRAIGHT_RAD = (0.004, 0.010), 0.15
"""Lateral error of the gripper below which it approaches the handle straight, between thick and
thin handles, and angular error. A policy does not observe the error of the estimated position: if
it made the expert stay back, the policy would stop before every handle."""
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
BESIDE_M = 0.01
"""Distance of the handle's side from the middle of the gripper up to which it may be between the
fingers [m]."""
OPEN_M, ROOM_M = 0.08, 0.004
"""Largest finger opening, and least room between a finger and the side of a handle [m]."""
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


@dataclass(frozen=True)
class ScriptedExpert:
    """Scripted expert; its arrays have one row per environment, or one row for all."""

    control: ControlConfig
    hinge: Mask
    """True where the joint rotates (N,)."""
    axis_h: Array
    """Axis of the joint in the frame of the handle (N, 3)."""
    pivot_h: Array
    """Point on that axis in the same frame, at nominal size (N, 3) [m]."""
    span: Array
    """Signed travel of the joint to the open state (N,) [m or rad]."""
    along_m: Array
    """Distance from the handle's middle at which fingers may hold it (N,) [m]."""
    thick_m: Array
    """Thickness of the handle between the fingers (N,) [m]."""
    deep_m: Array
    """Distance beyond the middle of the handle at which the fingers close (N,) [m]."""
    beside_m: Array
    """Position of the handle's middle along the closing axis (N,) [m]; the fingers may be centred
    anywhere from 0 to it."""
    shut: Mask
    """True where closed fingers push or hook the part instead of holding it (N,)."""
    hooks: Mask
    """True where they hook it (N,)."""
    aim: Array
    """Open fraction to which the part is led (N,)."""

    def act(self, state: State, params: EpisodeParams) -> Array:
        """Return actions (N, 8) in [-1, 1] for N environments.

        Args:
            state: State of the environments.
            params: Parameters of their episodes.
        """
        control = self.control
        unit = np.repeat([control.move_m, control.turn_rad], 3)
        T_ht = relative(state.T_wh, state.T_wt)
        T_wa = state.T_wt_target @ _small_pose(state.pending_actions[:, :6] * unit)
        T_ha = relative(state.T_wh, T_wa)
        held, empty = self._held(state, params, T_ht)
        touching = np.where(self.hooks, _behind(T_ht), _touching(T_ht))
        held, empty = np.where(self.shut, touching, held), empty & ~self.shut
        near, at = self._at_handle(T_ht, T_ha)
        goal = self._before(T_ha, retreat=empty)
        T_goal = np.where(held[:, None, None], self._ahead(state, params, T_ht), state.T_wh @ goal)
        twist = small_twist(T_wa, T_goal) / unit
        commanded = state.gripper.command > 0.0
        limit = np.where(near & ~held, SLOW, 1.0)
        largest = np.abs(twist).max(axis=1)
        for part in (slice(0, 3), slice(3, 6)):
            size = np.abs(twist[:, part]).max(axis=1)
            size = np.where(held, np.maximum(size, TOGETHER * largest), size)
            twist[:, part] *= (limit / np.maximum(size, limit))[:, None]
        close = self.shut | ((held | at | (commanded & near)) & ~empty)
        out = np.zeros((len(twist), ACTION.size))
        out[:, :6] = twist
        out[:, ACTION.slice("gripper").start] = np.where(close, 1.0, -1.0)
        return out

    def _held(self, state: State, params: EpisodeParams, T_ht: Array) -> tuple[Mask, Mask]:
        """Return masks (N,): the fingers hold the handle; they have closed on nothing."""
        thick = self.thick_m * params["scale"]
        closing, width = state.gripper.closing > 0.0, state.gripper_width
        across = T_ht[:, 1, 3]
        across = across - np.clip(
            across, np.minimum(self.beside_m, 0.0), np.maximum(self.beside_m, 0.0)
        )
        between = np.abs(across) <= 0.5 * thick + BESIDE_M
        between &= np.abs(T_ht[:, 2, 3]) <= LOST_M
        empty = closing & (width < np.where(between, HELD_SHARE * thick, SHUT_M))
        held = closing & between & ~empty & (width <= thick + HELD_M)
        return held, empty

    def _at_handle(self, T_ht: Array, T_ha: Array) -> tuple[Mask, Mask]:
        """Return masks (N,): the gripper is near the handle; it may close there."""
        turned = rotation_angle(T_ht[:, :3, :3])
        off = np.abs(np.stack([self._beside(T_ht), self._beside(T_ha)]))
        near = (off[0] < LOST_M).all(axis=1) & (turned < 2.0 * AT_RAD)
        at = (off[1] < AT_M).all(axis=1) & (off[0] < SOON_M).all(axis=1)
        return near, at & (turned < AT_RAD)

    def _beside(self, T: Array) -> Array:
        """Return positions (N, 3) [m] in the handle's frame from its nearest graspable point."""
        off = T[:, :3, 3].copy()
        most = ALONG * self.along_m
        off[:, 0] -= np.clip(off[:, 0], -most, most)
        return off

    def _before(self, T_ha: Array, *, retreat: Mask) -> Array:
        """Return goal poses (N, 4, 4) of an open gripper in the handle's frame."""
        off = self._beside(T_ha)
        lateral = np.linalg.norm(off[:, :2], axis=1)
        turned = rotation_angle(T_ha[:, :3, :3])
        straight = np.clip(0.5 * (OPEN_M - self.thick_m) - ROOM_M, *STRAIGHT_M)
        straight = np.where(self.hooks, STRAIGHT_M[0], straight)
        back = BACK[0] * np.maximum(lateral - straight, 0.0)
        back += BACK[1] * np.maximum(turned - STRAIGHT_RAD, 0.0)
        back = np.clip(np.where(retreat, RETREAT_M, back), 0.0, MAX_BACK_M)
        most = ALONG * self.along_m
        along = np.clip(T_ha[:, 0, 3], -most, most)
        return pose(np.stack([along, np.zeros_like(along), self.deep_m - back], axis=1))

    def _ahead(self, state: State, params: EpisodeParams, T_ht: Array) -> Array:
        """Return goal poses (N, 4, 4) in the world of a gripper that leads the part, grasp kept.

        Fingers that hook it stay as deep behind its edge as they should be.
        """
        scale, left = params["scale"], self.aim - state.opened
        next_pose = self._moved(state.T_wh, scale, STEP * np.sign(left))
        travel = np.linalg.norm((next_pose - state.T_wh)[:, :3, 3], axis=1) / STEP
        brake = np.where(self.hooks, HOOKED_BRAKE, BRAKE)
        lead = np.minimum(LEAD_M, brake * np.abs(left) * travel + MIN_LEAD_M)
        ahead = np.sign(left) * np.minimum(np.abs(left), lead / np.maximum(travel, 1e-6))
        kept = np.where(self.hooks[:, None, None], np.eye(4), T_ht)
        kept[:, 0, 3] = T_ht[:, 0, 3]
        kept[:, 2, 3] = np.where(self.hooks, HOOKED_M, T_ht[:, 2, 3])
        return np.asarray(self._moved(state.T_wh, scale, ahead) @ kept)

    def _moved(self, T_wh: Array, scale: Array, fraction: Array) -> Array:
        """Return the poses (N, 4, 4) of handles at ``T_wh`` after ``fraction`` (N,) of travel.

        The joint's axis is constant in the frame of the handle, which moves with the part.
        """
        travel = fraction * self.span
        turn = axis_angle_to_matrix(self.axis_h, np.where(self.hinge, travel, 0.0))
        pivot = self.pivot_h * scale[:, None]
        slid = self.axis_h * np.where(self.hinge, 0.0, travel * scale)[:, None]
        turned = pivot - np.einsum("nij,nj->ni", turn, pivot)
        return np.asarray(T_wh @ pose(slid + turned, turn))


def make_scripted_expert(scene: Scene, *others: Scene) -> ScriptedExpert:
    """Return the scripted expert of ``scene`` for all environments, or of one scene for each.

    Args:
        scene: Scene of all environments, or of the first one.
        *others: Scenes of the other environments; all have the same control stack.
    """
    scenes = (scene, *others)
    paths = [handle_path_of(one.asset, one.task.joint, flip=one.placement.flip) for one in scenes]
    handles = [one.asset.handle_of(one.task.joint) for one in scenes]
    grasps = [grasp_of(handle, one.placement) for handle, one in zip(handles, scenes, strict=True)]
    turns = [path.T_oh[:3, :3].T for path in paths]
    return ScriptedExpert(
        control=scene.control,
        hinge=np.array([path.hinge for path in paths]),
        axis_h=np.array([t @ p.axis_o for t, p in zip(turns, paths, strict=True)]),
        pivot_h=np.array(
            [t @ (p.pivot_o - p.T_oh[:3, 3]) for t, p in zip(turns, paths, strict=True)]
        ),
        span=np.array([path.span for path in paths]),
        along_m=np.array([grasp.along_m for grasp in grasps]),
        thick_m=np.array([grasp.thick_m for grasp in grasps]),
        deep_m=np.array([_deep_m(handle) for handle in handles]),
        beside_m=np.array([grasp.beside_m for grasp in grasps]),
        shut=np.array([h is not None and h.shut for h in handles]),
        hooks=np.array([h is not None and h.kind == "hook" for h in handles]),
        aim=np.array([_aim(one.task, h) for one, h in zip(scenes, handles, strict=True)]),
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
    return min((HOOKED_BEYOND if hooks else BEYOND) * task.target, stop)


def _touching(T_ht: Array) -> Mask:
    """Return a mask (N,): closed fingers are at the place to push."""
    off = T_ht[:, :3, 3]
    beside = np.linalg.norm(off[:, :2], axis=1) < LOST_M
    return np.asarray(beside & (off[:, 2] > -PUSH_M))


def _behind(T_ht: Array) -> Mask:
    """Return a mask (N,): closed fingers are behind the edge that they hook."""
    off = np.abs(T_ht[:, :3, 3])
    off[:, 2] = np.maximum(-T_ht[:, 2, 3], 0.0)
    return np.asarray((off < HOOK_M).all(axis=1))


def _small_pose(twist: Array) -> Array:
    """Return poses (N, 4, 4) of small motions (N, 6) [m, rad], rotations to first order."""
    out = np.tile(np.eye(4), (len(twist), 1, 1))
    x, y, z = twist[:, 3], twist[:, 4], twist[:, 5]
    out[:, 0, 1], out[:, 0, 2], out[:, 1, 2] = -z, y, -x
    out[:, 1, 0], out[:, 2, 0], out[:, 2, 1] = z, -y, x
    out[:, :3, 3] = twist[:, :3]
    return out
