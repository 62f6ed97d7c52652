"""The child process: locks itself up, reads a program, checks and interprets it.

Run as a script, isolated and without packages, so that nothing but the standard library and the
few modules of the language is ever loaded::

    python -I -S -B child.py '{"memory_bytes": …, "cpu_s": …, "layers": […]}'

Lines of JSON go out of the standard output: what is active, calls to be answered, and at last
``done`` or a violation. Lines of JSON come in: the program, and the answers.
"""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path
from typing import Any

sys.path.append(str(Path(__file__).resolve().parents[3]))

from articulate.reconstruct.program.allow_list import check  # needs the path above
from articulate.reconstruct.program.interpret import interpret
from articulate.reconstruct.program.language import RuleViolation
from articulate.reconstruct.program.parse import RuleError
from articulate.reconstruct.program.process_limits import restrict_process
from articulate.reconstruct.program.values import InvalidValueError

READ_BYTES = 65_536
MOST_BYTES = 4_000_000
"""Longest line that is read."""


class ParentChannel:
    """One JSON document a line, to and from the parent."""

    def __init__(self) -> None:
        self._rest = b""

    def say(self, content: dict[str, Any]) -> None:
        """Write one line."""
        data = json.dumps(content).encode() + b"\n"
        while data:
            data = data[os.write(1, data) :]

    def hear(self) -> dict[str, Any]:
        """Read one line; ends the process where there is none."""
        while b"\n" not in self._rest:
            more = os.read(0, READ_BYTES)
            if not more or len(self._rest) > MOST_BYTES:
                sys.exit(0)
            self._rest += more
        line, self._rest = self._rest.split(b"\n", 1)
        content: dict[str, Any] = json.loads(line)
        return content

    def ask(self, name: str, arguments: dict[str, Any], at: tuple[int, int]) -> Any:
        """The parent's answer to a call; ValueRefused with its sentence if it refuses."""
        self.say({"call": name, "arguments": arguments, "line": at[0], "column": at[1]})
        answer = self.hear()
        if "error" in answer:
            raise InvalidValueError(str(answer["error"]))
        return answer["value"]


def main() -> None:
    """Serve one program."""
    settings = json.loads(sys.argv[1])
    sys.path.clear()
    line = ParentChannel()
    line.say({"layers": restrict_process(**settings)})
    found = _outcome(str(line.hear()["source"]), line)
    line.say({"done": True} if found is None else {"violation": vars(found)})


def _outcome(source: str, line: ParentChannel) -> RuleViolation | None:
    try:
        tree = check(source)
        if isinstance(tree, RuleViolation):
            return tree
        interpret(tree, line.ask)
    except RuleError as refused:
        return refused.violation
    except MemoryError:
        return RuleViolation(0, 0, "the program needs more memory than it may have", "limit")
    return None


if __name__ == "__main__":
    main()
