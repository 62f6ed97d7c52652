"""Keep what a run found, small enough for the repository: figures and thinned learning curves.

python benchmarks/collect.py runs/cabinet > docs/results/open_drawer_cabinet.json
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any

POINTS = 20
"""Points kept of a learning curve."""


def thinned(curve: dict[str, Any]) -> dict[str, Any]:
    """A curve at about :data:`POINTS` moments, each the mean of the rows up to it."""
    rows = list(zip(curve["steps"], curve["success"], curve["opened"], strict=True))
    size = max(1, len(rows) // POINTS)
    groups = [rows[i : i + size] for i in range(0, len(rows) - size + 1, size)]
    return {
        "seed": curve["seed"],
        "steps": [int(g[-1][0]) for g in groups],
        "success": [round(sum(r[1] for r in g) / size, 3) for g in groups],
        "opened": [round(sum(r[2] for r in g) / size, 3) for g in groups],
    }


def kept(report: dict[str, Any]) -> dict[str, Any]:
    """The figures of a report that the repository keeps."""
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


def main() -> int:
    """Print the kept figures of one run."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("run", type=Path)
    flags = parser.parse_args()
    report = json.loads((flags.run / "report.json").read_text(encoding="utf-8"))
    print(json.dumps(kept(report), indent=1))
    return 0


if __name__ == "__main__":
    sys.exit(main())
