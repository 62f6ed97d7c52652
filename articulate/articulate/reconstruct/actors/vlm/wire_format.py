"""Wire formats of providers: how a request and a reply are written as JSON over HTTP."""

from __future__ import annotations

import base64
import math
import struct
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Protocol

from articulate.reconstruct.actors.vlm.model import CaptionedImage, CaptionedVideo, Content, Request

BYTES_PER_TOKEN = 3.0
"""Bytes of text in a token, for estimates; English text has about four."""
MESSAGE_TOKENS = 16
"""Tokens that a provider adds to each message, for estimates."""


@dataclass(frozen=True, kw_only=True)
class Answer:
    """Content of a reply, read from its JSON."""

    text: str
    model: str
    """Name of the model in the reply; empty if it has none."""
    tokens_in: int
    tokens_out: int
    is_cut: bool = False
    block_reason: str = ""


class WireFormat(Protocol):
    """Format of one provider. Methods that read raise KeyError, TypeError or ValueError."""

    @property
    def provider(self) -> str:
        """Name before the colon in ``PROVIDER:NAME``."""
        ...

    @property
    def key_variables(self) -> tuple[str, ...]:
        """Environment variables of the key; the first that is set is used."""
        ...

    @property
    def url_variable(self) -> str:
        """Environment variable of the URL of another server with the same format."""
        ...

    @property
    def default_url(self) -> str:
        """URL of the provider's own server."""
        ...

    def path(self, model: str) -> str:
        """Return the path of the request below the URL."""
        ...

    def headers(self, key: str) -> Mapping[str, str]:
        """Return the headers of a request; ``key`` is empty for a server without keys."""
        ...

    def body(self, model: str, request: Request, max_output_tokens: int) -> dict[str, Any]:
        """Return the JSON of a request."""
        ...

    def read(self, body: Mapping[str, Any]) -> Answer:
        """Read the JSON of a reply."""
        ...

    def image_tokens(self, width_px: int, height_px: int) -> int:
        """Return the tokens of an image by the provider's documentation."""
        ...


def estimate_tokens(wire_format: WireFormat, request: Request) -> int:
    """Estimate the input tokens of a request from the bytes of texts and the sizes of images."""
    texts = [request.system, str(dict(request.schema))]
    total = 0
    for turn in request.turns:
        total += MESSAGE_TOKENS
        for piece in turn.content:
            if isinstance(piece, str):
                texts.append(piece)
                continue
            texts.append(piece.caption)
            for image in [piece] if isinstance(piece, CaptionedImage) else piece.frames:
                texts.append(image.caption)
                total += wire_format.image_tokens(*png_size(image.png))
    return total + math.ceil(sum(len(text.encode()) for text in texts) / BYTES_PER_TOKEN)


def png_size(png: bytes) -> tuple[int, int]:
    """Return width and height of a PNG [px]; 1024 x 1024 if it cannot be read."""
    if len(png) < 24 or png[12:16] != b"IHDR":
        return 1024, 1024
    width, height = struct.unpack(">II", png[16:24])
    return int(width), int(height)


def base64_of(content: bytes) -> str:
    """Encode bytes for JSON."""
    return base64.b64encode(content).decode("ascii")


def without_videos(content: tuple[Content, ...]) -> Iterator[str | CaptionedImage]:
    """Yield the content with the frames of each video in its place."""
    for piece in content:
        if isinstance(piece, CaptionedVideo):
            yield f"{piece.caption}, as frames:"
            yield from piece.frames
        else:
            yield piece


def count_of(value: Any) -> int:
    """Return a count of a reply; 0 if it is absent or no count."""
    return value if isinstance(value, int) and not isinstance(value, bool) and value > 0 else 0


def text_of(value: Any) -> str:
    """Return a text of a reply with valid characters; empty if it is no text."""
    return value.encode("utf-8", "replace").decode("utf-8") if isinstance(value, str) else ""
