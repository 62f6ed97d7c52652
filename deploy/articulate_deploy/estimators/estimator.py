"""Protocol of estimators of the object's state."""

from __future__ import annotations

from typing import Protocol

from articulate.task.observation import Estimate


class Estimator(Protocol):
    """Estimator of the object's state; estimates have one row."""

    def reset(self) -> None:
        """Begin a new episode, with the robot at its start."""

    def update(self) -> None:
        """Take in the state after a control step."""

    def estimate(self) -> Estimate:
        """Return the input of the policy, once per control step."""

    def monitored_state(self) -> Estimate:
        """Return the state for the success criteria: the true one if known, else the estimate."""
