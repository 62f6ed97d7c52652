"""Names of parts: PartNet-Mobility's ``semantics.txt``, and labels that do not reveal the joint."""

from __future__ import annotations

import re
from pathlib import Path

from articulate.errors import UsageError
from articulate.untrusted import read_bounded

MAX_BYTES = 1_000_000
"""Largest ``semantics.txt`` that is read."""
JOINT_WORDS = frozenset(
    {
        *("hinge", "hinged", "slide", "slider", "sliding", "rotation", "rotating", "rotary"),
        *("revolute", "translation", "translating", "prismatic", "continuous", "fixed", "static"),
        *("free", "heavy", "joint", "link", "helper", "moving", "movable"),
    }
)
"""Words of a semantic name that would reveal a joint, or that only number parts."""


def semantic_names(folder: Path) -> dict[str, str]:
    """Read the semantic name of each link from ``semantics.txt``; empty without the file.

    Each line holds a link, a joint word and a name.
    """
    try:
        content = read_bounded(folder / "semantics.txt", MAX_BYTES)
    except UsageError:
        return {}
    words = [line.split() for line in content.decode("utf-8", errors="replace").splitlines()]
    return {w[0]: w[2] for w in words if len(w) >= 3}


def plain_label(name: str) -> str:
    """Return the words of a name without numbers and joint words; ``part`` if none is left.

    ``doorLeft`` and ``door_left`` have the same words.
    """
    spaced = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", name)
    words = [w for w in re.split(r"[^a-z]+", spaced.lower()) if w]
    return " ".join(w for w in words if w not in JOINT_WORDS) or "part"
