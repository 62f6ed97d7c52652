"""Check ``trimming``: repairs left most of the collision volume of each part."""

from __future__ import annotations

from articulate.assets.check_report import Check
from articulate.checks.model import ObjectModel

ALLOWED = 1.0 / 3.0
"""Largest fraction of the collision volume of a part that repairs may cut away. A part that
loses more is no longer the part that was authored, so that the object counts as not repaired."""


def check_trimming(model: ObjectModel) -> tuple[Check, ...]:
    """Compare the trimmed fraction of each part with the limit; parts without cuts are omitted."""
    checks = []
    for link in model.asset.links:
        if link.trimmed <= 0.0:
            continue
        passed = link.trimmed <= ALLOWED
        message = f"repairs cut away {link.trimmed:.1%} of the collision volume of {link.name}"
        if not passed:
            message += ": that is no repair; correct the geometry or the limits in the input"
        checks.append(
            Check(
                name="trimming",
                outcome="passed" if passed else "failed",
                subject=link.name,
                measured=link.trimmed,
                allowed=ALLOWED,
                unit="1",
                message=message,
            )
        )
    return tuple(checks)
