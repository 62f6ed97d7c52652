"""Console output of commands: results on stdout, everything else on stderr.

Inside :func:`session` only :func:`emit` writes to the standard output. ``print`` and the file
descriptor 1, which native libraries and child processes use, lead to the standard error, so that
``--json`` prints one JSON object and nothing else.
"""

from __future__ import annotations

import json
import logging
import os
import shlex
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from typing import Any, TextIO

from articulate.errors import UsageError

QUIET, NORMAL, VERBOSE = 0, 1, 2
"""Verbosity: errors and warnings; progress too; logs of libraries too."""
_LOG = {QUIET: logging.ERROR, NORMAL: logging.WARNING, VERBOSE: logging.INFO}


@dataclass
class _State:
    level: int = NORMAL
    stdout: TextIO | None = None
    hint: str = ""


_state = _State()


def open_closed_streams() -> None:
    """Open the null device for each standard stream that the shell has closed (``>&-``).

    Otherwise Python has no stream to print to, and the next file that is opened becomes it.
    """
    for number, name, mode in ((0, "stdin", "r"), (1, "stdout", "w"), (2, "stderr", "w")):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # takes the lowest free number
            setattr(sys, name, os.fdopen(number, mode, encoding="utf-8", closefd=False))


@contextmanager
def session() -> Iterator[None]:
    """Reserve the standard output for results while the block runs."""
    global _state  # noqa: PLW0603  one process has one standard output
    open_closed_streams()
    outer, out = _state, sys.stdout
    level = logging.getLogger().level
    saved = _divert(out)
    _state = _State(stdout=saved or out)
    sys.stdout = sys.stderr
    try:
        yield
    finally:
        sys.stdout = out
        logging.getLogger().setLevel(level)
        try:
            if saved is not None:
                saved.flush()
        finally:
            if saved is not None:
                _restore(out, saved)
            _state = outer


def _divert(out: TextIO) -> TextIO | None:
    """Redirect descriptor 1 to the standard error; return a stream to its former target.

    None if Python's stdout is not descriptor 1, e.g. the buffer of a test.
    """
    try:
        out.flush()
        if out.fileno() != 1:
            return None
        sys.stderr.flush()
        copy = os.dup(1)
        os.dup2(2, 1)
    except (OSError, ValueError, AttributeError):
        return None
    # File names may hold bytes that the encoding of the terminal lacks.
    return os.fdopen(copy, "w", encoding=out.encoding, errors="backslashreplace")


def _restore(out: TextIO, saved: TextIO) -> None:
    with suppress(OSError, ValueError):
        out.flush()  # text of others, while descriptor 1 still leads to stderr
    os.dup2(saved.fileno(), 1)
    with suppress(OSError):
        saved.close()


def forget_results() -> None:
    """Discard unwritten results, also at exit, after the reader of the output has closed it."""
    if _state.stdout is not None:
        with suppress(OSError, ValueError):
            os.dup2(os.open(os.devnull, os.O_WRONLY), _state.stdout.fileno())


def emit(text: str) -> None:
    """Print a result.

    Raises:
        UsageError: The standard output cannot be written.
    """
    stream = _state.stdout or sys.stdout
    try:
        stream.write(f"{text}\n")
        stream.flush()
    except BrokenPipeError:
        raise
    except OSError as error:
        forget_results()
        raise UsageError(f"the standard output cannot be written ({error.strerror})") from None


def emit_json(content: Any) -> None:
    """Print a result as JSON; NaN is a bug."""
    emit(json.dumps(content, indent=1, allow_nan=False))


def show_progress(text: str) -> None:
    """Print a line of progress, unless ``--quiet``."""
    if _state.level > QUIET:
        print_error(text)


def show_waiting(text: str) -> None:
    """Print the current stage on a terminal only.

    Elsewhere nothing is printed, so that bad input that is found later is one line.
    """
    if is_live():
        print_error(text)


def detail(text: str) -> None:
    """Print a line with ``--verbose`` only."""
    if _state.level >= VERBOSE:
        print_error(text)


def print_error(text: str) -> None:
    """Print an error or a warning on the standard error, at any verbosity."""
    _print_to_stderr(f"{text}\n")


def _print_to_stderr(text: str) -> None:
    try:
        sys.stderr.write(text)
        sys.stderr.flush()
    except OSError:  # closed or full: nothing can be reported
        with suppress(OSError, ValueError):  # what is buffered would fail again at exit
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stderr.fileno())


def rewrite(text: str) -> None:
    """Replace the last line by ``text``; only if :func:`is_live`."""
    if _state.level > QUIET:
        _print_to_stderr(f"\r{text[:110]:<110}")


def is_live() -> bool:
    """Return whether a line can be rewritten: stderr is a capable terminal.

    Nothing is printed in colour, so ``NO_COLOR`` has no effect.
    """
    return _state.level > QUIET and sys.stderr.isatty() and os.environ.get("TERM") != "dumb"


def set_level(level: int) -> None:
    """Set the verbosity, that of libraries' logs too."""
    _state.level = level
    logging.basicConfig(format="%(message)s", stream=sys.stderr)
    logging.getLogger().setLevel(_LOG[level])


def hint_after_interrupt(text: str) -> None:
    """Set the hint that an interrupt prints: the command that continues."""
    _state.hint = text


def interrupt_hint() -> str:
    """Return the hint of :func:`hint_after_interrupt`."""
    return _state.hint


def command_line(words: Sequence[object]) -> str:
    """Quote ``words`` for a shell."""
    return shlex.join(str(word) for word in words)
