"""Wire format of Anthropic's messages; the JSON schema is that of a tool which must be called."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from articulate.reconstruct.actors.vlm.model import Request, Turn
from articulate.reconstruct.actors.vlm.wire_format import (
    Answer,
    base64_of,
    count_of,
    text_of,
    without_videos,
)

VERSION = "2023-06-01"
"""Version of the format, for the header ``anthropic-version``."""
TOOL = "answer"
PIXELS_PER_TOKEN = 750.0


@dataclass(frozen=True)
class AnthropicFormat:
    """Messages with images as base64."""

    provider: str = "anthropic"
    key_variables: tuple[str, ...] = ("ANTHROPIC_API_KEY",)
    url_variable: str = "ANTHROPIC_BASE_URL"
    default_url: str = "https://api.anthropic.com"

    def path(self, model: str) -> str:
        """Return the path of messages."""
        return "/v1/messages"

    def headers(self, key: str) -> Mapping[str, str]:
        """Return the headers of the key and of the version."""
        return {"anthropic-version": VERSION} | ({"x-api-key": key} if key else {})

    def body(self, model: str, request: Request, max_output_tokens: int) -> dict[str, Any]:
        """Return the JSON of a request."""
        schema = dict(request.schema)
        tool = {"name": TOOL, "description": schema["description"], "input_schema": schema}
        return {
            "model": model,
            "max_tokens": max_output_tokens,
            "system": request.system,
            "messages": [_message(turn) for turn in request.turns],
            "tools": [tool],
            "tool_choice": {"type": "tool", "name": TOOL},
        }

    def read(self, body: Mapping[str, Any]) -> Answer:
        """Read the input of the tool, or the text if the tool is not called."""
        usage = body.get("usage") or {}
        stop = text_of(body.get("stop_reason"))
        texts = [text_of(block.get("text")) for block in body["content"]]
        inputs = [block["input"] for block in body["content"] if block.get("type") == "tool_use"]
        text = text_of(json.dumps(inputs[0])) if inputs else "".join(texts)
        is_cut = stop == "max_tokens"
        block_reason = stop if stop == "refusal" else ""
        if not text and not is_cut:
            block_reason = block_reason or stop or "it is empty"
        return Answer(
            text=text,
            model=text_of(body.get("model")),
            tokens_in=count_of(usage.get("input_tokens"))
            + count_of(usage.get("cache_creation_input_tokens"))
            + count_of(usage.get("cache_read_input_tokens")),
            tokens_out=count_of(usage.get("output_tokens")),
            is_cut=is_cut,
            block_reason=block_reason,
        )

    def image_tokens(self, width_px: int, height_px: int) -> int:
        """Return one token for 750 pixels."""
        return math.ceil(width_px * height_px / PIXELS_PER_TOKEN)


def _message(turn: Turn) -> dict[str, Any]:
    if turn.role == "model":
        return {"role": "assistant", "content": turn.text or "(no text)"}
    content: list[dict[str, Any]] = []
    for piece in without_videos(turn.content):
        if isinstance(piece, str):
            content.append({"type": "text", "text": piece})
            continue
        source = {"type": "base64", "media_type": "image/png", "data": base64_of(piece.png)}
        content.append({"type": "text", "text": f"{piece.caption}:"})
        content.append({"type": "image", "source": source})
    return {"role": "user", "content": content}
