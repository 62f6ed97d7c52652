"""Simulated measurements: object state and contact force with delays and sampled errors."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from articulate.jit import row_function
from articulate.task.observation import Estimate
from articulate.task.randomization import COLUMNS, EpisodeParams
from articulate.task.randomization_config import MAX_DELAY_STEPS, RandomizationConfig
from articulate.transforms import Array, Ints

MAX_AGE = MAX_DELAY_STEPS + 1
"""Number of states that are kept."""
PART_LENGTH = 0.3
"""Scale of ``part_noise``: 0.3 m of a slide, 1 rad of a hinge, over the span."""
_BIAS, _YAW = COLUMNS.index("bias_x_m"), COLUMNS.index("bias_yaw_rad")
_AGE = COLUMNS.index("estimate_delay_steps")
_FORCE_BIAS = COLUMNS.index("force_bias_x_n")


class StateHistory(NamedTuple):
    """States of N objects, the latest first."""

    T_wh: Array
    """Poses of the handles in the world (ages, N, 4, 4)."""
    opened: Array
    """Fractions open (ages, N)."""
    speed: Array
    """Speeds of the parts (ages, N) [m/s or rad/s]."""


class EstimatorParams(NamedTuple):
    """Standard deviations of the noise that is new in each control step."""

    pos_m: float
    """Position of the handle, each axis [m]."""
    opened: Array
    """Fraction open of each object (N,)."""


@row_function
def push_state(history: StateHistory, T_wh: Array, opened: Array, speed: Array) -> None:
    """Store the state of a control step: poses (N, 4, 4), fractions (N,), speeds (N,)."""
    for age in range(len(history.opened) - 1, 0, -1):
        history.T_wh[age] = history.T_wh[age - 1]
        history.opened[age] = history.opened[age - 1]
        history.speed[age] = history.speed[age - 1]
    history.T_wh[0] = T_wh
    history.opened[0] = opened
    history.speed[0] = speed


@row_function
def estimate_state(
    history: StateHistory,
    i: int,
    values: Array,
    noise: Array,
    params: EstimatorParams,
    T_wh: Array,
) -> tuple[float, float]:
    """Write the estimated handle pose of object ``i``; return its fraction open and its speed.

    Args:
        history: States of N objects.
        i: Index of the object.
        values: Its episode parameters (columns,).
        noise: Standard normal numbers (4,): position and fraction open.
        params: Standard deviations.
        T_wh: Output (4, 4).
    """
    age = int(values[_AGE])
    true = history.T_wh[age, i]
    c, s = np.cos(values[_YAW]), np.sin(values[_YAW])
    for j in range(3):
        T_wh[0, j] = c * true[0, j] - s * true[1, j]
        T_wh[1, j] = s * true[0, j] + c * true[1, j]
        T_wh[2, j] = true[2, j]
        T_wh[j, 3] = true[j, 3] + values[_BIAS + j] + params.pos_m * noise[j]
    opened = history.opened[age, i] + params.opened[i] * noise[3]
    return opened, history.speed[age, i]


@row_function
def measured_force(force_w: Array, values: Array, noise: Array, noise_n: float, out: Array) -> None:
    """Write the measured force on a gripper: the true one with bias and noise.

    An arm derives it from its torques. Joint friction and a wrong payload make errors: 2 N at rest
    in a recording of libfranka's issue 112.

    Args:
        force_w: True net force, world axes (3,) or more [N].
        values: Episode parameters (columns,), with the constant error.
        noise: Standard normal numbers (3,).
        noise_n: Standard deviation of the noise, each axis [N].
        out: Output (3,) [N].
    """
    for k in range(3):
        out[k] = force_w[k] + values[_FORCE_BIAS + k] + noise_n * noise[k]


class NoisyEstimator:
    """Estimator that keeps the last states of N objects and returns them late and with errors."""

    def __init__(
        self,
        n: int,
        span: float | Array,
        kind: str | Sequence[str],
        config: RandomizationConfig,
    ) -> None:
        """Create an estimator of N objects.

        Args:
            n: Number of objects.
            span: Travel of the joint, of all objects or of each (N,) [m or rad].
            kind: ``"slide"`` or ``"hinge"``, of all joints or of each.
            config: Noise.
        """
        length = np.where(np.asarray(kind) == "slide", PART_LENGTH, 1.0)
        noise = np.broadcast_to(config.part_noise * length / np.abs(span), (n,))
        self.params = EstimatorParams(config.estimate_noise_m, noise.copy())
        """Standard deviations of the noise."""
        self.history = StateHistory(
            np.tile(np.eye(4), (MAX_AGE, n, 1, 1)), np.zeros((MAX_AGE, n)), np.zeros((MAX_AGE, n))
        )
        """Last states."""

    def reset(self, rows: Ints, T_wh: Array, opened: Array) -> None:
        """Fill the history of ``rows`` (M,) with initial poses (M, 4, 4) and fractions (M,)."""
        self.history.T_wh[:, rows] = T_wh
        self.history.opened[:, rows] = opened
        self.history.speed[:, rows] = 0.0

    def push(self, T_wh: Array, opened: Array, speed: Array) -> None:
        """Store the true state of a control step; see :func:`push_state`."""
        push_state(self.history, T_wh, opened, speed)

    def estimate(self, params: EpisodeParams, noise: Array) -> Estimate:
        """Return the estimate under the episode parameters (N rows).

        Args:
            params: Episode parameters.
            noise: Standard normal numbers (N, 4 or more), of which the first 4 are used.
        """
        n = len(params.values)
        T_wh, opened, speed = np.tile(np.eye(4), (n, 1, 1)), np.empty(n), np.empty(n)
        for i in range(n):
            opened[i], speed[i] = estimate_state(
                self.history, i, params.values[i], noise[i], self.params, T_wh[i]
            )
        return Estimate(T_wh=T_wh, opened=opened, speed=speed)

    def snapshot(self) -> dict[str, Array]:
        """Return copies of the states."""
        return {f"history_{k}": v.copy() for k, v in self.history._asdict().items()}

    def restore(self, snapshot: dict[str, Array]) -> None:
        """Continue from :meth:`snapshot`."""
        for name, array in self.history._asdict().items():
            array[:] = snapshot[f"history_{name}"]
