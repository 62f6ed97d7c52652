"""State message of the simulated arm, filled from its controller and its measurements."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from articulate.robot.kinematics import GRIPPER_YAW_RAD
from articulate.transforms import Array
from articulate_deploy.wire.limits import STEP_S
from articulate_deploy.wire.messages import ERRORS, Protocol
from articulate_deploy.wire.motion import ArmController
from articulate_deploy.wire.physics import Measured, rotation_z

T_FLANGE_NOMINAL = rotation_z(GRIPPER_YAW_RAD, 0.1034)
"""Nominal end effector ``F_T_NE`` of the gripper (4, 4); franka_description."""
GRIPPER_MASS_KG = 0.73
"""Mass of the gripper as the vendor's configuration has it [kg]."""
GRIPPER_COM_M = (-0.01, 0.0, 0.03)
"""Its centre of mass in the flange frame [m]; same source."""
GRIPPER_INERTIA = (0.001, 0.0025, 0.0017)
"""Its principal inertias [kg m^2]; same source."""


class StateWriter:
    """Writer of state messages of one protocol version."""

    def __init__(self, protocol: Protocol, flange_pose: Callable[[Array], Array]) -> None:
        """Set the end effector and the load to those of the gripper.

        Args:
            protocol: Version of the protocol.
            flange_pose: Forward kinematics from joint angles to the pose of the flange.
        """
        self._record = np.zeros((), protocol.state_type)
        self._flange_pose = flange_pose
        self._q_d: Array | None = None
        self._last_torque = np.zeros(7)
        self.message_id = 0
        self.T_NE_EE, self.T_EE_K = np.eye(4), np.eye(4)
        self._record["m_ee"] = GRIPPER_MASS_KG
        self._record["F_x_Cee"] = GRIPPER_COM_M
        self._record["I_ee"] = np.diag(GRIPPER_INERTIA).ravel()
        self._record["O_ddP_O"] = (0.0, 0.0, -9.81)
        self._write_frames()

    def set_load(self, mass_kg: float, com_m: Array, inertia: Array) -> None:
        """Set the mass [kg], centre (3,) [m] and inertia (9,) [kg m^2] of the load."""
        self._record["m_load"], self._record["F_x_Cload"] = mass_kg, com_m
        self._record["I_load"] = inertia

    def set_frames(self, T_NE_EE: Array | None = None, T_EE_K: Array | None = None) -> None:
        """Set the end effector (4, 4) or the stiffness frame (4, 4)."""
        self.T_NE_EE = self.T_NE_EE if T_NE_EE is None else T_NE_EE
        self.T_EE_K = self.T_EE_K if T_EE_K is None else T_EE_K
        self._write_frames()
        self._q_d = None

    def _write_frames(self) -> None:
        record = self._record
        self._T_F_EE = T_FLANGE_NOMINAL @ self.T_NE_EE
        self._T_F_K = self._T_F_EE @ self.T_EE_K
        record["F_T_NE"] = T_FLANGE_NOMINAL.T.ravel()
        record["NE_T_EE"] = self.T_NE_EE.T.ravel()
        record["F_T_EE"] = self._T_F_EE.T.ravel()
        record["EE_T_K"] = self.T_EE_K.T.ravel()

    def write(self, arm: ArmController, measured: Measured) -> bytes:
        """Return the next state message."""
        record = self._record
        self.message_id += 1
        record["message_id"] = self.message_id
        record["O_T_EE"] = (measured.T_wf @ self._T_F_EE).T.ravel()
        if self._q_d is None or not np.array_equal(self._q_d, arm.q_d):
            self._q_d = arm.q_d
            T_wf = self._flange_pose(arm.q_d)
            record["O_T_EE_d"] = record["O_T_EE_c"] = (T_wf @ self._T_F_EE).T.ravel()
            record["elbow_d"] = record["elbow_c"] = elbow(arm.q_d)
        record["elbow"] = elbow(measured.q)
        record["tau_J"] = measured.torque
        record["dtau_J"] = (measured.torque - self._last_torque) / STEP_S
        self._last_torque = measured.torque
        record["tau_J_d"] = arm.torque if arm.is_torque_controlled else measured.drive_torque
        record["q"] = record["theta"] = measured.q
        record["dq"] = record["dtheta"] = measured.dq
        record["q_d"], record["dq_d"], record["ddq_d"] = arm.q_d, arm.dq_d, arm.ddq_d
        self._write_contact(arm, measured)
        record["motion_generator_mode"] = arm.generator_mode
        record["controller_mode"] = arm.controller_mode
        record["errors"] = _flags(arm.errors)
        record["reflex_reason"] = _flags(arm.reflex_reason)
        record["robot_mode"] = arm.robot_mode
        record["control_command_success_rate"] = arm.success_rate
        return record.tobytes()

    def _write_contact(self, arm: ArmController, measured: Measured) -> None:
        record = self._record
        record["joint_contact"], record["joint_collision"] = arm.joint_contact, arm.joint_collision
        record["cartesian_contact"] = arm.cartesian_contact
        record["cartesian_collision"] = arm.cartesian_collision
        record["tau_ext_hat_filtered"] = measured.external_torque
        wrench = measured.external_wrench
        if not wrench.any():
            record["O_F_ext_hat_K"] = record["K_F_ext_hat_K"] = 0.0
            return
        T_wk = measured.T_wf @ self._T_F_K
        force = wrench[:3]
        moment = wrench[3:] + np.cross(measured.T_wt[:3, 3] - T_wk[:3, 3], force)
        record["O_F_ext_hat_K"] = np.concatenate([force, moment])
        R = T_wk[:3, :3].T
        record["K_F_ext_hat_K"] = np.concatenate([R @ force, R @ moment])


def elbow(q: Array) -> tuple[float, float]:
    """Return the elbow's configuration: angle of joint 3 [rad], sign of joint 4."""
    return float(q[2]), 1.0 if q[3] >= 0.0 else -1.0


def _flags(indices: set[int]) -> Array:
    out = np.zeros(len(ERRORS))
    out[list(indices)] = 1.0
    return out
