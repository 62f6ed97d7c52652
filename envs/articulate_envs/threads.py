"""The batched engine: one model and one state per environment, on native threads."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np

from articulate.follow import discrete
from articulate.transforms import Array, Ints
from articulate_envs.buffered import BufferedEngine
from articulate_envs.compiled.advance import Aiming, Constants, Pointers, Where, advance
from articulate_envs.native import step_address
from articulate_envs.scene import Scene


class ThreadEngine(BufferedEngine):
    """N environments stepped by ``threads`` threads; see :class:`articulate_envs.engine.Engine`."""

    def __init__(self, scene: Scene, n_envs: int, *, threads: int = 1) -> None:
        """Make N environments of ``scene``; call :meth:`reset` for all before stepping."""
        super().__init__(scene, n_envs)
        self.threads = max(1, min(threads, n_envs))
        self._pool = ThreadPoolExecutor(self.threads - 1) if self.threads > 1 else None
        self._taken = np.zeros(n_envs, dtype=np.int64)
        self._edges = np.linspace(0, n_envs, self.threads + 1).astype(int)
        self._mj_step = step_address()
        self._pointers = self._addresses()
        self._where = _where(scene)
        self._constants = _constants(scene)
        self._aiming = Aiming(self._motion, self._tool, self._led)

    def _addresses(self) -> Pointers:
        def of(arrays: list[Array]) -> Ints:
            return np.array([a.ctypes.data for a in arrays], dtype=np.int64)

        data = self._data
        return Pointers(
            model=np.array([m._address for m in self._models], dtype=np.int64),
            data=np.array([d._address for d in data], dtype=np.int64),
            ctrl=of([d.ctrl for d in data]),
            qpos=of([d.qpos for d in data]),
            qvel=of([d.qvel for d in data]),
            torque=of([d.qfrc_actuator for d in data]),
            sensors=of([d.sensordata for d in data]),
            site=of([d.site_xpos for d in data]),
            xfrc=of([d.xfrc_applied for d in data]),
        )

    def _advance(self) -> None:
        args = (
            self._order,
            self._taken,
            self._mj_step,
            self._pointers,
            self._where,
            self._constants,
            self._chain,
            self._aiming,
            self._buffers,
            self._shown,
        )
        self._taken[:] = 0
        if self._pool is None:
            advance(0, *args)
            return
        jobs = [self._pool.submit(advance, int(first), *args) for first in self._edges[1:-1]]
        advance(0, *args)
        for job in jobs:
            job.result()

    def close(self) -> None:
        """End the threads."""
        if self._pool is not None:
            self._pool.shutdown()


def _where(scene: Scene) -> Where:
    at = scene.at
    return Where(
        arm_q=at.arm_q,
        finger_q=at.finger_q,
        arm_ctrl=at.arm_ctrl,
        finger_ctrl=at.finger_ctrl,
        part_q=at.part_q,
        part_v=at.part_v,
        push_row=at.part_body,
        tool_site=at.tool_site,
        hand_sensor=at.sensors[0],
        floor_sensor=at.sensors[1],
        robot_sensor=at.sensors[2],
    )


def _constants(scene: Scene) -> Constants:
    dt, limits, arm = scene.physics.timestep_s, scene.task.limits, scene.arm
    A, B = discrete(scene.follow.omega_rad_s, dt)
    return Constants(
        substeps=scene.substeps,
        dt=dt,
        A=np.ascontiguousarray(A),
        B=np.ascontiguousarray(B),
        dq_max=np.asarray(arm.dq_max),
        tau_max=np.asarray(arm.tau_max),
        dtau_max=arm.dtau_max,
        speed_share=limits.speed_share,
        torque_share=limits.torque_share,
        force=limits.force_n,
        moment=limits.moment_nm,
        gain=1.0 - float(np.exp(-dt / limits.filter_s)),
        short_gain=1.0 - float(np.exp(-dt / limits.short_filter_s)),
        finger_step=arm.hand.finger_speed_m_s * dt,
        finger_closed=arm.hand.finger_m[0],
        finger_open=arm.hand.finger_m[1],
    )
