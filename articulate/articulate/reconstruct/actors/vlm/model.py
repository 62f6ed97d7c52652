"""Model: whatever answers a request of words and pictures with words."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal, Protocol

KEY_VERSION = 1
"""Of what :meth:`Request.key` hashes; answers kept under another are asked for again."""


@dataclass(frozen=True)
class Picture:
    """A picture that a model is shown."""

    caption: str
    """Stands before it, as words."""
    png: bytes


Piece = str | Picture


@dataclass(frozen=True)
class Turn:
    """What one side says."""

    role: Literal["user", "model"]
    pieces: tuple[Piece, ...]

    @property
    def text(self) -> str:
        """All words, with captions where pictures are."""
        return "\n".join(p if isinstance(p, str) else f"[{p.caption}]" for p in self.pieces)


@dataclass(frozen=True, kw_only=True)
class Request:
    """One question with all that was said before it."""

    title: str
    """What it is about, for people; models are not told."""
    system: str
    """What holds for the whole conversation."""
    turns: tuple[Turn, ...]
    """Alternately user and model; the last is the user's."""
    schema: Mapping[str, Any]
    """JSON schema of the answer."""

    def after(self, answer: str, complaint: str) -> Request:
        """The question put again, after an answer that does not do."""
        more = (Turn("model", (answer,)), Turn("user", (complaint,)))
        return Request(
            title=self.title, system=self.system, turns=(*self.turns, *more), schema=self.schema
        )

    def key(self, source: str) -> str:
        """Hash of all that decides an answer: who gives it, words, pictures, schema."""
        turns = [
            [t.role, [p if isinstance(p, str) else [p.caption, _sha(p.png)] for p in t.pieces]]
            for t in self.turns
        ]
        content = [KEY_VERSION, source, self.system, turns, self.schema]
        return _sha(json.dumps(content, sort_keys=True).encode())


@dataclass(frozen=True, kw_only=True)
class Reply:
    """What a model said."""

    text: str
    model: str
    """The model that answered, as it calls itself."""
    seconds: float = 0.0
    tokens_in: int = 0
    tokens_out: int = 0
    kept: bool = False
    """Whether it was said in an earlier run and kept."""


class Model(Protocol):
    """Answers requests."""

    @property
    def name(self) -> str:
        """Name in messages and reports."""
        ...

    @property
    def source(self) -> str:
        """What decides its answers besides the request: the model, and who runs it."""
        ...

    def ask(self, request: Request) -> Reply:
        """Its answer.

        Raises:
            UsageError: It cannot be asked, or does not answer.
        """
        ...


def _sha(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()
