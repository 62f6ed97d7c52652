"""Wire format of chat completions, which OpenAI and most local servers accept."""

from __future__ import annotations

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

BASE_TOKENS, TILE_TOKENS, TILE_PX = 85, 170, 512


@dataclass(frozen=True)
class OpenAIFormat:
    """Chat completions with images as data URLs and a JSON schema as response format."""

    provider: str = "openai"
    key_variables: tuple[str, ...] = ("OPENAI_API_KEY",)
    url_variable: str = "OPENAI_BASE_URL"
    default_url: str = "https://api.openai.com/v1"

    def path(self, model: str) -> str:
        """Return the path of chat completions."""
        return "/chat/completions"

    def headers(self, key: str) -> Mapping[str, str]:
        """Return the header of the key."""
        return {"Authorization": f"Bearer {key}"} if key else {}

    def body(self, model: str, request: Request, max_output_tokens: int) -> dict[str, Any]:
        """Return the JSON of a request."""
        messages = [{"role": "system", "content": request.system}, *map(_message, request.turns)]
        schema = {"name": "answer", "schema": dict(request.schema)}
        return {
            "model": model,
            "messages": messages,
            "response_format": {"type": "json_schema", "json_schema": schema},
            "max_completion_tokens": max_output_tokens,
        }

    def read(self, body: Mapping[str, Any]) -> Answer:
        """Read the first choice."""
        usage = body.get("usage") or {}
        first = body["choices"][0]
        message, finish = first.get("message") or {}, text_of(first.get("finish_reason"))
        text, block_reason = text_of(message.get("content")), text_of(message.get("refusal"))
        is_cut = finish == "length"
        if finish == "content_filter":
            block_reason = block_reason or finish
        elif not text and not is_cut:
            block_reason = block_reason or finish or "it is empty"
        return Answer(
            text=text,
            model=text_of(body.get("model")),
            tokens_in=count_of(usage.get("prompt_tokens")),
            tokens_out=count_of(usage.get("completion_tokens")),
            is_cut=is_cut,
            block_reason=block_reason,
        )

    def image_tokens(self, width_px: int, height_px: int) -> int:
        """Return 85 tokens and 170 for each tile; other servers differ."""
        tiles = math.ceil(width_px / TILE_PX) * math.ceil(height_px / TILE_PX)
        return BASE_TOKENS + TILE_TOKENS * tiles


def _message(turn: Turn) -> dict[str, Any]:
    if turn.role == "model":
        return {"role": "assistant", "content": turn.text}
    content: list[dict[str, Any]] = []
    for piece in without_videos(turn.content):
        if isinstance(piece, str):
            content.append({"type": "text", "text": piece})
            continue
        url = f"data:image/png;base64,{base64_of(piece.png)}"
        content.append({"type": "text", "text": f"{piece.caption}:"})
        content.append({"type": "image_url", "image_url": {"url": url}})
    return {"role": "user", "content": content}
