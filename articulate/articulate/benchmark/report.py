"""The report of a run: one page that opens anywhere."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from articulate.benchmark.protocols import ANGLE_RAD, LENGTH, PROTOCOLS
from articulate.benchmark.records import Record
from articulate.benchmark.summary import SEEN_PX, VISIBLE_PX, Item, items_of
from articulate.page import Bars, Chart, Line, Page, Tile, Violins
from articulate.page.numbers import shown

Cell = str | int | float | bool | None

PUBLISHED = {
    "Articulate-Anything (its paper)": (0.021, 0.141, 0.200),
    "URDF-Anything (its paper)": (0.008, 0.132, 0.164),
}
"""Mean errors of type, axis [rad] and origin as published, for the row beside ours."""
MOST_FAILED = 60
"""Failed joints that are listed one by one."""
ROWS = {
    "seen": f"part moves by {SEEN_PX:g} px or more",
    "hardly_seen": "part moves by less",
    "compound": "slides and turns at once",
}
WORDS = {
    "paper": "paper",
    "released_code": "released code",
    "strict": "strict",
    "links": "links not in place",
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
) -> Path:
    """Write the page and return its path.

    Args:
        results: The content of ``results.json``.
        records: Records of the objects.
        path: HTML file.
        command: Command that made the run.
        versions: Versions for the foot.
    """
    config = results["config"]
    page = Page(
        f"Benchmark: {config['actor']} on {results['dataset']}",
        f"{results['objects']} objects, {results['joints']} joints; modality {config['modality']}, "
        f"task {config['task']}, condition {config['condition']}, seed {config['seed']}.",
    )
    _tiles(page, results)
    _scores(page, results)
    _failures(page, results)
    _errors(page, results, items_of(records))
    _placement(page, results)
    _groups(page, results)
    _loop(page, results)
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
        Tile(
            value=results["cost"]["seconds_per_question"]["median"], label="s per question, median"
        )
    )
    lost = len(results["lost"])
    tiles.append(Tile(value=lost, label="objects lost", tone="bad" if lost else "plain"))
    page.tiles(*tiles)


def _scores(page: Page, results: Record) -> None:
    page.section(
        "Success",
        "A joint is right where type, axis, origin and limits are; the share where type, axis and "
        "origin are right stands beside it. Intervals are Wilson's at 95 %. `paper` takes the "
        "publication's words and thresholds (0.25 rad, 0.05 units), `released_code` does what its "
        "code does, flaws and choice of attempt by the truth included, `strict` asks that the part "
        "moves as it does in truth. docs/benchmark.md says where they differ.",
    )
    rows: list[list[Cell]] = []
    for name, text in _rows(results).items():
        rows += [[text, *_score_cells(results["rows"][name], p)] for p in PROTOCOLS]
    page.table(
        ["joints", "protocol", "n", "success %", "95 %", "type, axis, origin %", "95 %"], rows
    )
    literal = results["protocols"]["paper_literal_origin"]["joint_success"]
    page.text(
        f"With the published origin error read literally for slides too, `paper` is "
        f"{_percent(literal)}. Joints invented on fixed parts: {results['spurious']}; each counts "
        "as a failure in `strict`."
    )


def _rows(results: Record) -> dict[str, str]:
    """Rows of the table of success; without clips nothing moves in a picture."""
    if results["config"]["modality"] == "video":
        return ROWS
    return {"seen": "all that only slide or turn", "compound": ROWS["compound"]}


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
                title=f"What failed first, {WORDS[protocol]}",
                marks=Bars(
                    labels=[WORDS[name] for name in found],
                    values=[float(v) for v in found.values()],
                ),
                x_label="joints",
            )
        )
    page.section("Failures", "In the published order: the first thing that is wrong counts.")
    page.charts(*charts)


def _errors(page: Page, results: Record, items: Sequence[Item]) -> None:
    means = results["errors"]
    page.section(
        "Errors",
        "Means with a bootstrap over objects. What was not said counts as the worst case: a wrong "
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
    page.charts(*_violins([item for item in items if item.row == "seen"]))


def _violins(items: Sequence[Item]) -> list[Violins]:
    kinds = ("prismatic", "revolute", "continuous")

    def of(kind: str, name: str) -> list[float]:
        said = [i.errors[name] for i in items if i.kind == kind and i.errors]
        return [float(value) for value in said if value is not None]

    return [
        Violins(
            title="Axis error",
            groups=[(kind, of(kind, "axis_rad")) for kind in kinds],
            y_label="rad",
            goal=ANGLE_RAD,
            caption="of the joints that were said; dashed: the threshold",
        ),
        Violins(
            title="Origin error near the part",
            groups=[(kind, of(kind, "origin_foot")) for kind in kinds[1:]],
            y_label="units",
            y_range=(0.0, 0.5),
            goal=LENGTH,
            caption="values above 0.5 are drawn there",
        ),
        Violins(
            title="Motion error over what is allowed",
            groups=[(kind, of(kind, "motion")) for kind in kinds[:2]],
            y_label="1 = the limit of strict",
            y_range=(0.0, 4.0),
            goal=1.0,
            caption="values above 4 are drawn there",
        ),
    ]


def _placement(page: Page, results: Record) -> None:
    placement = results["placement"]
    if placement is None:
        return
    page.section(
        "Link placement",
        "Each part was handed over with the middle of its box at the origin. In `strict` a link is "
        "right within 0.05 units and 0.25 rad, an object if all its links are.",
    )
    names = {
        "links_visible": f"links with {VISIBLE_PX:g} visible pixels or more, strict",
        "links_hardly_visible": "links with fewer, strict",
        "links_all": "all links, strict",
    }
    rows: list[list[Cell]] = [
        [f"objects, {WORDS[p]}", *_share_cells(placement["objects"][p])] for p in PROTOCOLS
    ]
    rows += [[text, *_share_cells(placement[name])] for name, text in names.items()]
    page.table(["what", "n", "right %", "95 %"], rows)


def _share_cells(share: Record) -> list[Cell]:
    return [share["n"], _hundred(share["share"]), _interval([share["low"], share["high"]])]


def _groups(page: Page, results: Record) -> None:
    page.section(
        "Groups",
        "In distribution are the five categories on which the publication's rivals were trained: "
        "StorageFurniture, Laptop, Box, Table, Refrigerator.",
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
    page.table([*header, "paper, limits apart %"], rows)


def _loop(page: Page, results: Record) -> None:
    turns = results["iterations"]
    if len(turns) > 1:
        page.section("The loop", "Success after each turn; who had stopped keeps what it had.")
        x = [turn["iteration"] for turn in turns]
        page.charts(
            Chart(
                title="Success by iteration",
                marks=[
                    Line(
                        name=WORDS[p],
                        x=x,
                        y=[turn[p]["share"] for turn in turns],
                        low=[turn[p]["low"] for turn in turns],
                        high=[turn[p]["high"] for turn in turns],
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
            caption="Number of joints. The column success below its first row was praised wrongly.",
        )


def _cost(page: Page, results: Record) -> None:
    page.section("Cost")
    rows: list[list[Cell]] = [
        [name.replace("_", " "), spread["median"], spread["p90"], spread["max"]]
        for name, spread in results["cost"].items()
        if isinstance(spread, dict)
    ]
    page.table(["", "median", "90 %", "largest"], rows)
    if results["lost"]:
        page.section("Objects lost", "Their process failed; all their joints count as wrong.")
        page.table(
            ["object", "category", "why"],
            [[row["object"], row["category"], row["why"]] for row in results["lost"]],
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
                        *(WORDS.get(joint["failures"][p], "right") for p in ("paper", "strict")),
                        shown(case["moved_px"]),
                        case["refusal"][:120],
                    ]
                )
    if rows:
        page.section(
            "What failed, one by one",
            f"The first {min(MOST_FAILED, len(rows))} of {len(rows)}; all are in the folder "
            "`objects` beside this page.",
        )
        page.table(
            ["joint", "category", "kind", "paper", "strict", "moved px", "refusal"],
            rows[:MOST_FAILED],
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
    return f"{shown(round(factor * low, digits))} to {shown(round(factor * high, digits))}"
