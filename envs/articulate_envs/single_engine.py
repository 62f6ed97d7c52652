"""One environment whose physics is stepped from Python, for :mod:`articulate_envs.gym_env`.

It calls the same compiled functions as the batched engine, and MuJoCo through its Python bindings
between them. Both give the physics the same numbers to the bit: where fingers press on a handle, a
difference of 1e-14 can become one of 4e-3 within a control step.
"""

from __future__ import annotations

import numpy as np

from articulate.simulator import mujoco
from articulate_envs.buffered_engine import BufferedEngine
from articulate_envs.compiled.step import (
    compiled_post_substep,
    compiled_pre_substep,
    compiled_update_targets,
    compiled_workspace,
    read_state,
)
from articulate_envs.scene import Scene


class SingleEngine(BufferedEngine):
    """One environment, stepped in Python; see :class:`articulate_envs.engine.Engine`."""

    def __init__(self, scene: Scene) -> None:
        """Create one environment of ``scene``; call :meth:`reset` before stepping."""
        super().__init__(scene, 1)
        self._workspace, self._wrench = compiled_workspace(), np.zeros(6)

    @property
    def model(self) -> mujoco.MjModel:
        """Model, with the sampled numbers of the last reset."""
        return self._models[0]

    @property
    def data(self) -> mujoco.MjData:
        """State of the physics."""
        return self._data[0]

    def _advance(self) -> None:
        b, motion = self._buffers, self._delay.motion
        compiled_update_targets(
            b.target[0], motion[0], b.q[0], self._retract[0], self._targets, self._workspace
        )
        if b.alive[0] > 0.0:
            self._simulate()
        self._refresh(np.zeros(1, dtype=np.int64))

    def _simulate(self) -> None:
        data, at, params, b = self.data, self._layout, self._substep, self._buffers
        data.xfrc_applied[at.push_row, :3] = b.push[0]
        for _ in range(params.substeps):
            compiled_pre_substep(0, data.ctrl, at, params, b)
            mujoco.mj_step(self.model, data)
            if not compiled_post_substep(
                0,
                data.qvel,
                data.qfrc_actuator,
                data.sensordata,
                data.site_xpos[at.tool_site],
                at,
                params,
                b,
                self._wrench,
            ):
                return
        read_state(0, data.qpos, data.qvel, at, b)
