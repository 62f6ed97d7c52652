r"""Run the full pipeline from a video to a policy, and evaluate the policy on the true object.

    python benchmarks/full_pipeline.py --data data --out full_pipeline \
        --objects open_drawer=partnet_20411 open_door=partnet_7119 --json

For each object, a video of the joint that ``train`` would choose is rendered. ``articulate make``
reconstructs the joint from the video and the parts. ``train`` runs twice: on the reconstruction and
on the true object. ``evaluate --asset`` evaluates both policies in the scene of the true object.
Steps whose results exist below ``--out`` are skipped, so the command can be stopped and repeated.
``--truth`` replaces the training on the true object by a finished run, or by the summary of one
from ``benchmarks/collect.py``, whose evaluation is used.
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
from articulate.reconstruct.result import MADE_FILE, URDF_FILE
from articulate_envs.joint_selection import choose_joint
from articulate_train.config import TrainConfig
from articulate_train.run import SUMMARY, open_run, prepare_asset

ACTOR = "geometric-video"
EXITS_WITH_RESULT = (0, 3)
"""Exit codes of ``make`` and ``evaluate`` with which there is a result."""


def articulate(*arguments: object) -> str:
    """Run a command of ``articulate`` and return its standard output.

    Raises:
        UsageError: It fails.
    """
    texts = [str(argument) for argument in arguments]
    sys.stderr.write(f"articulate {' '.join(texts)}\n")
    done = subprocess.run(
        [sys.executable, "-m", "articulate", *texts],
        stdout=subprocess.PIPE,
        text=True,
        check=False,
    )
    if done.returncode not in EXITS_WITH_RESULT:
        raise UsageError(f"articulate {' '.join(texts)}: exit {done.returncode}")
    return done.stdout


def write_video(index: Path, data: Path, object_id: str, link: str, folder: Path) -> None:
    """Render a video of the joint that moves ``link``, and write it with its camera.

    Raises:
        UsageError: The object has no such joint.
    """
    subject = open_dataset(str(index), data).load(object_id)
    joint = next((j for j in subject.joints if link in j.rigid), None)
    if joint is None:
        raise UsageError(f"{object_id}: no joint moves the link {link}")
    single = dataclasses.replace(subject, joints=(joint,))
    write_evidence(next(iter(cases_of(single, BenchmarkConfig(actor=ACTOR)))).evidence, folder)


def train(asset: Path, folder: Path, flags: argparse.Namespace, *more: object) -> None:
    """Train on ``asset`` in ``folder``, or resume that training; do nothing if it is finished."""
    if (folder / SUMMARY).exists():
        return
    if folder.exists():
        articulate("train", "--resume", "--out", folder, "--no-evaluate")
        return
    steps = ("--steps", flags.steps, "--seeds", *flags.seeds)
    articulate("train", "--asset", asset, "--out", folder, "--no-evaluate", *steps, *more)


def evaluate(run: Path, asset: Path, joint: str, flags: argparse.Namespace) -> dict[str, Any]:
    """Return the report of the policies of ``run`` on ``joint`` of the true object ``asset``."""
    arguments = ("--asset", asset, "--joint", joint, "--episodes", flags.episodes)
    report: dict[str, Any] = json.loads(articulate("evaluate", run, *arguments, "--json"))
    return report


def read_summary(
    path: Path, object_id: str, task: str, joint: str, flags: argparse.Namespace
) -> dict[str, Any]:
    """Return the summary of a run on the true object.

    Raises:
        UsageError: It is of another object, task, joint, training or evaluation.
    """
    summary: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    episodes = {seed["seed"]: seed["success"]["n"] for seed in summary["seeds"]}
    found = {name: summary[name] for name in ("asset", "task", "joint", "steps")}
    found["episodes of seeds"] = episodes
    required = {
        "asset": object_id,
        "task": task,
        "joint": joint,
        "steps": flags.steps,
        "episodes of seeds": dict.fromkeys(flags.seeds, flags.episodes),
    }
    if found != required:
        raise UsageError(f"{path}: has {found}, but {required} is required")
    return summary


def run_pipeline(task: str, object_id: str, flags: argparse.Namespace) -> dict[str, Any]:
    """Return the result for one object: its reconstruction and both success rates."""
    index = json.loads(flags.index.read_text(encoding="utf-8"))["assets"]
    item = next((item for item in index if item["id"] == object_id), None)
    if item is None:
        raise UsageError(f"{object_id}: not in {flags.index}")
    asset, folder = flags.data / item["path"], flags.out / f"{object_id}-{task}"
    config = TrainConfig(asset=str(asset), task=task)
    true_object = prepare_asset(config, cache_folder())
    joint = choose_joint(config, true_object)[0].joint
    link = next(j.link for j in true_object.joints if j.name == joint)
    made = make(asset, object_id, link, folder, flags)
    result = {"object": object_id, "task": task, "joint": joint}
    if made["urdf"] is None:
        return result | {"reconstruction": made, "ratio": 0.0}
    run = folder / "run_reconstruction"
    train(folder / "made" / URDF_FILE, run, flags, "--task", task)
    truth = flags.truth.get(object_id, folder / "run_truth")
    if truth.suffix == ".json":
        on_truth = read_summary(truth, object_id, task, joint, flags)
    else:
        train(asset, truth, flags, "--task", task, "--joint", joint)
        on_truth = evaluate(truth, asset, joint, flags)
    on_made = evaluate(run, asset, joint, flags)
    return result | {
        "reconstruction": {
            k: made[k] for k in ("verdict", "reasons", "rating", "joints", "seconds")
        },
        "joint_of_reconstruction": open_run(run).task.joint,
        "success_reconstruction": on_made["success_rate"],
        "success_truth": on_truth["success_rate"],
        "seeds_reconstruction": [seed["success"]["value"] for seed in on_made["seeds"]],
        "seeds_truth": [seed["success"]["value"] for seed in on_truth["seeds"]],
        "ratio": on_made["success_rate"] / max(on_truth["success_rate"], 1e-9),
    }


def make(
    asset: Path, object_id: str, link: str, folder: Path, flags: argparse.Namespace
) -> dict[str, Any]:
    """Return the content of ``made.json`` for a rendered video of the joint of ``link``."""
    video, out = folder / "video", folder / "made"
    if not (video / "camera.json").exists():
        write_video(flags.index, flags.data, object_id, link, video)
    if not (out / MADE_FILE).exists():
        query = ("--video", video / "video.mp4", "--camera-file", video / "camera.json")
        articulate("make", *query, "--actor", ACTOR, "--library", asset.parent, "--out", out)
    content: dict[str, Any] = json.loads((out / MADE_FILE).read_text(encoding="utf-8"))
    return content


def _pair(text: str) -> tuple[str, str]:
    left, equals, right = text.partition("=")
    if not (left and equals and right):
        raise argparse.ArgumentTypeError(f"{text!r}: give NAME=VALUE")
    return left, right


def text_of(row: dict[str, Any]) -> str:
    """Return one line about the result of an object."""
    on_made, on_truth = row.get("success_reconstruction", 0.0), row.get("success_truth", 0.0)
    return (
        f"{row['task']} {row['object']} {row['joint']}: {on_made:.1%} trained on the "
        f"reconstruction ({row['reconstruction']['verdict']}), {on_truth:.1%} trained on the true "
        f"object: ratio {row['ratio']:.2f}"
    )


def main() -> int:
    """Print both success rates of each object; return 2 for bad input."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--data", type=Path, required=True, help="folder of the index's paths")
    parser.add_argument("--index", type=Path, help="index of objects; by default DATA/assets.json")
    parser.add_argument(
        "--out", type=Path, required=True, help="folder of the results; it may have earlier ones"
    )
    parser.add_argument(
        "--objects", type=_pair, nargs="+", required=True, metavar="TASK=ID",
        help="task and id in the index of each object, e.g. open_drawer=partnet_20411",
    )  # fmt: skip
    parser.add_argument(
        "--truth", type=_pair, nargs="*", default=[], metavar="ID=RUN_OR_JSON",
        help="finished run on the true object, or its summary from benchmarks/collect.py",
    )  # fmt: skip
    parser.add_argument("--seeds", type=int, nargs="+", default=[0, 1, 2], help="training seeds")
    parser.add_argument("--steps", type=int, default=2_000_000, help="control steps of each seed")
    parser.add_argument("--episodes", type=int, default=200, help="evaluation episodes per seed")
    parser.add_argument("--json", action="store_true", help="print the result as JSON only")
    flags = parser.parse_args()
    flags.index = flags.index or flags.data / "assets.json"
    flags.truth = {name: Path(run) for name, run in flags.truth}
    try:
        rows = [run_pipeline(task, object_id, flags) for task, object_id in flags.objects]
    except UsageError as error:
        sys.stderr.write(f"{error}\n")
        return 2
    lines = [json.dumps(rows, indent=1)] if flags.json else [text_of(row) for row in rows]
    sys.stdout.write("".join(f"{line}\n" for line in lines))
    return 0


if __name__ == "__main__":
    sys.exit(main())
