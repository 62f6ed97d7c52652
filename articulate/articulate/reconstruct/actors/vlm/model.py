"""Requests to a model and its replies."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal, Protocol

KEY_VERSION = 1
"""Version of the content that :meth:`Request.key` hashes; other versions miss the cache."""


@dataclass(frozen=True)
class CaptionedImage:
    """An image of a request."""

    caption: str
    """Text before the image."""
    png: bytes


@dataclass(frozen=True)
class CaptionedVideo:
    """A video of a request; models that take no video receive its frames."""

    caption: str
    """Text before the video."""
    mp4: bytes
    fps: float
    """Frames per second that the model samples."""
    frames: tuple[CaptionedImage, ...]


Content = str | CaptionedImage | CaptionedVideo


@dataclass(frozen=True)
class Turn:
    """One message of a conversation."""

    role: Literal["user", "model"]
    content: tuple[Content, ...]

    @property
    def text(self) -> str:
        """The text of the message, with captions for images."""
        return "\n".join(p if isinstance(p, str) else f"[{p.caption}]" for p in self.content)


@dataclass(frozen=True, kw_only=True)
class Request:
    """A request with all earlier messages of its conversation."""

    title: str
    """Subject, for reports; it is not sent."""
    system: str
    """Instructions for the entire conversation."""
    turns: tuple[Turn, ...]
    """Messages of user and model in turn; the last is the user's."""
    schema: Mapping[str, Any]
    """JSON schema of the answer."""

    def after(self, answer: str, error: str) -> Request:
        """Return the request that follows an invalid answer."""
        more = (Turn("model", (answer,)), Turn("user", (error,)))
        return Request(
            title=self.title, system=self.system, turns=(*self.turns, *more), schema=self.schema
        )

    def key(self, source: str) -> str:
        """Hash everything that determines an answer: the model, texts, images and the schema."""
        turns = [[t.role, [_identity(piece) for piece in t.content]] for t in self.turns]
        content = [KEY_VERSION, source, self.system, turns, self.schema]
        return _sha(json.dumps(content, sort_keys=True).encode())


@dataclass(frozen=True, kw_only=True)
class Reply:
    """Reply of a model."""

    text: str
    model: str
    """Name of the model in the reply."""
    seconds: float = 0.0
    tokens_in: int = 0
    tokens_out: int = 0
    """Generated tokens, thoughts included."""
    is_cut: bool = False
    """True if the answer ends at the token limit."""
    block_reason: str = ""
    """Reason of the model or server for sending no answer; empty otherwise."""
    cached: bool = False
    """True for a reply from the cache."""


class Model(Protocol):
    """A model that answers requests; :func:`providers.create_model` makes those of a network."""

    @property
    def name(self) -> str:
        """Name in messages and reports."""
        ...

    @property
    def source(self) -> str:
        """Model and server; with the request they determine an answer."""
        ...

    def estimate_tokens(self, request: Request) -> int:
        """Estimate the input tokens of a request, rather too many than too few."""
        ...

    def generate(self, request: Request) -> Reply:
        """Send a request and return the reply.

        Raises:
            UsageError: The request cannot be sent, or the reply cannot be read.
        """
        ...


def _identity(piece: Content) -> Any:
    """Return what identifies a piece of content in a hash."""
    if isinstance(piece, str):
        return piece
    content = piece.png if isinstance(piece, CaptionedImage) else piece.mp4
    return [piece.caption, _sha(content)]


def _sha(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()
