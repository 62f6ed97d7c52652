"""Joints from clips: a random sample of joints, one clip each, scored by all protocols.

    python benchmarks/video_joints.py --index assets.json --data DIR --count 25 --seed 1 --json

A quick look between full runs of `articulate benchmark`: it draws joints, not objects, and leaves
out joints whose part moves by less than 5 px in the picture. Every figure is of the joints drawn.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from articulate.benchmark.config import BenchmarkConfig
from articulate.benchmark.dataset import open_dataset
from articulate.benchmark.evidence import cases_of
from articulate.benchmark.run import run_case
from articulate.errors import UsageError
from articulate.reconstruct.actors.registry import make_actor

Record = dict[str, Any]
LEAST_PX = 5.0


def records(args: argparse.Namespace) -> Iterator[Record]:
    """One record for each joint drawn."""
    dataset = open_dataset(str(args.index), args.data)
    config = BenchmarkConfig(
        actor=args.actor,
        condition=args.condition,
        seed=args.seed,
        width_px=args.width,
        height_px=args.width * 3 // 4,
    )
    drawn = [(i, k) for i in dataset.ids() for k in range(len(dataset.known(i)))]
    np.random.default_rng(args.seed).shuffle(drawn)
    actor, found = make_actor(args.actor), 0
    for object_id, k in drawn:
        if found == args.count:
            return
        try:
            subject = dataset.load(object_id)
        except UsageError as error:
            print(f"{object_id}: {error}", file=sys.stderr)
            continue
        if int(k) >= len(subject.joints):
            continue
        joint = subject.joints[int(k)]
        if joint.status == "compound":
            continue
        one = dataclasses.replace(subject, joints=(joint,))
        case = next(iter(cases_of(one, config)))
        if (case.moved_px or 0.0) < LEAST_PX:
            continue
        found += 1
        start = time.process_time()
        record = run_case(one, case, actor)
        record |= {
            "object": object_id,
            "category": subject.category,
            "cpu_seconds": time.process_time() - start,
        }
        _say(found, record)
        yield record


def _say(n: int, record: Record) -> None:
    joint = record["joints"][0]
    said = joint["predicted"] or {}
    said = {key: said.get(key) for key in ("kind", "axis_o", "pivot_o", "lower", "upper")}
    print(
        f"{n} {record['object']} {record['category']} {joint['joint']} {joint['kind']}: "
        f"paper {joint['failures']['paper']}, strict {joint['failures']['strict']}; "
        f"moved {record['moved_px']:.0f} px, rated {record['rating']}, {record['critic']}, "
        f"{record['cpu_seconds']:.1f} s of CPU; {record['refusal']}",
        file=sys.stderr,
        flush=True,
    )
    if joint["failures"]["strict"] != "success":
        truth = {k: joint["truth"][k] for k in ("kind", "axis_o", "pivot_o", "lower", "upper")}
        print(f"    truth {truth}\n    said  {said}", file=sys.stderr, flush=True)


def summary(found: list[Record]) -> Record:
    """Shares and medians over the records."""
    joints = [record["joints"][0] for record in found]
    errors = [joint["errors"] for joint in joints if joint["errors"] is not None]
    axis = [e["axis_rad"] for e in errors if e["axis_rad"] is not None]
    origin = [e["origin_foot"] for e in errors if e.get("origin_foot") is not None]
    good = [joint["failures"]["paper"] == "success" for joint in joints]
    rated = [(record["rating"] or 0.0) > 5.0 for record in found]
    return {
        "n": len(joints),
        "share_right": {
            name: float(np.mean([joint["failures"][name] == "success" for joint in joints]))
            for name in ("paper", "strict", "released_code")
        },
        "failures_paper": _counts(joints, "paper"),
        "failures_strict": _counts(joints, "strict"),
        "type_error": float(np.mean([j["failures"]["paper"] == "joint_type" for j in joints])),
        "mean_axis_error_rad": float(np.mean(axis)) if axis else None,
        "mean_origin_error": float(np.mean(origin)) if origin else None,
        "critic_content_and_right": sum(a and b for a, b in zip(rated, good, strict=True)),
        "critic_content_and_wrong": sum(a and not b for a, b in zip(rated, good, strict=True)),
        "critic_discontent_and_right": sum(not a and b for a, b in zip(rated, good, strict=True)),
        "critic_discontent_and_wrong": sum(
            not a and not b for a, b in zip(rated, good, strict=True)
        ),
        "median_cpu_seconds": float(np.median([record["cpu_seconds"] for record in found])),
        "most_cpu_seconds": float(np.max([record["cpu_seconds"] for record in found])),
    }


def _counts(joints: list[Record], protocol: str) -> dict[str, int]:
    names = [joint["failures"][protocol] for joint in joints]
    return {name: names.count(name) for name in sorted(set(names))}


def main() -> None:
    """Print the summary; with --json the records too."""
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    parser.add_argument("--index", type=Path, required=True, help="assets.json")
    parser.add_argument("--data", type=Path, required=True, help="folder that its paths start from")
    parser.add_argument("--count", type=int, default=25)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--width", type=int, default=640, help="width of the pictures [px]")
    parser.add_argument("--condition", choices=["plain", "camera_off", "noisy"], default="plain")
    parser.add_argument("--actor", default="geometric-video")
    parser.add_argument("--json", action="store_true")
    args = parser.parse_args()
    found = list(records(args))
    result = summary(found)
    if args.json:
        result["records"] = found
    print(json.dumps(result, indent=1))


if __name__ == "__main__":
    main()
