"""Success by training mechanism: PPO alone, imitation, checkpoint selection, ensemble.

    python benchmarks/ablation.py --data data --out runs/ablation --json

Each row adds one mechanism to the row above, at the same number of control steps per seed. Runs
that exist in ``--out`` are resumed or read, so the command can be stopped and called again.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
from pathlib import Path
from statistics import mean
from typing import Any

OBJECTS = {
    "open_drawer": "partnet/20411",
    "open_door": "partnet/7119",
    "open_lid": "partnet/9748",
}
"""Task and object of each column."""
_ONE = ["--ensemble-size", "1"]
_LAST = ["--set", "checkpoint_selection.n_checkpoints=1"]
VARIANTS = {
    "PPO": [*_ONE, *_LAST, "--set", "imitation.until=0"],
    "+ imitation": [*_ONE, *_LAST],
    "+ checkpoint selection": _ONE,
    "+ ensemble of two": [],
}
"""Arguments of ``train`` for each row."""


def success(folder: Path) -> dict[str, float] | None:
    """Return success and opened rate of a finished run; None if it has no report."""
    path = folder / "report.json"
    if not path.is_file():
        return None
    report = json.loads(path.read_text(encoding="utf-8"))
    return {name: report[f"{name}_rate"] for name in ("success", "opened")}


def run(folder: Path, asset: Path, task: str, seed: int, steps: int, extra: list[str]) -> None:
    """Train and evaluate one seed, or resume it."""
    words = [sys.executable, "-m", "articulate", "train", "--out", str(folder), "--quiet"]
    if (folder / "config.yaml").is_file():
        words.append("--resume")
    else:
        words += ["--asset", str(asset), "--task", task, "--seeds", str(seed), "--jobs", "1"]
        words += ["--steps", str(steps), "--episodes", "500", "--force", *extra]
    subprocess.run(words, check=True, stdout=subprocess.DEVNULL)


def main() -> None:
    """Run what is missing and print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n\n")[0])
    parser.add_argument("--data", type=Path, required=True, help="folder with assets/")
    parser.add_argument("--out", type=Path, required=True, help="folder of the runs")
    parser.add_argument("--seeds", type=int, nargs="+", default=[0, 1, 2])
    parser.add_argument("--steps", type=int, default=1_000_000, help="control steps of each seed")
    parser.add_argument("--json", action="store_true", help="print the result as JSON alone")
    flags = parser.parse_args()
    rows: dict[str, dict[str, Any]] = {variant: {} for variant in VARIANTS}
    for seed in flags.seeds:
        for task, name in OBJECTS.items():
            asset = flags.data / "assets" / name / "mobility.urdf"
            for k, (variant, extra) in enumerate(VARIANTS.items()):
                folder = flags.out / f"{task}-{k}-seed-{seed}"
                if success(folder) is None:
                    run(folder, asset, task, seed, flags.steps, extra)
                found = success(folder)
                rows[variant].setdefault(task, []).append(found)
                sys.stderr.write(f"{task}, seed {seed}, {variant}: {found}\n")
    if flags.json:
        print(json.dumps({"steps": flags.steps, "seeds": flags.seeds, "rows": rows}, indent=1))
        return
    print("| | " + " | ".join(OBJECTS) + " |\n" + "|---" * (len(OBJECTS) + 1) + "|")
    for variant, cells in rows.items():
        texts = []
        for task in OBJECTS:
            rates = [100.0 * r["success"] for r in cells[task]]
            texts.append(f"{mean(rates):.1f} % ({', '.join(f'{r:.1f}' for r in rates)})")
        print(f"| {variant} | {' | '.join(texts)} |")


if __name__ == "__main__":
    main()
