"""Report of a run as one HTML page."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from articulate.benchmark.protocols import ANGLE_RAD, LENGTH, PROTOCOLS
from articulate.benchmark.records import Record
from articulate.benchmark.summary import (
    MIN_MOTION_PX,
    VISIBLE_PX,
    WORST_AXIS_RAD,
    ScoredJoint,
    scored_joints,
)
from articulate.page import Bars, Chart, ChartLine, Page, Tile
from articulate.page.text import format_number

Cell = str | int | float | bool | None

PUBLISHED = {
    "Articulate-Anything (its paper)": (0.021, 0.141, 0.200),
    "URDF-Anything (its paper)": (0.008, 0.132, 0.164),
}
"""Published mean errors of type, axis [rad] and origin, for comparison."""
PUBLISHED_INVALID = "URDFormer 59.1 %, Real2Code 17.5 %"
MAX_FAILED = 500
"""Most failed joints that are listed."""
ROWS = {
    "visible": f"part moves by {MIN_MOTION_PX:g} px or more",
    "low_visibility": "part moves by less",
    "compound": "part slides and turns",
}
WORDS = {
    "paper": "paper",
    "released_code": "released code",
    "strict": "strict",
    "links": "placement",
    "joint_type": "type",
    "joint_axis": "axis",
    "joint_origin": "origin",
    "joint_limit": "limit",
}


def write_report(
    results: Record,
    records: Sequence[Record],
    path: Path,
    command: str,
    versions: Mapping[str, str],
    others: Mapping[str, Record] | None = None,
) -> Path:
    """Write the page and return its path.

    Args:
        results: The content of ``results.json``.
        records: Records of the objects.
        path: HTML file.
        command: Command that made the run.
        versions: Versions for the footer.
        others: Results of other runs by name, for comparison.
    """
    config = results["config"]
    page = Page(
        f"Benchmark: {config['actor']} on {results['dataset']}",
        f"{results['objects']} objects, {results['joints']} joints; modality {config['modality']}, "
        f"task {config['task']}, condition {config['condition']}, seed {config['seed']}.",
    )
    _tiles(page, results)
    _imported(page, results)
    _scores(page, results)
    _failures(page, results)
    _errors(page, results, scored_joints(records))
    _placement(page, results)
    _groups(page, results)
    _loop(page, results)
    _compared(page, results, others or {})
    _cost(page, results)
    _failed(page, records)
    page.footer(command, versions)
    return page.save(path)


def _tiles(page: Page, results: Record) -> None:
    tiles = [
        Tile(value=_percent(results["protocols"][p]["joint_success"]), label=f"success, {WORDS[p]}")
        for p in PROTOCOLS
    ]
    tiles.append(
        Tile(value=results["cost"]["seconds_per_case"]["median"], label="s per case, median")
    )
    crashed = len(results["crashed"])
    tiles.append(Tile(value=crashed, label="crashed objects", tone="bad" if crashed else "plain"))
    page.tiles(*tiles)


def _scores(page: Page, results: Record) -> None:
    page.section(
        "Success",
        "A joint is correct if type, axis, origin and limits are; a further column ignores the "
        "limits. Intervals are Wilson's at 95 %. `paper` uses the text and thresholds of the "
        "publication (0.25 rad, 0.05 units). `released_code` reproduces its code, with its errors "
        "and its selection of attempts by the truth. `strict` requires that the part moves as in "
        "truth. docs/results/benchmark.md describes the differences.",
    )
    rows: list[list[Cell]] = []
    for name, text in _rows(results).items():
        rows += [[text, *_score_cells(results["rows"][name], p)] for p in PROTOCOLS]
    page.table(
        ["joints", "protocol", "n", "success %", "95 %", "type, axis, origin %", "95 %"], rows
    )
    literal = results["protocols"]["paper_literal_origin"]["joint_success"]
    page.text(
        f"With the published origin error applied to slides as well, `paper` is "
        f"{_percent(literal)}. Joints predicted for fixed parts: {results['false_positives']}; "
        "each counts as a failure in `strict`."
    )


def _imported(page: Page, results: Record) -> None:
    """Add the validity of imported outputs."""
    found = results.get("predictions")
    if found is None:
        return
    n = found["files"]
    page.section(
        "Imported outputs",
        f"{n} files of {found['source']}; {found['without_object']} of them name no scored object, "
        f"and {found['objects_without_file']} objects have no file: their joints count as wrong. "
        f"Published shares of invalid outputs: {PUBLISHED_INVALID}.",
    )
    rows: list[list[Cell]] = [["valid", found["valid"], _hundred(found["valid"] / n)]]
    rows += [
        [name.replace("_", " "), count, _hundred(count / n)]
        for name, count in found["invalid"].items()
    ]
    page.table(["outputs", "files", "%"], rows)
    page.table(
        ["file", "scored", "invalid"],
        [[row["file"], row["scored"], row["invalid"] or "–"] for row in found["rows"][:MAX_FAILED]],
    )


def _rows(results: Record) -> dict[str, str]:
    """Return the rows of the table of success; visibility is known for videos only."""
    if results["config"]["modality"] == "video":
        return ROWS
    return {"visible": "part slides or turns", "compound": ROWS["compound"]}


def _score_cells(rows: Record, protocol: str) -> list[Cell]:
    row = rows[protocol]
    return [
        WORDS[protocol],
        row["n"],
        _hundred(row["joint_success"]),
        _interval(row["joint_success_interval"]),
        _hundred(row["type_axis_origin"]),
        _interval(row["type_axis_origin_interval"]),
    ]


def _failures(page: Page, results: Record) -> None:
    charts = []
    for protocol in PROTOCOLS:
        found = results["protocols"][protocol]["failures"]
        charts.append(
            Chart(
                title=f"First failures, {WORDS[protocol]}",
                marks=Bars(
                    labels=[WORDS[name] for name in found],
                    values=[float(v) for v in found.values()],
                ),
                x_label="joints",
            )
        )
    page.section("Failures", "The first failure of each joint, in the published order.")
    page.charts(*charts)


def _errors(page: Page, results: Record, items: Sequence[ScoredJoint]) -> None:
    means = results["errors"]
    page.section(
        "Errors",
        "Means with a bootstrap over objects. Missing joints count as the worst case: a wrong "
        "type, a right angle, a diagonal of the object.",
    )
    rows: list[list[Cell]] = [
        [
            name.replace("_", " "),
            m["n"],
            m["mean"],
            _interval([m["low"], m["high"]], 1.0),
            m["median"],
        ]
        for name, m in means.items()
    ]
    rows += [
        [f"E, {name}", m["n"], m["mean"], _interval([m["low"], m["high"]], 1.0), m["median"]]
        for name, m in results["endpoints"].items()
    ]
    page.table(["error", "n", "mean", "95 %", "median"], rows)
    ours: list[Cell] = [means[k]["mean"] for k in ("type", "axis_rad", "origin")]
    published: list[list[Cell]] = [[name, *values] for name, values in PUBLISHED.items()]
    page.table(
        ["means, all classes", "type", "axis rad", "origin"],
        [[f"this run ({results['dataset']})", *ours], *published],
    )
    page.charts(*_distributions([item for item in items if item.row == "visible"]))


def _distributions(items: Sequence[ScoredJoint]) -> list[Chart]:
    """Return charts of the cumulative distribution of each error by joint type."""
    kinds = ("prismatic", "revolute", "continuous")

    def line(kind: str, name: str, most: float) -> ChartLine:
        errors = [i.errors[name] for i in items if i.kind == kind and i.errors]
        x = np.sort([float(e) for e in errors if e is not None and np.isfinite(e)])
        share = np.arange(1, len(x) + 1) / max(len(x), 1)
        inside = x <= most
        return ChartLine(name=f"{kind} (n {len(x)})", x=x[inside], y=share[inside])

    return [
        Chart(
            title=title,
            marks=[line(kind, name, most) for kind in selected],
            x_label=x_label,
            y_label="share of predicted joints",
            x_range=(0.0, most),
            y_range=(0.0, 1.0),
            caption=f"threshold {goal:g}",
        )
        for title, name, selected, x_label, most, goal in (
            ("Axis error", "axis_rad", kinds, "rad", WORST_AXIS_RAD, ANGLE_RAD),
            ("Origin error near the part", "origin_foot", kinds[1:], "units", 0.5, LENGTH),
            ("Motion error over its threshold", "motion", kinds[:2], "ratio", 4.0, 1.0),
        )
    ]


def _placement(page: Page, results: Record) -> None:
    placement = results["placement"]
    if placement is None:
        return
    page.section(
        "Link placement",
        "Each part was given with the centre of its box at the origin. In `strict` a link is "
        "correct within 0.05 units and 0.25 rad, an object if all its links are.",
    )
    names = {
        "links_visible": f"links with {VISIBLE_PX:g} visible pixels or more, strict",
        "links_low_visibility": "links with fewer, strict",
        "links_all": "all links, strict",
    }
    rows: list[list[Cell]] = [
        [f"objects, {WORDS[p]}", *_share_cells(placement["objects"][p])] for p in PROTOCOLS
    ]
    rows += [[text, *_share_cells(placement[name])] for name, text in names.items()]
    page.table(["placement", "n", "correct %", "95 %"], rows)


def _share_cells(share: Record) -> list[Cell]:
    return [share["n"], _hundred(share["share"]), _interval([share["low"], share["high"]])]


def _groups(page: Page, results: Record) -> None:
    page.section(
        "Groups",
        "In distribution are the five categories in the training data of the publication's "
        "baselines: StorageFurniture, Laptop, Box, Table, Refrigerator.",
    )
    rows: list[list[Cell]] = []
    for name, found in [*results["groups"].items(), *results["categories"].items()]:
        row: list[Cell] = [name.replace("_", " "), found["paper"]["n"]]
        for protocol in PROTOCOLS:
            row += [
                _hundred(found[protocol]["joint_success"]),
                _interval(found[protocol]["joint_success_interval"]),
            ]
        rows.append([*row, _hundred(found["paper"]["type_axis_origin"])])
    header = ["group", "n"]
    for protocol in PROTOCOLS:
        header += [f"{WORDS[protocol]} %", "95 %"]
    page.table([*header, "paper, without limits %"], rows)


def _loop(page: Page, results: Record) -> None:
    steps = results["iterations"]
    if len(steps) > 1:
        page.section(
            "Iterations", "Success after each iteration; stopped objects keep their result."
        )
        x = [step["iteration"] for step in steps]
        page.charts(
            Chart(
                title="Success by iteration",
                marks=[
                    ChartLine(
                        name=WORDS[p],
                        x=x,
                        y=[step[p]["share"] for step in steps],
                        low=[step[p]["low"] for step in steps],
                        high=[step[p]["high"] for step in steps],
                    )
                    for p in ("paper", "strict")
                ],
                x_label="iteration",
                y_label="share",
                y_range=(0.0, 1.0),
            )
        )
    for protocol, found in results["critic"].items():
        if not found["n"]:
            continue
        order = [WORDS.get(name, name) for name in found["order"]]
        matrix = found["truth_by_critic"]
        page.section(f"Critic against truth, {WORDS[protocol]}")
        page.table(
            ["truth \\ critic", *order],
            [[name, *row] for name, row in zip(order, matrix, strict=True)],
            caption="Number of joints. In the column success only the first row is correct.",
        )


def _compared(page: Page, results: Record, others: Mapping[str, Record]) -> None:
    """Add a table of this run, other runs and first attempts."""
    rows = [_run_row(name, run) for name, run in {"this run": results, **others}.items()]
    for name, run in {"this run": results, **others}.items():
        if len(run["iterations"]) > 1:
            first = run["iterations"][0]
            row = _run_row(f"{name}, first attempts", run)
            shares = [_hundred(first["paper"]["share"]), _hundred(first["strict"]["share"])]
            rows.append([*row[:4], first["paper"]["n"], *shares, *([None] * 5)])
    if len(rows) == 1:
        return
    page.section("Comparison of runs", "Success at first attempts is that without a critic.")
    header = ["run", "actor", "modality", "condition", "n", "paper %", "strict %"]
    header += ["paper, without limits %", "type", "axis rad", "origin", "s per case"]
    page.table(header, rows)


def _run_row(name: str, run: Record) -> list[Cell]:
    config, means, found = run["config"], run["errors"], run["protocols"]
    return [
        name,
        config["actor"],
        config["modality"] if config["task"] == "joints" else f"{config['modality']}, placement",
        config["condition"],
        found["paper"]["n"],
        _hundred(found["paper"]["joint_success"]),
        _hundred(found["strict"]["joint_success"]),
        _hundred(found["paper"]["type_axis_origin"]),
        *(means[kind]["mean"] for kind in ("type", "axis_rad", "origin")),
        run["cost"]["seconds_per_case"]["median"],
    ]


def _cost(page: Page, results: Record) -> None:
    page.section("Cost")
    rows: list[list[Cell]] = [
        [name.replace("_", " "), spread["median"], spread["p90"], spread["max"]]
        for name, spread in results["cost"].items()
        if isinstance(spread, dict)
    ]
    page.table(["", "median", "90 %", "largest"], rows)
    if results["crashed"]:
        page.section("Crashed objects", "Their process failed; all their joints count as failed.")
        page.table(
            ["object", "category", "reason"],
            [[row["object"], row["category"], row["reason"]] for row in results["crashed"]],
        )


def _failed(page: Page, records: Sequence[Record]) -> None:
    rows: list[list[Cell]] = []
    for record in sorted(records, key=lambda r: str(r["object"])):
        for case in record["cases"]:
            for joint in case["joints"]:
                if joint["failures"]["strict"] == joint["failures"]["paper"] == "success":
                    continue
                rows.append(
                    [
                        f"{record['object']} {joint['joint']}",
                        record["category"],
                        joint["kind"],
                        *(WORDS.get(joint["failures"][p], "correct") for p in ("paper", "strict")),
                        format_number(case["moved_px"]),
                        case["rejection"][:120],
                    ]
                )
    if rows:
        page.section(
            "Failed joints",
            f"The first {min(MAX_FAILED, len(rows))} of {len(rows)}; all are in the folder "
            "`objects` beside this page.",
        )
        page.table(
            ["joint", "category", "kind", "paper", "strict", "moved px", "rejection"],
            rows[:MAX_FAILED],
        )


def _percent(share: float | None) -> str:
    return "–" if share is None else f"{100.0 * share:.1f} %"


def _hundred(share: float | None) -> float | None:
    return None if share is None else round(100.0 * share, 1)


def _interval(ends: Sequence[float | None], factor: float = 100.0) -> str:
    low, high = ends
    if low is None or high is None:
        return "–"
    digits = 1 if factor > 1.0 else 3
    return " to ".join(format_number(round(factor * end, digits)) for end in (low, high))
