"""Commands: ``articulate VERB ...`` and the short names of its verbs.

Verbs are entry points of the group ``articulate.commands``, imported when they are asked for.
A verb is a function ``main(argv) -> int`` that lets errors through; what is said about them,
and the exit code, is decided here. It prints results by :func:`articulate.commands.console.emit`,
progress by :func:`~articulate.commands.console.show_progress`, and its module names the class of its flags
``FLAGS``, from which completion is made.
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
from articulate.errors import KilledError, UsageError, nearest

GROUP = "articulate.commands"
DISTRIBUTION = "articulate-robots"
USAGE_EXIT = 2
BUG_EXIT = 1

Main = Callable[[Sequence[str]], int]

SUMMARIES = {
    "make": "find the joints of an object whose parts are known, and prove it",
    "check": "convert an object and prove it ready for simulation",
    "train": "train a policy on an object",
    "evaluate": "evaluate a run again",
    "export": "write a run's policy as a bundle for robots",
    "benchmark": "score an actor on objects whose joints are known",
    "observe": "say how the part that is operated in a film moves",
    "deploy": "run a bundle on a robot or a stand-in",
    "watch": "see a policy act: a clip, a recording for rerun, or a window",
    "cache": "list or clean what earlier checks left behind",
}
GLOBAL = ("--help", "--version", "--completion")


def main(argv: Sequence[str] | None = None) -> int:
    """Entry of ``articulate``: dispatch to a verb and return the exit code."""
    arguments = list(sys.argv[1:] if argv is None else argv)
    if not arguments or arguments[0] in {"-h", "--help"}:
        print(_help())
        return 0 if arguments else USAGE_EXIT
    first, rest = arguments[0], arguments[1:]
    if first in {"-V", "--version"}:
        print(f"articulate {version()}")
        return 0
    if first.partition("=")[0] == "--completion":
        return run_command(_completion, [*first.split("=")[1:], *rest])
    return run_command(_verb(first), rest)


def run_command(command: Main, argv: Sequence[str]) -> int:
    """Exit code of ``command(argv)``; every error becomes one line on stderr.

    Bad input and a full disk give 2, an interrupt 130, a process of ours that was killed 128 and
    the number of the signal, and a bug 1, with its trace in a file.
    """
    with console.session(), graceful_interrupt():
        try:
            return command(argv)
        except UsageError as error:
            return _complain(str(error), USAGE_EXIT)
        except KilledError as error:
            return _complain(str(error), error.exit_code)
        except KeyboardInterrupt:
            hint = console.interrupt_hint()
            return _complain(f"interrupted{hint and f'; {hint}'}", INTERRUPT_EXIT)
        except BrokenPipeError:
            console.forget_results()  # their reader has gone (`| head`)
            return BUG_EXIT
        except Exception as error:  # noqa: BLE001  a bug: its trace goes into a file, one line to the user
            return _unexpected(error)


def _unexpected(error: Exception) -> int:
    if isinstance(error, OSError) and error.errno in {errno.ENOSPC, errno.EDQUOT}:
        where = f" for {error.filename}" if error.filename else ""
        line = f"no space left on the disk{where}; free some or choose another --out"
        return _complain(line, USAGE_EXIT)
    kind = type(error).__name__
    return _complain(f"{kind}: {_one_line(str(error))}; trace in {_write_trace()}", BUG_EXIT)


def version() -> str:
    """Version of the installed distribution."""
    try:
        return metadata.version(DISTRIBUTION)
    except metadata.PackageNotFoundError:
        return "unknown (not installed)"


def check_asset() -> int:
    """Entry of ``check-asset``, short for ``articulate check``."""
    return main(["check", *sys.argv[1:]])


def train() -> int:
    """Entry of ``train``, short for ``articulate train``."""
    return main(["train", *sys.argv[1:]])


def evaluate() -> int:
    """Entry of ``evaluate``, short for ``articulate evaluate``."""
    return main(["evaluate", *sys.argv[1:]])


def export_policy() -> int:
    """Entry of ``export-policy``, short for ``articulate export``."""
    return main(["export", *sys.argv[1:]])


def deploy() -> int:
    """Entry of ``deploy``, short for ``articulate deploy``."""
    return main(["deploy", *sys.argv[1:]])


def _verb(name: str) -> Main:
    """A command that imports the verb ``name`` and runs it, so that failing to is its error."""

    def command(argv: Sequence[str]) -> int:
        found = [entry for entry in metadata.entry_points(group=GROUP) if entry.name == name]
        if not found and name.startswith("-"):
            close = nearest(name, GLOBAL)
            raise UsageError(f"{name}: unknown flag{close}; a command comes first: articulate VERB")
        if not found:
            known = metadata.entry_points(group=GROUP).names
            raise UsageError(f"{name}: no such command{nearest(name, known)}")
        try:
            loaded: Main = found[0].load()
        except ModuleNotFoundError as error:
            if (error.name or "").startswith("articulate"):
                raise
            raise UsageError(
                f"{name}: {found[0].value} needs the module {error.name}, which is not installed; "
                'install the extra that brings it, e.g. pip install "articulate-robots[all]"'
            ) from None
        return loaded(argv)

    return command


def _help() -> str:
    """The text of ``--help``: names come from the entry points, none of which is imported."""
    names = sorted(metadata.entry_points(group=GROUP).names)
    width = max(map(len, names), default=0)
    verbs = [f"  {name:<{width}}  {SUMMARIES.get(name, '')}".rstrip() for name in names]
    lines = [
        "usage: articulate VERB [flags]",
        "",
        "From a description of an articulated object to an arm that opens it.",
        "",
        "verbs:",
        *(verbs or ["  none: the distribution is not installed"]),
        "",
        "articulate VERB --help lists the flags of a verb; --version tells the version;",
        "--completion bash|zsh|fish prints a script that completes verbs and flags.",
        "",
        "exit codes: 0 done, 1 a bug, 2 bad input and nothing written, 3 done but not what was",
        "asked for, 130 interrupted.",
    ]
    return "\n".join(lines)


def _completion(argv: Sequence[str]) -> int:
    from articulate.commands.completion import SHELLS, script, verb_words  # imports every verb

    if len(argv) != 1:
        raise UsageError(f"--completion needs the name of a shell: {', '.join(SHELLS)}")
    entries = sorted(metadata.entry_points(group=GROUP), key=lambda entry: entry.name)
    # The shell is checked first: verbs take a while to import.
    made = script(argv[0], {}) and script(argv[0], {e.name: verb_words(e) for e in entries})
    console.emit(made.rstrip("\n"))
    return 0


def _complain(message: str, code: int) -> int:
    console.print_error(_one_line(message))
    return code


def _one_line(text: str) -> str:
    return " ".join(text.split())


def _write_trace() -> Path:
    """File that holds the trace of the exception at hand and the call it came from."""
    with tempfile.NamedTemporaryFile(
        "w",
        prefix="articulate-",
        suffix=".log",
        delete=False,
        encoding="utf-8",
        errors="backslashreplace",  # words of the command line need not be UTF-8
    ) as stream:
        stream.write(f"articulate {version()}\n{' '.join(sys.argv)}\n\n{traceback.format_exc()}")
    return Path(stream.name)
