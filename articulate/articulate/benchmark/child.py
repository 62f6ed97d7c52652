"""``python -m articulate.benchmark.child``: run one object in a process of its own.

A JSON object on the standard input says what to do; the record is written to the file it names.
Settings that are not accepted, and packages and keys that are not there, end with 2, an object that
cannot be read with 3, each with one sentence on the standard error.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

from articulate.benchmark.batch import RECORD_VERSION, USAGE_EXIT
from articulate.benchmark.config import BenchmarkConfig
from articulate.benchmark.dataset import open_dataset
from articulate.benchmark.run import run_object
from articulate.errors import MissingError, UsageError
from articulate.files import write_json
from articulate.reconstruct.actors.registry import make_actor

OBJECT_EXIT = 3


def main() -> int:
    """Do what the standard input says."""
    request = json.loads(sys.stdin.read())
    try:
        config = BenchmarkConfig(**request["config"])
        data = None if request["data"] is None else Path(request["data"])
        dataset = open_dataset(request["source"], data)
        actor = make_actor(config.actor)
    except UsageError as error:
        sys.stderr.write(f"{error}\n")
        return USAGE_EXIT
    try:
        record = run_object(dataset.load(request["object"]), actor, config)
    except UsageError as error:
        sys.stderr.write(f"{error}\n")
        return USAGE_EXIT if isinstance(error, MissingError) else OBJECT_EXIT
    record["fingerprint"] = request["fingerprint"]
    record["version"] = RECORD_VERSION
    write_json(Path(request["path"]), record)
    return 0


if __name__ == "__main__":
    sys.exit(main())
