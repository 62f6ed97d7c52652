"""Resolve mimic joints and their travel."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import replace

from articulate.conversion.joints import Travel
from articulate.formats.repairs import Repairs
from articulate.formats.source_object import SourceJoint

MIN_TRAVEL = 1e-6
"""A follower of less travel than this [rad, source units] keeps its limits."""
Followed = tuple[str, float, float]
"""Leading joint, multiplier, offset in units of the source."""


def resolve_mimics(joints: Iterable[SourceJoint]) -> tuple[dict[str, Followed], dict[str, str]]:
    """Return the leader of each mimic joint, and of those without a valid leader the reason.

    A leader must move, and must not follow the joint in turn. A joint that follows a follower is
    given the leader of both.

    Args:
        joints: All moving joints.
    """
    joints = tuple(joints)
    moving = {joint.name for joint in joints}
    leaders = {joint.name: joint.mimic[0] for joint in joints if joint.mimic}
    kept: dict[str, Followed] = {}
    dropped: dict[str, str] = {}
    for joint in joints:
        if joint.mimic is None:
            continue
        leader = joint.mimic[0]
        if leader in moving and not _circular(joint.name, leaders):
            kept[joint.name] = joint.mimic
            continue
        dropped[joint.name] = "itself" if leader in moving else f"{leader}, which does not move"
        del leaders[joint.name]
    led = {name: _by_the_first(name, kept) for name in kept}
    for name, (_, multiplier, offset) in list(led.items()):
        if not (math.isfinite(multiplier) and math.isfinite(offset)):
            dropped[name] = f"{kept[name][0]} by a factor that is not finite"
            del led[name]
    return led, dropped


def _by_the_first(joint: str, leads: Mapping[str, Followed]) -> Followed:
    """Return the first leader of the chain of ``joint``, with the composed factor and offset."""
    leader, multiplier, offset = leads[joint]
    while leader in leads:
        leader, further, start = leads[leader]
        multiplier, offset = multiplier * further, multiplier * start + offset
    return leader, multiplier, offset


def _circular(joint: str, leaders: Mapping[str, str]) -> bool:
    """Return whether the chain of leaders of ``joint`` leads back to it."""
    seen = {joint}
    while joint in leaders:
        joint = leaders[joint]
        if joint in seen:
            return True
        seen.add(joint)
    return False


def apply_mimics(
    travels: Mapping[str, Travel], leads: Mapping[str, Followed], repairs: Repairs
) -> dict[str, Travel]:
    """Return the travels, each follower closed and open where its leader is.

    Args:
        travels: Travel of each joint by its limits.
        leads: Leader of each follower, which is not a follower.
        repairs: Receives the followers whose limits are smaller than their travel.
    """
    out = dict(travels)
    for name, (leader, multiplier, offset) in leads.items():
        ends = [multiplier * q + offset for q in (out[leader].closed, out[leader].open)]
        out[name] = _moved(name, out[name], leader, ends, repairs)
    return out


def _moved(name: str, own: Travel, leader: str, ends: list[float], repairs: Repairs) -> Travel:
    """Return the travel of a follower between two ``ends``, within its limits."""
    low = -math.inf if own.lower is None else own.lower
    high = math.inf if own.upper is None else own.upper
    closed, far = (min(max(q, low), high) for q in ends)
    if not MIN_TRAVEL <= abs(far - closed) < math.inf:  # infinite: a factor beyond all numbers
        return own
    if max(abs(closed - ends[0]), abs(far - ends[1])) > MIN_TRAVEL:
        repairs.note(
            f"joint {name} would go from {ends[0]:.4g} to {ends[1]:.4g} with {leader}, and its "
            f"limits are {low:.4g} and {high:.4g}"
        )
    return replace(own, closed=closed, open=far, closed_rule=f"follows {leader}")
