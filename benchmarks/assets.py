"""Check many objects, and compare the time of their physics with that of plain boxes.

python benchmarks/assets.py --data data --out checked --jobs 2 --json

The data folder contains ``assets.json`` with ``id``, ``path``, ``category`` and ``source`` of each
object, and the objects as files or in ``assets.tar.xz``. Verdicts, reasons and times are printed.
"""

from __future__ import annotations

import argparse
import json
import math
import statistics
import sys
import tarfile
import time
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from articulate.assets.asset import load_asset
from articulate.checks.descriptions import CHECKS
from articulate.checks.model import load_model
from articulate.checks.triangles import triangles_of
from articulate.preparation.batch import Batch, Checked, Item
from articulate.simulator import mujoco

STEPS = 2000
"""Physics steps timed together, in processor time."""
ROUNDS = 7
"""Repetitions, alternating; the median counts."""
FIRST = 10
"""Number of objects of the category that are timed, by id."""
CATEGORY = "StorageFurniture"


def items_of(data: Path, wanted: Sequence[str]) -> list[tuple[Item, dict[str, Any]]]:
    """Return the objects of ``assets.json`` with their files, unpacked if necessary.

    Args:
        data: Folder with ``assets.json``.
        wanted: These ids only, in this order; all if empty.
    """
    archive = data / "assets.tar.xz"
    entries = json.loads((data / "assets.json").read_text(encoding="utf-8"))["assets"]
    base = data
    if not (data / entries[0]["path"]).is_file() and archive.is_file():
        base = Path.home() / ".cache" / "articulate" / "data"
        if not (base / entries[0]["path"]).is_file():
            with tarfile.open(archive) as packed:
                packed.extractall(base, filter="data")
    by_id = {e["id"]: e for e in entries}
    return [(Item(name=i, file=base / by_id[i]["path"]), by_id[i]) for i in wanted or by_id]


def row_of(checked: Checked, entry: dict[str, Any]) -> dict[str, Any]:
    """Return the recorded values of one object."""
    check_report = checked.check_report
    return {
        "id": checked.item.name,
        "source": entry["source"],
        "category": entry["category"],
        "verdict": check_report.verdict,
        "seconds": round(check_report.seconds, 2),
        "joints": len(check_report.joints),
        "opened": sum((j.opened or 0.0) >= 0.9 for j in check_report.joints),
        "colliders": check_report.colliders,
        "reasons": list(check_report.reasons),
    }


def boxes_only(folder: Path) -> Any:
    """Compile the object with one oriented box for each connected visual component."""
    import trimesh

    asset = load_asset(folder)
    model = load_model(asset)
    spec = mujoco.MjSpec.from_file(str(folder / "object.xml"))
    for body in spec.bodies:
        for geom in list(body.geoms):
            if geom.contype or geom.conaffinity:
                spec.delete(geom)
    for link in asset.links:
        body = spec.body(link.name)
        for geom in model.visual_geoms(link.name).tolist():
            found = triangles_of(model.model, geom, "visual")
            if found is None:
                continue
            pos, quat = model.model.geom_pos[geom], model.model.geom_quat[geom]
            turn = np.zeros(9)
            mujoco.mju_quat2Mat(turn, quat)
            corners = found[0] @ turn.reshape(3, 3).T + pos
            mesh = trimesh.Trimesh(corners, found[1])
            for part in mesh.split(only_watertight=False):
                T_bp, extents = trimesh.bounds.oriented_bounds(part)
                T_pb = np.linalg.inv(T_bp)
                box_quat = np.zeros(4)
                mujoco.mju_mat2Quat(box_quat, T_pb[:3, :3].ravel())
                body.add_geom(
                    type=mujoco.mjtGeom.mjGEOM_BOX,
                    size=np.maximum(np.asarray(extents) / 2.0, 0.001),
                    pos=T_pb[:3, 3],
                    quat=box_quat,
                    condim=4,
                )
    return spec.compile()


def step_ratio(folder: Path) -> float:
    """Return the ratio of step times of an object and of the same with plain boxes."""
    models = (load_model(load_asset(folder)).model, boxes_only(folder))
    states = [mujoco.MjData(m) for m in models]
    times: tuple[list[float], list[float]] = ([], [])
    for _ in range(ROUNDS):
        for k, model in enumerate(models):
            start = time.thread_time()
            mujoco.mj_step(model, states[k], STEPS)
            times[k].append(time.thread_time() - start)
    return statistics.median(times[0]) / statistics.median(times[1])


def physics_cost(out: Path, rows: Sequence[dict[str, Any]]) -> dict[str, float]:
    """Return :func:`step_ratio` of the first objects of the category, by id."""
    own = [r for r in rows if r["category"] == CATEGORY and r["source"] == "partnet"]
    own.sort(key=lambda r: int(str(r["id"]).rsplit("_", 1)[1]))
    first = [r for r in own if r["verdict"] in ("passed", "repaired")][:FIRST]
    return {r["id"]: round(step_ratio(out / r["id"]), 3) for r in first}


def cached_seconds(done: Batch, items: Sequence[Item]) -> float:
    """Return the median time of a second check of the same objects [s]."""
    batch = Batch(out=done.out, cache=done.cache, options={}, limit_s=done.limit_s, single=False)
    times = []
    for item in items:
        start = time.perf_counter()
        batch.one(item)
        times.append(time.perf_counter() - start)
    return statistics.median(times)


def check_of(reason: str) -> str:
    """Return the check that ``reason`` begins with; ``unreadable`` if none ran."""
    first = reason.split(" ")[0].split(":")[0]
    return first if first in CHECKS else "unreadable"


def summarize(rows: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Count verdicts, failed checks and times."""
    verdicts = Counter(r["verdict"] for r in rows)
    checks = Counter(check for r in rows for check in {check_of(reason) for reason in r["reasons"]})
    seconds = sorted(r["seconds"] for r in rows)
    good = verdicts["passed"] + verdicts["repaired"]
    return {
        "objects": len(rows),
        "verdicts": dict(verdicts),
        "good_share": round(good / max(len(rows), 1), 4),
        "rejected_by": dict(checks.most_common(20)),
        "seconds_median": statistics.median(seconds) if seconds else None,
        "seconds_p95": seconds[int(0.95 * (len(seconds) - 1))] if seconds else None,
        "joints": sum(r["joints"] for r in rows),
        "joints_opened": sum(r["opened"] for r in rows),
    }


def main() -> int:
    """Check the objects; print a line for each and a summary."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--data", type=Path, required=True, help="folder that contains assets.json")
    parser.add_argument(
        "--out", type=Path, required=True, help="folder of the asset folders and of the result"
    )
    parser.add_argument("--cache", type=Path, help="cache folder")
    parser.add_argument("--jobs", type=int, default=2, help="objects checked at the same time")
    parser.add_argument("--limit", type=float, default=600.0, help="seconds for one object")
    parser.add_argument("--ids", nargs="*", default=(), help="these objects only, in this order")
    parser.add_argument("--minutes", type=float, help="stop then, and report what is done")
    parser.add_argument("--json", action="store_true", help="print only the result, as JSON")
    flags = parser.parse_args()
    found = items_of(flags.data, flags.ids)
    cache = flags.cache or flags.out / ".cache"
    batch = Batch(out=flags.out, cache=cache, options={}, limit_s=flags.limit, single=False)
    entries = {item.name: entry for item, entry in found}
    rows = []
    end = time.monotonic() + 60.0 * (flags.minutes or math.inf)
    for checked in batch.run([item for item, _ in found], flags.jobs):
        rows.append(row_of(checked, entries[checked.item.name]))
        first = f": {rows[-1]['reasons'][0][:160]}" if rows[-1]["reasons"] else ""
        text = f"{len(rows):4d} of {len(found)} {rows[-1]['id']} {rows[-1]['verdict']}{first}"
        print(text, file=sys.stderr, flush=True)
        if time.monotonic() > end:
            break
    done = {r["id"] for r in rows}
    rows.sort(key=lambda r: str(r["id"]))
    result = {
        "objects_requested": len(found),
        **summarize(rows),
        "cached_seconds_median": round(
            cached_seconds(batch, [item for item, _ in found if item.name in done]), 3
        ),
        "step_ratios": physics_cost(flags.out, rows),
        "rejected": [r for r in rows if r["verdict"] in ("rejected", "undecided")],
    }
    ratios = list(result["step_ratios"].values())
    result["step_ratio_median"] = statistics.median(ratios) if ratios else None
    print(json.dumps(result, indent=1 if flags.json else None))
    return 0


if __name__ == "__main__":
    sys.exit(main())
