"""Google's Gemini models through ``google-genai``."""

from __future__ import annotations

import importlib
import json
import os
import re
import time
from dataclasses import dataclass, field
from typing import Any

from articulate.errors import MissingError, UsageError, shorten
from articulate.reconstruct.actors.vlm.model import CaptionedImage, Reply, Request, Turn
from articulate.reconstruct.actors.vlm.network import (
    ProxySetting,
    check_connection,
    check_network_settings,
    proxy_of,
)

DEFAULT_MODEL = "gemini-3.8-flash"
"""Google's default of September 2026 (ai.google.dev, models); 2.5 is shut down 2026-12-01."""
MODEL_VARIABLE = "ARTICULATE_MODEL"
"""Environment variable that names another model."""
KEY_VARIABLES = ("GOOGLE_API_KEY", "GEMINI_API_KEY")
"""Environment variables of the key, in the order in which Google's client reads them."""
URL_VARIABLE = "GOOGLE_GEMINI_BASE_URL"
"""Environment variable of the URL of another server with the same API."""
DEFAULT_URL = "https://generativelanguage.googleapis.com"
RETRY_CODES = (408, 429, 500, 502, 503, 504)
"""HTTP status codes after which a request is sent again."""
MALFORMED = (TypeError, AttributeError, KeyError, IndexError)
"""Exceptions of the client where the JSON of a reply does not have the expected structure."""
HIDDEN = "(key)"
MAX_REASON = 200
"""Most characters of a server's reason in an error line."""
ESCAPED = re.compile(r"""\\(?:u([0-9a-fA-F]{4})|x([0-9a-fA-F]{2})|(["/\\]))""")
"""An escaped character in JSON or in a program."""


@dataclass(frozen=True, kw_only=True)
class Gemini:
    """A Gemini model.

    The key is read from the environment for each request. It appears in no output: where a server
    sends it back, it is replaced by :data:`HIDDEN`.
    """

    model: str = field(default_factory=lambda: os.environ.get(MODEL_VARIABLE) or DEFAULT_MODEL)
    attempts: int = 5
    """Most requests to a server that is busy or fails, the first included."""
    first_wait_s: float = 1.0
    """Wait before the second request [s]; each further wait is twice as long."""
    longest_wait_s: float = 30.0
    timeout_s: float = 300.0

    @property
    def name(self) -> str:
        """Name of the model."""
        return self.model

    @property
    def source(self) -> str:
        """Name of the model, with the server unless it is Google's."""
        url = os.environ.get(URL_VARIABLE)
        return f"{self.model} at {url}" if url else self.model

    def generate(self, request: Request) -> Reply:
        """Send a request and return the reply.

        Raises:
            MissingError: There is no key, or a package is not installed.
            UsageError: The server cannot be reached, rejects the request, or sends no answer.
        """
        key = api_key()
        genai = _package()
        check_network_settings()
        proxy = proxy_of(os.environ.get(URL_VARIABLE) or DEFAULT_URL)
        if proxy is not None:
            check_connection(proxy)
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
            raise UsageError(self._rejection(error, key)) from None
        except _network_errors() as error:
            reason = _plain(_describe_error(error), key)
            raise UsageError(self._unreachable(reason, proxy)) from None
        return self._reply(found, key, time.monotonic() - start)

    def _unreachable(self, reason: str, proxy: ProxySetting | None) -> str:
        where = "the network" if proxy is None else f"the proxy of {proxy.variable}"
        if "CERTIFICATE_VERIFY_FAILED" in reason:
            where += ", SSL_CERT_FILE"
        return (
            f"{self.name}: cannot be reached ({reason}); check {where} and {URL_VARIABLE}, or "
            "omit --actor: the default actors need no network"
        )

    def _http_options(self) -> dict[str, Any]:
        return {
            "timeout": round(1000.0 * self.timeout_s),
            "retry_options": {
                "attempts": self.attempts,
                "initial_delay": self.first_wait_s,
                "max_delay": self.longest_wait_s,
                "exp_base": 2.0,
                "jitter": 0.5 * self.first_wait_s,
                "http_status_codes": list(RETRY_CODES),
            },
        }

    def _reply(self, found: Any, key: str, seconds: float) -> Reply:
        text = _answer_text(found)
        if not text:
            why = _plain(_reason(found), key)
            raise UsageError(
                f"{self.name}: sent no answer ({why}); try again or choose another model"
            )
        usage = found.usage_metadata
        return Reply(
            text=_without_key(text, key),
            model=_plain(found.model_version or self.model, key),
            seconds=seconds,
            tokens_in=(usage and usage.prompt_token_count) or 0,
            tokens_out=(usage and usage.candidates_token_count) or 0,
        )

    def _rejection(self, error: Any, key: str) -> str:
        what = _plain(str(error.message or error.status or "no reason given"), key)
        if error.code in RETRY_CODES:
            return (
                f"{self.name}: status {error.code} on each of {self.attempts} attempts ({what}); "
                "run the command again later: earlier answers are cached"
            )
        if error.code in {401, 403} or "API key" in what:
            return (
                f"{self.name}: rejects the key of {key_variable()} ({error.code}: {what}); "
                "set a valid key"
            )
        if error.code == 404:
            return f"{self.name}: unknown model ({what}); set {MODEL_VARIABLE} to another one"
        return f"{self.name}: rejects the request ({error.code}: {what})"


def key_variable() -> str:
    """Return the environment variable that holds the key; empty if there is none."""
    return next((name for name in KEY_VARIABLES if os.environ.get(name, "").strip()), "")


def api_key() -> str:
    """Read the key from the environment.

    Raises:
        MissingError: There is no key, or the value cannot be a key.
    """
    name = key_variable()
    if not name:
        raise MissingError(
            f"no API key: set {' or '.join(KEY_VARIABLES)}, look at the requests with --dry-run, "
            "or omit --actor: the default actors use no model"
        )
    key = os.environ[name].strip()
    if not (key.isascii() and key.isprintable()):
        raise MissingError(
            f"{name} holds characters that no key contains; copy the key again, without line breaks"
        )
    return key


def _package() -> Any:
    try:
        return importlib.import_module("google.genai")  # heavy, and needed only here
    except ModuleNotFoundError:
        raise MissingError(
            "Gemini needs google-genai, which is not installed; "
            'run: pip install "articulate-robots[vlm]"'
        ) from None


def _network_errors() -> tuple[type[Exception], ...]:
    """Return the exceptions of the client for an unreachable server or a malformed reply."""
    httpx = importlib.import_module("httpx")  # comes with the client
    # A body that is not JSON arrives as the decoder's ValueError, one that is nested too deeply
    # as its RecursionError.
    return (httpx.HTTPError, httpx.InvalidURL, OSError, ValueError, RecursionError, *MALFORMED)


def _describe_error(error: Exception) -> str:
    """Describe a network error or a malformed reply."""
    if isinstance(error, RecursionError):
        return "the reply is nested too deeply"
    if isinstance(error, ValueError):
        return "the reply is not JSON"
    if isinstance(error, MALFORMED):
        return "the reply is not one of Gemini"
    return str(error) or type(error).__name__


def _content(turn: Turn) -> dict[str, Any]:
    parts: list[dict[str, Any]] = []
    for piece in turn.content:
        if isinstance(piece, CaptionedImage):
            parts.append({"text": f"{piece.caption}:"})
            parts.append({"inline_data": {"data": piece.png, "mime_type": "image/png"}})
        else:
            parts.append({"text": piece})
    return {"role": turn.role, "parts": parts}


def _answer_text(found: Any) -> str:
    """Return the text of the first candidate that has any, without thoughts."""
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
    """Return one line of at most ``MAX_REASON`` characters without the key."""
    return shorten(" ".join(_hide(text, key).split()), MAX_REASON)


def _without_key(text: str, key: str) -> str:
    """Remove the key from an answer, also where JSON escapes characters of it."""
    plain = _hide(text, key)
    try:
        content = json.loads(text)
        clean = _hide_in(content, key)
        return text if clean == content and plain == text else json.dumps(clean)
    except (ValueError, RecursionError):  # it is not JSON, or nested too deeply
        return plain


def _hide_in(value: Any, key: str) -> Any:
    """Replace the key in all texts of a JSON value."""
    if isinstance(value, str):
        return _hide(value, key)
    if isinstance(value, list):
        return [_hide_in(one, key) for one in value]
    if isinstance(value, dict):
        return {_hide(name, key): _hide_in(one, key) for name, one in value.items()}
    return value


def _hide(text: str, key: str) -> str:
    """Replace the key in a text, written plainly or with escapes."""
    text = text.replace(key, HIDDEN)
    plain = ESCAPED.sub(_unescape, text)
    return plain.replace(key, HIDDEN) if key in plain else text


def _unescape(found: re.Match[str]) -> str:
    return found[3] or chr(int(found[1] or found[2], 16))
