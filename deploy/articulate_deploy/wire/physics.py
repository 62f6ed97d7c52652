"""Physics behind the simulated robot: the protocol of plants, and a bare arm without an object.

One step is one control cycle of the arm, 1 ms. The robot compensates gravity, so torques of a
client are on top of it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from articulate.errors import ConfigError
from articulate.robot.arm import PANDA
from articulate.robot.kinematics import (
    GRIPPER_YAW_RAD,
    arm_geometry,
    write_frames,
    write_jacobian,
)
from articulate.task.observation import Estimate
from articulate.task.randomization import EpisodeParams
from articulate.transforms import Array
from articulate_deploy.robots.robot import Sample
from articulate_deploy.wire.limits import STEP_S

INERTIA = np.array([2.0, 2.0, 1.2, 1.2, 0.3, 0.35, 0.15])
"""Inertia of each joint of the bare arm (7,) [kg m^2]; the damping of the internal joint impedance
is critical for it."""
STIFFNESS = np.array([3000.0, 3000.0, 3000.0, 2500.0, 2500.0, 2000.0, 2000.0])
"""Internal joint impedance before ``SetJointImpedance`` (7,) [Nm/rad], libfranka's default."""
EXTERNAL_FILTER_S = 0.01
"""Time constant of the estimated external torque [s]; the arm's is not published."""
MIN_STIFFNESS = 1.0
"""Stiffness below which the damping does not decrease further [Nm/rad]."""


@dataclass(frozen=True)
class Drive:
    """Input of the arm in one cycle: a client's torque, or set points of the joint impedance."""

    q_d: Array
    """Set point (7,) [rad]."""
    dq_d: Array
    """Speed of the set point (7,) [rad/s]."""
    stiffness: Array
    """Stiffness of the internal joint impedance (7,) [Nm/rad]."""
    damping: Array
    """Damping of the internal joint impedance (7,) [Nm s/rad]."""
    torque: Array | None = None
    """Torque without gravity (7,) [Nm]; None uses the joint impedance."""


def critical_damping(stiffness: Array) -> Array:
    """Return the damping (7,) [Nm s/rad] of the internal joint impedance (7,) [Nm/rad]."""
    return np.asarray(2.0 * np.sqrt(np.maximum(stiffness, MIN_STIFFNESS) * INERTIA))


@dataclass(frozen=True)
class FingerDrive:
    """Input of the gripper in one cycle."""

    finger_m: float
    """Set point of one finger [m], half the opening."""
    force_n: float
    """Largest force of a finger [N]."""


@dataclass
class Measured:
    """Measurements after a cycle."""

    q: Array
    """Joint angles (7,) [rad]."""
    dq: Array
    """Joint speeds (7,) [rad/s]."""
    torque: Array
    """Joint torques with gravity (7,) [Nm]."""
    drive_torque: Array
    """Joint torques without gravity (7,) [Nm]."""
    external_torque: Array
    """Torque of the arm on its surroundings (7,) [Nm], filtered."""
    external_wrench: Array
    """Force [N] and moment [Nm] of the gripper on its surroundings about the tool, world axes
    (6,), filtered."""
    T_wf: Array
    """Pose of the flange (4, 4)."""
    T_wt: Array
    """Pose of the tool (4, 4)."""
    width_m: float
    """Opening between the fingers [m]."""


class Physics(Protocol):
    """Arm, gripper and object."""

    @property
    def max_width_m(self) -> float:
        """Largest opening of the gripper [m]."""

    def reset_to(self, q: Array, width_m: float) -> None:
        """Place the arm at rest at ``q`` (7,) [rad], the object at its start."""

    def step(self, drive: Drive, fingers: FingerDrive, *, in_motion: bool) -> Measured:
        """Advance by one cycle; time of an episode passes with ``in_motion``."""

    def measure(self) -> Measured:
        """Return the measurements without advancing."""

    def flange_pose(self, q: Array) -> Array:
        """Return the pose of the flange (4, 4) at ``q`` (7,) [rad]."""

    def set_external_torque(self, torque: Array) -> None:
        """Set a torque of the surroundings on the arm (7,) [Nm], in addition to contacts."""

    def set_episode_params(self, params: EpisodeParams) -> None:
        """Set the parameters of the next episodes, from :meth:`reset_to` on."""

    def object_state(self) -> Estimate:
        """Return the true state of the object, one row."""

    def take_samples(self) -> list[Sample]:
        """Return the samples since the last call, at the rate of training."""


def inverse_rigid(T: Array) -> Array:
    """Return the inverse of one pose (4, 4)."""
    out = np.eye(4)
    out[:3, :3] = T[:3, :3].T
    out[:3, 3] = -T[:3, :3].T @ T[:3, 3]
    return out


def rotation_z(angle_rad: float, z_m: float) -> Array:
    """Return the pose (4, 4) of a frame turned about z and moved along it."""
    c, s = np.cos(angle_rad), np.sin(angle_rad)
    return np.array([[c, -s, 0, 0], [s, c, 0, 0], [0, 0, 1, z_m], [0, 0, 0, 1.0]])


T_FLANGE_TOOL = rotation_z(GRIPPER_YAW_RAD, PANDA.gripper.tcp_z_m)
"""Pose of the project's tool frame in the flange's."""
T_TOOL_FLANGE = inverse_rigid(T_FLANGE_TOOL)
"""Pose of the flange in the project's tool frame."""


class ArmPoses:
    """Forward kinematics of one arm, with its scratch arrays."""

    def __init__(self) -> None:
        """Allocate the arrays."""
        self._geometry = arm_geometry(PANDA)
        self._frames = np.empty((7, 12))

    def tool(self, q: Array) -> Array:
        """Return the pose of the tool (4, 4) at ``q`` (7,) [rad]."""
        T_wt = np.empty((4, 4))
        write_frames(q.tolist(), self._geometry, self._frames, T_wt)
        return T_wt

    def jacobian(self, q: Array) -> Array:
        """Return the Jacobian of the tool (6, 7) in world axes."""
        out = np.empty((6, 7))
        T_wt = self.tool(q)
        write_jacobian(self._frames, T_wt, np.eye(3), out)
        return out


def wrench_from_torque(jacobian: Array, torque: Array) -> Array:
    """Return the wrench (6,) at the tool that gives ``torque`` (7,) by least squares."""
    if not np.abs(torque).max() > 1e-6:
        return np.zeros(6)
    gram = jacobian @ jacobian.T
    gram[np.diag_indices(6)] += 1e-6
    return np.asarray(np.linalg.solve(gram, jacobian @ torque))


class BareArm(Physics):
    """Arm and gripper without an object: seven decoupled joints, gravity compensated exactly."""

    def __init__(self, q: Array, *, grasped_width_m: float = 0.0) -> None:
        """Begin at rest at ``q`` (7,) [rad].

        Args:
            q: Joint angles.
            grasped_width_m: Width of a rigid object between the fingers, 0 for none [m].
        """
        self._poses = ArmPoses()
        self._grasped_m = grasped_width_m
        self._external = np.zeros(7)
        self.reset_to(q, self.max_width_m)

    @property
    def max_width_m(self) -> float:
        """Largest opening of the gripper [m]."""
        return PANDA.gripper.max_width_m

    def reset_to(self, q: Array, width_m: float) -> None:
        """Place the arm at rest."""
        self._q, self._dq = np.array(q, dtype=np.float64), np.zeros(7)
        self._torque, self._estimate = np.zeros(7), np.zeros(7)
        self._width = float(width_m)

    def step(self, drive: Drive, fingers: FingerDrive, *, in_motion: bool) -> Measured:
        """Advance by one cycle."""
        torque = drive.torque
        if torque is None:
            error = drive.q_d - self._q
            torque = drive.stiffness * error + drive.damping * (drive.dq_d - self._dq)
            torque = np.clip(torque, -np.asarray(PANDA.tau_max), np.asarray(PANDA.tau_max))
        self._torque = np.asarray(torque)
        self._dq = self._dq + STEP_S * (self._torque + self._external) / INERTIA
        self._q = self._q + STEP_S * self._dq
        gain = STEP_S / (EXTERNAL_FILTER_S + STEP_S)
        self._estimate = self._estimate + gain * (-self._external - self._estimate)
        lowest = min(self._grasped_m, self._width)
        self._width = min(max(2.0 * fingers.finger_m, lowest), self.max_width_m)
        return self.measure()

    def measure(self) -> Measured:
        """Return the measurements without advancing."""
        T_wt = self._poses.tool(self._q)
        wrench = np.zeros(6)
        if np.abs(self._estimate).max() > 1e-6:
            wrench = wrench_from_torque(self._poses.jacobian(self._q), self._estimate)
        return Measured(
            q=self._q,
            dq=self._dq,
            torque=self._torque,
            drive_torque=self._torque,
            external_torque=self._estimate,
            external_wrench=wrench,
            T_wf=T_wt @ T_TOOL_FLANGE,
            T_wt=T_wt,
            width_m=self._width,
        )

    def flange_pose(self, q: Array) -> Array:
        """Return the pose of the flange (4, 4) at ``q`` (7,) [rad]."""
        return self._poses.tool(q) @ T_TOOL_FLANGE

    def set_external_torque(self, torque: Array) -> None:
        """Set a torque of the surroundings on the arm (7,) [Nm]."""
        self._external = np.array(torque, dtype=np.float64)

    def set_episode_params(self, params: EpisodeParams) -> None:
        """Reject the parameters: they describe an object.

        Raises:
            ConfigError: Always.
        """
        raise ConfigError("a bare arm has no episode parameters; give a bundle")

    def object_state(self) -> Estimate:
        """Reject the request: there is no object.

        Raises:
            ConfigError: Always.
        """
        raise ConfigError("a bare arm has no object; give a bundle")

    def take_samples(self) -> list[Sample]:
        """Return nothing: there is no monitor without a task."""
        return []
