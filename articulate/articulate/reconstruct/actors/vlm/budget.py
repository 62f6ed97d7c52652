"""Budget of calls, tokens and money, shared by threads and processes.

Before each request the largest possible use is reserved: the estimated input and all output tokens
that are permitted. A request that could exceed a limit is not sent. After the reply the reservation
is replaced by the reported use.
"""

from __future__ import annotations

import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path

from filelock import FileLock

from articulate.config import number_of
from articulate.errors import BudgetError, ConfigError, nearest, quote
from articulate.files import read_json_object, write_json

KEYS = ("calls", "tokens", "usd", "usd_in", "usd_out")
POLL_S = 0.002
"""Time between two attempts to acquire the lock of a ledger [s]."""


@dataclass(frozen=True, kw_only=True)
class BudgetLimits:
    """Limits of all requests together; None: no limit."""

    calls: float | None = None
    """Requests to the server, retries included."""
    tokens: float | None = None
    """Input and output tokens."""
    usd: float | None = None
    """Money [US dollars]; it needs the costs of tokens."""
    usd_in: float | None = None
    """Cost of a million input tokens [US dollars]."""
    usd_out: float | None = None
    """Cost of a million output tokens [US dollars]."""

    @classmethod
    def from_words(cls, words: Sequence[str]) -> BudgetLimits:
        """Read ``KEY=NUMBER`` words.

        Raises:
            ConfigError: A key is unknown or given twice, a number is negative, or a cost is
                missing.
        """
        found: dict[str, float] = {}
        for word in words:
            key, equals, text = word.partition("=")
            if not equals or key not in KEYS:
                raise ConfigError(f"--budget {quote(word)}: must be KEY=NUMBER{nearest(key, KEYS)}")
            if key in found:
                raise ConfigError(f"--budget {key}: given twice")
            value = number_of(float, text)
            if value is None or not 0.0 <= value < float("inf"):
                raise ConfigError(f"--budget {quote(word)}: must be a number, 0 or more")
            found[key] = float(value)
        limits = cls(**found)
        if limits.usd is not None and (limits.usd_in is None or limits.usd_out is None):
            raise ConfigError(
                "--budget usd needs the cost of a million tokens; "
                "add usd_in=NUMBER usd_out=NUMBER [US dollars]"
            )
        return limits

    def usd_of(self, tokens_in: int, tokens_out: int) -> float:
        """Return the cost of tokens [US dollars]; 0 without the costs."""
        return 1e-6 * (tokens_in * (self.usd_in or 0.0) + tokens_out * (self.usd_out or 0.0))


@dataclass(frozen=True, kw_only=True)
class Usage:
    """Use of a model."""

    calls: int = 0
    tokens_in: int = 0
    tokens_out: int = 0

    def plus(self, other: Usage, sign: int = 1) -> Usage:
        """Return the sum, or the difference for ``sign`` -1."""
        return Usage(
            calls=self.calls + sign * other.calls,
            tokens_in=self.tokens_in + sign * other.tokens_in,
            tokens_out=self.tokens_out + sign * other.tokens_out,
        )


@dataclass(kw_only=True)
class Budget:
    """Limits and the use so far."""

    limits: BudgetLimits = field(default_factory=BudgetLimits)
    ledger: Path | None = None
    """File with the use, shared by processes; None: counted in this object only."""
    _used: Usage = field(default_factory=Usage, init=False)
    _lock: threading.Lock = field(default_factory=threading.Lock, init=False, repr=False)

    @property
    def used(self) -> Usage:
        """Use so far, reservations included."""
        return self._used if self.ledger is None else _read(self.ledger)

    def reserve(self, tokens_in: int, tokens_out: int) -> Usage:
        """Reserve one call with at most so many tokens and return the reservation.

        Raises:
            BudgetError: The call could exceed a limit.
        """
        call = Usage(calls=1, tokens_in=tokens_in, tokens_out=tokens_out)
        with self._exclusive():
            used = self.used
            self._check(used, used.plus(call))
            self._write(used.plus(call))
        return call

    def settle(self, reserved: Usage, tokens_in: int, tokens_out: int) -> None:
        """Replace the tokens of a reservation by those that were used."""
        actual = replace(reserved, tokens_in=tokens_in, tokens_out=tokens_out)
        with self._exclusive():
            self._write(self.used.plus(reserved, -1).plus(actual))

    def _check(self, used: Usage, then: Usage) -> None:
        limits = self.limits
        for key, limit, now, after in (
            ("calls", limits.calls, used.calls, then.calls),
            (
                "tokens",
                limits.tokens,
                used.tokens_in + used.tokens_out,
                then.tokens_in + then.tokens_out,
            ),
            (
                "usd",
                limits.usd,
                limits.usd_of(used.tokens_in, used.tokens_out),
                limits.usd_of(then.tokens_in, then.tokens_out),
            ),
        ):
            if limit is not None and after > limit:
                raise BudgetError(
                    f"--budget {key}={limit:g}: {now:g} are used and the next request may take "
                    f"{after - now:g}; raise the limit (answers so far are kept)"
                )

    def _write(self, used: Usage) -> None:
        if self.ledger is None:
            self._used = used
        else:
            write_json(self.ledger, vars(used))

    @contextmanager
    def _exclusive(self) -> Iterator[None]:
        with self._lock:
            if self.ledger is None:
                yield
                return
            self.ledger.parent.mkdir(parents=True, exist_ok=True)
            with FileLock(f"{self.ledger}.lock", poll_interval=POLL_S):
                yield


def _read(ledger: Path) -> Usage:
    content = read_json_object(ledger)
    counts = {key: content.get(key) for key in vars(Usage())}
    return Usage(**{key: n for key, n in counts.items() if isinstance(n, int) and n >= 0})
