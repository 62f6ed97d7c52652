"""Batched engine on MuJoCo Warp: the physics of all environments on one GPU.

The host computes controls before and monitors samples after the physics steps of a control step,
with the functions of the other engines (:mod:`.compiled.worlds`). The device gets the controls of
all physics steps at once and returns samples of all of them.

Warp calculates in single precision, and finds other contact points of meshes. Boxes that are
parallel to seven digits, as fingers at a handle in a precomputed start, can be without a contact
for a physics step. So results are close to those of the other engines, but not equal. On a CPU they
are reproducible; on a GPU the order of parallel sums changes the last digits.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING, Any

import numpy as np

from articulate.errors import EngineError, MissingError
from articulate.simulator import mujoco
from articulate.transforms import Array
from articulate_envs.buffered_engine import BufferedEngine
from articulate_envs.compiled.worlds import compiled_read_samples, compiled_write_controls
from articulate_envs.config import WarpConfig
from articulate_envs.scene import Scene

if TYPE_CHECKING:
    from articulate_envs.warp_worlds import Worlds


class WarpEngine(BufferedEngine):
    """N environments of one scene on one device; see :class:`articulate_envs.engine.Engine`."""

    def __init__(
        self,
        scene: Scene | Sequence[Scene],
        n_envs: int,
        *,
        threads: int = 1,
        config: WarpConfig | None = None,
    ) -> None:
        """Create N environments of one scene; call :meth:`reset` before stepping.

        Args:
            scene: Scene of all environments.
            n_envs: Number of environments.
            threads: Number of threads on the host.
            config: Memory on the device.

        Raises:
            EngineError: There are several scenes, or MuJoCo Warp does not support the model.
            MissingError: MuJoCo Warp is not installed.
        """
        super().__init__(scene, n_envs)
        if len(self.scenes) > 1:
            raise EngineError(
                f"{len(self.scenes)} scenes for an engine on MuJoCo Warp, which runs one; use one "
                "engine for each, or engine cpu"
            )
        worlds = _worlds_class()
        self._worlds: Worlds = worlds(self.scene, n_envs, config or WarpConfig())
        self._loads: dict[int, Array] = {}
        self._downloaded: dict[str, Array] | None = None
        threads = max(1, min(threads, n_envs))
        self._pool = ThreadPoolExecutor(threads)
        self._edges = [int(edge) for edge in np.linspace(0, n_envs, threads + 1)]

    def _allocate(self) -> tuple[list[mujoco.MjModel], list[mujoco.MjData]]:
        """Return one model and one state for all environments in turn: the device keeps theirs."""
        model = copy.copy(self.scene.nominal)
        return [model] * self.n_envs, [mujoco.MjData(model)] * self.n_envs

    def _load(self, i: int) -> None:
        k = int(self._model_of[i])
        self._loads[i] = self._worlds.pack(k, self._models[i], self._data[i])

    def _flush(self) -> None:
        """Write the environments that were loaded to the device."""
        if self._loads:
            self._worlds.load(self._loads)
            self._loads = {}
            self._downloaded = None

    def _advance(self) -> None:
        self._flush()
        b, worlds = self._buffers, self._worlds
        common = (self._layout, self._substep, self._targets)
        self._run_threads(
            compiled_write_controls,
            worlds.controls,
            *common,
            self._delay.motion,
            self._retract,
            b,
        )
        worlds.forces[:] = b.push
        was_alive = b.alive > 0.0
        samples, qpos = worlds.step()
        self._downloaded = None
        self._run_threads(compiled_read_samples, samples, qpos, *common, b, self._poses)
        for i in np.flatnonzero(was_alive & (b.alive == 0.0)):
            self._park(int(i))

    def _run_threads(self, function: Callable[..., None], *args: Any) -> None:
        """Call a compiled function for all environments, on all threads."""
        spans = zip(self._edges[:-1], self._edges[1:], strict=True)
        for job in [self._pool.submit(function, *span, *args) for span in spans]:
            job.result()

    def _park(self, i: int) -> None:
        """Put a diverged environment at the model's reference positions until it is reset."""
        self._write_model(i, self._values[i])
        mujoco.mj_resetData(self._models[i], self._data[i])
        self._load(i)

    def physics_state(self, i: int) -> tuple[mujoco.MjModel, mujoco.MjData]:
        """Return model and data of environment ``i``: read them only, and before the next call."""
        self._flush()
        if self._downloaded is None:
            self._downloaded = self._worlds.state()
        self._write_model(i, self._values[i])
        data = self._data[i]
        mujoco.mj_resetData(self._models[i], data)
        for name, values in self._downloaded.items():
            getattr(data, name)[:] = values[i]
        return self._models[i], data

    def close(self) -> None:
        """End the threads."""
        self._pool.shutdown()


def warp_device() -> str:
    """Return the name of the device on which environments run: a GPU if there is one.

    Raises:
        MissingError: MuJoCo Warp is not installed.
    """
    return _worlds_class().device_name()


def _worlds_class() -> type[Worlds]:
    try:
        import warp as wp

        wp.config.log_level = wp.LOG_WARNING
        from articulate_envs.warp_worlds import Worlds
    except ModuleNotFoundError:
        raise MissingError(
            "engine warp needs mujoco-warp, which is not installed; "
            'run: pip install "articulate-robots[warp]"'
        ) from None
    return Worlds
