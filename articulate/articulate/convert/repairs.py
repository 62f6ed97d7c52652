"""The list of everything that was changed on the way from the input."""

from __future__ import annotations


class Repairs:
    """Sentences in the order of work, each once."""

    def __init__(self) -> None:
        self._sentences: dict[str, None] = {}

    def add(self, sentence: str) -> None:
        """Note one change."""
        self._sentences.setdefault(sentence)

    @property
    def sentences(self) -> tuple[str, ...]:
        """All changes noted so far."""
        return tuple(self._sentences)
