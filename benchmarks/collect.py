"""Keep what a run found, small enough for the repository: figures and thinned learning curves.

python benchmarks/collect.py runs/cabinet > docs/results/data/policies/open_drawer_cabinet.json

Evaluations with wider ranges are taken along from where ``evaluate --ranges`` leaves them in the
folder of the run, and with ``--deploy FILE`` what ``deploy BUNDLE --robot mujoco pybullet --json``
printed.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import yaml

from articulate_train.run import CONFIG, DONE

POINTS = 20
"""Points kept of a learning curve."""
LEARNT, WINDOW = 0.9, 100
"""Share of the last so many training episodes from home that is called learnt."""


def thinned(curve: dict[str, Any]) -> dict[str, Any]:
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


def when_learnt(rows: Sequence[Mapping[str, Any]]) -> dict[str, float] | None:
    """Ticks and seconds until the last :data:`WINDOW` training episodes succeed often enough.

    ``rows`` are those of a seed's ``progress.jsonl``. None if that never comes.
    """
    for end in range(1, len(rows) + 1):
        episodes = successes = 0.0
        for row in reversed(rows[:end]):
            episodes += row["episodes"]
            successes += row["episodes"] * (row["success"] or 0.0)
            if episodes >= WINDOW:
                break
        if episodes >= WINDOW and successes >= LEARNT * episodes:
            return {"steps": rows[end - 1]["steps"], "seconds": rows[end - 1]["seconds"]}
    return None


def until_learnt(run: Path, seeds: Sequence[int]) -> list[dict[str, Any]]:
    """When each seed of ``run`` first had :data:`LEARNT` of its own episodes from home.

    Episodes while a guide acts in some environments do not count.
    """
    config = yaml.safe_load((run / CONFIG).read_text(encoding="utf-8"))
    shown = config["show"]["until"] * config["show"]["expert_until"] * config["steps"]
    found = []
    for seed in seeds:
        lines = (run / f"seed_{seed}" / "progress.jsonl").read_text(encoding="utf-8").splitlines()
        rows = [json.loads(line) for line in lines]
        when = when_learnt([row for row in rows if row["steps"] > shown])
        found.append({"seed": seed, "steps": None, "seconds": None} | (when or {}))
    return found


def who_acts(run: Path, seed: int) -> dict[str, Any]:
    """Which member of a seed acts alone, if one does, and how all and each alone were judged."""
    done = json.loads((run / f"seed_{seed}" / DONE).read_text(encoding="utf-8"))
    return {"seed": seed, "acts": done.get("acts"), "judged": done.get("members", [])}


def outcome(report: Mapping[str, Any]) -> dict[str, Any]:
    """Return the result of an evaluation with other ranges, without the run's description."""
    names = ("success_rate", "opened_rate", "worst_seed_success_rate", "success_iqm", "reasons")
    return {
        **{k: report[k] for k in names},
        "seeds": [{"seed": s["seed"], "success": s["success"]} for s in report["seeds"]],
    }


def kept(report: Mapping[str, Any]) -> dict[str, Any]:
    """Return the figures of a report that the repository keeps."""
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
            {k: p[k] for k in ("name", "lowest", "highest", "unevenness")}
            for p in report["parameters"]
        ],
        "curves": [thinned(c) for c in report["curves"]],
    }


def collected(run: Path, deploy: Path | None) -> dict[str, Any]:
    """All that the repository keeps of a run."""
    report = json.loads((run / "report.json").read_text(encoding="utf-8"))
    found = kept(report)
    seeds = [s["seed"] for s in report["seeds"]]
    found["learnt"] = until_learnt(run, seeds)
    found["members"] = [who_acts(run, seed) for seed in seeds]
    found["ranges"] = {
        path.parent.name.removeprefix("ranges_"): outcome(
            json.loads(path.read_text(encoding="utf-8"))
        )
        for path in sorted(run.glob("ranges_*/report.json"))
    }
    if deploy is not None:
        found["deploy"] = compared(json.loads(deploy.read_text(encoding="utf-8")))
    return found


def compared(report: dict[str, Any]) -> dict[str, Any]:
    """Return the output of ``deploy --json`` without its single episodes."""
    robots = {
        name: {key: value for key, value in robot.items() if key != "each"}
        for name, robot in report["robots"].items()
    }
    return report | {"robots": robots}


def main() -> int:
    """Print the kept figures of one run."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("run", type=Path)
    parser.add_argument("--deploy", type=Path, help="what deploy --json printed of its bundle")
    flags = parser.parse_args()
    print(json.dumps(collected(flags.run, flags.deploy), indent=1))
    return 0


if __name__ == "__main__":
    sys.exit(main())
