"""Estimator from the object's true state in simulation, late and with the sampled errors."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from articulate.task.observation import Estimate
from articulate.task.randomization import EpisodeParams
from articulate.task.randomization_config import RandomizationConfig
from articulate.task.state_estimation import NoisyEstimator
from articulate.task.task import Task


class StateSource(Protocol):
    """Simulation that provides the true state of the object."""

    def object_state(self) -> Estimate:
        """Return the true state of the object (one row)."""


class TruthEstimator:
    """An :class:`~articulate_deploy.estimators.estimator.Estimator` for a simulated robot."""

    def __init__(
        self,
        robot: StateSource,
        config: RandomizationConfig,
        task: Task,
        params: EpisodeParams,
        rng: np.random.Generator,
    ) -> None:
        """Use errors and age of ``params`` (one row), and noise of ``config`` from ``rng``."""
        self._robot, self._params, self._rng = robot, params, rng
        self._noisy = NoisyEstimator(1, task.span, task.kind, config)

    def reset(self) -> None:
        """Fill the history with the present state."""
        now = self._robot.object_state()
        self._noisy.reset(np.zeros(1, dtype=np.int64), now.T_wh, now.opened)
        self.update()

    def update(self) -> None:
        """Store the state of this control step."""
        now = self._robot.object_state()
        self._noisy.push(now.T_wh, now.opened, now.speed)

    def estimate(self) -> Estimate:
        """Return the input of the policy."""
        return self._noisy.estimate(self._params, self._rng.normal(size=(1, 4)))

    def monitored_state(self) -> Estimate:
        """Return the true state."""
        return self._robot.object_state()
