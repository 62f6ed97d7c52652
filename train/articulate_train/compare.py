"""Comparison of runs: success rates with intervals and differing settings.

::

    comparison.json     all figures
    comparison.html     the same figures as charts and tables; opens offline
"""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from articulate.errors import RunError, shorten
from articulate.files import write_json, write_text
from articulate.page import Bars, Chart, ChartLine, Page
from articulate.statistics import Difference, Share, difference, percent, wilson
from articulate.task.episode_monitor import REASONS
from articulate.transforms import Array
from articulate.untrusted import load_json_object, parse_yaml
from articulate_train.report import SCHEMA, SCHEMA_VERSION
from articulate_train.report_html import REASON_TEXT

COMPARISON_SCHEMA = "articulate.comparison"
COMPARISON_SCHEMA_VERSION = 2
CURVE_POINTS = 100
"""Points at which the seeds' learning curves are averaged."""


@dataclass(frozen=True, kw_only=True)
class Curve:
    """Success rate of training episodes at K points, averaged over the seeds of a run."""

    steps: Array
    """Control steps (K,)."""
    success: Array
    """Mean over seeds (K,), in [0, 1]."""
    low: Array
    """Worst seed (K,)."""
    high: Array
    """Best seed (K,)."""


@dataclass(frozen=True, kw_only=True)
class Row:
    """Row of the table: one run."""

    name: str
    asset: str
    task: str
    joint: str
    steps: int
    """Configured control steps of each seed."""
    unfinished: str
    """Seeds with incomplete training and their progress; empty if there are none."""
    seeds: int
    success: Share
    """Success rate of all episodes of all seeds, with Wilson's interval."""
    opened: Share
    worst_seed: float
    """Success rate of the worst seed."""
    nominal: float | None
    """Success rate without randomization; None if that was not evaluated."""
    reasons: Mapping[str, int]
    """Number of episodes by termination reason."""
    difference_to_first: Difference | None
    """Success rate minus that of the first run; None for the first."""
    curve: Curve | None


@dataclass(frozen=True, kw_only=True)
class Comparison:
    """Runs in the order of the command line."""

    rows: tuple[Row, ...]
    differing: Mapping[str, tuple[str, ...]]
    """Settings that differ between the runs, with the value of each run."""

    def content(self) -> dict[str, Any]:
        """Return the comparison as a JSON object."""
        plain = dataclasses.asdict(self, dict_factory=_plain)
        return {"schema": COMPARISON_SCHEMA, "schema_version": COMPARISON_SCHEMA_VERSION, **plain}

    def text(self) -> str:
        """Return the table for the terminal."""
        names = _names(self.rows)
        width = max(len(n) for n in names)
        lines = [
            f"{'':{width}}  success (95 %)          opened   worst seed  difference to the first"
        ]
        for name, row in zip(names, self.rows, strict=True):
            lines.append(
                f"{name:{width}}  {_interval(row.success):22s}  {percent(row.opened.value):>5}%   "
                f"{percent(row.worst_seed):>5}%      {_signed(row.difference_to_first)}".rstrip()
            )
        return "\n".join(lines)


def read_report(folder: Path) -> dict[str, Any]:
    """Read the ``report.json`` of a run.

    Raises:
        RunError: It is missing, damaged or of another schema.
    """
    path = folder / "report.json"
    try:
        content = load_json_object(path, error=RunError)
    except RunError as error:
        raise RunError(f"{error}; make it with evaluate {folder}") from None
    known = content.get("schema") == SCHEMA
    if not known or content.get("schema_version") != SCHEMA_VERSION:
        raise RunError(
            f"{path}: not a report of schema {SCHEMA} {SCHEMA_VERSION}; "
            f"make it again with evaluate {folder}"
        )
    try:
        comparison_page(compare([content]), "")
    except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as error:
        raise RunError(
            f"{path}: damaged ({shorten(error)}); make it again with evaluate {folder}"
        ) from None
    return content


def compare(reports: Sequence[Mapping[str, Any]]) -> Comparison:
    """Compare runs.

    Args:
        reports: Contents of at least one ``report.json``; differences are to the first.
    """
    first: Share | None = None
    rows = []
    for content in reports:
        row = _row(content, first)
        first = first or row.success
        rows.append(row)
    configs = [
        _flat(parse_yaml(content["info"]["config"], "report.json", error=RunError) or {})
        for content in reports
    ]
    return Comparison(rows=tuple(rows), differing=_differing(configs))


def _row(content: Mapping[str, Any], first: Share | None) -> Row:
    info = content["info"]
    seeds = content["seeds"]
    success = _pooled([s["success"] for s in seeds])
    return Row(
        name=info["name"],
        asset=info["asset"],
        task=info["task"],
        joint=info["joint"],
        steps=info["steps"],
        unfinished=info.get("unfinished", ""),
        seeds=len(seeds),
        success=success,
        opened=_pooled([s["opened"] for s in seeds]),
        worst_seed=content["worst_seed_success_rate"],
        nominal=content["nominal_success_rate"],
        reasons=dict(content["reasons"]),
        difference_to_first=difference(success, first) if first is not None else None,
        curve=_curve(content["curves"]),
    )


def _pooled(shares: Sequence[Mapping[str, Any]]) -> Share:
    """Pool the episodes of all seeds."""
    return wilson(sum(round(s["value"] * s["n"]) for s in shares), sum(s["n"] for s in shares))


def _curve(curves: Sequence[Mapping[str, Any]]) -> Curve | None:
    """Average the seeds' curves at common points; None without curves."""
    points = []
    for curve in curves:
        steps = np.array(curve["steps"], dtype=np.float64)
        success = np.array(curve["success"], dtype=np.float64)  # JSON's null becomes NaN
        there = np.isfinite(success)
        if there.any():
            points.append((steps[there], success[there]))
    if not points:
        return None
    begin = max(steps[0] for steps, _ in points)
    moments = np.linspace(begin, max(steps[-1] for steps, _ in points), CURVE_POINTS)
    each = np.stack([np.interp(moments, steps, success) for steps, success in points])
    return Curve(steps=moments, success=each.mean(0), low=each.min(0), high=each.max(0))


def _flat(value: Any, name: str = "") -> dict[str, str]:
    """Return settings by dotted key, e.g. ``reward.open``."""
    if isinstance(value, Mapping):
        out: dict[str, str] = {}
        for key, inner in value.items():
            out |= _flat(inner, f"{name}.{key}" if name else str(key))
        return out
    return {name: json.dumps(value, default=str)}


def _differing(configs: Sequence[Mapping[str, str]]) -> dict[str, tuple[str, ...]]:
    names = list(dict.fromkeys(name for config in configs for name in config))
    columns = {name: tuple(config.get(name, "–") for config in configs) for name in names}
    return {name: values for name, values in columns.items() if len(set(values)) > 1}


def write_comparison(comparison: Comparison, folder: Path, command: str) -> tuple[Path, Path]:
    """Write ``comparison.json`` and ``comparison.html`` and return their paths.

    Args:
        comparison: The comparison.
        folder: Folder to write to.
        command: Command that repeats it.
    """
    json_path, html_path = folder / "comparison.json", folder / "comparison.html"
    write_json(json_path, comparison.content())
    write_text(html_path, comparison_page(comparison, command))
    return json_path, html_path


def comparison_page(comparison: Comparison, command: str) -> str:
    """Render the page as HTML."""
    rows, names = comparison.rows, _names(comparison.rows)
    page = Page(f"Comparison of {len(rows)} runs", ", ".join(names))
    page.table(
        ["run", "success", "opened", "worst seed", "not randomized", "difference to the first"],
        [
            [
                name,
                _interval(row.success),
                _interval(row.opened),
                f"{percent(row.worst_seed)}%",
                "–" if row.nominal is None else f"{percent(row.nominal)}%",
                _signed(row.difference_to_first) or "–",
            ]
            for name, row in zip(names, rows, strict=True)
        ],
    )
    page.text(
        "Success rates of all episodes of a run have Wilson's 95 % intervals. Differences are in "
        "percentage points and have Newcombe's intervals, which cover other episodes of the same "
        "policies but not other seeds. An interval without 0 is more than chance."
    )
    page.charts(_success_chart(names, rows), *_curve_charts(names, rows))
    page.section("Failures")
    seen = [r for r in REASONS if any(r in row.reasons for row in rows)]
    page.table(
        ["ended by", *names],
        [[REASON_TEXT[r], *(row.reasons.get(r, 0) for row in rows)] for r in seen],
    )
    page.section("Differences")
    about: dict[str, list[str | int]] = {
        "object": [row.asset for row in rows],
        "task": [row.task for row in rows],
        "joint": [row.joint for row in rows],
        "steps per seed": [row.steps for row in rows],
        "seeds": [row.seeds for row in rows],
    }
    if any(row.unfinished for row in rows):
        about["training incomplete"] = [row.unfinished or "–" for row in rows]
    page.table(["", *names], [[key, *values] for key, values in about.items()])
    if comparison.differing:
        page.table(
            ["setting", *names], [[k, *values] for k, values in comparison.differing.items()]
        )
    else:
        page.text("The configurations are the same.")
    page.section("Reproduction")
    page.code(command)
    return page.html()


def _success_chart(names: Sequence[str], rows: Sequence[Row]) -> Chart:
    return Chart(
        title="Success",
        marks=Bars(
            labels=names,
            values=[round(100.0 * row.success.value, 1) for row in rows],
            low=[100.0 * row.success.low for row in rows],
            high=[100.0 * row.success.high for row in rows],
        ),
        x_label="% of episodes, with 95 % intervals",
        x_range=(0.0, 100.0),
    )


def _curve_charts(names: Sequence[str], rows: Sequence[Row]) -> list[Chart]:
    marks = [
        ChartLine(
            name=name,
            x=row.curve.steps,
            y=100.0 * row.curve.success,
            low=100.0 * row.curve.low,
            high=100.0 * row.curve.high,
        )
        for name, row in zip(names, rows, strict=True)
        if row.curve is not None
    ]
    if not marks:
        return []
    chart = Chart(
        title="Training",
        marks=marks,
        x_label="steps",
        y_label="success %",
        y_range=(0.0, 100.0),
        caption="Training episodes from home: mean over seeds, worst to best seed.",
    )
    return [chart]


def _names(rows: Sequence[Row]) -> list[str]:
    """Return the names of the runs, numbered where two are equal."""
    names = [row.name for row in rows]
    return [
        name if names.count(name) == 1 else f"{name} ({names[: i + 1].count(name)})"
        for i, name in enumerate(names)
    ]


def _interval(share: Share) -> str:
    return f"{percent(share.value)}% ({percent(share.low)}–{percent(share.high)})"


def _signed(gap: Difference | None) -> str:
    if gap is None:
        return ""
    value, low, high = (100.0 * x for x in (gap.value, gap.low, gap.high))
    return f"{value:+.1f} points ({low:+.1f} to {high:+.1f})"


def _plain(items: list[tuple[str, Any]]) -> dict[str, Any]:
    def plain(value: Any) -> Any:
        if isinstance(value, np.ndarray):
            return [float(f"{x:.6g}") if math.isfinite(x) else None for x in value]
        return value

    return {key: plain(value) for key, value in items}
