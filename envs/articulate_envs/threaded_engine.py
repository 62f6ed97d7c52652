"""Batched engine: one model and one state per environment, on native threads.

Environments can have different scenes; each row of a batch belongs to one of them.
"""

from __future__ import annotations

import copy
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from articulate.simulator import mujoco
from articulate.transforms import Array, Ints
from articulate_envs.buffered_engine import BufferedEngine, model_layout
from articulate_envs.compiled.step import EnvironmentPointers, ThreadWorkspaces, compiled_step
from articulate_envs.native_mujoco import sampled_arrays, step_address
from articulate_envs.scene import Scene


class ThreadEngine(BufferedEngine):
    """N environments stepped by ``threads`` threads; see :class:`articulate_envs.engine.Engine`."""

    def __init__(self, scene: Scene | Sequence[Scene], n_envs: int, *, threads: int = 1) -> None:
        """Create N environments of one or several scenes; call :meth:`reset` before stepping.

        Args:
            scene: Scene of all environments, or scenes that are distributed evenly.
            n_envs: Number of environments.
            threads: Number of threads.
        """
        super().__init__(scene, n_envs)
        self.threads = max(1, min(threads, n_envs))
        self._pool = ThreadPoolExecutor(self.threads - 1) if self.threads > 1 else None
        self._claimed = np.zeros(n_envs, dtype=np.int64)
        self._edges = np.linspace(0, n_envs, self.threads + 1).astype(int)
        self._mj_step = step_address()
        self._thread_models = self._make_thread_models()
        self._thread_data = [
            [mujoco.MjData(one.nominal) for one in self.scenes] for _ in range(self.threads)
        ]
        self._layouts = np.array([model_layout(one) for one in self.scenes], dtype=np.int64)
        self._environments, self._workspaces = (
            self._environment_pointers(),
            self._workspace_pointers(),
        )

    def _make_thread_models(self) -> list[list[mujoco.MjModel]]:
        """Models of each scene and size for each thread; a single environment uses its model."""
        if self.n_envs == 1:
            return [self._models * len(self.scene.models)]
        models = [model for scene in self.scenes for model in scene.models]
        return [[copy.copy(model) for model in models] for _ in range(self.threads)]

    def _environment_pointers(self) -> EnvironmentPointers:
        arrays = [sampled_arrays(model) for model in self._models]
        return EnvironmentPointers(
            scene=self.scene_of,
            model=self._model_of,
            counts=np.array([counts for _, counts in arrays]),
            sampled=np.array([addresses for addresses, _ in arrays]),
            **_state_addresses(self._data),
        )

    def _workspace_pointers(self) -> ThreadWorkspaces:
        rows = self._thread_models
        data = [one for of_thread in self._thread_data for one in of_thread]
        addresses = {
            "data": np.array([d._address for d in data], dtype=np.int64),
            "torque": _addresses([d.qfrc_actuator for d in data]),
            "sensors": _addresses([d.sensordata for d in data]),
            "site": _addresses([d.site_xpos for d in data]),
            **_state_addresses(data),
        }
        shape = (self.threads, len(self.scenes))
        return ThreadWorkspaces(
            model=np.array([[m._address for m in models] for models in rows], dtype=np.int64),
            sampled=np.array([[sampled_arrays(m)[0] for m in models] for models in rows]),
            **{name: values.reshape(shape) for name, values in addresses.items()},
        )

    def _advance(self) -> None:
        args = (
            self._order,
            self._claimed,
            self._mj_step,
            self._environments,
            self._workspaces,
            self._layouts,
            self._substep,
            self._targets,
            self._delay.motion,
            self._retract,
            self._buffers,
            self._poses,
        )
        self._claimed[:] = 0
        if self._pool is None:
            compiled_step(0, 0, *args)
            return
        jobs = [
            self._pool.submit(compiled_step, thread, int(first), *args)
            for thread, first in enumerate(self._edges[1:-1], start=1)
        ]
        compiled_step(0, 0, *args)
        for job in jobs:
            job.result()

    def close(self) -> None:
        """End the threads."""
        if self._pool is not None:
            self._pool.shutdown()


def _addresses(arrays: list[Array]) -> Ints:
    return np.array([array.ctypes.data for array in arrays], dtype=np.int64)


def _state_addresses(data: list[mujoco.MjData]) -> dict[str, Ints]:
    """Addresses of the arrays of each ``data`` that are copied between environment and thread."""
    return {
        "qpos": _addresses([d.qpos for d in data]),
        "qvel": _addresses([d.qvel for d in data]),
        "warm": _addresses([d.qacc_warmstart for d in data]),
        "ctrl": _addresses([d.ctrl for d in data]),
        "xfrc": _addresses([d.xfrc_applied for d in data]),
    }
