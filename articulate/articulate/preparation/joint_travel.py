"""Range, load and free travel of joints, for repairs."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from articulate.assets.asset import Asset, Joint
from articulate.checks.interference import LIMIT_M, MAX_STATES, Interference, Sweeper
from articulate.checks.model import ObjectModel
from articulate.checks.sweep import Violation
from articulate.simulator import mujoco

HALVINGS = 5
"""Bisections of the step in which an interference begins."""
WEIGHINGS = 9
"""Positions of a joint at which the weight is computed."""


def links_carried_by(asset: Asset, link: str) -> list[str]:
    """Return ``link`` and all its descendants."""
    found = [link]
    for name in found:
        found += [other.name for other in asset.links if other.parent == name]
    return found


def weight_on(model: ObjectModel, joint: Joint) -> float:
    """Return the largest effort of gravity on a joint, the others closed [N or Nm]."""
    data, effort = model.data(), np.zeros(model.model.nv)
    largest = 0.0
    for q in np.linspace(joint.closed, joint.open, WEIGHINGS):
        model.set_joints(data, {joint.name: float(q)})
        mujoco.mj_comPos(model.model, data)
        mujoco.mj_comVel(model.model, data)
        mujoco.mj_rne(model.model, data, 0, effort)
        largest = max(largest, abs(float(effort[model.dof_address(joint.name)])))
    return largest


def exceeds_limit(interference: Interference) -> bool:
    """Return whether an overlap is deeper than the check allows."""
    return interference.excess_m > LIMIT_M


def reach(
    sweeper: Sweeper,
    violation: Violation,
    pairs: set[tuple[str, str]],
    counts: Callable[[Interference], bool] = exceeds_limit,
) -> tuple[float, float]:
    """Return the range of a joint around closed without interference of ``pairs`` [m or rad].

    Args:
        sweeper: Object to move.
        violation: Joint and positions of the other joints.
        pairs: Names of links.
        counts: Predicate for interferences that end the travel.
    """

    def is_blocked(q: float) -> bool:
        found = sweeper.interferences(violation.joint, {**violation.others, violation.joint: q})
        return any((m.one, m.other) in pairs and counts(m) for m in found)

    closed = sweeper.model.closed[violation.joint]
    ends = [closed]
    for positions in sweeper.positions(violation.joint, MAX_STATES):
        free = closed
        for q in positions.tolist():
            if is_blocked(q):
                for _ in range(HALVINGS):
                    middle = (free + q) / 2.0
                    free, q = (free, middle) if is_blocked(middle) else (middle, q)
                break
            free = q
        ends.append(free)
    return min(ends), max(ends)


def joint_range(joint: Joint) -> tuple[float, float]:
    """Return the limits of a joint [m or rad]; one turn from closed if it has none."""
    if joint.lower is None or joint.upper is None:
        return joint.closed - 2.0 * math.pi, joint.closed + 2.0 * math.pi
    return joint.lower, joint.upper
