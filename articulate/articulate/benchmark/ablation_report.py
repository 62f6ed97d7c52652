"""Tables and charts of ablations, in the form of the publication's figures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from articulate.benchmark.protocols import ANGLE_RAD, LENGTH
from articulate.benchmark.records import Record
from articulate.benchmark.report import PUBLISHED, WORDS
from articulate.page import Bars, Chart, ChartLine, Page

Cell = str | int | float | bool | None
TITLES = {
    "modality": "Success by modality",
    "examples": "Success by number of in-context examples",
    "iterations": "Success by iteration",
    "base_model": "Success by base model",
    "critic": "Critic against truth",
}
PUBLISHED_SUCCESS = {
    "Articulate-Anything (its paper, video)": "75",
    "URDFormer, Real2Code (the same paper, comparable input: one image)": "8.7 to 12.2",
}
"""Published joint success in percent; the bars of the publication's figures have no numbers."""
PUBLISHED_GAIN = "The publication reports +5.8 % for placement and +2.4 % for joints by iterating."
ERRORS = {
    "axis_rad": ("Axis error", "rad", 1.6, ANGLE_RAD),
    "origin_foot": ("Origin error near the part", "units", 0.5, LENGTH),
    "motion": ("Motion error over its threshold", "ratio", 4.0, 1.0),
}
"""Title, unit, largest value and threshold of each distribution."""


def write_ablation_report(
    results: Record, path: Path, command: str, versions: Mapping[str, str]
) -> Path:
    """Write the page of one or several ablations and return its path."""
    page = Page(
        f"Ablations on {results['dataset']}",
        f"{results['objects']} objects; condition {results['config']['condition']}, seed "
        f"{results['config']['seed']}. Rows with a model use recorded answers.",
    )
    for table in results["ablations"]:
        add_ablation(page, table)
    page.footer(command, versions)
    return page.save(path)


def add_ablation(page: Page, table: Record) -> None:
    """Add the section of one ablation."""
    name, rows = table["ablation"], table["rows"]
    page.section(TITLES[name])
    _success(page, rows)
    measured = [row for row in rows if row["results"] is not None]
    if name == "modality":
        _published(page, measured)
        _categories(page, measured)
    if name in {"iterations", "critic"}:
        _iterations(page, measured)
        _confusion(page, measured)
    _failures(page, measured)
    page.charts(*(_distribution(measured, error) for error in ERRORS))


def _success(page: Page, rows: Sequence[Record]) -> None:
    header = ["row", "actor", "model", "n", "paper %", "95 %", "strict %"]
    header += ["type, axis, origin %", "objects placed, strict %", "s per case"]
    page.table([*header, "status"], [_success_row(row) for row in rows])
    plotted = [row for row in rows if row["results"] and row["results"]["protocols"]["paper"]["n"]]
    if not plotted:
        return
    found = [row["results"]["protocols"]["paper"] for row in plotted]
    page.charts(
        Chart(
            title="Joint success, paper",
            marks=Bars(
                labels=[row["label"] for row in plotted],
                values=[100.0 * f["joint_success"] for f in found],
                low=[100.0 * f["joint_success_interval"][0] for f in found],
                high=[100.0 * f["joint_success_interval"][1] for f in found],
            ),
            x_label="%",
        )
    )


def _success_row(row: Record) -> list[Cell]:
    head: list[Cell] = [row["label"], row["actor"], row["model"] or "–"]
    results = row["results"]
    if results is None:
        return [*head, *([None] * 7), row["status"]]
    paper, strict = results["protocols"]["paper"], results["protocols"]["strict"]
    placed = results["placement"]
    return [
        *head,
        paper["n"],
        _hundred(paper["joint_success"]),
        _interval(paper["joint_success_interval"]),
        _hundred(strict["joint_success"]),
        _hundred(paper["type_axis_origin"]),
        None if placed is None else _hundred(placed["objects"]["strict"]["share"]),
        results["cost"]["seconds_per_case"]["median"],
        row["status"],
    ]


def _published(page: Page, rows: Sequence[Record]) -> None:
    """Add published figures beside those of comparable input."""
    lines: list[list[Cell]] = [
        [row["label"], str(_hundred(row["results"]["protocols"]["paper"]["joint_success"]))]
        for row in rows
    ]
    lines += [[name, value] for name, value in PUBLISHED_SUCCESS.items()]
    page.table(["input", "joint success, paper %"], lines, "Comparable input")
    means: list[list[Cell]] = [
        [
            row["label"],
            *(row["results"]["errors"][k]["mean"] for k in ("type", "axis_rad", "origin")),
        ]
        for row in rows
    ]
    means += [[name, *values] for name, values in PUBLISHED.items()]
    page.table(["mean errors", "type", "axis rad", "origin"], means)


def _categories(page: Page, rows: Sequence[Record]) -> None:
    names = sorted({name for row in rows for name in row["results"]["categories"]})
    lines: list[list[Cell]] = []
    for name in names:
        found = [row["results"]["categories"].get(name) for row in rows]
        n = next(f["paper"]["n"] for f in found if f)
        shares = [None if f is None else _hundred(f["paper"]["type_axis_origin"]) for f in found]
        lines.append([name, n, *shares])
    header = ["category", "n", *(row["label"] for row in rows)]
    page.table(header, lines, "Type, axis and origin right, %, by category")


def _failures(page: Page, rows: Sequence[Record]) -> None:
    names = ("links", "joint_type", "joint_axis", "joint_origin", "joint_limit")
    lines: list[list[Cell]] = []
    for row in rows:
        for protocol in ("paper", "strict"):
            found = row["results"]["protocols"][protocol]
            counts = [found["failures"].get(name, 0) for name in names]
            lines.append([row["label"], WORDS[protocol], found["n"], *counts])
    header = ["row", "protocol", "n", *(WORDS[name] for name in names)]
    page.table(header, lines, "First failures, number of joints")


def _iterations(page: Page, rows: Sequence[Record]) -> None:
    lines: list[list[Cell]] = []
    charts = []
    for row in rows:
        steps = row["results"]["iterations"]
        for step in steps:
            shares = [step[key] for key in ("critic", "paper", "strict")]
            lines.append(
                [
                    row["label"],
                    step["iteration"],
                    step["paper"]["n"],
                    step["still_running"],
                    *(_hundred(share["share"]) for share in shares),
                ]
            )
        marks = [
            ChartLine(
                name=text,
                x=[step["iteration"] for step in steps],
                y=[100.0 * (step[key]["share"] or 0.0) for step in steps],
            )
            for key, text in (("critic", "critic"), ("paper", "truth, paper"))
        ]
        if len(steps) > 1:
            charts.append(
                Chart(title=row["label"], marks=marks, x_label="iteration", y_label="success %")
            )
    header = ["row", "iteration", "joints", "still running", "critic: success %"]
    page.text(f"Objects that have stopped keep their result. {PUBLISHED_GAIN}")
    page.table([*header, "truth: paper %", "truth: strict %"], lines)
    page.charts(*charts)


def _confusion(page: Page, rows: Sequence[Record]) -> None:
    for row in rows:
        found = row["results"]["critic"]["paper"]
        if not found["n"]:
            continue
        order = [WORDS.get(word, word) for word in found["order"]]
        matrix = np.array(found["truth_by_critic"])
        accepted, right = int(matrix[:, 0].sum()), int(matrix[0].sum())
        agreed = int(matrix[0, 0] + matrix[1:, 1:].sum())
        page.table(
            ["truth \\ critic", *order],
            [[name, *map(int, line)] for name, line in zip(order, matrix, strict=True)],
            f"{row['label']}: critic against truth in `paper`; success agrees in {agreed} of "
            f"{found['n']}; {accepted - int(matrix[0, 0])} of {found['n'] - right} failures are "
            "accepted",
        )


def _distribution(rows: Sequence[Record], error: str) -> Chart:
    title, unit, most, goal = ERRORS[error]
    lines = []
    for row in rows:
        found = row["results"]["distributions"][error]
        x = np.array(found["quantiles"])
        y = np.linspace(0.0, 1.0, len(x))
        lines.append(
            ChartLine(name=f"{row['label']} (n {found['n']})", x=x[x <= most], y=y[x <= most])
        )
    return Chart(
        title=title,
        marks=lines,
        x_label=unit,
        y_label="share of predicted joints",
        x_range=(0.0, most),
        y_range=(0.0, 1.0),
        caption=f"threshold {goal:g}",
    )


def _hundred(share: float | None) -> float | None:
    return None if share is None else round(100.0 * share, 1)


def _interval(ends: Sequence[float | None]) -> str:
    low, high = ends
    return "–" if low is None or high is None else f"{100.0 * low:.1f} to {100.0 * high:.1f}"
