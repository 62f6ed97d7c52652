"""How long commands take to answer: ``--help`` of each verb, and importing the package.

    .venv/bin/python benchmarks/startup.py [--json] [--times 7]

Each is run in a process of its own, some times over; the shortest counts, for a busy machine only
ever adds. Processor time is printed beside it.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import time
from importlib import metadata
from typing import Any


def calls() -> dict[str, list[str]]:
    """Return the commands that are run, by name."""
    python = [sys.executable]
    verbs = sorted(metadata.entry_points(group="articulate.commands").names)
    return {
        "python": [*python, "-c", "pass"],
        "import articulate": [*python, "-c", "import articulate"],
        "articulate --help": [*python, "-m", "articulate", "--help"],
        **{f"{verb} --help": [*python, "-m", "articulate", verb, "--help"] for verb in verbs},
    }


def measured(call: list[str], times: int) -> dict[str, float]:
    """Shortest wall-clock and processor time of ``call`` [s]."""
    walls, cpus = [], []
    for _ in range(times):
        before, begin = os.times(), time.perf_counter()
        subprocess.run(call, check=True, stdout=subprocess.DEVNULL)
        walls.append(time.perf_counter() - begin)
        after = os.times()
        cpus.append(
            after.children_user
            + after.children_system
            - before.children_user
            - before.children_system
        )
    return {"wall_s": round(min(walls), 3), "cpu_s": round(min(cpus), 3)}


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--times", type=int, default=7)
    flags = parser.parse_args()
    found: dict[str, Any] = {n: measured(call, flags.times) for n, call in calls().items()}
    if flags.json:
        print(json.dumps(found, indent=1))
        return
    for name, row in found.items():
        print(f"{name:<20} {row['wall_s']:.3f} s, {row['cpu_s']:.3f} s of processor")


if __name__ == "__main__":
    main()
