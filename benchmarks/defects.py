"""Insert defects into checked assets and measure how many the checks find and name.

python benchmarks/defects.py --checked checked --data data --out damaged --count 30 --json

Each kind of ``benchmarks/planted.py`` is planted in a copy of the asset's folder, which is then
checked against the original input like ``check-asset DAMAGED --against INPUT``, without earlier
results or a fresh conversion. The input is read once for all damaged copies of an asset. Results
are appended below ``--out`` as they come, and a second run continues from there: give another
``--out`` after a change of the code.

Found means that a check fails. Named means that a check which the table of kinds lists fails and
names a link or joint of the defect.
"""

from __future__ import annotations

import argparse
import json
import math
import re
import shutil
import sys
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
from lxml import etree

from articulate.assets.asset import load_asset
from articulate.assets.check_report import CheckReport
from articulate.checks.run_checks import run_checks
from articulate.checks.source import Origin, origin_of_reading
from articulate.conversion.convert import read_input
from articulate.formats.config import ConvertConfig
from articulate.preparation.batch import Item
from assets import items_of
from planted import KINDS, Damaged, Names

UNTOUCHED = "untouched"
"""Kind without a defect; a failure is a false alarm."""
BY_INPUT = {"input_kinematics", "visual_fidelity"}
"""Checks that compare with the input."""

Row = dict[str, Any]


def check_copy(
    folder: Path, kind: str, out: Path, origin: Origin
) -> tuple[Names, CheckReport | None]:
    """Return the names of a defect and the report of the copy; None if the kind does not apply."""
    name = re.sub(r"\W+", "_", f"{folder.name}-{kind}")[:120]
    copy = out / name
    shutil.rmtree(copy, ignore_errors=True)
    shutil.copytree(folder, copy, ignore=shutil.ignore_patterns("check_report.*"))
    try:
        asset = load_asset(copy)
        names: Names = ()
        if kind != UNTOUCHED:
            parser = etree.XMLParser(resolve_entities=False, no_network=True)
            tree = etree.parse(str(copy / "object.xml"), parser)
            names = KINDS[kind].apply(Damaged(copy, asset, tree))
            if not names:
                return (), None
            tree.write(str(copy / "object.xml"))
        return names, run_checks(asset, origin)
    finally:
        shutil.rmtree(copy)


def row_of(kind: str, names: Names, check_report: CheckReport | None, seconds: float) -> Row:
    """Return the recorded values of one damaged copy."""
    failed = [c for c in check_report.checks if c.outcome == "failed"] if check_report else []
    by = KINDS[kind].named_by if kind in KINDS else ()
    return {
        "kind": kind,
        "planted": check_report is not None,
        "found": bool(failed),
        "named": any(
            c.name in by and any(contains_word(f"{c.subject} {c.message}", n) for n in names)
            for c in failed
        ),
        "checks": sorted({c.name for c in failed}),
        "reasons": list(check_report.reasons)[:6] if check_report else [],
        "seconds": round(seconds, 2),
    }


def contains_word(text: str, name: str) -> bool:
    """Return whether ``text`` contains the word ``name``."""
    return re.search(rf"(?<!\w){re.escape(name)}(?!\w)", text) is not None


def read_results(path: Path) -> list[Row]:
    """Read the results in a file; an incomplete last line is removed."""
    if not path.is_file():
        return []
    text = path.read_text(encoding="utf-8")
    complete = text[: text.rfind("\n") + 1]
    if complete != text:
        path.write_text(complete, encoding="utf-8")
    return [json.loads(line) for line in complete.splitlines()]


def run_asset(job: tuple[str, str, str, float]) -> None:
    """Run the remaining kinds on one asset, until ``time.time()`` reaches the last number."""
    folder, source, out = (Path(p) for p in job[:3])
    path = results_of(out, folder.name)
    done = {row["kind"] for row in read_results(path)}
    left = [kind for kind in (UNTOUCHED, *KINDS) if kind not in done]
    if not left or time.time() > job[3]:
        return
    config = ConvertConfig()
    origin = origin_of_reading(read_input(source, config), config)
    for kind in left:
        if time.time() > job[3]:
            return
        start = time.perf_counter()
        names, check_report = check_copy(folder, kind, out, origin)
        row = row_of(kind, names, check_report, time.perf_counter() - start)
        with path.open("a", encoding="utf-8") as file:
            file.write(json.dumps(row) + "\n")
        if row["planted"] and row["found"] == (kind == UNTOUCHED):
            text = "false alarm" if kind == UNTOUCHED else f"missed: {kind}"
            print(f"{folder.name}: {text}", file=sys.stderr, flush=True)


def results_of(out: Path, name: str) -> Path:
    """Return the file with the results of one asset."""
    return out / f"{name}.jsonl"


def select_assets(checked: Path, data: Path, count: int) -> list[Item]:
    """Return usable assets with joints, spread evenly over the index."""
    good = []
    for item, _ in items_of(data, ()):
        path = checked / item.name / "check_report.json"
        if path.is_file():
            check_report = json.loads(path.read_text(encoding="utf-8"))
            if check_report["verdict"] in ("passed", "repaired") and check_report["joints"]:
                good.append(item)
    return [good[i] for i in np.linspace(0, len(good) - 1, min(count, len(good))).astype(int)]


def summarize(rows: Mapping[str, Sequence[Row]]) -> dict[str, Any]:
    """Count the results over all assets."""
    kinds = {}
    for kind in KINDS:
        own = [(i, r) for i, of in rows.items() for r in of if r["kind"] == kind and r["planted"]]
        found = [r for _, r in own if r["found"]]
        kinds[kind] = {
            "planted": len(own),
            "found": len(found),
            "named": sum(r["named"] for r in found),
            "by_input_only": sum(set(r["checks"]) <= BY_INPUT for r in found),
            "checks": dict(Counter(c for r in found for c in r["checks"]).most_common()),
            "missed": [i for i, r in own if not r["found"]],
            "not_named": [i for i, r in own if r["found"] and not r["named"]],
        }
    planted, found, named = (
        sum(k[w] for k in kinds.values()) for w in ("planted", "found", "named")
    )
    untouched = {i: r for i, of in rows.items() for r in of if r["kind"] == UNTOUCHED}
    seconds = [r["seconds"] for of in rows.values() for r in of if r["planted"]]
    return {
        "assets": len(untouched),
        "complete": sum(len(of) == len(KINDS) + 1 for of in rows.values()),
        "planted": planted,
        "found": found,
        "found_share": round(found / max(planted, 1), 4),
        "named": named,
        "named_share": round(named / max(planted, 1), 4),
        "false_alarms": {i: r["reasons"] for i, r in untouched.items() if r["found"]},
        "seconds_median": round(float(np.median(seconds)), 2) if seconds else None,
        "kinds": kinds,
    }


def main() -> int:
    """Print how many of each kind were found, and by which checks."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--checked", type=Path, required=True, help="folders of benchmarks/assets.py"
    )
    parser.add_argument("--data", type=Path, required=True, help="folder that contains assets.json")
    parser.add_argument(
        "--out", type=Path, required=True, help="results; existing ones are continued"
    )
    parser.add_argument("--count", type=int, default=30, help="number of assets")
    parser.add_argument("--jobs", type=int, default=2, help="assets at the same time")
    parser.add_argument("--minutes", type=float, help="stop then, and report what is done")
    parser.add_argument("--json", action="store_true", help="print only the result, as JSON")
    flags = parser.parse_args()
    flags.out.mkdir(parents=True, exist_ok=True)
    items = select_assets(flags.checked, flags.data, flags.count)
    end = time.time() + 60.0 * (math.inf if flags.minutes is None else flags.minutes)
    work = [(str(flags.checked / i.name), str(i.file), str(flags.out), end) for i in items]
    with ProcessPoolExecutor(flags.jobs) as pool:
        list(pool.map(run_asset, work))
    result = summarize({i.name: read_results(results_of(flags.out, i.name)) for i in items})
    print(json.dumps(result, indent=1 if flags.json else None))
    return 0


if __name__ == "__main__":
    sys.exit(main())
