"""Safety filter of the episode loop: targets are limited before any robot gets them."""

from __future__ import annotations

import numpy as np

from articulate.errors import UsageError
from articulate.robot.arm import Arm
from articulate.robot.config import ControlConfig
from articulate.robot.control import joint_steps
from articulate.task.manifest import StartEntry
from articulate.transforms import Array

ROUNDING_RAD = 1e-9
"""Smallest change that counts as clipped [rad]."""
START_SLACK_RAD = 1e-3
"""Slack of an arm at rest beside the tolerance of its start [rad]."""


class StartError(UsageError):
    """The arm is not at the start of its episodes."""


def safe_target(requested: Array, last: Array, config: ControlConfig, arm: Arm) -> Array:
    """Return the targets (7,) [rad] nearest to the requested ones that are safe.

    They are within the joint limits and within one step of the last targets. A request that is not
    a number keeps the last target of its joint.

    Args:
        requested: Requested targets (7,) [rad].
        last: Last targets that were sent (7,) [rad].
        config: Step and margin.
        arm: Joint limits.
    """
    low, high = arm.bounds(config.margin_rad)
    requested = np.where(np.isfinite(requested), requested, last)
    change = np.clip(requested, low, high) - last
    most = joint_steps(config, arm)
    return np.asarray(last + np.clip(change, -most, most))


def was_clipped(requested: Array, sent: Array) -> bool:
    """Return True if the targets that were sent differ from the requested ones."""
    return not bool(np.all(np.abs(requested - sent) <= ROUNDING_RAD))


def check_start(q: Array, start: StartEntry) -> None:
    """Reject a start that no episode of training had.

    Raises:
        StartError: A joint at ``q`` (7,) [rad] is further from its start than the tolerance.
    """
    offset = np.abs(q - np.asarray(start.q))
    worst = int(np.argmax(offset))
    if not offset[worst] <= start.tolerance_rad + START_SLACK_RAD:
        raise StartError(
            f"joint_{worst + 1} is {offset[worst]:.3f} rad from its start; "
            f"{start.tolerance_rad:.3f} are allowed: call reset_to first"
        )
