r"""From a clip to an opened drawer: policies learnt on what was made of it, judged on the truth.

    python benchmarks/whole_way.py --data data --out whole_way \
        --objects open_drawer=partnet_20411 open_door=partnet_7119 --json

For each object a clip of the joint that ``train`` would take is rendered, ``articulate make`` finds
the joint in it from the parts alone, and ``train`` learns twice: on what was made, and on the true
object. ``evaluate --asset`` judges both in the scene of the true object. A step whose result lies
below ``--out`` is not done again, so that the command goes on where it was stopped; ``--truth``
takes a run on the true object that is there already, or what ``benchmarks/collect.py`` wrote of
one, whose evaluation then stands for the truth.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import subprocess
import sys
from pathlib import Path
from typing import Any

from articulate.benchmark.config import BenchmarkConfig
from articulate.benchmark.dataset import open_dataset
from articulate.benchmark.evidence import cases_of
from articulate.benchmark.export import write_evidence
from articulate.cache import cache_folder
from articulate.errors import UsageError
from articulate.reconstruct.result import URDF_FILE
from articulate_envs.joint_selection import choose_joint
from articulate_train.config import TrainConfig
from articulate_train.run import open_run, prepare_asset

ACTOR = "geometric-video"
MADE_EXITS = (0, 3)
"""Exits of ``make`` and ``evaluate`` with which there is a result."""


def articulate(*words: object) -> str:
    """Run a command of ours and return what it prints; what it says besides goes on to stderr."""
    arguments = [str(word) for word in words]
    sys.stderr.write(f"articulate {' '.join(arguments)}\n")
    done = subprocess.run(
        [sys.executable, "-m", "articulate", *arguments],
        stdout=subprocess.PIPE,
        text=True,
        check=False,
    )
    if done.returncode not in MADE_EXITS:
        raise UsageError(f"articulate {' '.join(arguments)}: exit {done.returncode}")
    return done.stdout


def write_video(index: Path, data: Path, object_id: str, link: str, folder: Path) -> None:
    """Render the clip of the joint that moves ``link``, and write what ``make`` needs."""
    subject = open_dataset(str(index), data).load(object_id)
    joint = next((j for j in subject.joints if link in j.rigid), None)
    if joint is None:
        raise UsageError(f"{object_id}: its truth has no joint of {link}")
    one = dataclasses.replace(subject, joints=(joint,))
    write_evidence(next(iter(cases_of(one, BenchmarkConfig(actor=ACTOR)))).evidence, folder)


def trained(asset: Path, folder: Path, flags: argparse.Namespace, *more: object) -> None:
    """Train on ``asset`` in ``folder``, or go on there."""
    if (folder / "summary.json").exists():
        return
    if folder.exists():
        articulate("train", "--resume", "--out", folder, "--no-evaluate")
        return
    steps = ("--steps", flags.steps, "--seeds", *flags.seeds)
    articulate("train", "--asset", asset, "--out", folder, "--no-evaluate", *steps, *more)


def judged(run: Path, asset: Path, joint: str, flags: argparse.Namespace) -> dict[str, Any]:
    """Return the report of ``run`` on the joint of the true object."""
    words = ("--asset", asset, "--joint", joint, "--episodes", flags.episodes)
    report: dict[str, Any] = json.loads(articulate("evaluate", run, *words, "--json"))
    return report


def kept_report(
    summary: Path, object_id: str, task: str, joint: str, flags: argparse.Namespace
) -> dict[str, Any]:
    """Return the evaluation of a run on the true object, as ``summary`` keeps it.

    Raises:
        UsageError: It is of something else, or of other draws.
    """
    report: dict[str, Any] = json.loads(summary.read_text(encoding="utf-8"))
    seeds = {seed["seed"]: seed["success"]["episodes"] for seed in report["seeds"]}
    kept = {name: report[name] for name in ("asset", "task", "joint", "steps")} | {"seeds": seeds}
    asked = {
        "asset": object_id,
        "task": task,
        "joint": joint,
        "steps": flags.steps,
        "seeds": dict.fromkeys(flags.seeds, flags.episodes),
    }
    if kept != asked:
        raise UsageError(f"{summary}: is of {kept}, asked is {asked} (seeds with their episodes)")
    return report


def way(task: str, object_id: str, flags: argparse.Namespace) -> dict[str, Any]:
    """One object, from its clip to the two rates."""
    index = json.loads(flags.index.read_text(encoding="utf-8"))["assets"]
    item = next((item for item in index if item["id"] == object_id), None)
    if item is None:
        raise UsageError(f"{object_id}: not in {flags.index}")
    asset, folder = flags.data / item["path"], flags.out / f"{object_id}-{task}"
    config = TrainConfig(asset=str(asset), task=task)
    true = prepare_asset(config, cache_folder())
    joint = choose_joint(config, true)[0].joint
    link = next(j.link for j in true.joints if j.name == joint)
    clip, result = folder / "clip", folder / "made"
    if not (clip / "camera.json").exists():
        write_video(flags.index, flags.data, object_id, link, clip)
    if not (result / "made.json").exists():
        seen = ("--video", clip / "clip.mp4", "--camera-file", clip / "camera.json")
        who = ("--actor", ACTOR, "--library", asset.parent)
        articulate("make", *seen, *who, "--out", result)
    content = json.loads((result / "made.json").read_text(encoding="utf-8"))
    if content["urdf"] is None:
        return {"object": object_id, "task": task, "joint": joint, "made": content, "ratio": 0.0}
    trained(result / URDF_FILE, folder / "run_made", flags, "--task", task)
    truth = flags.truth.get(object_id, folder / "run_true")
    if truth.suffix == ".json":
        on_true = kept_report(truth, object_id, task, joint, flags)
    else:
        trained(asset, truth, flags, "--task", task, "--joint", joint)
        on_true = judged(truth, asset, joint, flags)
    on_made = judged(folder / "run_made", asset, joint, flags)
    return {
        "object": object_id,
        "task": task,
        "joint": joint,
        "made": {k: content[k] for k in ("verdict", "reasons", "rating", "joints", "seconds")},
        "joint_trained_on": open_run(folder / "run_made").task.joint,
        "success_of_made": on_made["success_rate"],
        "success_of_truth": on_true["success_rate"],
        "seeds_of_made": [seed["success"]["value"] for seed in on_made["seeds"]],
        "seeds_of_truth": [seed["success"]["value"] for seed in on_true["seeds"]],
        "ratio": on_made["success_rate"] / max(on_true["success_rate"], 1e-9),
    }


def _pair(text: str) -> tuple[str, str]:
    left, equals, right = text.partition("=")
    if not (left and equals and right):
        raise argparse.ArgumentTypeError(f"{text!r}: give NAME=VALUE")
    return left, right


def main() -> int:
    """Print the rates of each object; 2 where something is wrong with what was given."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data", type=Path, required=True, help="folder that paths start from")
    parser.add_argument("--index", type=Path, default=None, help="by default DATA/assets.json")
    parser.add_argument("--out", type=Path, required=True, help="gone on with if there")
    parser.add_argument("--objects", type=_pair, nargs="+", required=True, metavar="TASK=ID")
    parser.add_argument("--truth", type=_pair, nargs="*", default=[], metavar="ID=RUN_OR_JSON")
    parser.add_argument("--seeds", type=int, nargs="+", default=[0, 1, 2])
    parser.add_argument("--steps", type=int, default=2_000_000)
    parser.add_argument("--episodes", type=int, default=200)
    parser.add_argument("--json", action="store_true", help="print the result as JSON alone")
    flags = parser.parse_args()
    flags.index = flags.index or flags.data / "assets.json"
    flags.truth = {name: Path(run) for name, run in flags.truth}
    try:
        found = [way(task, object_id, flags) for task, object_id in flags.objects]
    except UsageError as error:
        sys.stderr.write(f"{error}\n")
        return 2
    if flags.json:
        sys.stdout.write(json.dumps(found, indent=1) + "\n")
        return 0
    for row in found:
        result, true = row.get("success_of_made", 0.0), row.get("success_of_truth", 0.0)
        sys.stdout.write(
            f"{row['task']} {row['object']} {row['joint']}: {result:.1%} learnt on what was made, "
            f"{true:.1%} on the truth: {row['ratio']:.2f} ({row['result']['verdict']})\n"
        )
    return 0


if __name__ == "__main__":
    sys.exit(main())
