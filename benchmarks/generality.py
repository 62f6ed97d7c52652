"""Success of the generalist policy on many objects without training on them.

    python benchmarks/generality.py --procedural 1000 1003 --out generality
    python benchmarks/generality.py --data /data/assets.json --half published --out generality

Objects are placed as by ``train`` and evaluated with its randomization and limits. The table is
resumable: what ``scenes.jsonl`` and ``results.jsonl`` of ``--out`` hold is not repeated, and
``summary.json`` has the means by split and task, and the rank correlation of the success of the
scripted expert with that of the policy. ``--runs`` adds the correlation with the success of trained
runs that have a report. The split is ``validation`` for procedural seeds
from 1000 to 1999, ``test`` from 2000 on (below 1000: ``training``); other objects belong to the
half of :func:`articulate.benchmark.split.half`. ``--limit`` chooses a sample by the hash of the id.
"""

# ruff: noqa: E402 - the environment comes before numpy
from __future__ import annotations

import os

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ[_name] = "1"

import argparse
import hashlib
import json
import re
import sys
from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from scipy.stats import spearmanr

from articulate.benchmark.split import half
from articulate.files import write_json
from articulate.task.episode_monitor import REASONS
from articulate.task.randomization_config import RandomizationConfig
from articulate_train.config import TrainConfig
from articulate_train.evaluate import run_episodes
from articulate_train.feasibility_check import feasibility_of
from articulate_train.generalist import generalist_metadata, generalist_state
from articulate_train.policy import policy_of
from articulate_train.run import open_run
from generalist_scenes import (
    CATEGORIES,
    CLOSING_TASKS,
    TASKS,
    SceneRecord,
    prepare,
    procedural_ids,
    read_records,
    scene_of,
    write_procedural,
)

GOOD = 0.8
"""Success rate from which on an object counts as solved."""
SEED = 1_000_003
"""Seed of the episodes."""


def split_of(object_id: str) -> str:
    """Return the name of the split of an object."""
    found = re.fullmatch(rf"({'|'.join(CATEGORIES)})-(\d+)", object_id)
    if found is None:
        return half(object_id)
    seed = int(found[2])
    return "training" if seed < 1000 else "validation" if seed < 2000 else "test"


def policy_id(task: str) -> str:
    """Return the beginning of the hash of the weights for ``task``."""
    return str(generalist_metadata(task)["sha256"][:12])


def evaluate(record: SceneRecord, episodes: int) -> dict[str, Any]:
    """Return the row of one joint: success of the policy over ``episodes`` episodes."""
    randomization = RandomizationConfig()
    scene = scene_of(record, randomization.scale_values)
    config = TrainConfig(asset=record.source, task=record.task, joint=record.joint)
    policy = policy_of(generalist_state(config, scene))
    ended, _ = run_episodes(
        scene,
        policy,
        randomization,
        np.random.SeedSequence([SEED]),
        episodes=episodes,
        threads=1,
    )
    codes = ended.code
    failures = codes[codes != 0]
    return {
        "object": record.object,
        "split": split_of(record.object),
        "category": record.category,
        "task": record.task,
        "joint": record.joint,
        "expert": record.expert,
        "episodes": episodes,
        "success": float(np.mean(codes == 0)),
        "opened": float(np.mean(ended.opened)),
        "failure": REASONS[int(np.bincount(failures).argmax())] if len(failures) else "",
        "policy": policy_id(record.task),
    }


def trained_row(folder: Path) -> dict[str, Any]:
    """Return success of the expert and of the policies of the evaluated run in ``folder``."""
    run = open_run(folder)
    report = json.loads((folder / "report.json").read_text(encoding="utf-8"))
    expert = feasibility_of(run.scene(), run.config).success
    return {"run": folder.name, "expert": expert, "success": report["success_rate"]}


def rank_correlation(rows: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Return Spearman's correlation of the success of expert and policy over ``rows``.

    It is None for fewer than three rows, and where all have the same success.
    """
    both = [[row[name] for row in rows] for name in ("expert", "success")]
    out: dict[str, Any] = {"spearman": None, "n": len(rows)}
    if len(rows) >= 3 and all(len(set(values)) > 1 for values in both):
        out["spearman"] = round(float(spearmanr(*both).statistic), 3)
    return out


def summary(
    rows: Sequence[dict[str, Any]],
    records: Sequence[SceneRecord],
    trained: Sequence[dict[str, Any]] = (),
) -> dict[str, Any]:
    """Return means by split and task, rank correlations and the share of accepted joints."""
    groups: dict[str, list[float]] = defaultdict(list)
    for row in rows:
        groups[f"{row['split']} {row['task']}"].append(row["success"])
    tried = [record for record in records if record.task]
    return {
        "accepted": f"{sum(r.placement is not None for r in tried)} of {len(tried)} joints",
        "groups": {
            name: {
                "joints": len(values),
                "success": round(float(np.mean(values)), 3),
                "share_from_80_percent": round(float(np.mean(np.array(values) >= GOOD)), 3),
            }
            for name, values in sorted(groups.items())
        },
        "expert_and_generalist": rank_correlation(rows),
        "expert_and_training": {**rank_correlation(trained), "runs": list(trained)},
        "policies": {task: policy_id(task) for task in sorted({row["task"] for row in rows})},
    }


def items_of(args: argparse.Namespace) -> list[tuple[str, Path, str]]:
    """Return the objects: id, file and category."""
    if args.procedural is not None:
        ids = procedural_ids(range(*args.procedural))
        folder = args.out / "objects"
        return [(i, write_procedural(i, folder), i.rpartition("-")[0]) for i in ids]
    assets = json.loads(args.data.read_text(encoding="utf-8"))["assets"]
    kept = [a for a in assets if half(a["id"]) == args.half]
    kept.sort(key=lambda a: hashlib.sha256(a["id"].encode()).hexdigest())  # --limit: a sample
    return [(a["id"], args.data.parent / a["path"], a["category"]) for a in kept][: args.limit]


def main(argv: Sequence[str]) -> int:
    """Prepare the objects, evaluate the policy on each joint and write the summary."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--procedural", type=int, nargs=2, help="first seed, and end")
    parser.add_argument("--data", type=Path, help="index of other objects, assets.json")
    parser.add_argument(
        "--half", choices=("development", "published"), default="development", help="half of --data"
    )
    parser.add_argument("--limit", type=int, help="most objects of --data")
    parser.add_argument("--closing", action="store_true", help="tasks that close instead of open")
    parser.add_argument("--episodes", type=int, default=200, help="episodes of each joint")
    parser.add_argument("--runs", type=Path, nargs="+", default=(), help="evaluated run folders")
    parser.add_argument("--out", type=Path, required=True, help="folder of the results")
    args = parser.parse_args(argv)
    if (args.procedural is None) == (args.data is None):
        parser.error("give --procedural or --data")
    torch.set_num_threads(1)
    args.out.mkdir(parents=True, exist_ok=True)
    scenes, results = args.out / "scenes.jsonl", args.out / "results.jsonl"
    prepare(items_of(args), scenes, CLOSING_TASKS if args.closing else TASKS)
    lines = results.read_text(encoding="utf-8").splitlines() if results.exists() else []
    rows = [json.loads(line) for line in lines]
    rows = [row for row in rows if row["policy"] == policy_id(row["task"])]
    done = {(row["object"], row["task"], row["joint"]) for row in rows}
    for record in read_records(scenes):
        if record.placement is None or (record.object, record.task, record.joint) in done:
            continue
        row = evaluate(record, args.episodes)
        rows.append(row)
        with results.open("a", encoding="utf-8") as stream:
            stream.write(json.dumps(row) + "\n")
        print(f"{row['split']} {row['object']} {row['task']} {row['success']:.0%}", flush=True)
    trained = [trained_row(folder) for folder in args.runs]
    write_json(args.out / "summary.json", summary(rows, read_records(scenes), trained))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
