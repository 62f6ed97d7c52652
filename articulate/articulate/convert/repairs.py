"""The list of everything that was changed on the way from the input."""

from __future__ import annotations

NOTE = "note: "
"""Begins a sentence about something that was put another way, without changing what it means."""


class Repairs:
    """Sentences in the order of work, each once."""

    def __init__(self) -> None:
        self._sentences: dict[str, None] = {}

    def add(self, sentence: str) -> None:
        """Note one change."""
        self._sentences.setdefault(sentence)

    def note(self, sentence: str) -> None:
        """Note what is worth knowing but changes nothing."""
        self._sentences.setdefault(NOTE + sentence)

    def restore(self, sentences: tuple[str, ...]) -> None:
        """Go back to the ``sentences`` of an earlier time."""
        self._sentences = dict.fromkeys(sentences)

    @property
    def sentences(self) -> tuple[str, ...]:
        """All changes and notes so far."""
        return tuple(self._sentences)


def is_note(sentence: str) -> bool:
    """Whether a sentence of the list tells of no change."""
    return sentence.startswith(NOTE)
