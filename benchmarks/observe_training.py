"""Train and evaluate the classifiers of `articulate observe` on rendered videos.

    python benchmarks/observe_training.py render train --first 0 --count 1000
    python benchmarks/observe_training.py features train
    python benchmarks/observe_training.py train train
    python benchmarks/observe_training.py render test --first 1000 --count 100
    python benchmarks/observe_training.py evaluate test

`render` writes videos, labels of pixels and truth; objects of the procedural library, or those of
an index file (`--dataset assets.json --half published`). `features` tracks points and stores the
features of all candidate parts. `train` writes `articulate/video/joint_classifier.json`; it needs
scikit-learn. Every step continues where it was interrupted.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any, Literal

import numpy as np

from articulate.benchmark.dataset import Dataset, LibraryDataset, open_dataset
from articulate.benchmark.operated_joint import Conditions
from articulate.benchmark.rendered_video import MOVING, RenderedVideo, render_operated
from articulate.benchmark.split import half
from articulate.errors import AssetError, UsageError
from articulate.library.procedural.categories import CATEGORIES
from articulate.library.procedural.library import ProceduralLibrary
from articulate.render.encode_video import write_video
from articulate.video.candidate_parts import candidate_parts, video_motion
from articulate.video.joint_classifier import PATH
from articulate.video.motion_features import features, opening_features
from articulate.video.observe import observe_joint
from articulate.video.read_video import VideoReadOptions, read_video
from articulate.video.surface_tracks import follow_surface

KINDS: tuple[Literal["revolute", "prismatic"], ...] = ("revolute", "prismatic")
FEATURES = ".features.json"
TRIES = 6
"""Objects that are tried for a video."""
OTHER_JOINTS = 0.25
"""Share of procedural videos in which the object's joint is replaced."""
DRAWERS = ("cabinet", "chest_of_drawers", "table_with_drawers")
SLIDING = [
    *DRAWERS,
    "oven",
    "washing_machine",
    "sliding_window",
    "suitcase",
    "kitchen_pot",
    *DRAWERS,
]
"""Categories with a sliding part; the most frequent ones twice."""
TURNING = [
    name
    for name in CATEGORIES
    if name not in ("chest_of_drawers", "table_with_drawers", "sliding_window", "kitchen_pot")
] + ["cabinet", "fridge", "oven", "box_with_lid", "door"]
"""Categories with a rotating part; the most frequent ones twice."""


def render(args: argparse.Namespace) -> None:
    """Render videos into the folder."""
    args.folder.mkdir(parents=True, exist_ok=True)
    data, ids = _source(args)
    kinds = _kinds(data, ids) if args.dataset else {}
    for seed in range(args.first, args.first + args.count):
        path = args.folder / f"{seed:05d}.json"
        if path.exists():
            continue
        made = _rendered(data, ids, kinds, seed)
        if made is None:
            path.write_text("null", encoding="utf-8")
            continue
        frames = made.video.frames
        quality: Literal["small", "faithful"] = "small" if seed % 2 else "faithful"
        size = (frames.shape[2], frames.shape[1])
        write_video(path.with_suffix(".mp4"), frames, size, made.video.fps, quality)
        np.savez_compressed(path.with_suffix(".npz"), labels=made.labels)
        path.write_text(json.dumps(made.truth.as_json()), encoding="utf-8")
        print(seed, made.truth.object_id, made.truth.kind, flush=True)


def _source(args: argparse.Namespace) -> tuple[Dataset, list[str]]:
    if not args.dataset:
        return LibraryDataset("procedural", ProceduralLibrary(10**6)), []
    data = open_dataset(args.dataset)
    return data, [i for i in data.ids() if not args.half or half(i) == args.half]


def _kinds(data: Dataset, ids: list[str]) -> dict[str, list[str]]:
    """Return the objects with a joint of each type."""
    found: dict[str, list[str]] = {kind: [] for kind in KINDS}
    for name in ids:
        types = {"prismatic" if k.kind == "prismatic" else "revolute" for k in data.known(name)}
        for kind in types:
            found[kind].append(name)
    return found


def _rendered(
    data: Dataset, ids: list[str], kinds: dict[str, list[str]], seed: int
) -> RenderedVideo | None:
    rng = np.random.default_rng([77, seed])
    kind = KINDS[seed % 2]
    other = rng.random() < OTHER_JOINTS and not ids
    how = Conditions(other_joint=1.0 if other else 0.0)
    names = list(CATEGORIES) if other else SLIDING if kind == "prismatic" else TURNING
    for k in range(TRIES):
        names = kinds[kind] if ids else names
        name = names[int(rng.integers(len(names)))]
        name = name if ids else f"{name}-{seed}"
        try:
            made = render_operated(data.load(name), seed * 10 + k, kind=kind, conditions=how)
        except AssetError:
            continue
        if made is not None:
            return made
    return None


def extract(args: argparse.Namespace) -> None:
    """Store the features of all candidates of the videos in the folder."""
    for path in sorted(args.folder.glob("*.mp4")):
        out = path.with_suffix(FEATURES)
        if not out.exists():
            out.write_text(json.dumps(_video_features(path)), encoding="utf-8")


def _video_features(path: Path) -> dict[str, Any]:
    truth = json.loads(path.with_suffix(".json").read_text(encoding="utf-8"))
    frames = read_video(path, VideoReadOptions(longest_side_px=480, most_frames=72)).frames
    labels = np.load(path.with_suffix(".npz"))["labels"]
    motion = video_motion(follow_surface(frames), (frames.shape[2], frames.shape[1]))
    found = candidate_parts(motion)
    rows = []
    for k, part in enumerate(found):
        t, n = np.nonzero(motion.visible[:, part.core])
        at = (motion.raw_uv[t, part.core[n]] / 2.0).astype(int)
        inside = labels[
            t, at[:, 1].clip(0, labels.shape[1] - 1), at[:, 0].clip(0, labels.shape[2] - 1)
        ]
        rows.append(
            {
                "features": features(motion, found, k),
                "opening": opening_features(part),
                "share": float((inside == MOVING).mean()),
            }
        )
    return {"truth": truth, "rows": rows}


def train(args: argparse.Namespace) -> None:
    """Fit, calibrate by cross-validation over categories, and write the classifiers."""
    from joint_training import train_classifiers

    paths = sorted(args.folder.glob(f"*{FEATURES}"))
    videos = [json.loads(path.read_text(encoding="utf-8")) for path in paths]
    content = train_classifiers([v for v in videos if v["rows"]])
    PATH.write_text(json.dumps(content, separators=(",", ":")) + "\n", encoding="utf-8")


def evaluate(args: argparse.Namespace) -> None:
    """Print one line for each video and the figures of all."""
    records = []
    for path in sorted(args.folder.glob("*.mp4")):
        truth = json.loads(path.with_suffix(".json").read_text(encoding="utf-8"))
        records.append(_evaluated(path, truth))
        print(json.dumps(records[-1]), flush=True)
    print(json.dumps(summary(records)))


def _evaluated(path: Path, truth: dict[str, Any]) -> dict[str, Any]:
    video = read_video(path, VideoReadOptions(longest_side_px=480, most_frames=72))
    try:
        seen = observe_joint(video, path.name)
    except UsageError as error:
        return {"id": path.stem, "kind": truth["kind"], "error": str(error)}
    axis = np.asarray(truth["axis_c"])
    cosine = float(axis @ np.asarray(seen.axis_c))
    turns = truth["kind"] == "revolute"
    angle = float(np.degrees(np.arccos(np.clip(abs(cosine) if turns else cosine, -1.0, 1.0))))
    q = np.asarray(truth["positions"])
    peak = int(np.argmax(np.abs(q - q[0])))
    along = float(np.clip(np.dot(seen.direction_px, truth["direction_px"]), -1.0, 1.0))
    return {
        "id": path.stem,
        "kind": truth["kind"],
        "kind_right": seen.kind == truth["kind"],
        "confidence": seen.confidence,
        "doubtful": seen.doubtful,
        "axis_off_deg": angle,
        "side_right": seen.side == truth["side"],
        "direction_off_deg": float(np.degrees(np.arccos(along))),
        "opening": seen.opening,
        "opening_right": seen.opening == bool(abs(q[peak]) > abs(q[0])),
    }


def summary(records: list[dict[str, Any]]) -> dict[str, float]:
    """Return the figures of all videos; a video with an error counts as wrong and doubtful."""
    n = len(records)
    ok = np.array([bool(r.get("kind_right")) for r in records])
    doubtful = np.array([bool(r.get("doubtful", True)) for r in records])
    slides = np.array([r["kind"] == "prismatic" for r in records])
    near = np.array([abs(r.get("confidence", 0.0) - 0.8) <= 0.1 for r in records])
    turning = [r for r in records if r["kind"] == "revolute" and r.get("kind_right")]
    sliding = [r for r in records if r["kind"] == "prismatic" and r.get("kind_right")]
    opened = [r for r in records if r.get("opening") is not None]

    def share(values: Any) -> float:
        values = list(values)
        return round(float(np.mean(values)), 3) if values else float("nan")

    return {
        "videos": n,
        "type_right": share(ok),
        "slides_found": share(ok[slides]),
        "precision_not_doubtful": share(ok[~doubtful]),
        "share_not_doubtful": share(~doubtful),
        "wrong_marked_doubtful": share(doubtful[~ok]),
        "right_at_confidence_0.8": share(ok[near]),
        "axis_within_15": share(r["axis_off_deg"] <= 15.0 for r in turning + sliding),
        "hinge_side_right": share(r["side_right"] for r in turning),
        "direction_within_30": share(r["direction_off_deg"] <= 30.0 for r in sliding),
        "opening_right": share(r["opening_right"] for r in opened),
    }


def main() -> None:
    """Run one step."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "step", choices=["render", "features", "train", "evaluate"], help="step to run"
    )
    parser.add_argument("folder", type=Path, help="folder of the videos")
    parser.add_argument("--first", type=int, default=0, help="first seed")
    parser.add_argument("--count", type=int, default=1000, help="number of videos")
    parser.add_argument("--dataset", default="", help="index file; procedural objects if not given")
    parser.add_argument("--half", default="", help="development or published objects of the index")
    args = parser.parse_args()
    steps = {"render": render, "features": extract, "train": train, "evaluate": evaluate}
    steps[args.step](args)


if __name__ == "__main__":
    main()
