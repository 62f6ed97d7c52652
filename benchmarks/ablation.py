"""Measure success by training mechanism: PPO, imitation, checkpoint selection, ensemble.

    python benchmarks/ablation.py --data data --out runs/ablation --json

Each row adds one mechanism to the row above, at the same number of control steps per seed. The row
without selection evaluates the last checkpoint of the training with selection. Runs that exist in
``--out`` are resumed or read, so the command can be stopped and repeated.
"""

from __future__ import annotations

import argparse
import json
import shutil
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
_SELECTED = "+ checkpoint selection"
TRAININGS = {
    "PPO": [*_ONE, *_LAST, "--set", "imitation.until=0"],
    _SELECTED: _ONE,
    "+ ensemble of two": [],
}
"""Arguments of ``train`` for each row that is trained."""
ROWS = ("PPO", "+ imitation", *list(TRAININGS)[1:])


def success(folder: Path) -> dict[str, float] | None:
    """Return success and opened rate of a finished run; None if it has no report."""
    path = folder / "report.json"
    if not path.is_file():
        return None
    report = json.loads(path.read_text(encoding="utf-8"))
    return {name: report[f"{name}_rate"] for name in ("success", "opened")}


def train(folder: Path, arguments: list[str]) -> None:
    """Train and evaluate one seed, or resume it."""
    command = [sys.executable, "-m", "articulate", "train", "--out", str(folder), "--quiet"]
    command += ["--resume"] if (folder / "config.yaml").is_file() else arguments
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)


def evaluate_last(trained: Path, folder: Path, seed: int) -> None:
    """Evaluate the last checkpoint of a training instead of the selected one."""
    shutil.rmtree(folder, ignore_errors=True)
    shutil.copytree(trained, folder)
    (folder / "report.json").unlink()
    (folder / f"seed_{seed}" / "policy.pt").unlink()
    command = [sys.executable, "-m", "articulate", "evaluate", str(folder)]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)


def measure(out: Path, asset: Path, task: str, seed: int, steps: int) -> dict[str, Any]:
    """Return the success of each row for one object and seed; run what is missing."""
    common = ["--asset", str(asset), "--task", task, "--seeds", str(seed), "--jobs", "1"]
    common += ["--steps", str(steps), "--episodes", "500", "--force", "--from-scratch"]
    folders = {row: out / f"{task}-{k}-seed-{seed}" for k, row in enumerate(ROWS)}
    for row, extra in TRAININGS.items():
        if success(folders[row]) is None:
            train(folders[row], [*common, *extra])
    if success(folders["+ imitation"]) is None:
        evaluate_last(folders[_SELECTED], folders["+ imitation"], seed)
    return {row: success(folder) for row, folder in folders.items()}


def main() -> None:
    """Run what is missing and print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--data", type=Path, required=True, help="folder that contains assets/")
    parser.add_argument("--out", type=Path, required=True, help="folder of the runs")
    parser.add_argument("--seeds", type=int, nargs="+", default=[0, 1, 2], help="training seeds")
    parser.add_argument("--steps", type=int, default=500_000, help="control steps of each seed")
    parser.add_argument("--json", action="store_true", help="print the result as JSON only")
    flags = parser.parse_args()
    rows: dict[str, dict[str, Any]] = {row: {} for row in ROWS}
    for seed in flags.seeds:
        for task, name in OBJECTS.items():
            asset = flags.data / "assets" / name / "mobility.urdf"
            for row, found in measure(flags.out, asset, task, seed, flags.steps).items():
                rows[row].setdefault(task, []).append(found)
                sys.stderr.write(f"{task}, seed {seed}, {row}: {found}\n")
    if flags.json:
        print(json.dumps({"steps": flags.steps, "seeds": flags.seeds, "rows": rows}, indent=1))
        return
    print("| | " + " | ".join(OBJECTS) + " |\n" + "|---" * (len(OBJECTS) + 1) + "|")
    for row, cells in rows.items():
        texts = []
        for task in OBJECTS:
            rates = [100.0 * r["success"] for r in cells[task]]
            texts.append(f"{mean(rates):.1f} % ({', '.join(f'{r:.1f}' for r in rates)})")
        print(f"| {row} | {' | '.join(texts)} |")


if __name__ == "__main__":
    main()
