"""The object's true state, late and with the errors that were drawn."""

from __future__ import annotations

import numpy as np

from articulate.task.observation import Estimate
from articulate.task.randomization import EpisodeParams
from articulate.task.randomization_config import RandomizationConfig
from articulate.task.state_estimation import NoisyEstimator
from articulate.task.task import Task
from articulate_deploy.robots.robot import SimulatedRobot


class TruthEstimator:
    """An :class:`~articulate_deploy.estimators.estimator.Estimator` that asks a stand-in."""

    def __init__(
        self,
        robot: SimulatedRobot,
        config: RandomizationConfig,
        task: Task,
        drawn: EpisodeParams,
        rng: np.random.Generator,
    ) -> None:
        """With errors and age of ``drawn`` (one row); noise of ``config`` comes from ``rng``."""
        self._robot, self._drawn, self._rng = robot, drawn, rng
        self._noisy = NoisyEstimator(1, task.span, task.kind, config)

    def reset(self) -> None:
        """The past is as the present."""
        now = self._robot.object_state()
        self._noisy.reset(np.zeros(1, dtype=np.int64), now.T_wh, now.opened)
        self.update()

    def update(self) -> None:
        """Take the state of this tick."""
        now = self._robot.object_state()
        self._noisy.push(now.T_wh, now.opened, now.speed)

    def estimate(self) -> Estimate:
        """What the policy is told."""
        return self._noisy.estimate(self._drawn, self._rng)

    def judged(self) -> Estimate:
        """The truth."""
        return self._robot.object_state()
