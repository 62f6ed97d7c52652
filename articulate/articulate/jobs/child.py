"""Handle one request in a child process: ``python -m articulate.jobs.child MODULE PARENT``.

A JSON object on standard input is passed to ``MODULE.run``; the text that it returns is the last
line of standard output. Bad usage ends with status 2 and any other error of the project with
status 3, each with one line on standard error.
"""

from __future__ import annotations

import json
import sys
from importlib import import_module

from articulate.errors import ArticulateError, UsageError
from articulate.jobs.process_identity import end_with_parent

USAGE_EXIT = 2
"""Status for settings that are wrong for every request."""
REQUEST_EXIT = 3
"""Status for a request that cannot be handled, for a reason that the last line gives."""


def main(argv: list[str]) -> int:
    """Read, handle and answer one request."""
    end_with_parent(int(argv[1]))
    request = json.loads(sys.stdin.read())
    try:
        result = import_module(argv[0]).run(request)
    except ArticulateError as error:
        sys.stderr.write(f"{error}\n")
        return USAGE_EXIT if isinstance(error, UsageError) else REQUEST_EXIT
    sys.stdout.write(f"\n{result}\n")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
