"""Keep what an actor said of each joint, small enough for the repository.

python benchmarks/joints_said.py runs/video > docs/results/data/joints_video_281.json

One line for each object of a run of ``articulate benchmark``: the joints as they were said, how
they are judged, by how much they are off, and how far the part moves in the picture.
``made_assets.py`` takes such a file in place of the run.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

SAID = ("part", "parent", "kind", "axis_o", "pivot_o", "lower", "upper")
"""What is kept of a predicted joint."""
OFF = ("axis_rad", "origin_paper", "range_paper")
"""What is kept of its errors."""
CASE = ("case", "moved_px", "seconds", "rating", "spurious", "fixed")
"""What is kept of the question."""
DIGITS = 6


def rounded(value: Any) -> Any:
    """``value`` with every number in it rounded."""
    if isinstance(value, float):
        return round(value, DIGITS)
    if isinstance(value, list):
        return [rounded(one) for one in value]
    return value


def _picked(content: Mapping[str, Any] | None, names: tuple[str, ...]) -> dict[str, Any] | None:
    if content is None:
        return None
    return {name: rounded(content[name]) for name in names if name in content}


def kept(record: Mapping[str, Any]) -> dict[str, Any]:
    """What is kept of the record of an object."""
    cases = [
        {
            **(_picked(case, CASE) or {}),
            "joints": [
                {
                    "kind": joint["truth"]["kind"],
                    "status": joint["status"],
                    "failures": joint["failures"],
                    "errors": _picked(joint["errors"], OFF),
                    "predicted": _picked(joint["predicted"], SAID),
                }
                for joint in case["joints"]
            ],
        }
        for case in record["cases"]
    ]
    return {"category": record["category"], "error": record["error"], "cases": cases}


def records_of(place: Path) -> Iterator[tuple[str, dict[str, Any]]]:
    """Records by object, of the folder of a run or of a file that this command wrote."""
    if place.is_file():
        yield from json.loads(place.read_text(encoding="utf-8")).items()
        return
    for file in sorted((place / "objects").glob("*.json")):
        yield file.stem, json.loads(file.read_text(encoding="utf-8"))


def main() -> int:
    """Print what is kept of a run."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("run", type=Path, help="folder of articulate benchmark")
    flags = parser.parse_args()
    whole = flags.run / "objects"
    records = records_of(flags.run) if whole.is_dir() else ()
    lines = [f"{json.dumps(name)}: {json.dumps(kept(record))}" for name, record in records]
    if not lines:
        sys.stderr.write(f"{flags.run}: holds no records of articulate benchmark\n")
        return 2
    sys.stdout.write("{\n" + ",\n".join(lines) + "\n}\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
