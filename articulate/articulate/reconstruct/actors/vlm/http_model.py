"""A model behind HTTP: keys, retries, budget, limits of replies, and error lines.

The key is read from the environment for each request. It appears in one header and in no output:
where a server sends it back, it is replaced.
"""

from __future__ import annotations

import importlib
import json
import os
import re
import threading
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from email.utils import parsedate_to_datetime
from typing import Any
from urllib.parse import urlsplit, urlunsplit

from articulate.errors import ConfigError, MissingError, UsageError, quote
from articulate.reconstruct.actors.vlm.budget import Budget
from articulate.reconstruct.actors.vlm.hide_key import hide_in_answer, short_reason
from articulate.reconstruct.actors.vlm.model import Reply, Request
from articulate.reconstruct.actors.vlm.network import (
    ProxySetting,
    check_connection,
    check_network_settings,
    proxy_of,
)
from articulate.reconstruct.actors.vlm.schema import MAX_CHARACTERS
from articulate.reconstruct.actors.vlm.wire_format import WireFormat, estimate_tokens

MODEL_VARIABLE = "ARTICULATE_MODEL"
"""Environment variable that names another model, as ``PROVIDER:NAME``."""
RETRY_CODES = frozenset({408, 409, 429, 500, 502, 503, 504, 529})
"""HTTP status codes after which a request is sent again."""
MAX_REPLY_BYTES = 8_000_000
"""Longest reply that is read."""
MALFORMED = (TypeError, AttributeError, KeyError, IndexError, ValueError, RecursionError)
"""Exceptions where the JSON of a reply does not have the expected structure."""
MAX_CLIENTS = 4
_CLIENTS: dict[tuple[tuple[str, str], ...], Any] = {}
_CLIENTS_LOCK = threading.Lock()
ENVIRONMENT = re.compile(r"(?i)(https?|all|no)_proxy|SSL_CERT_(FILE|DIR)")
"""Variables that a connection depends on."""


@dataclass(frozen=True, kw_only=True)
class HttpModel:
    """A model of one provider, or of a server with the same wire format."""

    wire_format: WireFormat
    model: str
    base_url: str = ""
    """URL of the server; empty: that of the environment, else the provider's own."""
    attempts: int = 5
    """Most requests to a server that is busy or fails, the first included."""
    first_wait_s: float = 1.0
    """Wait before the second request [s]; each further wait is twice as long. A delay that the
    server requests is used instead."""
    longest_wait_s: float = 120.0
    """A server that requests a longer delay is not sent the request again [s]."""
    timeout_s: float = 300.0
    """Longest time for one reply [s]."""
    max_output_tokens: int = 16384
    budget: Budget = field(default_factory=Budget, compare=False)

    @property
    def name(self) -> str:
        """Name of the model."""
        return self.model

    @property
    def spec(self) -> str:
        """Name that creates the same model again: ``PROVIDER:NAME[@URL]``."""
        name = f"{self.wire_format.provider}:{self.model}"
        return (
            name if self.url == self.wire_format.default_url else f"{name}@{public_url(self.url)}"
        )

    @property
    def url(self) -> str:
        """URL of the server."""
        named = self.base_url or os.environ.get(self.wire_format.url_variable, "").strip()
        return (named or self.wire_format.default_url).rstrip("/")

    @property
    def source(self) -> str:
        """Provider and model, with the server unless it is the provider's own."""
        name = f"{self.wire_format.provider}:{self.model}"
        url = self.url
        return name if url == self.wire_format.default_url else f"{name} at {public_url(url)}"

    def estimate_tokens(self, request: Request) -> int:
        """Estimate the input tokens of a request, rather too many than too few."""
        return estimate_tokens(self.wire_format, request)

    def generate(self, request: Request) -> Reply:
        """Send a request and return the reply.

        Raises:
            MissingError: There is no key, or a package is not installed.
            BudgetError: The request could exceed the budget.
            UsageError: The server cannot be reached, rejects the request, or its reply cannot be
                read.
        """
        key = self._key()
        connection = _Connection(self, key)
        tokens_in = self.estimate_tokens(request)
        body = self.wire_format.body(self.model, request, self.max_output_tokens)
        start = time.monotonic()
        for attempt in range(1, self.attempts + 1):
            reserved = self.budget.reserve(tokens_in, self.max_output_tokens)
            reply: Reply | None = None
            used = (tokens_in, 0)
            try:
                status, headers, content = connection.post(body)
                if status == 200:
                    reply = self._reply(content, key, time.monotonic() - start)
                    used = (reply.tokens_in, reply.tokens_out)
                else:
                    used = (0, 0)
            finally:
                self.budget.settle(reserved, *used)
            if reply is not None:
                return reply
            delay = self._retry_delay(attempt, status, headers, content)
            if delay is None:
                raise UsageError(self._rejection(status, headers, content, key, attempt))
            time.sleep(delay)
        raise AssertionError("unreachable")

    def _key(self) -> str:
        """Read the key from the environment; a server of the user's own needs none.

        Raises:
            MissingError: There is no key, or the value cannot be a key.
        """
        variables = self.wire_format.key_variables
        name = next((v for v in variables if os.environ.get(v, "").strip()), "")
        if not name:
            if self.wire_format.provider == "openai" and self.url != self.wire_format.default_url:
                return ""
            raise MissingError(
                f"no API key: set {' or '.join(variables)}, look at the requests with --dry-run, "
                "or omit --actor: the default actors use no model"
            )
        key = os.environ[name].strip()
        if not (key.isascii() and key.isprintable() and " " not in key):
            raise MissingError(
                f"{name} holds characters that no key contains; copy the key again, without line "
                "breaks"
            )
        return key

    def _reply(self, content: bytes, key: str, seconds: float) -> Reply:
        what = ""
        try:
            answer = self.wire_format.read(json.loads(content))
        except RecursionError:
            what = "nested too deeply"
        except (json.JSONDecodeError, UnicodeError):
            what = "not JSON"
        except MALFORMED:
            what = f"not one of {self.wire_format.provider}"
        if what:
            proxy = proxy_of(self.url)
            where = "" if proxy is None else f"the proxy of {proxy.variable}, "
            raise UsageError(
                f"{self.name}: the reply is {what}; check {where}"
                f"{self.wire_format.url_variable} and --model"
            )
        return Reply(
            text=hide_in_answer(answer.text[: MAX_CHARACTERS + 1], key),
            model=short_reason(answer.model or self.model, key),
            seconds=seconds,
            tokens_in=answer.tokens_in,
            tokens_out=answer.tokens_out,
            is_cut=answer.is_cut,
            block_reason=short_reason(answer.block_reason, key),
        )

    def _retry_delay(
        self, attempt: int, status: int, headers: Mapping[str, str], content: bytes
    ) -> float | None:
        """Return the wait before the next request [s]; None if none is to be sent."""
        if status not in RETRY_CODES or attempt >= self.attempts:
            return None
        delay = requested_delay_s(headers, content)
        if delay is None:
            return min(self.first_wait_s * 2.0 ** (attempt - 1), self.longest_wait_s)
        return delay if delay <= self.longest_wait_s else None

    def _rejection(
        self, status: int, headers: Mapping[str, str], content: bytes, key: str, attempts: int
    ) -> str:
        what = short_reason(_error_message(content) or "no reason given", key)
        if status in RETRY_CODES:
            delay = requested_delay_s(headers, content)
            if delay is not None and delay > self.longest_wait_s:
                what = f"{what}; the server requests a delay of {delay:.0f} s"
            return (
                f"{self.name}: status {status} on each of {attempts} attempts ({what}); "
                "run the command again later: earlier answers are cached"
            )
        if status in {401, 403} or "API key" in what:
            variables = self.wire_format.key_variables
            name = next((v for v in variables if os.environ.get(v, "").strip()), variables[0])
            return f"{self.name}: rejects the key of {name} ({status}: {what}); set a valid key"
        if status == 404:
            return f"{self.name}: unknown model ({what}); set {MODEL_VARIABLE} to another one"
        return f"{self.name}: rejects the request ({status}: {what})"


class _Connection:
    """Connection to the server of a model."""

    def __init__(self, model: HttpModel, key: str) -> None:
        self._httpx = _package()
        self._model, self._key = model, key
        names = sorted(name for name in os.environ if ENVIRONMENT.fullmatch(name))
        self._client = _client(tuple((name, os.environ[name]) for name in names))
        self._proxy = proxy_of(model.url)
        if self._proxy is not None:
            check_connection(self._proxy)

    def post(self, body: Mapping[str, Any]) -> tuple[int, Mapping[str, str], bytes]:
        """Send JSON and return status, headers and content of the reply.

        Raises:
            UsageError: The server cannot be reached or its reply is too long or too slow.
        """
        model, httpx = self._model, self._httpx
        url = model.url + model.wire_format.path(model.model)
        until = time.monotonic() + model.timeout_s
        try:
            with self._client.stream(
                "POST",
                url,
                json=body,
                headers=dict(model.wire_format.headers(self._key)),
                timeout=model.timeout_s,
            ) as response:
                content = b"".join(self._bounded(response.iter_bytes(), until))
                return response.status_code, dict(response.headers), content
        except httpx.TimeoutException:
            raise UsageError(
                f"{model.name}: no reply within {model.timeout_s:g} s; try again or choose another "
                "model with --model"
            ) from None
        except (httpx.HTTPError, httpx.InvalidURL, OSError, ValueError) as error:
            reason = short_reason(str(error) or type(error).__name__, self._key)
            raise UsageError(_unreachable(model, reason, self._proxy)) from None

    def _bounded(self, chunks: Iterator[bytes], until: float) -> Iterator[bytes]:
        size = 0
        for chunk in chunks:
            size += len(chunk)
            if size > MAX_REPLY_BYTES:
                raise UsageError(
                    f"{self._model.name}: the reply is longer than {MAX_REPLY_BYTES / 1e6:.0f} MB"
                )
            if time.monotonic() > until:
                raise self._httpx.ReadTimeout("the reply is too slow")
            yield chunk


def requested_delay_s(headers: Mapping[str, str], content: bytes) -> float | None:
    """Return the delay that a server requests [s]: Retry-After or Gemini's RetryInfo."""
    named = {name.lower(): value for name, value in headers.items()}
    try:
        if "retry-after-ms" in named:
            return max(0.0, float(named["retry-after-ms"]) / 1000.0)
        if "retry-after" in named:
            return max(0.0, float(named["retry-after"]))
    except ValueError:
        try:
            date = parsedate_to_datetime(named.get("retry-after", ""))
            return max(0.0, (date - datetime.now(UTC)).total_seconds())
        except (TypeError, ValueError):
            return None
    try:
        for detail in json.loads(content)["error"]["details"]:
            if "retryDelay" in detail:
                return max(0.0, float(str(detail["retryDelay"]).removesuffix("s")))
    except MALFORMED:
        return None
    return None


def public_url(url: str) -> str:
    """Return a URL without user name and password."""
    parts = urlsplit(url)
    return urlunsplit(parts._replace(netloc=parts.netloc.rpartition("@")[2]))


def check_url(url: str) -> str:
    """Return the URL of a server.

    Raises:
        ConfigError: It is no HTTP URL.
    """
    try:
        parts = urlsplit(url)
        good = parts.scheme in {"http", "https"} and bool(parts.hostname) and parts.port != 0
    except ValueError:
        good = False
    if not good:
        raise ConfigError(
            f"{quote(public_url(url) if '@' not in url else '(URL)')}: not the URL of a server; "
            "write http://HOST:PORT/PATH"
        )
    return url


def _unreachable(model: HttpModel, reason: str, proxy: ProxySetting | None) -> str:
    where = "the network" if proxy is None else f"the proxy of {proxy.variable}"
    if "CERTIFICATE_VERIFY_FAILED" in reason:
        where += ", SSL_CERT_FILE"
    return (
        f"{model.name}: cannot be reached ({reason}); check {where} and "
        f"{model.wire_format.url_variable}, or omit --actor: the default actors need no network"
    )


def _error_message(content: bytes) -> str:
    """Return the message of a rejection; all three formats have ``error.message``."""
    try:
        error = json.loads(content)["error"]
        if not isinstance(error, dict):
            return str(error)
        return str(error["message"] or error.get("status") or "")
    except MALFORMED:
        return ""


def _client(environment: tuple[tuple[str, str], ...]) -> Any:
    """Return a client that keeps connections open; one for each state of the environment."""
    with _CLIENTS_LOCK:
        if environment not in _CLIENTS:
            check_network_settings()
            if len(_CLIENTS) >= MAX_CLIENTS:
                _CLIENTS.pop(next(iter(_CLIENTS))).close()
            _CLIENTS[environment] = _package().Client()
        return _CLIENTS[environment]


def _package() -> Any:
    try:
        return importlib.import_module("httpx")  # heavy, and needed only here
    except ModuleNotFoundError:
        raise MissingError(
            'models need httpx, which is not installed; run: pip install "articulate-robots[vlm]"'
        ) from None
