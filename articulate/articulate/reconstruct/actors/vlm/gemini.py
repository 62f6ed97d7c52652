"""Gemini: Google's models through ``google-genai``."""

from __future__ import annotations

import importlib
import json
import os
import re
import time
from dataclasses import dataclass, field
from typing import Any

from articulate.errors import MissingError, UsageError
from articulate.reconstruct.actors.vlm.model import Picture, Reply, Request, Turn

DEFAULT_MODEL = "gemini-3.8-flash"
"""Google's default of September 2026 (ai.google.dev, models); 2.5 is shut down 2026-12-01."""
MODEL_VARIABLE = "ARTICULATE_MODEL"
"""Environment variable that names another model."""
KEY_VARIABLES = ("GOOGLE_API_KEY", "GEMINI_API_KEY")
"""Where the key is looked for, in this order, as Google's own client does."""
URL_VARIABLE = "GOOGLE_GEMINI_BASE_URL"
"""Another server that speaks the same language."""
AGAIN = (408, 429, 500, 502, 503, 504)
"""Answers of a server after which it is asked again."""
SHAPELESS = (TypeError, AttributeError, KeyError, IndexError)
"""What the client stumbles over where JSON is not of the shape of an answer."""
HIDDEN = "(key)"
ESCAPED = re.compile(r"""\\(?:u([0-9a-fA-F]{4})|x([0-9a-fA-F]{2})|(["/\\]))""")
"""A character as JSON and programs may write it."""


@dataclass(frozen=True, kw_only=True)
class Gemini:
    """One of Google's models.

    The key is read from the environment when the model is asked, and is in nothing that comes out:
    where a server sends it back, :data:`HIDDEN` stands for it.
    """

    model: str = field(default_factory=lambda: os.environ.get(MODEL_VARIABLE) or DEFAULT_MODEL)
    attempts: int = 5
    """Times that a busy or broken server is asked, the first included."""
    first_wait_s: float = 1.0
    """Before the second time; each further wait is twice as long."""
    longest_wait_s: float = 30.0
    timeout_s: float = 300.0

    @property
    def name(self) -> str:
        """Name of the model."""
        return self.model

    @property
    def source(self) -> str:
        """The model, and the server where it is not Google's."""
        url = os.environ.get(URL_VARIABLE)
        return f"{self.model} at {url}" if url else self.model

    def ask(self, request: Request) -> Reply:
        """Its answer.

        Raises:
            MissingError: There is no key, or ``google-genai`` is not installed.
            UsageError: The server cannot be reached, refuses, or gives no answer.
        """
        key = api_key()
        genai = _package()
        contents = [_content(turn) for turn in request.turns]
        start = time.monotonic()
        try:
            with genai.Client(
                api_key=key, vertexai=False, http_options=self._http_options()
            ) as client:
                found = client.models.generate_content(
                    model=self.model,
                    contents=contents,
                    config={
                        "system_instruction": request.system,
                        "response_mime_type": "application/json",
                        "response_json_schema": dict(request.schema),
                    },
                )
        except genai.errors.APIError as error:
            raise UsageError(self._refused(error, key)) from None
        except _unreached() as error:
            what = _plain(_heard(error), key)
            raise UsageError(
                f"{self.name}: cannot be reached ({what}); look at the network and "
                f"{URL_VARIABLE}, or leave --actor out: the usual actors need none"
            ) from None
        return self._reply(found, key, time.monotonic() - start)

    def _http_options(self) -> dict[str, Any]:
        return {
            "timeout": round(1000.0 * self.timeout_s),
            "retry_options": {
                "attempts": self.attempts,
                "initial_delay": self.first_wait_s,
                "max_delay": self.longest_wait_s,
                "exp_base": 2.0,
                "jitter": 0.5 * self.first_wait_s,
                "http_status_codes": list(AGAIN),
            },
        }

    def _reply(self, found: Any, key: str, seconds: float) -> Reply:
        text = _said(found)
        if not text:
            why = _plain(_reason(found), key)
            raise UsageError(f"{self.name}: gave no answer ({why}); ask again, or another model")
        usage = found.usage_metadata
        return Reply(
            text=_without_key(text, key),
            model=_plain(found.model_version or self.model, key),
            seconds=seconds,
            tokens_in=(usage and usage.prompt_token_count) or 0,
            tokens_out=(usage and usage.candidates_token_count) or 0,
        )

    def _refused(self, error: Any, key: str) -> str:
        what = _plain(str(error.message or error.status or "no reason given"), key)
        if error.code in AGAIN:
            return (
                f"{self.name}: answers {error.code} each of {self.attempts} times ({what}); wait, "
                "then run this again: answers that came are kept"
            )
        if error.code in {401, 403} or "API key" in what:
            return (
                f"{self.name}: refuses the key of {key_variable()} ({error.code}: {what}); "
                "set one that is valid"
            )
        if error.code == 404:
            return (
                f"{self.name}: there is no such model ({what}); name another with {MODEL_VARIABLE}"
            )
        return f"{self.name}: refuses what it was asked ({error.code}: {what})"


def key_variable() -> str:
    """The variable that holds the key; empty if none does."""
    return next((name for name in KEY_VARIABLES if os.environ.get(name, "").strip()), "")


def api_key() -> str:
    """The key, from the environment alone.

    Raises:
        MissingError: There is none, or something else stands there.
    """
    name = key_variable()
    if not name:
        raise MissingError(
            f"no key for a model: set {' or '.join(KEY_VARIABLES)}, look at what would be sent "
            "with --dry-run, or leave --actor out: the usual actors ask no model"
        )
    key = os.environ[name].strip()
    if not (key.isascii() and key.isprintable()):
        raise MissingError(
            f"{name} holds characters that are in no key; copy the key again, without line breaks"
        )
    return key


def _package() -> Any:
    try:
        return importlib.import_module("google.genai")  # heavy, and wanted for this alone
    except ModuleNotFoundError:
        raise MissingError(
            "asking Gemini needs google-genai, which is not installed; "
            'run: pip install "articulate-robots[vlm]"'
        ) from None


def _unreached() -> tuple[type[Exception], ...]:
    """What the client raises where there is no server, or none that speaks as it should."""
    httpx = importlib.import_module("httpx")  # comes with the client
    # A body that is not JSON reaches us as the decoder's ValueError, one that is nested too deeply
    # as its RecursionError.
    return (httpx.HTTPError, httpx.InvalidURL, OSError, ValueError, RecursionError, *SHAPELESS)


def _heard(error: Exception) -> str:
    """What is wrong with what answered, or with the way there."""
    if isinstance(error, RecursionError):
        return "what answers there is nested too deeply"
    if isinstance(error, ValueError):
        return "what answers there is no JSON"
    if isinstance(error, SHAPELESS):
        return "what answers there is no answer of Gemini"
    return str(error) or type(error).__name__


def _content(turn: Turn) -> dict[str, Any]:
    parts: list[dict[str, Any]] = []
    for piece in turn.pieces:
        if isinstance(piece, Picture):
            parts.append({"text": f"{piece.caption}:"})
            parts.append({"inline_data": {"data": piece.png, "mime_type": "image/png"}})
        else:
            parts.append({"text": piece})
    return {"role": turn.role, "parts": parts}


def _said(found: Any) -> str:
    """All words of the first candidate that are not thoughts."""
    for candidate in found.candidates or ():
        parts = (candidate.content and candidate.content.parts) or ()
        text = "".join(part.text for part in parts if part.text and not part.thought)
        return text.encode("utf-8", "replace").decode("utf-8")  # halves of characters become "?"
    return ""


def _reason(found: Any) -> str:
    for candidate in found.candidates or ():
        if candidate.finish_reason is not None:
            return str(getattr(candidate.finish_reason, "value", candidate.finish_reason))
    blocked = found.prompt_feedback and found.prompt_feedback.block_reason
    return str(getattr(blocked, "value", blocked)) if blocked else "it is empty"


def _plain(text: str, key: str) -> str:
    """One line of at most 300 letters without the key."""
    return " ".join(_hidden(text, key).split())[:300]


def _without_key(text: str, key: str) -> str:
    """An answer without the key, however its JSON writes the letters of the key."""
    plain = _hidden(text, key)
    try:
        content = json.loads(text)
        clean = _without(content, key)
        return text if clean == content and plain == text else json.dumps(clean)
    except (ValueError, RecursionError):  # it is not JSON, or nested too deeply
        return plain


def _without(value: Any, key: str) -> Any:
    """A value of JSON without the key in its words."""
    if isinstance(value, str):
        return _hidden(value, key)
    if isinstance(value, list):
        return [_without(one, key) for one in value]
    if isinstance(value, dict):
        return {_hidden(name, key): _without(one, key) for name, one in value.items()}
    return value


def _hidden(text: str, key: str) -> str:
    """The text without the key, be it written plainly or with escapes."""
    text = text.replace(key, HIDDEN)
    plain = ESCAPED.sub(_letter, text)
    return plain.replace(key, HIDDEN) if key in plain else text


def _letter(found: re.Match[str]) -> str:
    return found[3] or chr(int(found[1] or found[2], 16))
