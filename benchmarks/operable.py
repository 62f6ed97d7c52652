"""Compare the objects that `train` accepts with those that a person considers operable.

    python benchmarks/operable.py --data data --out runs/operable.jsonl --json

``benchmarks/data/operable.json`` lists objects and tasks. A person classified each pair from
images: operable with a Panda gripper or not. ``train`` accepts a pair if a placement is found and
the scripted expert succeeds often enough. Results are appended to ``--out``, so the command can be
stopped and repeated.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from pathlib import Path
from typing import Any

from articulate.cache import cache_folder, cache_in_use
from articulate.conversion import ConvertConfig
from articulate.errors import ArticulateError
from articulate.preparation.prepare import load_checked_asset
from articulate_train.config import TrainConfig
from articulate_train.feasibility_check import STOP_BELOW, best_scene, feasibility_of

LIST = Path(__file__).parent / "data" / "operable.json"


def attempt(file: Path, task: str) -> dict[str, Any]:
    """Return the decision of ``train`` on one task of the object ``file``, with its reasons."""
    config = TrainConfig(asset=str(file), task=task)
    cache = cache_folder()
    start = time.process_time()
    try:
        with cache_in_use(cache):
            asset = load_checked_asset(file, cache, ConvertConfig())
            scene = best_scene(config, asset)
            found = feasibility_of(scene, config)
    except ArticulateError as error:
        return {"accepted": False, "reason": str(error), "seconds": time.process_time() - start}
    handle = scene.asset.handle_of(scene.task.joint)
    return {
        "accepted": found.success >= STOP_BELOW,
        "success": found.success,
        "failure": found.dominant_failure,
        "joint": scene.task.joint,
        "handle": None if handle is None else handle.kind,
        "own_handle": scene.placement.handle is None,
        "target": scene.task.target,
        "seconds": time.process_time() - start,
    }


def agreement(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Return the accepted share of operable pairs and the rejected share of the others."""
    out: dict[str, Any] = {"pairs": len(rows)}
    for operable, name in ((True, "accepted_of_operable"), (False, "rejected_of_others")):
        own = [row["accepted"] == operable for row in rows if row["operable"] == operable]
        out[name] = round(sum(own) / len(own), 3) if own else None
    return out


def main() -> None:
    """Evaluate the missing pairs and print the agreement."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--data", type=Path, required=True, help="folder that contains assets.json")
    parser.add_argument("--out", type=Path, required=True, help="file of the results (JSON lines)")
    parser.add_argument("--json", action="store_true", help="print the result as JSON only")
    flags = parser.parse_args()
    entries = json.loads((flags.data / "assets.json").read_text(encoding="utf-8"))["assets"]
    paths = {entry["id"]: flags.data / entry["path"] for entry in entries}
    rows = []
    if flags.out.is_file():
        rows = [json.loads(line) for line in flags.out.read_text(encoding="utf-8").splitlines()]
    done = {(row["id"], row["task"]) for row in rows}
    for pair in json.loads(LIST.read_text(encoding="utf-8"))["rows"]:
        if (pair["id"], pair["task"]) in done:
            continue
        rows.append({**pair, **attempt(paths[pair["id"]], pair["task"])})
        with flags.out.open("a", encoding="utf-8") as file:
            file.write(json.dumps(rows[-1]) + "\n")
        if not flags.json:
            sys.stderr.write(f"{pair['id']} {pair['task']}: {rows[-1]}\n")
    print(json.dumps({**agreement(rows), "rows": rows} if flags.json else agreement(rows)))


if __name__ == "__main__":
    main()
