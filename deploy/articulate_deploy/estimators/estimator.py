"""The protocol of estimators: where the object's state comes from."""

from __future__ import annotations

from typing import Protocol

from articulate.task.observation import Estimate


class Estimator(Protocol):
    """What is known of the object. Estimates have one row."""

    def reset(self) -> None:
        """A new episode begins; the robot stands at its start."""

    def update(self) -> None:
        """A tick has passed."""

    def estimate(self) -> Estimate:
        """What the policy is told, once a tick."""

    def judged(self) -> Estimate:
        """What the episode is judged by: the truth where it is known, else the estimate."""
