"""The batched engine: one model and one state per environment, on native threads."""

from __future__ import annotations

import copy
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from articulate.robot.control import discretize_filter
from articulate.simulator import mujoco
from articulate.transforms import Array, Ints
from articulate_envs.buffered_engine import BufferedEngine
from articulate_envs.compiled.advance import (
    Aiming,
    Constants,
    Pointers,
    ThreadWorkspaces,
    Where,
    advance,
)
from articulate_envs.native_mujoco import drawn_arrays, step_address
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
        self._models_of = self._desk_models()
        self._desk_data = [mujoco.MjData(scene.nominal) for _ in range(self.threads)]
        self._pointers, self._desks = self._what_is_kept(), self._what_is_on_desks()
        self._where = _where(scene)
        self._constants = _constants(scene)
        self._aiming = Aiming(self._motion, self._yields, self._tool, self._led)

    def _desk_models(self) -> list[list[mujoco.MjModel]]:
        """A model of each size for each thread; one environment alone is stepped with its own."""
        if self.n_envs == 1:
            return [self._models * len(self.scene.models)]
        desks = [[copy.copy(model) for model in self.scene.models] for _ in range(self.threads)]
        for models in desks:
            for lender, model in zip(self._lenders, models, strict=True):
                lender.lend(model)
        return desks

    def _what_is_kept(self) -> Pointers:
        return Pointers(
            size=self._sizes,
            doubles=drawn_arrays(self.scene.nominal)[1],
            drawn=np.array([drawn_arrays(model)[0] for model in self._models]),
            **_shared_addresses(self._data),
        )

    def _what_is_on_desks(self) -> ThreadWorkspaces:
        rows, data = self._models_of, self._desk_data
        return ThreadWorkspaces(
            model=np.array([[m._address for m in models] for models in rows], dtype=np.int64),
            drawn=np.array([[drawn_arrays(m)[0] for m in models] for models in rows]),
            data=np.array([d._address for d in data], dtype=np.int64),
            torque=_addresses([d.qfrc_actuator for d in data]),
            sensors=_addresses([d.sensordata for d in data]),
            site=_addresses([d.site_xpos for d in data]),
            **_shared_addresses(data),
        )

    def _advance(self) -> None:
        args = (
            self._order,
            self._taken,
            self._mj_step,
            self._pointers,
            self._desks,
            self._where,
            self._constants,
            self._chain,
            self._aiming,
            self._buffers,
            self._shown,
        )
        self._taken[:] = 0
        if self._pool is None:
            advance(0, 0, *args)
            return
        jobs = [
            self._pool.submit(advance, desk, int(first), *args)
            for desk, first in enumerate(self._edges[1:-1], start=1)
        ]
        advance(0, 0, *args)
        for job in jobs:
            job.result()

    def close(self) -> None:
        """End the threads."""
        if self._pool is not None:
            self._pool.shutdown()


def _addresses(arrays: list[Array]) -> Ints:
    return np.array([array.ctypes.data for array in arrays], dtype=np.int64)


def _shared_addresses(data: list[mujoco.MjData]) -> dict[str, Ints]:
    """Addresses of the arrays of each ``data`` that go from environments to desks and back."""
    return {
        "qpos": _addresses([d.qpos for d in data]),
        "qvel": _addresses([d.qvel for d in data]),
        "warm": _addresses([d.qacc_warmstart for d in data]),
        "ctrl": _addresses([d.ctrl for d in data]),
        "xfrc": _addresses([d.xfrc_applied for d in data]),
    }


def _where(scene: Scene) -> Where:
    at = scene.at
    return Where(
        nq=scene.nominal.nq,
        nv=scene.nominal.nv,
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
    A, B = discretize_filter(scene.control.omega_rad_s, dt)
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
        finger_step=arm.gripper.finger_speed_m_s * dt,
        finger_closed=arm.gripper.finger_m[0],
        finger_open=arm.gripper.finger_m[1],
    )
