"""Safety filter of the episode loop: targets are limited before any robot gets them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from articulate.errors import UsageError
from articulate.robot.arm import Arm
from articulate.robot.config import ControlConfig
from articulate.robot.control import joint_steps
from articulate.robot.kinematics import tool_pose
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


@dataclass(frozen=True, kw_only=True)
class ToolLimits:
    """Limits of the tool on a real arm."""

    speed_m_s: float = 0.25
    """Largest speed of the tool that targets may request [m/s]."""
    low_w: tuple[float, float, float] = (0.1, -0.6, -0.02)
    """Smallest coordinates of the tool, base frame [m]."""
    high_w: tuple[float, float, float] = (0.9, 0.6, 1.0)
    """Largest coordinates of the tool, base frame [m]."""


BISECTIONS = 6
"""Halvings of the interval in which a target reaches the box."""


def limit_tool(
    target: Array, last: Array, limits: ToolLimits, config: ControlConfig, arm: Arm
) -> Array:
    """Return targets (7,) [rad] on the line from the last ones within the tool's speed and box.

    From outside of the box, only targets that lead back are accepted.

    Args:
        target: Targets (7,) [rad], already within the joint limits.
        last: Last targets that were sent (7,) [rad].
        limits: Limits of the tool.
        config: Control stack, for the length of a step.
        arm: Kinematics.
    """
    low, high = np.asarray(limits.low_w), np.asarray(limits.high_w)
    shares = np.linspace(0.0, 1.0, 2**BISECTIONS + 1)
    pos_w = tool_pose(arm, last + shares[:, None] * (target - last))[:, :3, 3]
    moved = np.linalg.norm(pos_w - pos_w[0], axis=1)
    outside = np.maximum(np.maximum(low - pos_w, pos_w - high), 0.0).max(axis=1)
    good = (moved <= limits.speed_m_s * config.step_s) & (outside <= max(outside[0], 0.0))
    first_bad = len(good) if good.all() else int(np.argmin(good))
    return np.asarray(last + shares[max(first_bad - 1, 0)] * (target - last))


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
