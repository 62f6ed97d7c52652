"""Errors of the project.

::

    ArticulateError
    ├── UsageError          bad input: one line on stderr, exit 2
    │   ├── ConfigError     a value in a configuration or on the command line
    │   ├── AssetError      an object that cannot be read or is rejected
    │   ├── ReachError      a part that the arm cannot reach
    │   │   └── PathError   a handle that it cannot follow to the target
    │   ├── RunError        a run folder that is absent, foreign or in the way
    │   ├── BundleError     a bundle that was changed or cannot be read
    │   ├── EngineError     a call that an environment does not support
    │   ├── BudgetError     a request to a model that could exceed the budget
    │   └── MissingError    an optional package or a key that is missing
    ├── KilledError         a child process that was killed, exit 128 + signal
    ├── RobotStoppedError   a robot that was stopped after it had moved, exit 4
    └── DivergedError       training produced values that are not finite

Five more are defined where they are raised: ``StartError`` and ``ClipError``, both UsageErrors,
``MissingMesh`` and ``InvalidOutputError``, both AssetErrors, and ``NotConnectedError``.

Every message is one line: the wrong value, its origin, the accepted values, the next step.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable


class ArticulateError(Exception):
    """Root of all errors raised on purpose by the four packages."""


class UsageError(ArticulateError):
    """Bad input. Commands print it as one line and exit with 2."""


class ConfigError(UsageError):
    """A configuration value that is not accepted."""


class AssetError(UsageError):
    """An object that cannot be read or is rejected."""


class ReachError(UsageError):
    """A part whose handle the arm cannot reach."""


class PathError(ReachError):
    """A handle that the arm can reach, but not follow over its path to the target."""


class RunError(UsageError):
    """A run folder that is absent, foreign or in the way."""


class BundleError(UsageError):
    """A policy bundle that was changed or cannot be read."""


class EngineError(UsageError):
    """A call that an environment does not support: a wrong action, a step before a reset."""


class BudgetError(UsageError):
    """A request to a model could exceed the budget."""


class MissingError(UsageError):
    """An optional package is not installed, or the key of a service is not set."""


class KilledError(ArticulateError):
    """A child process was killed from outside: not a bug, another try may succeed."""

    def __init__(self, message: str, number: int) -> None:
        super().__init__(message)
        self.exit_code = 128 + number
        """Exit code that shells report for a process killed by signal ``number``."""


class RobotStoppedError(ArticulateError):
    """A robot was stopped after it had moved. Commands print it as one line and exit with 4."""

    exit_code = 4


class DivergedError(ArticulateError):
    """Training produced values that are not finite."""


MAX_QUOTED = 200
"""Most characters of the input that a message quotes."""


def quote(value: object, limit: int = MAX_QUOTED) -> str:
    """Return a printable representation of ``value``, of at most ``limit`` characters.

    Args:
        value: Input to quote in a message. Text is put into quotation marks.
        limit: Most characters of the input; an ellipsis marks what is left out.
    """
    if isinstance(value, str):
        return repr(value) if len(value) <= limit else repr(value[: limit - 1] + "…")
    return shorten(repr(value), limit)


def shorten(text: object, limit: int = MAX_QUOTED) -> str:
    """Return the first line of ``text``, of at most ``limit`` characters."""
    line = "".join(c if c.isprintable() else " " for c in str(text).strip().split("\n", 1)[0])
    return line if len(line) <= limit else line[: limit - 1] + "…"


def field_error(error: KeyError | TypeError) -> str:
    """Describe the error of a constructor or look-up for the author of the file."""
    text = str(error)
    unknown = re.search(r"unexpected keyword argument '(\w+)'", text)
    if unknown:
        return f"unknown field {unknown[1]}"
    absent = re.search(r"missing \d+ required \S+ arguments?: (.+)$", text)
    if absent:
        return f"field {absent[1]} is missing"
    if isinstance(error, KeyError):
        return f"field {text} is missing"
    return f"a field is of the wrong kind ({text})"


def nearest(word: str, known: Iterable[str]) -> str:
    """Return ``"; did you mean X?"``, or the list of the known words.

    Args:
        word: The unknown word.
        known: Accepted words.
    """
    options = sorted(known)
    close = difflib.get_close_matches(word, options, n=1, cutoff=0.6)
    if close:
        return f"; did you mean {close[0]}?"
    return f"; known: {', '.join(options)}" if options else ""
