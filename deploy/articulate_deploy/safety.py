"""What is sent to an arm is made safe here, whatever asked for it."""

from __future__ import annotations

import numpy as np

from articulate.errors import UsageError
from articulate.robot.arm import Arm
from articulate.robot.config import ControlConfig
from articulate.robot.control import joint_steps
from articulate.task.manifest import StartEntry
from articulate.transforms import Array

ROUNDING_RAD = 1e-9
"""Smallest change that counts as a clip [rad]."""
START_SLACK_RAD = 1e-3
"""What an arm at rest may miss beside the tolerance of its start [rad]."""


class StartError(UsageError):
    """The arm does not stand where episodes begin."""


def safe_target(wish: Array, last: Array, config: ControlConfig, arm: Arm) -> Array:
    """Targets (7,) nearest to ``wish`` within the joint limits and one step of ``last`` [rad].

    A wish that is not a number keeps the joint where it was told to be.
    """
    low, high = arm.bounds(config.margin_rad)
    wish = np.where(np.isfinite(wish), wish, last)
    change = np.clip(wish, low, high) - last
    most = joint_steps(config, arm)
    return np.asarray(last + np.clip(change, -most, most))


def was_clipped(wish: Array, sent: Array) -> bool:
    """Whether what was sent is not what was wished."""
    return not bool(np.all(np.abs(wish - sent) <= ROUNDING_RAD))


def check_start(q: Array, start: StartEntry) -> None:
    """Refuse to begin where no episode of training began.

    Raises:
        StartError: A joint at ``q`` (7,) [rad] is farther from its start than the tolerance.
    """
    away = np.abs(q - np.asarray(start.q))
    worst = int(np.argmax(away))
    if not away[worst] <= start.tolerance_rad + START_SLACK_RAD:
        raise StartError(
            f"joint_{worst + 1} stands {away[worst]:.3f} rad from its start; "
            f"{start.tolerance_rad:.3f} are allowed: call reset_to first"
        )
