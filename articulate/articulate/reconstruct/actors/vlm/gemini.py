"""Wire format of Google's Gemini API (ai.google.dev/api/generate-content, version v1beta)."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any
from urllib.parse import quote

from articulate.reconstruct.actors.vlm.model import CaptionedImage, CaptionedVideo, Request, Turn
from articulate.reconstruct.actors.vlm.wire_format import Answer, base64_of, count_of, text_of

DEFAULT_MODEL = "gemini-3.8-flash"
"""Google's default of September 2026 (ai.google.dev, models); 2.5 is shut down 2026-12-01."""
TILE_TOKENS, TILE_PX, SMALL_PX = 258, 768, 384
"""An image up to ``SMALL_PX`` on both sides is one tile, a larger one several of ``TILE_PX``."""


@dataclass(frozen=True)
class GeminiFormat:
    """Gemini: images and videos are sent inline."""

    provider: str = "gemini"
    key_variables: tuple[str, ...] = ("GOOGLE_API_KEY", "GEMINI_API_KEY")
    url_variable: str = "GOOGLE_GEMINI_BASE_URL"
    default_url: str = "https://generativelanguage.googleapis.com"

    def path(self, model: str) -> str:
        """Return the path of ``generateContent``."""
        return f"/v1beta/models/{quote(model, safe='')}:generateContent"

    def headers(self, key: str) -> Mapping[str, str]:
        """Return the header of the key."""
        return {"x-goog-api-key": key} if key else {}

    def body(self, model: str, request: Request, max_output_tokens: int) -> dict[str, Any]:
        """Return the JSON of a request; ``model`` is in the path."""
        return {
            "systemInstruction": {"parts": [{"text": request.system}]},
            "contents": [_content(turn) for turn in request.turns],
            "generationConfig": {
                "responseMimeType": "application/json",
                "responseJsonSchema": dict(request.schema),
                "maxOutputTokens": max_output_tokens,
            },
        }

    def read(self, body: Mapping[str, Any]) -> Answer:
        """Read the first candidate, without thoughts."""
        usage = body.get("usageMetadata") or {}
        if "candidates" not in body and "promptFeedback" not in body:
            raise KeyError("candidates")
        candidates = body.get("candidates") or []
        first = candidates[0] if candidates else {}
        finish = text_of(first.get("finishReason"))
        parts = (first.get("content") or {}).get("parts") or []
        text = "".join(text_of(p.get("text")) for p in parts if not p.get("thought"))
        blocked = text_of((body.get("promptFeedback") or {}).get("blockReason"))
        is_cut = finish == "MAX_TOKENS"
        return Answer(
            text=text,
            model=text_of(body.get("modelVersion")),
            tokens_in=count_of(usage.get("promptTokenCount")),
            tokens_out=count_of(usage.get("candidatesTokenCount"))
            + count_of(usage.get("thoughtsTokenCount")),
            is_cut=is_cut,
            block_reason="" if text or is_cut else blocked or finish or "it is empty",
        )

    def image_tokens(self, width_px: int, height_px: int) -> int:
        """Return 258 tokens for each tile."""
        if max(width_px, height_px) <= SMALL_PX:
            return TILE_TOKENS
        return TILE_TOKENS * math.ceil(width_px / TILE_PX) * math.ceil(height_px / TILE_PX)


def _content(turn: Turn) -> dict[str, Any]:
    parts: list[dict[str, Any]] = []
    for piece in turn.content:
        if isinstance(piece, str):
            parts.append({"text": piece})
            continue
        parts.append({"text": f"{piece.caption}:"})
        if isinstance(piece, CaptionedImage):
            parts.append({"inlineData": {"data": base64_of(piece.png), "mimeType": "image/png"}})
        elif isinstance(piece, CaptionedVideo):
            data = {"data": base64_of(piece.mp4), "mimeType": "video/mp4"}
            parts.append({"inlineData": data, "videoMetadata": {"fps": piece.fps}})
    return {"role": turn.role, "parts": parts}
