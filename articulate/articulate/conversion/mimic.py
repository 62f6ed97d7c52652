"""Joints that follow others: which do, and how far that takes them."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import replace

from articulate.conversion.joints import Travel
from articulate.formats.repairs import Repairs
from articulate.formats.source_object import SourceJoint

LEAST_WAY = 1e-6
"""A follower that goes less far than this [rad, source units] is held and not moved."""
Followed = tuple[str, float, float]
"""Joint that is followed, multiplier, offset in units of the source."""


def resolve_mimics(joints: Iterable[SourceJoint]) -> tuple[dict[str, Followed], dict[str, str]]:
    """Whom each joint follows, and of those that cannot whom they were to follow, in words.

    Nobody follows a joint that does not move, or himself over others. Who follows a follower
    follows the one that leads both.

    Args:
        joints: All that move.
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
    """The joint at the head of the chain that ``joint`` follows, with the whole way to it."""
    leader, multiplier, offset = leads[joint]
    while leader in leads:
        leader, further, start = leads[leader]
        multiplier, offset = multiplier * further, multiplier * start + offset
    return leader, multiplier, offset


def _circular(joint: str, leaders: Mapping[str, str]) -> bool:
    """Whether following leaders from ``joint`` leads back to it."""
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
    """The travels with each follower closed and open where its leader is.

    Args:
        travels: How far each joint goes by its own limits, by joint.
        leads: Whom each follower follows, none of them another follower.
        repairs: Takes which followers are stopped by limits of their own.
    """
    out = dict(travels)
    for name, (leader, multiplier, offset) in leads.items():
        ends = [multiplier * q + offset for q in (out[leader].closed, out[leader].open)]
        out[name] = _moved(name, out[name], leader, ends, repairs)
    return out


def _moved(name: str, own: Travel, leader: str, ends: list[float], repairs: Repairs) -> Travel:
    """The travel of a follower between two ``ends``, as far as its own limits let it."""
    low = -math.inf if own.lower is None else own.lower
    high = math.inf if own.upper is None else own.upper
    closed, far = (min(max(q, low), high) for q in ends)
    if not LEAST_WAY <= abs(far - closed) < math.inf:  # infinite: a factor beyond all numbers
        return own
    if max(abs(closed - ends[0]), abs(far - ends[1])) > LEAST_WAY:
        repairs.note(
            f"joint {name} would go from {ends[0]:.4g} to {ends[1]:.4g} with {leader}, and its "
            f"limits are {low:.4g} and {high:.4g}"
        )
    return replace(own, closed=closed, open=far, closed_rule=f"follows {leader}")
