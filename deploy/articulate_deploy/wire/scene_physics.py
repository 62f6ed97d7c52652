"""Scene of a bundle in MuJoCo behind the simulated robot, at 1 kHz.

The scene, its episode parameters and its addresses are those of
:class:`articulate_deploy.robots.mujoco.MujocoRobot`. Its arm gets torques, or set points of the
arm's internal joint impedance, instead of the set points of the trained impedance.
"""

from __future__ import annotations

import numpy as np

from articulate.robot.contact import contact_wrench
from articulate.simulator import mujoco
from articulate.transforms import Array
from articulate_deploy.bundle import Bundle
from articulate_deploy.robots.mujoco import MujocoRobot
from articulate_deploy.robots.robot import Sample
from articulate_deploy.robots.simulated import joined
from articulate_deploy.wire.limits import STEP_S
from articulate_deploy.wire.physics import (
    EXTERNAL_FILTER_S,
    T_TOOL_FLANGE,
    Drive,
    FingerDrive,
    Measured,
    Physics,
    wrench_from_torque,
)

_FIRST_CONTACT = int(mujoco.mjtConstraint.mjCNSTR_CONTACT_FRICTIONLESS)


class ScenePhysics(MujocoRobot, Physics):
    """Arm, gripper and object of a bundle; see :class:`articulate_deploy.wire.physics.Physics`."""

    name = "wire"

    def __init__(self, bundle: Bundle) -> None:
        """Compile the scene of ``bundle``, with the arm at its start.

        Raises:
            BundleError: The scene cannot be used.
        """
        super().__init__(bundle)
        self._external = np.zeros(7)
        self._in_torque: bool | None = None
        self._stiffness = np.zeros(7)
        self.connect()

    @property
    def physics_step_s(self) -> float:
        """Length of a physics step: one cycle of the arm [s]."""
        return STEP_S

    @property
    def notes(self) -> tuple[str, ...]:
        """Episode parameters that differ from training."""
        return (
            "stiffness and damping are not randomised: the client sets the gains of the arm",
            "the gripper's latency is that of its commands",
        )

    @property
    def max_width_m(self) -> float:
        """Largest opening of the gripper [m]."""
        return self._manifest.robot.gripper.max_width_m

    def reset_to(self, q: Array, gripper_width_m: float) -> None:
        """Begin an episode with the arm at rest at ``q`` (7,) [rad]."""
        super().reset_to(q, gripper_width_m)
        self._in_torque = None
        self._estimate, self._motion_steps = np.zeros(7), 0
        self._pending: list[Sample] = []
        mujoco.mj_forward(self._model, self._data)

    def _begin(self, q: Array, gripper_width_m: float, part: float) -> None:
        super()._begin(q, gripper_width_m, part)
        self._model.opt.timestep = STEP_S
        self._posed = mujoco.MjData(self._model)

    def step(self, drive: Drive, fingers: FingerDrive, *, in_motion: bool) -> Measured:
        """Advance by one cycle."""
        model, data, at = self._model, self._data, self._at
        if drive.torque is not None:
            self._set_torque_drive()
            data.ctrl[at.arm_u] = drive.torque
        else:
            self._set_impedance(drive)
            data.ctrl[at.arm_u] = drive.q_d + drive.dq_d * (drive.damping / drive.stiffness)
        model.actuator_forcerange[at.finger_u, 0] = -fingers.force_n
        model.actuator_forcerange[at.finger_u, 1] = fingers.force_n
        data.ctrl[at.finger_u] = (fingers.finger_m, -fingers.finger_m)
        data.qfrc_applied[at.arm_v] = self._external
        self._steps = int(self._motion_steps * STEP_S / self._manifest.control.step_s)
        self._push(self._present_push() if in_motion else np.zeros(3))
        mujoco.mj_step(model, data)
        self._estimate_external_torque()
        if in_motion:
            self._motion_steps += 1
            self._add_sample()
        return self.measure()

    def measure(self) -> Measured:
        """Return the measurements without advancing."""
        data, at = self._data, self._at
        q, dq, width = self._read()
        T_wt = _site_pose(data, at.tool)
        torque = data.qfrc_actuator[at.arm_v].copy()
        wrench = np.zeros(6)
        if np.abs(self._estimate).max() > 1e-6:
            wrench = wrench_from_torque(self._jacobian(), self._estimate)
        return Measured(
            q=q.copy(),
            dq=dq.copy(),
            torque=torque,
            drive_torque=torque - data.qfrc_gravcomp[at.arm_v],
            external_torque=self._estimate.copy(),
            external_wrench=wrench,
            T_wf=T_wt @ T_TOOL_FLANGE,
            T_wt=T_wt,
            width_m=width,
        )

    def flange_pose(self, q: Array) -> Array:
        """Return the pose of the flange (4, 4) at ``q`` (7,) [rad]."""
        data, at = self._posed, self._at
        data.qpos[at.arm_q] = q
        mujoco.mj_kinematics(self._model, data)
        return _site_pose(data, at.tool) @ T_TOOL_FLANGE

    def set_external_torque(self, torque: Array) -> None:
        """Set a torque of the surroundings on the arm (7,) [Nm]."""
        self._external = np.array(torque, dtype=np.float64)

    def _set_torque_drive(self) -> None:
        """Let the actuators of the arm take torques."""
        if self._in_torque is not True:
            self._in_torque = True
            self._model.actuator_gainprm[self._at.arm_u, 0] = 1.0
            self._model.actuator_biasprm[self._at.arm_u, 1:3] = 0.0

    def _set_impedance(self, drive: Drive) -> None:
        """Let the actuators of the arm take set points of the internal joint impedance."""
        if self._in_torque is not False or self._stiffness is not drive.stiffness:
            self._in_torque, self._stiffness = False, drive.stiffness
            self._model.actuator_gainprm[self._at.arm_u, 0] = drive.stiffness
            self._model.actuator_biasprm[self._at.arm_u, 1] = -drive.stiffness
            self._model.actuator_biasprm[self._at.arm_u, 2] = -drive.damping

    def _jacobian(self) -> Array:
        """Jacobian of the tool (6, 7) in world axes."""
        jacobian = np.zeros((2, 3, self._model.nv))
        mujoco.mj_jacSite(self._model, self._data, jacobian[0], jacobian[1], self._at.tool)
        return np.asarray(jacobian.reshape(6, -1)[:, self._at.arm_v])

    def _estimate_external_torque(self) -> None:
        """Filter the torque of all contacts of the arm, and the one that was set."""
        data, out = self._data, np.zeros(self._model.nv)
        if data.ncon:
            force = np.where(data.efc_type >= _FIRST_CONTACT, data.efc_force, 0.0)
            mujoco.mj_mulJacTVec(self._model, data, out, force)
        present = -(out[self._at.arm_v] + self._external)
        gain = STEP_S / (EXTERNAL_FILTER_S + STEP_S)
        self._estimate = self._estimate + gain * (present - self._estimate)

    def _add_sample(self) -> None:
        """Keep what the monitor of training needs, one sample for each of its physics steps."""
        data, at, wrench, touch = self._data, self._at, np.zeros(6), False
        if data.ncon:
            touch = contact_wrench(data.sensordata, *at.sensors, data.site_xpos[at.tool], wrench)
        self._pending.append(
            Sample(
                dq=data.qvel[at.arm_v].copy(),
                torque=data.qfrc_actuator[at.arm_v].copy(),
                wrench=wrench,
                touch=touch,
                dt=STEP_S,
            )
        )
        if len(self._pending) == round(self._manifest.scene.timestep_s / STEP_S):
            self._store(joined(self._pending))
            self._pending = []


def _site_pose(data: mujoco.MjData, site: int) -> Array:
    """Return the pose (4, 4) of a site."""
    out = np.empty((4, 4))
    out[:3, :3] = data.site_xmat[site].reshape(3, 3)
    out[:3, 3] = data.site_xpos[site]
    out[3] = (0.0, 0.0, 0.0, 1.0)
    return out
