"""What a command says: results on stdout, everything else on stderr.

Inside :func:`session` two things reach the standard output: what :func:`emit` is given, and what
modules of ``commands`` packages print, as nobody else may. What libraries print leads to the
standard error, and so does the file descriptor that native ones write to, so that ``--json``
prints one JSON object and nothing else.
"""

from __future__ import annotations

import io
import json
import logging
import os
import shlex
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from typing import Any, TextIO

QUIET, NORMAL, VERBOSE = 0, 1, 2
"""How much is said: errors and warnings alone; progress too; what libraries log as well."""
_LOG = {QUIET: logging.ERROR, NORMAL: logging.WARNING, VERBOSE: logging.INFO}


@dataclass
class _State:
    level: int = NORMAL
    stdout: TextIO | None = None
    hint: str = ""


_state = _State()


@contextmanager
def session() -> Iterator[None]:
    """Keep the standard output for results while the block runs."""
    global _state  # noqa: PLW0603  one process has one standard output
    outer, out = _state, sys.stdout
    logged = logging.getLogger().level
    saved = _divert(out)
    results = saved or out
    _state = _State(stdout=results)
    sys.stdout = _Routed(results)
    try:
        yield
    finally:
        sys.stdout = out
        logging.getLogger().setLevel(logged)
        try:
            if saved is not None:
                saved.flush()
        finally:
            if saved is not None:
                _restore(out, saved)
            _state = outer


class _Routed(io.TextIOBase):
    """Standard output: results if a command prints, else the standard error."""

    def __init__(self, results: TextIO) -> None:
        self._results = results

    def write(self, text: str) -> int:
        """Write ``text`` where its writer's words belong."""
        writer = str(sys._getframe(1).f_globals.get("__name__", ""))
        stream = self._results if "commands" in writer.split(".") else sys.stderr
        return stream.write(text)

    def flush(self) -> None:
        """Flush both."""
        self._results.flush()
        sys.stderr.flush()

    def fileno(self) -> int:
        """What a child process would write to."""
        return sys.stderr.fileno()


def _divert(out: TextIO) -> TextIO | None:
    """Lead descriptor 1 to the standard error; a stream to where it led, or None.

    None where Python's stdout is something else already: a test's buffer.
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
    # A file's name may hold bytes that are no letters, and a terminal may know few letters.
    return os.fdopen(copy, "w", encoding=out.encoding, errors="backslashreplace")


def _restore(out: TextIO, saved: TextIO) -> None:
    with suppress(OSError, ValueError):
        out.flush()  # what bypassed us was meant for stderr, where descriptor 1 still leads
    os.dup2(saved.fileno(), 1)
    with suppress(OSError):
        saved.close()


def forget_results() -> None:
    """The reader of our output has gone: nothing is left to say, not even at exit."""
    if _state.stdout is not None:
        with suppress(OSError, ValueError):
            os.dup2(os.open(os.devnull, os.O_WRONLY), _state.stdout.fileno())


def emit(text: str) -> None:
    """Print a result."""
    stream = _state.stdout or sys.stdout
    stream.write(f"{text}\n")
    stream.flush()


def emit_json(content: Any) -> None:
    """Print a result as JSON; NaN is a bug."""
    emit(json.dumps(content, indent=1, allow_nan=False))


def show_progress(text: str) -> None:
    """Tell of progress, unless ``--quiet``."""
    if _state.level > QUIET:
        print_error(text)


def show_waiting(text: str) -> None:
    """Tell who sits at a terminal what is waited for.

    Elsewhere nothing is said: bad input that comes to light meanwhile is one line.
    """
    if is_live():
        print_error(text)


def detail(text: str) -> None:
    """Tell of what only ``--verbose`` asks for."""
    if _state.level >= VERBOSE:
        print_error(text)


def print_error(text: str) -> None:
    """Print a line on the standard error, whatever the level: errors, warnings."""
    with suppress(BrokenPipeError):
        print(text, file=sys.stderr, flush=True)


def rewrite(text: str) -> None:
    """Show ``text`` over the line that was shown before; only where :func:`is_live`."""
    if _state.level > QUIET:
        print(f"\r{text[:110]:<110}", end="", file=sys.stderr, flush=True)


def is_live() -> bool:
    """Whether a line can be rewritten: stderr is a terminal that knows how.

    Nothing is ever printed in colour, so that ``NO_COLOR`` has nothing to turn off.
    """
    return _state.level > QUIET and sys.stderr.isatty() and os.environ.get("TERM") != "dumb"


def set_level(level: int) -> None:
    """Say more or less from now on; libraries' logs follow."""
    _state.level = level
    logging.basicConfig(format="%(message)s", stream=sys.stderr)
    logging.getLogger().setLevel(_LOG[level])


def hint_after_interrupt(text: str) -> None:
    """What an interrupt prints from now on besides that it was one: how to go on."""
    _state.hint = text


def interrupt_hint() -> str:
    """What :func:`hint_after_interrupt` was told last."""
    return _state.hint


def command_line(words: Sequence[object]) -> str:
    """``words`` as a shell reads them."""
    return shlex.join(str(word) for word in words)
