"""Replay of recorded episodes by ``mj_step`` only, the limit of the engine's speed."""

from __future__ import annotations

import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numba import carray, njit  # type: ignore[attr-defined]  # numba declares no __all__

from articulate.robot.control import discretize_filter, filter_step, finger_params, finger_step
from articulate.transforms import Array, Ints
from articulate_envs.compiled.pointers import call, doubles
from articulate_envs.scene import Scene
from articulate_envs.threaded_engine import ThreadEngine


class ReplayPointers(NamedTuple):
    """Addresses (N,) of the model, the ``mjData`` and two of its arrays, of each environment.

    The engine copies environments into workspaces; the replay stays with one environment for a
    complete episode and finds its arrays in the cache.
    """

    model: Ints
    data: Ints
    ctrl: Ints
    xfrc: Ints


@njit(nogil=True, error_model="numpy", boundscheck=False)
def replay(
    first: int,
    last: int,
    mj_step: Any,
    pointers: Any,
    push_row: int,
    controls: Array,
    pushes: Array,
) -> None:
    """Step environments ``first`` to ``last`` - 1 with controls (N, T, substeps, nu)."""
    nu = controls.shape[3]
    for i in range(first, last):
        ctrl = carray(doubles(pointers.ctrl[i]), nu)
        xfrc = carray(doubles(pointers.xfrc[i] + 48 * push_row), 6)
        for t in range(controls.shape[1]):
            for k in range(3):
                xfrc[k] = pushes[i, t, k]
            for s in range(controls.shape[2]):
                for k in range(nu):
                    ctrl[k] = controls[i, t, s, k]
                call(mj_step, pointers.model[i], pointers.data[i])


@dataclass
class Recorded:
    """State before each control step that determines the controls of its physics steps."""

    filter: list[Array] = field(default_factory=list)
    target: list[Array] = field(default_factory=list)
    closing: list[Array] = field(default_factory=list)
    finger: list[Array] = field(default_factory=list)
    push: list[Array] = field(default_factory=list)

    def controls(self, scene: Scene) -> tuple[Array, Array]:
        """Return controls (N, T, substeps, nu) and pushes (N, T, 3)."""
        at, dt = scene.at, scene.physics.timestep_s
        A, B = discretize_filter(scene.control.omega_rad_s, dt)
        fingers = finger_params(scene.arm.gripper, dt)
        n, steps = len(self.finger[0]), len(self.finger)
        out = np.zeros((n, steps, scene.substeps, scene.nominal.nu))
        for t in range(steps):
            for i in range(n):
                state, finger = self.filter[t][i], self.finger[t][i]
                for s in range(scene.substeps):
                    filter_step(state, self.target[t][i], A, B)
                    finger = finger_step(finger, self.closing[t][i], fingers)
                    out[i, t, s, at.arm_ctrl : at.arm_ctrl + 7] = state[:, 0]
                    out[i, t, s, at.finger_ctrl] = finger
                    out[i, t, s, at.finger_ctrl + 1] = -finger
        return out, np.stack(self.push, axis=1)


class RecordingEngine(ThreadEngine):
    """Batched engine that records the state before each control step."""

    def __init__(self, scene: Scene, n_envs: int, *, threads: int) -> None:
        super().__init__(scene, n_envs, threads=threads)
        self.recorded: Recorded | None = None

    def _advance(self) -> None:
        b = self._buffers
        before = b.filter.copy(), b.gripper.closing.copy(), b.finger.copy(), b.push.copy()
        super()._advance()
        if self.recorded is not None:
            r = self.recorded
            for values, value in zip((r.filter, r.closing, r.finger, r.push), before, strict=True):
                values.append(value)
            r.target.append(b.target.copy())

    def replay_seconds(self, kept: dict[str, Array], controls: Array, pushes: Array) -> float:
        """Return the time of ``mj_step`` from the snapshot ``kept`` with those controls [s]."""
        self.restore(kept)
        args = (self._mj_step, self._replay_pointers(), self._layout.push_row, controls, pushes)
        edges = [int(edge) for edge in self._edges]
        with ThreadPoolExecutor(self.threads) as pool:
            begin = time.perf_counter()
            spans = pairwise(edges)
            jobs = [pool.submit(replay, first, last, *args) for first, last in spans]
            for job in jobs:
                job.result()
            return time.perf_counter() - begin

    def _replay_pointers(self) -> ReplayPointers:
        return ReplayPointers(
            model=np.array([model._address for model in self._models]),
            data=np.array([data._address for data in self._data]),
            ctrl=self._environments.ctrl,
            xfrc=self._environments.xfrc,
        )

    def positions(self) -> Array:
        """Return the positions of all models (N, nq)."""
        return np.stack([data.qpos.copy() for data in self._data])
