"""Measure the start of commands: ``--help`` of each command, and the import of the package.

    python benchmarks/startup.py [--json] [--times 7]

Each command runs several times in a separate process. The shortest time counts, because other load
only adds time. Processor time is printed too.
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


def measured_commands() -> dict[str, list[str]]:
    """Return the measured commands by name."""
    python = [sys.executable]
    commands = sorted(metadata.entry_points(group="articulate.commands").names)
    return {
        "python": [*python, "-c", "pass"],
        "import articulate": [*python, "-c", "import articulate"],
        "articulate --help": [*python, "-m", "articulate", "--help"],
        **{f"{name} --help": [*python, "-m", "articulate", name, "--help"] for name in commands},
    }


def shortest_times(call: list[str], times: int) -> dict[str, float]:
    """Return the shortest wall-clock and processor time of ``call`` [s]."""
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
    """Measure and print the times."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--json", action="store_true", help="print the result as JSON only")
    parser.add_argument("--times", type=int, default=7, help="runs of each command")
    flags = parser.parse_args()
    found: dict[str, Any] = {
        n: shortest_times(call, flags.times) for n, call in measured_commands().items()
    }
    if flags.json:
        print(json.dumps(found, indent=1))
        return
    for name, row in found.items():
        print(f"{name:<20} {row['wall_s']:.3f} s, {row['cpu_s']:.3f} s of processor time")


if __name__ == "__main__":
    main()
