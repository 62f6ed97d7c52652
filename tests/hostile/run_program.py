"""Run an untrusted program on parts, as a command: ``python -m tests.hostile.run_program``."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

from articulate.commands import run_command
from articulate.errors import UsageError
from articulate.reconstruct.program.language import MAX_SOURCE
from articulate.reconstruct.program.result import ProgramError
from articulate.reconstruct.program.run import run_program
from articulate.untrusted import read_text


def main(argv: Sequence[str]) -> int:
    """Run the program ``argv[0]`` on the folder of parts ``argv[1]``."""
    source = read_text(Path(argv[0]), 4 * MAX_SOURCE)
    found = run_program(source, Path(argv[1]))
    if isinstance(found, ProgramError):
        raise UsageError(f"{argv[0]}:{found.line}:{found.column}: {found.message}")
    return 0


if __name__ == "__main__":
    sys.exit(run_command(main, sys.argv[1:]))
