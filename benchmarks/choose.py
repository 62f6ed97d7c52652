"""Which objects the table of policies is trained on, and why others are not.

For each task the PartNet-Mobility objects of its categories are taken in the order of their
numbers, and those of other sources in the order of their names, until enough of each are proven
and can be reached over the run's randomisation. Nothing is trained here: the list is fixed before
anything is, with every object that was skipped and the reason.

    ARTICULATE_DATA=data python benchmarks/choose.py --out docs/results/data/assets_policies.json

The list is written after each object, and what it says of objects already is kept: the command goes
on where it was stopped, by ``--minutes`` or by hand. A row is ``complete`` once it has all that it
wants or every object was tried; ``code`` names the converter and the proof that said so.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from articulate.cache import cache_folder, using
from articulate.errors import UsageError
from articulate.files import write_json
from articulate.preparation.store import code_id
from articulate_envs.joint_selection import choose_joint
from articulate_train.config import TrainConfig
from articulate_train.run import prepare_asset

PARTNET = "partnet"


@dataclass(frozen=True, kw_only=True)
class Row:
    """A task, and of what it is asked."""

    task: str
    categories: tuple[str, ...]
    """PartNet-Mobility's names."""
    partnet: int = 1
    """How many of PartNet-Mobility."""
    others: int = 1
    """How many of all other sources together, where there are any."""
    first: tuple[str, ...] = ()
    """Ids of other sources that come before all others."""

    @property
    def name(self) -> str:
        """Short name of the row."""
        return f"{self.task} {'/'.join(self.categories)}"


Attempt = Callable[[Row, dict[str, Any]], dict[str, Any]]
"""What is said of an object that is tried for a row."""
ROWS = (
    Row(task="close_lid", categories=("Toilet",)),
    Row(task="close_lid", categories=("Laptop",)),
    Row(task="close_door", categories=("Microwave",)),
    Row(task="close_drawer", categories=("StorageFurniture",)),
    Row(
        task="open_drawer",
        categories=("StorageFurniture", "Table"),
        partnet=2,
        first=("sektion_cabinet",),
    ),
    Row(task="open_door", categories=("Microwave",)),
    Row(task="open_door", categories=("StorageFurniture",)),
    Row(task="open_door", categories=("Refrigerator",)),
    Row(task="open_lid", categories=("Box",)),
    Row(task="open_lid", categories=("Laptop",)),
)


def candidates(row: Row, index: list[dict[str, Any]]) -> tuple[list[Any], list[Any]]:
    """Objects of PartNet-Mobility and of other sources, in the order in which they are tried."""
    mine = [item for item in index if item["category"] in row.categories]
    own = [item for item in mine if item["source"] == PARTNET]
    others = [item for item in mine if item["source"] != PARTNET]

    def place(item: dict[str, Any]) -> tuple[bool, str]:
        return item["id"] not in row.first, item["id"]

    return sorted(own, key=lambda item: int(item["partnet_id"])), sorted(others, key=place)


def tried(row: Row, item: dict[str, Any], data: Path, cache: Path) -> dict[str, Any]:
    """What proof and reach say of one object."""
    begun = time.perf_counter()
    config = TrainConfig(asset=str(data / item["path"]), task=row.task)
    out: dict[str, Any] = {"id": item["id"], "source": item["source"], "path": item["path"]}
    try:
        asset = prepare_asset(config, cache)
        task, place = choose_joint(config, asset)
    except UsageError as error:
        out["reason"] = str(error).replace(f"{data}/", "")
        return out
    return out | {
        "category": asset.category,
        "licence": asset.licence,
        "joint": task.joint,
        "kind": task.kind,
        "travel": round(abs(task.span), 4),
        "target_fraction": round(task.target, 4),
        "size_m": [round(b - a, 3) for a, b in zip(*asset.bounds_o, strict=True)],
        "joint_margin_rad": round(place.joint_margin_rad, 3),
        "drawn_share": place.drawn_share,
        "seconds": round(time.perf_counter() - begun, 1),
    }


def progress(
    row: Row, index: list[dict[str, Any]], known: dict[str, dict[str, Any]], attempt: Attempt
) -> Iterator[dict[str, Any]]:
    """The row after each object that was tried anew, and once more when it is complete.

    Args:
        row: What is asked.
        index: All objects.
        known: What is known of objects by their id.
        attempt: Tries an object.
    """
    results: list[dict[str, Any]] = []
    for items, wanted in zip(candidates(row, index), (row.partnet, row.others), strict=True):
        found = 0
        for item in items:
            if found == wanted:
                break
            new = item["id"] not in known
            results.append(attempt(row, item) if new else known[item["id"]])
            found += "reason" not in results[-1]
            if new:
                yield content(row, results, complete=False)
    yield content(row, results, complete=True)


def content(row: Row, results: list[dict[str, Any]], *, complete: bool) -> dict[str, Any]:
    """A row as it is written."""
    return {
        "task": row.task,
        "categories": list(row.categories),
        "wanted": {"partnet": row.partnet, "others": row.others},
        "complete": complete,
        "taken": [r for r in results if "reason" not in r],
        "skipped": [r for r in results if "reason" in r],
    }


def read(path: Path) -> dict[str, dict[str, Any]]:
    """Rows that are in the file at ``path`` already, by name."""
    if not path.exists():
        return {}
    rows = json.loads(path.read_text(encoding="utf-8"))["rows"]
    return {f"{row['task']} {'/'.join(row['categories'])}": row for row in rows}


def main() -> int:
    """Choose for each row and write the list; 1 if the time was over before."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("docs/results/data/assets_policies.json"))
    parser.add_argument("--only", nargs="*", default=None, help="tasks to choose for")
    parser.add_argument("--minutes", type=float, default=math.inf, help="stop after so many")
    flags = parser.parse_args()
    data = Path(os.environ.get("ARTICULATE_DATA", "data"))
    index = json.loads((data / "assets.json").read_text(encoding="utf-8"))["assets"]
    cache, end = cache_folder(), time.monotonic() + 60.0 * flags.minutes

    def attempt(row: Row, item: dict[str, Any]) -> dict[str, Any]:
        result = tried(row, item, data, cache) | {"code": code_id()[:12]}
        sys.stderr.write(f"{row.name}: {item['id']}: {result.get('reason', 'taken')}\n")
        return result

    rows = read(flags.out)
    for row in ROWS:
        before = rows.get(row.name, {})
        if before.get("complete") or (flags.only is not None and row.task not in flags.only):
            continue
        known = {r["id"]: r for r in [*before.get("taken", ()), *before.get("skipped", ())]}
        with using(cache):
            for state in progress(row, index, known, attempt):
                rows[row.name] = state
                ordered = [rows[r.name] for r in ROWS if r.name in rows]
                write_json(flags.out, {"command": "python benchmarks/choose.py", "rows": ordered})
                if time.monotonic() > end and not state["complete"]:
                    return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
