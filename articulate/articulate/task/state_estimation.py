"""A simulated estimator: the object's true state with the noise and age that were drawn."""

from __future__ import annotations

import numpy as np

from articulate.task.observation import Estimate
from articulate.task.randomization import EpisodeParams
from articulate.task.randomization_config import MAX_DELAY_STEPS, RandomizationConfig
from articulate.transforms import Array, Ints

MAX_AGE = MAX_DELAY_STEPS + 1
"""How many states are kept."""
PART_LENGTH = 0.3
"""What ``part_noise`` is a share of: 0.3 m of a slide, 1 rad of a hinge, over the span."""


class NoisyEstimator:
    """Holds the last states of N objects and gives them late and with errors."""

    def __init__(self, n: int, span: float, kind: str, config: RandomizationConfig) -> None:
        """For N objects whose joint goes ``span`` [m or rad] from closed to open."""
        self._config = config
        length = PART_LENGTH if kind == "slide" else 1.0
        self.part_noise = config.part_noise * length / abs(span)
        """Standard deviation of the fraction open."""
        self.poses = np.tile(np.eye(4), (MAX_AGE, n, 1, 1))
        self.opened = np.zeros((MAX_AGE, n))
        self.speed = np.zeros((MAX_AGE, n))

    def reset(self, rows: Ints, T_wh: Array, opened: Array) -> None:
        """Fill the past of ``rows`` with the state at their start."""
        self.poses[:, rows] = T_wh
        self.opened[:, rows] = opened
        self.speed[:, rows] = 0.0

    def push(self, T_wh: Array, opened: Array, speed: Array) -> None:
        """Take the true state of this tick: poses (N, 4, 4), fractions (N,), speeds (N,)."""
        for past, now in ((self.poses, T_wh), (self.opened, opened), (self.speed, speed)):
            past[1:] = past[:-1]
            past[0] = now

    def estimate(self, drawn: EpisodeParams, rng: np.random.Generator) -> Estimate:
        """What is known at this tick under the draws (N rows); noise comes from ``rng``."""
        n = len(drawn.values)
        age = drawn["estimate_delay_steps"].astype(np.int64)
        rows = np.arange(n)
        T_wh = self.poses[age, rows].copy()
        _turn(T_wh, drawn["bias_yaw_rad"])
        noise = rng.normal(size=(n, 4))
        T_wh[:, :3, 3] += drawn["bias"] + self._config.estimate_noise_m * noise[:, :3]
        return Estimate(
            T_wh=T_wh,
            opened=self.opened[age, rows] + self.part_noise * noise[:, 3],
            speed=self.speed[age, rows].copy(),
        )

    def snapshot(self) -> dict[str, Array]:
        """The states held."""
        return {
            "estimate_poses": self.poses.copy(),
            "estimate_opened": self.opened.copy(),
            "estimate_speed": self.speed.copy(),
        }

    def restore(self, snapshot: dict[str, Array]) -> None:
        """Continue from :meth:`snapshot`."""
        self.poses[:] = snapshot["estimate_poses"]
        self.opened[:] = snapshot["estimate_opened"]
        self.speed[:] = snapshot["estimate_speed"]


def felt(force_w: Array, drawn: EpisodeParams, noise_n: float, rng: np.random.Generator) -> Array:
    """What an arm says of the forces (N, 3) on its hand, world axes [N].

    An arm tells them from its torques, and is wrong by what its joints' friction and the weight
    that it believes in are wrong: at rest by 2 N in a recording of libfranka's issue 112.

    Args:
        force_w: What is true (N, 3) [N].
        drawn: The constant errors (N rows).
        noise_n: Standard deviation of what is added anew, each axis [N].
        rng: Where that comes from.
    """
    noise = rng.normal(size=force_w.shape)
    return np.asarray(force_w + drawn["force_bias"] + noise_n * noise)


def _turn(T: Array, yaw_rad: Array) -> None:
    """Turn the axes of poses (N, 4, 4) by yaws (N,) [rad] about the vertical, in place."""
    c, s = np.cos(yaw_rad)[:, None], np.sin(yaw_rad)[:, None]
    x, y = T[:, 0, :3].copy(), T[:, 1, :3].copy()
    T[:, 0, :3] = c * x - s * y
    T[:, 1, :3] = s * x + c * y
