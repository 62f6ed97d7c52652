"""One environment stepped from Python: the reference that the batched engine is held against.

It steps the physics and judges by the functions that a robot runs. Targets move, and the hand is
told, by the compiled functions that the batch uses, so that both give the physics the same numbers,
to the bit: where fingers press on a handle, a difference of 1e-14 can become one of 4e-3 within a
tick. It is what :mod:`articulate_envs.gym_env` and :mod:`articulate_envs.robosuite_env` step.
"""

from __future__ import annotations

import numpy as np

from articulate.robot.control import discretize_filter, filter_step
from articulate.simulator import mujoco
from articulate.task.episode_monitor import judge_sample
from articulate_envs.buffered_engine import DIVERGED, BufferedEngine
from articulate_envs.compiled.motion import aim, room_of
from articulate_envs.scene import Scene, wrench_of


class SingleEngine(BufferedEngine):
    """One environment, stepped in Python; see :class:`articulate_envs.engine.Engine`."""

    def __init__(self, scene: Scene) -> None:
        """Make one environment of ``scene``; call :meth:`reset` before stepping."""
        super().__init__(scene, 1)
        self._matrices = discretize_filter(scene.control.omega_rad_s, scene.physics.timestep_s)
        self._room = room_of()
        at = scene.at
        self._arm_v = slice(at.arm_q, at.arm_q + 7)
        self._watched_v = slice(0, max(at.part_v, at.finger_q + 1) + 1)

    @property
    def model(self) -> mujoco.MjModel:
        """The model, with what was drawn written into it at each reset."""
        return self._models[0]

    @property
    def data(self) -> mujoco.MjData:
        """The state of the physics."""
        return self._data[0]

    def _advance(self) -> None:
        b = self._buffers
        aim(b.target[0], self._motion[0], b.q[0], self._yields[0], self._chain, self._room)
        self._substeps()
        self._see(np.zeros(1, dtype=np.int64))

    def _substeps(self) -> None:
        data, at, b = self.data, self.scene.at, self._buffers
        data.xfrc_applied[at.part_body, :3] = b.push[0]
        for _ in range(self.scene.substeps):
            if b.rest[0, 3] == 0.0:
                return
            self._control()
            mujoco.mj_step(self.model, data)
            if not np.all(np.abs(data.qvel[self._watched_v]) < DIVERGED):
                b.rest[0, 3] = 0.0
                b.samples[0, 0] = np.nan
                return
            self._judge()
        b.q[0] = data.qpos[self._arm_v]
        b.dq[0] = data.qvel[self._arm_v]
        b.rest[0, 0] = data.qpos[at.finger_q] - data.qpos[at.finger_q + 1]
        b.rest[0, 1] = data.qpos[at.part_q]
        b.rest[0, 2] = data.qvel[at.part_v]

    def _control(self) -> None:
        """Move the follower and the fingers on by one physics step."""
        b, at, gripper = self._buffers, self.scene.at, self.scene.arm.gripper
        b.filter[:] = filter_step(b.filter, b.target, *self._matrices)
        step = gripper.finger_speed_m_s * self.scene.physics.timestep_s
        way = -step if b.closing[0] > 0.0 else step
        closed, wide = gripper.finger_m
        wide = min(max(b.finger[0] + way, closed), wide)
        b.finger[0] = wide
        ctrl = self.data.ctrl
        ctrl[at.arm_ctrl : at.arm_ctrl + 7] = b.filter[0, :, 0]
        ctrl[at.finger_ctrl : at.finger_ctrl + 2] = wide, -wide

    def _judge(self) -> None:
        b, data, scene = self._buffers, self.data, self.scene
        tool_w = data.site_xpos[scene.at.tool_site][None]
        wrench, touch = wrench_of(data.sensordata[None], scene.at, tool_w)
        torque = data.qfrc_actuator[self._arm_v][None].copy()
        b.samples[:] = judge_sample(
            b.samples,
            dq=data.qvel[self._arm_v][None],
            torque=torque,
            torque_before=b.torque,
            wrench=wrench,
            touch=touch,
            dt=scene.physics.timestep_s,
            arm=scene.arm,
            limits=scene.task.limits,
        )
        b.torque[:] = torque
