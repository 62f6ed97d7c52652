"""Print the summary of a run that the repository keeps: figures and thinned learning curves.

python benchmarks/collect.py runs/cabinet > docs/results/data/policies/open_drawer_cabinet.json

The summary includes the evaluations with wider ranges that ``evaluate --ranges`` wrote to the
folder of the run. ``--deploy FILE`` adds the output of ``deploy BUNDLE --robot mujoco pybullet
--json``.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from articulate_train.run import DONE, Run, open_run
from articulate_train.train_seed import PROGRESS

POINTS = 20
"""Points of a learning curve in the summary."""
SUCCESS, WINDOW = 0.9, 100
"""Success rate over the latest training episodes whose time is reported, and their number."""


def thin_curve(curve: dict[str, Any]) -> dict[str, Any]:
    """Reduce a curve to about :data:`POINTS` points, each the mean of the rows up to it."""
    rows = list(zip(curve["steps"], curve["success"], curve["opened"], strict=True))
    size = max(1, len(rows) // POINTS)
    groups = [rows[i : i + size] for i in range(0, len(rows) - size + 1, size)]
    return {
        "seed": curve["seed"],
        "steps": [int(g[-1][0]) for g in groups],
        "success": [round(sum(r[1] for r in g) / size, 3) for g in groups],
        "opened": [round(sum(r[2] for r in g) / size, 3) for g in groups],
    }


def first_success(rows: Sequence[Mapping[str, Any]]) -> dict[str, float] | None:
    """Return the control steps and seconds until training succeeds in :data:`SUCCESS`.

    The rate is that of the latest :data:`WINDOW` training episodes from the start pose.

    Args:
        rows: Rows of a seed's ``progress.jsonl``.

    Returns:
        ``steps`` and ``seconds`` [s]; None if the rate is never reached.
    """
    for end in range(1, len(rows) + 1):
        episodes = successes = 0.0
        for row in reversed(rows[:end]):
            episodes += row["episodes"]
            successes += row["episodes"] * (row["success"] or 0.0)
            if episodes >= WINDOW:
                break
        if episodes >= WINDOW and successes >= SUCCESS * episodes:
            return {"steps": rows[end - 1]["steps"], "seconds": rows[end - 1]["seconds"]}
    return None


def training_times(run: Run, seeds: Sequence[int]) -> list[dict[str, Any]]:
    """Return :func:`first_success` of each seed, with None for rates that are never reached."""
    times = []
    for seed in seeds:
        lines = (run.seed_folder(seed) / PROGRESS).read_text(encoding="utf-8").splitlines()
        rows = [json.loads(line) for line in lines]
        found = first_success(rows)
        times.append({"seed": seed, "steps": None, "seconds": None} | (found or {}))
    return times


def member_scores(run: Path, seed: int) -> dict[str, Any]:
    """Return the evaluations of a seed's ensemble and members that selected the active ones."""
    done = json.loads((run / f"seed_{seed}" / DONE).read_text(encoding="utf-8"))
    return {"seed": seed, "scores": done["ensemble"]}


def range_summary(report: Mapping[str, Any]) -> dict[str, Any]:
    """Return the result of an evaluation with other ranges, without the run's description."""
    names = ("success_rate", "opened_rate", "worst_seed_success_rate", "success_iqm", "reasons")
    return {
        **{k: report[k] for k in names},
        "seeds": [{"seed": s["seed"], "success": s["success"]} for s in report["seeds"]],
    }


def report_summary(report: Mapping[str, Any]) -> dict[str, Any]:
    """Return the figures of ``report.json`` that the repository keeps."""
    info = report["info"]
    names = (
        "success_rate", "opened_rate", "nominal_success_rate", "worst_seed_success_rate",
        "success_iqm", "opened_iqm", "reasons", "peaks",
    )  # fmt: skip
    return {
        **{k: info[k] for k in ("asset", "task", "joint", "steps", "seconds", "steps_per_s")},
        **{k: info[k] for k in ("target_text", "command", "commit", "versions")},
        **{k: report[k] for k in names},
        "seeds": report["seeds"],
        "parameters": [
            {k: p[k] for k in ("name", "lowest", "highest", "dispersion")}
            for p in report["parameters"]
        ],
        "curves": [thin_curve(c) for c in report["curves"]],
    }


def run_summary(folder: Path, deploy: Path | None) -> dict[str, Any]:
    """Return everything about a run that the repository keeps."""
    report = json.loads((folder / "report.json").read_text(encoding="utf-8"))
    summary = report_summary(report)
    seeds = [s["seed"] for s in report["seeds"]]
    summary["time_to_90_percent"] = training_times(open_run(folder), seeds)
    summary["member_scores"] = [member_scores(folder, seed) for seed in seeds]
    summary["ranges"] = {
        path.parent.name.removeprefix("ranges_"): range_summary(
            json.loads(path.read_text(encoding="utf-8"))
        )
        for path in sorted(folder.glob("ranges_*/report.json"))
    }
    if deploy is not None:
        summary["deploy"] = deploy_summary(json.loads(deploy.read_text(encoding="utf-8")))
    return summary


def deploy_summary(report: dict[str, Any]) -> dict[str, Any]:
    """Return the output of ``deploy --json`` without its single episodes and notes."""
    robots = {
        name: {key: value for key, value in robot.items() if key not in ("each", "notes")}
        for name, robot in report["robots"].items()
    }
    return report | {"robots": robots}


def main() -> int:
    """Print the summary of one run."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("run", type=Path, help="folder of a finished run")
    parser.add_argument("--deploy", type=Path, help="output of deploy --json for its bundle")
    flags = parser.parse_args()
    print(json.dumps(run_summary(flags.run, flags.deploy), indent=1))
    return 0


if __name__ == "__main__":
    sys.exit(main())
