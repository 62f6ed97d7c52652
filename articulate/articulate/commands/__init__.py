"""Commands: ``articulate COMMAND ...`` and their short names.

Commands are entry points of the group ``articulate.commands``, imported on use. A command is a
function ``main(argv) -> int`` that lets errors through; :func:`run_command` prints them and returns
the exit code. It prints results by :func:`articulate.commands.console.emit` and progress by
:func:`~articulate.commands.console.show_progress`. Its module names the class of its flags
``FLAGS``, which completion reads.
"""

from __future__ import annotations

import errno
import sys
import tempfile
import traceback
from collections.abc import Callable, Sequence
from importlib import metadata
from pathlib import Path

from articulate.commands import console
from articulate.commands.interrupt import INTERRUPT_EXIT, graceful_interrupt
from articulate.errors import KilledError, RobotStoppedError, UsageError, nearest, shorten

GROUP = "articulate.commands"
DISTRIBUTION = "articulate-robots"
USAGE_EXIT = 2
BUG_EXIT = 1
MAX_WORD = 300
"""Longest word of an error [characters]."""

Main = Callable[[Sequence[str]], int]

SUMMARIES = {
    "make": "make an object from a text, image, video or scan",
    "check": "convert an object and check that it is ready for simulation",
    "train": "train a policy on an object",
    "evaluate": "evaluate the policies of a run",
    "export": "write a run's policy as a bundle for robots",
    "benchmark": "score an actor on objects with known joints",
    "observe": "estimate joint type and axis from a video",
    "studio": "view and correct an object in a local page",
    "deploy": "run a bundle on a robot or a simulated robot",
    "sim-robot": "serve a simulated Franka arm to real clients",
    "watch": "show a policy: a video, a recording for rerun, or a window",
    "markers": "print markers and calibration boards",
    "calibrate": "calibrate a camera, or its pose before the robot",
    "locate": "measure where an object is, from markers",
    "cache": "list or clean the cache of checked objects",
}
GLOBAL = ("--help", "--version", "--completion")


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command that ``argv`` names and return the exit code."""
    arguments = list(sys.argv[1:] if argv is None else argv)
    if not arguments or arguments[0] in {"-h", "--help"}:
        return run_command(_emitting(_help(), 0 if arguments else USAGE_EXIT), [])
    first, rest = arguments[0], arguments[1:]
    if first in {"-V", "--version"}:
        return run_command(_emitting(f"articulate {version()}", 0), [])
    if first.partition("=")[0] == "--completion":
        return run_command(_completion, [*first.split("=")[1:], *rest])
    return run_command(_command(first), rest)


def run_command(command: Main, argv: Sequence[str]) -> int:
    """Return the exit code of ``command(argv)``; print an error as one line on stderr.

    Bad input and a full disk give 2, an interrupt 130, a killed child process 128 plus the number
    of the signal, and a bug 1, with its trace in a file.
    """
    with console.session(), graceful_interrupt():
        try:
            return command(argv)
        except UsageError as error:
            return _print_and_return(str(error), USAGE_EXIT)
        except (KilledError, RobotStoppedError) as error:
            return _print_and_return(str(error), error.exit_code)
        except KeyboardInterrupt:
            hint = console.interrupt_hint()
            return _print_and_return(f"interrupted{hint and f'; {hint}'}", INTERRUPT_EXIT)
        except BrokenPipeError:
            console.forget_results()  # the reader has closed the pipe (`| head`)
            return BUG_EXIT
        except Exception as error:  # noqa: BLE001  a bug: its trace goes into a file, one line to the user
            return _unexpected(error)


def _unexpected(error: Exception) -> int:
    if isinstance(error, OSError) and error.errno in {errno.ENOSPC, errno.EDQUOT}:
        where = f" for {error.filename}" if error.filename else ""
        line = f"no space left on the disk{where}; free some or choose another --out"
        return _print_and_return(line, USAGE_EXIT)
    kind = type(error).__name__
    return _print_and_return(
        f"{kind}: {_one_line(str(error))}; trace in {_write_trace()}", BUG_EXIT
    )


def version() -> str:
    """Return the version of the installed distribution."""
    try:
        return metadata.version(DISTRIBUTION)
    except metadata.PackageNotFoundError:
        return "unknown (not installed)"


def check_asset() -> int:
    """Run ``check-asset``, short for ``articulate check``."""
    return main(["check", *sys.argv[1:]])


def train() -> int:
    """Run ``train``, short for ``articulate train``."""
    return main(["train", *sys.argv[1:]])


def evaluate() -> int:
    """Run ``evaluate``, short for ``articulate evaluate``."""
    return main(["evaluate", *sys.argv[1:]])


def export_policy() -> int:
    """Run ``export-policy``, short for ``articulate export``."""
    return main(["export", *sys.argv[1:]])


def deploy() -> int:
    """Run ``deploy``, short for ``articulate deploy``."""
    return main(["deploy", *sys.argv[1:]])


def sim_robot() -> int:
    """Run ``articulate-sim-robot``, short for ``articulate sim-robot``."""
    return main(["sim-robot", *sys.argv[1:]])


def _command(name: str) -> Main:
    """Return a command that imports the command ``name`` and runs it; import errors are its own."""

    def command(argv: Sequence[str]) -> int:
        found = [entry for entry in metadata.entry_points(group=GROUP) if entry.name == name]
        if not found and name.startswith("-"):
            close = nearest(name, GLOBAL)
            raise UsageError(
                f"{shorten(name)}: unknown flag{close}; the command comes first: articulate COMMAND"
            )
        if not found:
            known = metadata.entry_points(group=GROUP).names
            raise UsageError(f"{shorten(name)}: no such command{nearest(name, known)}")
        try:
            loaded: Main = found[0].load()
        except ModuleNotFoundError as error:
            if (error.name or "").startswith("articulate"):
                raise
            raise UsageError(
                f"{name}: {found[0].value} needs the module {error.name}, which is not installed; "
                'install the extra with it, e.g. pip install "articulate-robots[all]"'
            ) from None
        return loaded(argv)

    return command


def _emitting(text: str, code: int) -> Main:
    """Return a command that prints ``text`` and returns ``code``."""

    def command(_: Sequence[str]) -> int:
        console.emit(text)
        return code

    return command


def _help() -> str:
    """Return the text of ``--help``; no command is imported."""
    names = sorted(metadata.entry_points(group=GROUP).names)
    width = max(map(len, names), default=0)
    verbs = [f"  {name:<{width}}  {SUMMARIES.get(name, '')}".rstrip() for name in names]
    lines = [
        "usage: articulate COMMAND [flags]",
        "",
        "Convert, check and reconstruct articulated objects; train, evaluate and deploy policies.",
        "",
        "commands:",
        *(verbs or ["  none: the distribution is not installed"]),
        "",
        "articulate COMMAND --help lists the common flags, --help-all all of them.",
        "--version prints the version; --completion bash|zsh|fish prints a completion script.",
        "",
        "exit codes: 0 done, 1 a bug, 2 bad input and nothing written, 3 done but below the",
        "requirement or doubtful, 4 a robot was stopped, 130 interrupted.",
    ]
    return "\n".join(lines)


def _completion(argv: Sequence[str]) -> int:
    from articulate.commands.completion import SHELLS, script, verb_words  # imports every command

    if len(argv) != 1:
        raise UsageError(f"--completion needs the name of a shell: {', '.join(SHELLS)}")
    entries = sorted(metadata.entry_points(group=GROUP), key=lambda entry: entry.name)
    # The shell is checked first: commands take a while to import.
    text = script(argv[0], {}) and script(argv[0], {e.name: verb_words(e) for e in entries})
    console.emit(text.rstrip("\n"))
    return 0


def _print_and_return(message: str, code: int) -> int:
    console.print_error(_one_line(message))
    return code


def _one_line(text: str) -> str:
    """Return ``text`` as one line; no input can make a word of it longer than a path."""
    return " ".join(shorten(word, MAX_WORD) for word in text.split())


def _write_trace() -> Path:
    """Write the trace of the current exception and the command line to a file."""
    with tempfile.NamedTemporaryFile(
        "w",
        prefix="articulate-",
        suffix=".log",
        delete=False,
        encoding="utf-8",
        errors="backslashreplace",  # the command line need not be UTF-8
    ) as stream:
        stream.write(f"articulate {version()}\n{' '.join(sys.argv)}\n\n{traceback.format_exc()}")
    return Path(stream.name)
