"""Print the table of policies: success of three seeds for each object, bold at the target.

python benchmarks/policies.py

The summaries in ``docs/results/data/policies`` are written by ``benchmarks/collect.py``.
``docs/results/index.md`` has the main columns of the table.
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
TARGETS = {"open": (0.98, 0.95), "close": (0.995, 0.99)}
"""Target success of tasks that open and close: mean over seeds, worst seed."""
TARGET_WIDE, TARGET_RATIO = 0.85, 0.9
"""Target success with ranges 1.5 times as wide; target ratio of PyBullet to MuJoCo successes."""
ONE_MEMBER = "°"
"""Marks the success of a seed with a single active ensemble member."""
HEAD = (
    "task, object",
    "success: mean (seeds)",
    "worst seed",
    "opened (or closed)",
    "failures",
    "ranges 1.5 times as wide",
    "PyBullet ÷ MuJoCo",
    "90 % of training episodes after",
    "peak force; peak joint speed",
    "commit",
)


def format_share(value: float, target: float) -> str:
    """Format a share in per cent: bold if it reaches ``target``, else rounded down."""
    if value >= target - 1e-9:
        return f"**{100 * value:.1f} %**"
    return f"{math.floor(1000 * value + 1e-9) / 10:.1f} %"


def failures(reasons: Mapping[str, int]) -> str:
    """Format the reasons of failure, the most frequent first."""
    counts = sorted(((n, r) for r, n in reasons.items() if r != "success"), reverse=True)
    total = sum(reasons.values())
    text = ", ".join(f"{r.replace('_', ' ')} {n}" for n, r in counts) or "none"
    return f"{text} of {total:,}"


def training_time_text(rows: Iterable[Mapping[str, Any]]) -> str:
    """Format the median steps and minutes until 90 % of the training episodes succeed."""
    seeds = list(rows)
    steps = [row["steps"] for row in seeds if row["steps"] is not None]
    if len(steps) < len(seeds):
        return f"{len(steps)} of {len(seeds)} seeds"
    seconds = statistics.median(row["seconds"] for row in seeds)
    return f"{statistics.median(steps) / 1e6:.2f}M, {seconds / 60:.1f} min"


def peaks_text(peaks: Iterable[Mapping[str, Any]]) -> str:
    """Format the median over episodes of the largest force and joint speed."""
    by_name = {peak["name"]: peak for peak in peaks}
    force, speed = by_name["force"], by_name["speed_share"]
    return f"{force['median']:.0f} N; {100 * speed['median']:.0f} %"


def ratio_text(deploy: Mapping[str, Any] | None) -> str:
    """Format the successes in PyBullet and in MuJoCo on the same episodes, and their ratio."""
    if deploy is None:
        return "—"
    robots, ratio = deploy["robots"], deploy["ratios"]["pybullet"]
    other, own = robots["pybullet"]["successes"], robots["mujoco"]["successes"]
    return f"{other} ÷ {own}: {format_share(ratio, TARGET_RATIO)}"


def object_text(summary: Mapping[str, Any]) -> str:
    """Return the name of the object after its data set, the folder below ``assets``."""
    name = str(summary["asset"]).replace("_", " ")
    _, known, path = str(summary["command"]).partition("/assets/")
    source = path.split("/")[0] if known else ""
    return name if name.startswith(source) else f"{source} {name}"


def row(summary: Mapping[str, Any]) -> tuple[str, ...]:
    """Return the cells of one object's row."""
    mean, worst = TARGETS[summary["task"].split("_")[0]]
    seeds = ", ".join(
        f"{100 * s['success']['value']:.1f}{'' if s['active_member'] is None else ONE_MEMBER}"
        for s in summary["seeds"]
    )
    wide = summary["ranges"].get("1.5")
    return (
        f"{summary['task']}, {object_text(summary)}",
        f"{format_share(summary['success_rate'], mean)} ({seeds})",
        format_share(summary["worst_seed_success_rate"], worst),
        f"{100 * summary['opened_rate']:.1f} %",
        failures(summary["reasons"]),
        "—" if wide is None else format_share(wide["success_rate"], TARGET_WIDE),
        ratio_text(summary.get("deploy")),
        training_time_text(summary["time_to_90_percent"]),
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
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--folder", type=Path, default=FOLDER, help="folder of the summaries")
    print(table(parser.parse_args().folder))
    return 0


if __name__ == "__main__":
    sys.exit(main())
