"""Success of the generalist policy in PyBullet, divided by that in MuJoCo, on the same episodes.

    python benchmarks/generalist_physics.py --scenes generality/scenes.jsonl --out rows.jsonl

Each accepted joint of the list (``benchmarks/generality.py``) is exported as a bundle and deployed
on both simulated robots. The table is resumable: what ``--out`` holds is not repeated.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from generalist_scenes import SceneRecord, read_records

MIN_EXPERT = 0.2
"""Least success rate of the expert, as for ``train``."""


def run(*words: object) -> str:
    """Return what a command prints on standard output."""
    line = [sys.executable, "-m", "articulate", *map(str, words)]
    done = subprocess.run(line, capture_output=True, text=True, check=False)
    if done.returncode:
        raise RuntimeError(done.stderr.strip().splitlines()[-1])
    return done.stdout


def compare(record: SceneRecord, episodes: int) -> dict[str, Any]:
    """Return the row of one joint: successes of both robots on the same episodes."""
    row: dict[str, Any] = {"object": record.object, "task": record.task, "joint": record.joint}
    with tempfile.TemporaryDirectory() as folder:
        bundle = Path(folder) / "bundle.zip"
        source = ("--asset", record.source, "--task", record.task, "--joint", record.joint)
        try:
            run("export", "--policy", "generalist", *source, "--out", bundle)
            robots = ("--robot", "mujoco", "pybullet", "--episodes", episodes)
            report = json.loads(run("deploy", bundle, *robots, "--json"))
        except RuntimeError as error:
            return row | {"error": str(error)}
    found = {name: robot["successes"] for name, robot in report["robots"].items()}
    return row | {"episodes": episodes, **found}


def summary(rows: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Return successes of both robots and their ratio over all rows."""
    valid = [row for row in rows if "error" not in row]
    both = {name: sum(row[name] for row in valid) for name in ("mujoco", "pybullet")}
    ratio = round(both["pybullet"] / both["mujoco"], 3) if both["mujoco"] else None
    return {"joints": len(valid), "errors": len(rows) - len(valid), **both, "ratio": ratio}


def main(argv: Sequence[str]) -> int:
    """Compare the robots on each joint and print the summary."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0] if __doc__ else None)
    parser.add_argument("--scenes", type=Path, required=True, help="list of scenes")
    parser.add_argument("--episodes", type=int, default=20)
    parser.add_argument("--out", type=Path, required=True, help="rows, one per line")
    args = parser.parse_args(argv)
    lines = args.out.read_text(encoding="utf-8").splitlines() if args.out.exists() else []
    rows = [json.loads(line) for line in lines]
    done = {(row["object"], row["task"], row["joint"]) for row in rows}
    for record in read_records(args.scenes):
        key = (record.object, record.task, record.joint)
        if record.placement is None or record.expert < MIN_EXPERT or key in done:
            continue
        rows.append(compare(record, args.episodes))
        with args.out.open("a", encoding="utf-8") as stream:
            stream.write(json.dumps(rows[-1]) + "\n")
        print(json.dumps(rows[-1]), flush=True)
    print(json.dumps(summary(rows)))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
