"""List of all changes made to the input."""

from __future__ import annotations

import re

NOTE = "note: "
"""Prefix of a message about something that changes nothing of the meaning."""

OF_MESH = re.compile(rf"({NOTE})?mesh ([^:]+): (.+)", re.DOTALL)
"""A message about one mesh: prefix, file and text."""
MOST_NAMES = 3
"""At most this many files are named in one message."""


class Repairs:
    """Messages in the order of work, without duplicates."""

    def __init__(self) -> None:
        self._messages: dict[str, None] = {}

    def add(self, message: str) -> None:
        """Add a message about a change."""
        self._messages.setdefault(message)

    def note(self, message: str) -> None:
        """Add a message about something that changes nothing."""
        self._messages.setdefault(NOTE + message)

    def restore(self, messages: tuple[str, ...]) -> None:
        """Replace all messages by those of an earlier time."""
        self._messages = dict.fromkeys(messages)

    @property
    def messages(self) -> tuple[str, ...]:
        """All changes and notes so far; equal messages about many meshes become one."""
        meshes: dict[tuple[str, str], list[str]] = {}
        for message in self._messages:
            found = OF_MESH.match(message)
            if found:
                meshes.setdefault((found[1] or "", found[3]), []).append(found[2])
        out: dict[str, None] = {}
        for message in self._messages:
            found = OF_MESH.match(message)
            names = meshes[found[1] or "", found[3]] if found else []
            if found and len(names) > MOST_NAMES:
                first = ", ".join(names[:MOST_NAMES])
                more = len(names) - MOST_NAMES
                message = f"{found[1] or ''}meshes {first} and {more} more: {found[3]}"
            out.setdefault(message)
        return tuple(out)


def is_note(message: str) -> bool:
    """Return whether a message is about something that changes nothing."""
    return message.startswith(NOTE)
