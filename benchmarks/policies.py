"""Table of policies: targets beside the figures of three seeds for each object.

python benchmarks/policies.py

Read the summaries that ``benchmarks/collect.py`` wrote to ``docs/results/data/policies`` and
print their table; ``docs/results/index.md`` has its main columns.
"""

from __future__ import annotations

import argparse
import json
import math
import statistics
import sys
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

FOLDER = Path(__file__).resolve().parents[1] / "docs" / "results" / "data" / "policies"
ASKED = {"open": (0.98, 0.95), "close": (0.995, 0.99)}
"""Success asked of tasks that open and close: mean over seeds, worst seed."""
ASKED_WIDE, ASKED_RATIO = 0.85, 0.9
"""Success asked at 1.5 times every range; share of MuJoCo's successes asked of PyBullet."""
ALONE = "°"
"""Marks the success of a seed of which one member acts alone."""
HEAD = (
    "task, object",
    "success: mean (seeds)",
    "worst seed",
    "opened (or closed)",
    "failures",
    "1.5 times every range",
    "PyBullet ÷ MuJoCo",
    "90 % learnt after",
    "peak force; joint speed",
    "commit",
)


def share(value: float, asked: float) -> str:
    """Format a share in per cent: bold if it reaches ``asked``, else rounded down."""
    if value >= asked - 1e-9:
        return f"**{100 * value:.1f} %**"
    return f"{math.floor(1000 * value + 1e-9) / 10:.1f} %"


def failures(reasons: Mapping[str, int]) -> str:
    """Reasons of failure, the commonest first."""
    counts = sorted(((n, r) for r, n in reasons.items() if r != "success"), reverse=True)
    total = sum(reasons.values())
    text = ", ".join(f"{r.replace('_', ' ')} {n}" for n, r in counts) or "none"
    return f"{text} of {total:,}"


def learnt_text(rows: Iterable[Mapping[str, Any]]) -> str:
    """Median over seeds of the steps and minutes until 90 % of training episodes succeed."""
    seeds = list(rows)
    steps = [row["steps"] for row in seeds if row["steps"] is not None]
    if len(steps) < len(seeds):
        return f"{len(steps)} of {len(seeds)} seeds"
    seconds = statistics.median(row["seconds"] for row in seeds)
    return f"{statistics.median(steps) / 1e6:.2f}M, {seconds / 60:.1f} min"


def peaks_text(peaks: Iterable[Mapping[str, Any]]) -> str:
    """Largest force and fastest joint of an episode, in the median."""
    by_name = {peak["name"]: peak for peak in peaks}
    force, speed = by_name["force"], by_name["speed_share"]
    return f"{force['median']:.0f} N; {100 * speed['median']:.0f} %"


def ratio_text(deploy: Mapping[str, Any] | None) -> str:
    """Successes in PyBullet over those in MuJoCo on the same draws."""
    if deploy is None:
        return "—"
    robots, ratio = deploy["robots"], deploy["ratios"]["pybullet"]
    other, own = robots["pybullet"]["successes"], robots["mujoco"]["successes"]
    return f"{other} ÷ {own}: {share(ratio, ASKED_RATIO)}"


def object_text(summary: Mapping[str, Any]) -> str:
    """Name of the object, with the data set that it is of: the folder below ``assets``."""
    name = str(summary["asset"]).replace("_", " ")
    _, known, path = str(summary["command"]).partition("/assets/")
    source = path.split("/")[0] if known else ""
    return name if name.startswith(source) else f"{source} {name}"


def row(summary: Mapping[str, Any]) -> tuple[str, ...]:
    """Cells of one object's row."""
    mean, worst = ASKED[summary["task"].split("_")[0]]
    alone = {m["seed"] for m in summary.get("members", []) if m["acts"] is not None}
    seeds = ", ".join(
        f"{100 * s['success']['value']:.1f}{ALONE if s['seed'] in alone else ''}"
        for s in summary["seeds"]
    )
    wide = summary["ranges"].get("1.5")
    return (
        f"{summary['task']}, {object_text(summary)}",
        f"{share(summary['success_rate'], mean)} ({seeds})",
        share(summary["worst_seed_success_rate"], worst),
        f"{100 * summary['opened_rate']:.1f} %",
        failures(summary["reasons"]),
        "—" if wide is None else share(wide["success_rate"], ASKED_WIDE),
        ratio_text(summary.get("deploy")),
        learnt_text(summary["learnt"]),
        peaks_text(summary["peaks"]),
        summary["commit"],
    )


def table(folder: Path) -> str:
    """Return a Markdown table with a row for each summary of ``folder``, sorted by name."""
    summaries = [json.loads(p.read_text(encoding="utf-8")) for p in sorted(folder.glob("*.json"))]
    rows = [HEAD, tuple("---" for _ in HEAD), *(row(summary) for summary in summaries)]
    return "\n".join("| " + " | ".join(cells) + " |" for cells in rows)


def main() -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--folder", type=Path, default=FOLDER)
    print(table(parser.parse_args().folder))
    return 0


if __name__ == "__main__":
    sys.exit(main())
