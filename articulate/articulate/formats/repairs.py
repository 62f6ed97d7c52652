"""The list of everything that was changed on the way from the input."""

from __future__ import annotations

import re

NOTE = "note: "
"""Begins a sentence about something that was put another way, without changing what it means."""

OF_MESH = re.compile(rf"({NOTE})?mesh ([^:]+): (.+)", re.DOTALL)
"""A sentence about one mesh: its file, and what is said of it."""
MOST_NAMES = 3
"""Of so many files at most the names are given."""


class Repairs:
    """Sentences in the order of work, each once."""

    def __init__(self) -> None:
        self._messages: dict[str, None] = {}

    def add(self, sentence: str) -> None:
        """Note one change."""
        self._messages.setdefault(sentence)

    def note(self, sentence: str) -> None:
        """Note what is worth knowing but changes nothing."""
        self._messages.setdefault(NOTE + sentence)

    def restore(self, messages: tuple[str, ...]) -> None:
        """Go back to the ``messages`` of an earlier time."""
        self._messages = dict.fromkeys(messages)

    @property
    def messages(self) -> tuple[str, ...]:
        """All changes and notes so far; what is said of many meshes is said once."""
        meshes: dict[tuple[str, str], list[str]] = {}
        for sentence in self._messages:
            found = OF_MESH.match(sentence)
            if found:
                meshes.setdefault((found[1] or "", found[3]), []).append(found[2])
        out: dict[str, None] = {}
        for sentence in self._messages:
            found = OF_MESH.match(sentence)
            names = meshes[found[1] or "", found[3]] if found else []
            if found and len(names) > MOST_NAMES:
                first = ", ".join(names[:MOST_NAMES])
                more = len(names) - MOST_NAMES
                sentence = f"{found[1] or ''}meshes {first} and {more} more: {found[3]}"
            out.setdefault(sentence)
        return tuple(out)


def is_note(sentence: str) -> bool:
    """Whether a sentence of the list tells of no change."""
    return sentence.startswith(NOTE)
