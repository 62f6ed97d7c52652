"""Turn accepted failures of the check ``authored_overlap`` into warnings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from articulate.assets.check_report import Check

AUTHORED_OVERLAP = "authored_overlap"


def accept_overlaps(checks: Sequence[Check]) -> tuple[Check, ...]:
    """Return ``checks`` with overlaps of authored parts as warnings where nothing jams.

    Some objects are authored so that parts run a few millimetres through each other although
    every joint opens and closes. Acceptance is a choice of the user (``--accept
    authored_overlap``) and not the default, because the engine may let the parts pass only for
    contacts that conversion excluded; then the force check cannot see the obstacle.

    A failure stays a failure where no depth was measured (joints that block each other), or
    where the force checks ``opening`` or ``closing`` of the same joint did not pass.
    """
    opened = {c.subject for c in checks if c.name == "opening" and c.outcome == "passed"}
    opened -= {c.subject for c in checks if c.name == "closing" and c.outcome != "passed"}
    return tuple(
        replace(c, outcome="warning", message=f"accepted: {c.message}")
        if (
            c.name == AUTHORED_OVERLAP
            and c.outcome == "failed"
            and c.measured is not None
            and c.subject in opened
        )
        else c
        for c in checks
    )
