"""``python -m articulate.preparation.child``: check one object in a process of its own.

A JSON object on the standard input says what to do; the folder with the result is the last line
of the standard output. Bad usage ends with 2 and its sentence on the standard error.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

from articulate.errors import UsageError
from articulate.formats.config import ConvertConfig
from articulate.preparation.batch import USAGE_EXIT
from articulate.preparation.prepare import checked, refuse


def main() -> int:
    """Do what the standard input says."""
    request = json.loads(sys.stdin.read())
    file, cache, options = Path(request["file"]), Path(request["cache"]), request["options"]
    try:
        if request.get("refusal"):
            folder = refuse(
                file, request["refusal"], options, cache, lasting=bool(request["lasting"])
            )
        else:
            against = Path(options["against"]) if "against" in options else None
            folder = checked(file, _config(options, cache), options, against)
    except UsageError as error:
        sys.stderr.write(f"{error}\n")
        return USAGE_EXIT
    sys.stdout.write(f"\n{folder}\n")
    return 0


def _config(options: dict[str, object], cache: Path) -> ConvertConfig:
    given = {key: value for key, value in options.items() if key != "against"}
    if isinstance(given.get("mesh_dirs"), list):
        given["mesh_dirs"] = tuple(Path(str(path)) for path in given["mesh_dirs"])  # type: ignore[attr-defined]  # a list
    return ConvertConfig(cache_dir=cache, **given)  # type: ignore[arg-type]  # it checks them


if __name__ == "__main__":
    sys.exit(main())
