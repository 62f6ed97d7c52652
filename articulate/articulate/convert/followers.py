"""Joints that follow others: which do, and how far that takes them."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import replace

from articulate.convert.joints import Travel
from articulate.convert.read import SourceJoint
from articulate.convert.repairs import Repairs

LEAST_WAY = 1e-6
"""A follower that goes less far than this [rad, source units] is held and not moved."""
Followed = tuple[str, float, float]
"""Joint that is followed, multiplier, offset in units of the source."""


def followed(joints: Iterable[SourceJoint]) -> tuple[dict[str, Followed], dict[str, str]]:
    """Whom each joint follows, and of those that cannot whom they were to follow, in words.

    Nobody follows a joint that does not move, or himself over others.

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
    return kept, dropped


def _circular(joint: str, leaders: Mapping[str, str]) -> bool:
    """Whether following leaders from ``joint`` leads back to it."""
    seen = {joint}
    while joint in leaders:
        joint = leaders[joint]
        if joint in seen:
            return True
        seen.add(joint)
    return False


def with_followers(
    travels: Mapping[str, Travel], leads: Mapping[str, Followed], repairs: Repairs
) -> dict[str, Travel]:
    """The travels with each follower closed and open where its leader is.

    Args:
        travels: How far each joint goes by its own limits, by joint.
        leads: Whom each follower follows.
        repairs: Takes which followers are stopped by limits of their own.
    """
    out = dict(travels)
    for name in _leaders_first(leads):
        leader, multiplier, offset = leads[name]
        ends = [multiplier * q + offset for q in (out[leader].closed, out[leader].open)]
        out[name] = _moved(name, out[name], leader, ends, repairs)
    return out


def _leaders_first(leads: Mapping[str, Followed]) -> list[str]:
    ordered: dict[str, None] = {}
    for name in leads:
        chain = []
        while name in leads and name not in ordered:
            chain.append(name)
            name = leads[name][0]
        ordered |= dict.fromkeys(reversed(chain))
    return list(ordered)


def _moved(name: str, own: Travel, leader: str, ends: list[float], repairs: Repairs) -> Travel:
    """The travel of a follower between two ``ends``, as far as its own limits let it."""
    low = -math.inf if own.lower is None else own.lower
    high = math.inf if own.upper is None else own.upper
    closed, far = (min(max(q, low), high) for q in ends)
    if not LEAST_WAY <= abs(far - closed) < math.inf:  # infinite: factors multiplied along a chain
        return own
    if max(abs(closed - ends[0]), abs(far - ends[1])) > LEAST_WAY:
        repairs.note(
            f"joint {name} would go from {ends[0]:.4g} to {ends[1]:.4g} with {leader}, and its "
            f"limits are {low:.4g} and {high:.4g}"
        )
    return replace(own, closed=closed, open=far, closed_rule=f"follows {leader}")
