"""Child process: restricts itself, then reads, checks and interprets a program.

It runs as an isolated script without packages, so that only the standard library and the few
modules of the language are loaded::

    python -I -S -B child.py '{"memory_bytes": …, "cpu_s": …, "layers": […]}'

It writes lines of JSON to the standard output: the active layers, calls for the parent, and at last
``done`` or a violation. It reads lines of JSON: the program, and the answers.
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
MAX_BYTES = 4_000_000
"""Longest line that is read."""


class ParentChannel:
    """Lines of JSON to and from the parent."""

    def __init__(self) -> None:
        self._rest = b""

    def write(self, content: dict[str, Any]) -> None:
        """Write one line."""
        data = json.dumps(content).encode() + b"\n"
        while data:
            data = data[os.write(1, data) :]

    def read(self) -> dict[str, Any]:
        """Read one line; end the process at the end of the input."""
        while b"\n" not in self._rest:
            more = os.read(0, READ_BYTES)
            if not more or len(self._rest) > MAX_BYTES:
                sys.exit(0)
            self._rest += more
        line, self._rest = self._rest.split(b"\n", 1)
        content: dict[str, Any] = json.loads(line)
        return content

    def call(self, name: str, arguments: dict[str, Any], at: tuple[int, int]) -> Any:
        """Return the parent's answer to a call.

        Raises:
            InvalidValueError: The parent rejects the arguments.
        """
        self.write({"call": name, "arguments": arguments, "line": at[0], "column": at[1]})
        answer = self.read()
        if "error" in answer:
            raise InvalidValueError(str(answer["error"]))
        return answer["value"]


def main() -> None:
    """Serve one program."""
    settings = json.loads(sys.argv[1])
    sys.path.clear()
    channel = ParentChannel()
    channel.write({"layers": restrict_process(**settings)})
    found = _outcome(str(channel.read()["source"]), channel)
    channel.write({"done": True} if found is None else {"violation": vars(found)})


def _outcome(source: str, channel: ParentChannel) -> RuleViolation | None:
    try:
        tree = check(source)
        if isinstance(tree, RuleViolation):
            return tree
        interpret(tree, channel.call)
    except RuleError as error:
        return error.violation
    except MemoryError:
        return RuleViolation(0, 0, "the program needs more memory than is allowed", "limit")
    return None


if __name__ == "__main__":
    main()
