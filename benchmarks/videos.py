"""Evaluate `articulate observe` and `articulate make --video` on videos with known joints.

    python benchmarks/videos.py observe recorded.json wild.json --half published
    python benchmarks/videos.py render videos --data data --half published --count 24
    python benchmarks/videos.py render videos --half published --count 16
    python benchmarks/videos.py make videos
    python benchmarks/videos.py make videos --library data/assets/partnet
    python benchmarks/videos.py make recorded.json --half published --text
    python benchmarks/videos.py confidence videos/made.jsonl videos/made_text.jsonl

`render` writes videos of PartNet-Mobility objects (`--data`) or generated ones, whose doors,
drawers and lids are operated: the camera of `photos.py`, hand-held, an arm in a third of them.
`make` gives nothing but the video, with `--text` also the category, and evaluates the written
asset; with `--library` the category is recognized by renders of a folder of PartNet-Mobility
objects, without the object itself. It keeps one line for each video and continues where it was
interrupted. File names are not used. `confidence` needs scikit-learn. The classifiers are learned
from rendered videos; the development half of the recorded ones was used to compare designs.
"""

from __future__ import annotations

import argparse
import contextlib
import hashlib
import json
import tempfile
import time
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from articulate.benchmark.dataset import LibraryDataset, open_dataset
from articulate.benchmark.operated_joint import Conditions, OperatedJoint
from articulate.benchmark.rendered_video import RenderedVideo, render_operated
from articulate.benchmark.split import half
from articulate.benchmark.truth import TrueJoint, TrueObject
from articulate.cache import cache_folder
from articulate.errors import ArticulateError, AssetError, UsageError
from articulate.library.procedural.categories import CATEGORIES
from articulate.library.procedural.library import ProceduralLibrary
from articulate.library.procedural.truth import bounds
from articulate.reconstruct.fitting.categories import USUAL
from articulate.reconstruct.fitting.confidence import MotionEvidence
from articulate.reconstruct.link_meshes import HALF_TURN
from articulate.reconstruct.make_object import make_object
from articulate.reconstruct.proposal import ObjectProposal
from articulate.reconstruct.propose import propose_object
from articulate.reconstruct.query import video_query
from articulate.reconstruct.recognition.library_index import LibraryIndex, open_index
from articulate.reconstruct.result import MakeRequest
from articulate.render.encode_video import write_video
from articulate.render.parts import joint_bounds
from articulate.statistics import wilson
from articulate.transforms import Array, normalised
from articulate.video.observe import LONGEST_PX, MOST_FRAMES, Observation, observe_joint
from articulate.video.read_video import VideoReadOptions, read_video
from photos import openable

WITHIN_DEG = 30.0
AXIS_DEG, RANGE_SHARE = 15.0, 0.25
HOW = Conditions(arm=1.0 / 3.0, person=0.0, tripod=0.0, other_joint=0.0, entire=True)
OPENING_AXES: Mapping[str, tuple[float, float, float]] = {
    "left": (0.0, 0.0, -1.0),
    "right": (0.0, 0.0, 1.0),
    "bottom": (0.0, 1.0, 0.0),
    "top": (0.0, -1.0, 0.0),
    "rear": (0.0, -1.0, 0.0),
    "far": (0.0, -1.0, 0.0),
}
"""Axis about which a part opens by the noted edge of its hinge; the front is at +x, z up."""


def entries(index: Path) -> Iterator[dict[str, Any]]:
    """Yield id, path, joint type and the noted axis of each video of an index."""
    content = json.loads(index.read_text(encoding="utf-8"))
    for item in content.get("clips", []):
        yield {**item, "path": index.parent / item["file"]}
    for item in content.get("items", []):
        if item["kind"] == "clip":
            yield {**item["truth"], "id": item["id"], "path": index.parent / item["file"]}


def observe(args: argparse.Namespace) -> None:
    """Print one line for each recorded video, and the shares."""
    found = []
    for entry in (entry for index in args.source for entry in entries(index)):
        if args.half in ("", half(entry["id"])):
            found.append(evaluate(entry))
            print(json.dumps(found[-1]), flush=True)
    wrong = [r for r in found if not r["kind_right"]]
    sure = [r for r in found if not r["doubtful"]]
    slides = [r for r in found if r["slides"]]
    axes = [r for r in found if r.get("axis_right") is not None]
    print(
        json.dumps(
            {
                "videos": len(found),
                "kind_right": sum(r["kind_right"] for r in found),
                "slides": len(slides),
                "slides_found": sum(r["kind_right"] for r in slides),
                "wrong": len(wrong),
                "wrong_marked_doubtful": sum(r["doubtful"] for r in wrong),
                "not_doubtful": len(sure),
                "not_doubtful_right": sum(r["kind_right"] for r in sure),
                "axes": len(axes),
                "axes_right": sum(r["kind_right"] and r["axis_right"] for r in axes),
            }
        )
    )


def evaluate(entry: dict[str, Any]) -> dict[str, Any]:
    """Return whether joint type and axis are right, and the result."""
    turns = entry["joint_type"] in {"revolute", "continuous"}
    record: dict[str, Any] = {"id": entry["id"], "slides": not turns}
    options = VideoReadOptions(longest_side_px=LONGEST_PX, most_frames=MOST_FRAMES)
    try:
        seen = observe_joint(read_video(entry["path"], options), entry["id"])
    except UsageError as error:
        return record | {"kind_right": False, "doubtful": True, "error": str(error)}
    off = axis_error_deg(entry, seen, turns=turns)
    return record | {
        "kind_right": (seen.kind == "revolute") == turns,
        "doubtful": seen.doubtful,
        "p_revolute": round(seen.p_revolute, 3),
        "axis_off_deg": off,
        "axis_right": None if off is None else off <= WITHIN_DEG,
        "side": seen.side,
        "noted_side": entry.get("hinge_side"),
        "opening": seen.opening,
    }


def axis_error_deg(entry: dict[str, Any], seen: Observation, *, turns: bool) -> float | None:
    """Return the angle to the noted axis, in space or in the image [deg]; None without one."""
    found = np.asarray(seen.axis_c)
    if entry.get("axis_image"):
        truth = np.asarray(entry["axis_image"], dtype=float)
    elif entry.get("axis_px"):
        ends = np.asarray(entry["axis_px"], dtype=float)
        truth, found = ends[1] - ends[0], found[:2]
    elif entry.get("direction"):
        truth, found = np.asarray(entry["direction"], dtype=float), np.asarray(seen.direction_px)
        turns = True  # the noted direction is that of opening, not of the first motion
    else:
        return None
    cosine = float(found @ truth / max(np.linalg.norm(found) * np.linalg.norm(truth), 1e-9))
    return float(np.degrees(np.arccos(np.clip(abs(cosine) if turns else cosine, -1.0, 1.0))))


def render(args: argparse.Namespace) -> None:
    """Write videos and their truth into a folder."""
    (folder,) = args.source
    folder.mkdir(parents=True, exist_ok=True)
    found = 0
    for name, load, seed in _objects(args):
        if found >= args.count:
            break
        path = folder / f"{name}.json"
        if not path.exists():
            _write(path, load(), seed)
        found += path.read_text(encoding="utf-8") != "null"


def _objects(args: argparse.Namespace) -> Iterator[tuple[str, Any, int]]:
    """Yield name, loader and seed of the objects, in a fixed order."""
    if args.data is None:
        first = 2000 if args.half == "published" else 500
        library = LibraryDataset("procedural", ProceduralLibrary(10**6))
        names = [n for n in sorted(CATEGORIES) if CATEGORIES[n].partnet in USUAL]
        for seed in range(first, first + 4 * args.count):
            name = f"{names[seed % len(names)]}-{seed:04d}"
            yield name, lambda name=name: library.load(name), seed
        return
    data = open_dataset(str(args.data / "assets.json"), args.data)
    ids = [i for i in data.ids() if half(i) == args.half and data.category(i) in USUAL]
    ids.sort(key=lambda i: hashlib.sha256(i.encode()).hexdigest())
    for seed, name in enumerate(ids):
        yield name, lambda name=name: data.load(name), seed


def _write(path: Path, true: TrueObject, seed: int) -> None:
    """Render the video of an object; ``null`` if none of its openable parts can be seen."""
    joints = tuple(j for j in true.joints if openable([true.labels[j.joint.part]]))
    made: RenderedVideo | None = None
    with contextlib.suppress(AssetError):
        made = render_operated(replace(true, joints=joints), seed, conditions=HOW)
    if made is None:
        path.write_text("null", encoding="utf-8")
        return
    frames = made.video.frames
    size = (frames.shape[2], frames.shape[1])
    write_video(path.with_suffix(".mp4"), frames, size, made.video.fps, "faithful")
    operated = next(j for j in joints if j.moves[0] == made.truth.part)
    joint = operated.joint
    axis, span = opening(true, operated)
    size_m = float(np.linalg.norm(np.ptp(joint_bounds(true.parts), axis=0)))
    content = {
        "id": path.stem,
        "category": true.category,
        "kind": next(iter(openable([true.labels[joint.part]]))),
        "type": made.truth.kind,
        "axis": axis.tolist(),
        "range": None if span is None else span / (size_m if joint.kind == "prismatic" else 1.0),
        "arm": made.truth.arm,
        "positions": made.truth.positions,
    }
    path.write_text(json.dumps(content), encoding="utf-8")


def opening(true: TrueObject, joint: TrueJoint) -> tuple[Array, float | None]:
    """Return the axis (3,) along or about which a joint opens, and its range [rad or unit].

    The object is closed at the limit at which its box is smaller.
    """
    known = joint.joint
    axis = normalised(np.asarray(known.axis_o, dtype=np.float64))
    if known.lower is None or known.upper is None:
        return axis, None
    moved = OperatedJoint(
        kind="prismatic" if known.kind == "prismatic" else "revolute",
        axis=axis,
        pivot=np.asarray(known.pivot_o),
        lower=known.lower,
        upper=known.upper,
        moves=joint.moves,
        own=True,
    )
    still = [part for part in true.parts if part.name not in joint.moves]
    moving = [true.part(name) for name in joint.moves]
    volumes = [
        float(np.prod(np.ptp(joint_bounds([*still, *(p.moved(T) for p in moving)]), axis=0)))
        for T in (moved.motion(known.lower), moved.motion(known.upper))
    ]
    return (axis if volumes[0] <= volumes[1] else -axis), known.upper - known.lower


def make(args: argparse.Namespace) -> None:
    """Reconstruct all videos of folders and indices, and print the shares."""
    library = open_index(args.library, cache_folder()) if args.library else None
    rows = []
    for source in args.source:
        folder = source.parent if source.is_file() else source
        suffix = ("_text" if args.text else "") + ("_library" if args.library else "")
        suffix += "" if args.checks else "_unchecked"
        store = args.out or folder / f"made{suffix}.jsonl"
        known = {}
        if store.exists():
            lines = store.read_text(encoding="utf-8").splitlines()
            known = {row["id"]: row for row in map(json.loads, lines)}
        for truth in _truths(source, args.half):
            if truth["id"] not in known:
                known[truth["id"]] = _made(truth, args, library)
                with store.open("a", encoding="utf-8") as file:
                    file.write(json.dumps(known[truth["id"]]) + "\n")
                print(json.dumps(known[truth["id"]]), flush=True)
            rows.append(known[truth["id"]])
    print(json.dumps(summary(rows), indent=1))


def _truths(source: Path, chosen: str) -> Iterator[dict[str, Any]]:
    """Yield id, path and truth of the videos of a folder or an index."""
    if source.is_dir():
        for path in sorted(source.glob("*.json")):
            truth = json.loads(path.read_text(encoding="utf-8"))
            if truth is not None:
                yield {**truth, "path": path.with_suffix(".mp4")}
        return
    for entry in entries(source):
        if chosen not in ("", half(entry["id"])):
            continue
        noted = f"{entry.get('pivot') or ''} {entry.get('hinge_side') or ''}"
        sides = [axis for word, axis in OPENING_AXES.items() if word in noted]
        slides = entry["joint_type"] == "prismatic"
        kinds = list(openable([entry["moving_part"]]))
        yield {
            "id": entry["id"],
            "path": entry["path"],
            "category": entry["category"],
            "kind": kinds[0] if kinds else None,
            "type": "prismatic" if slides else "revolute",
            "axis": None if slides or not sides else list(sides[0]),
            "range": None,
            "arm": True,
        }


def _made(
    truth: dict[str, Any], args: argparse.Namespace, library: LibraryIndex | None
) -> dict[str, Any]:
    """Return the outcome of one video."""
    row = {key: truth[key] for key in ("id", "category", "kind", "type", "arm")}
    start, begin = time.process_time(), time.monotonic()
    words = "".join(f" {c.lower()}" if c.isupper() else c for c in truth["category"]).strip()
    try:
        query = video_query(truth["path"], words if args.text else "")
        others = (
            None if library is None else library.without({truth["id"].removeprefix("partnet_")})
        )
        found = propose_object(query, library=others)
    except ArticulateError as error:
        return {**row, "error": str(error), "doubtful": True}
    row["processor_s"] = round(time.process_time() - start, 1)
    row |= compare(found, truth)
    if args.checks:
        with tempfile.TemporaryDirectory() as folder:
            request = MakeRequest(out=Path(folder) / "made", cache=Path(folder) / "cache")
            result = make_object(query, found, request)
        row |= {"check": result.check_report.verdict, "verdict": result.verdict}
        row["doubtful"] = result.verdict != "passed"
    row["seconds"] = round(time.monotonic() - begin, 1)
    return row


def compare(found: ObjectProposal, truth: Mapping[str, Any]) -> dict[str, Any]:
    """Compare a proposal with the truth, both in the frame of the object's box."""
    figures = {k: v for step in found.trace for k, v in step.figures.items()}
    row: dict[str, Any] = {
        "found": found.category,
        "category_right": found.category == truth["category"],
        "confidence": round(found.confidence, 3),
        "doubtful": bool(found.doubts),
        "doubts": list(found.doubts),
        "figures": figures,
    }
    moved = [part for part in found.parts if found.evidence.get(part.name) == "video"]
    if not moved:
        return row | dict.fromkeys(("kind_right", "side_right", "axis_right", "range_right"), False)
    part = moved[0]
    motion = part.motion
    assert motion is not None
    slides = motion.kind == "prismatic"
    kinds = list(openable([part.name]))
    type_right = slides == (truth["type"] == "prismatic")
    kind_right = truth["kind"] is None or truth["kind"] in kinds
    upper = motion.upper if motion.kind != "continuous" else None
    row |= {"part": part.name, "type_right": type_right, "kind_right": type_right and kind_right}
    if truth["axis"] is None:
        row["side_right"] = type_right
    else:
        axis = HALF_TURN @ normalised(np.asarray(motion.axis, dtype=np.float64))
        off = float(np.degrees(np.arccos(np.clip(axis @ truth["axis"], -1.0, 1.0))))
        row["axis_off_deg"] = round(off, 1)
        row["side_right"] = type_right and off <= 45.0
        row["axis_right"] = type_right and (off if slides else min(off, 180.0 - off)) <= AXIS_DEG
    if truth["range"] is not None:
        size_m = float(np.linalg.norm(np.ptp(bounds(found.parts), axis=0)))
        span = None if upper is None else upper / (size_m if slides else 1.0)
        row["range"] = [span, truth["range"]]
        row["range_right"] = bool(
            type_right and span is not None and abs(span / truth["range"] - 1.0) <= RANGE_SHARE
        )
    return row


def right(row: Mapping[str, Any]) -> bool:
    """Return whether category, kind, joint type, side and axis are right."""
    names = ("category_right", "kind_right", "side_right")
    return all(row.get(name, False) for name in names) and row.get("axis_right", True)


def summary(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Return counts with 95 % Wilson intervals; a video with an error counts as wrong."""
    out: dict[str, Any] = {"videos": len(rows), "errors": sum("error" in r for r in rows)}
    known = ("category_right", "type_right", "kind_right", "side_right", "axis_right")
    for name in (*known, "range_right"):
        scored = [r for r in rows if name in r or "error" in r]
        if not scored:
            continue
        share = wilson(sum(bool(r.get(name)) for r in scored), len(scored))
        out[name] = [sum(bool(r.get(name)) for r in scored), len(scored), share.low, share.high]
    sure = [r for r in rows if not r["doubtful"]]
    out["right"] = sum(map(right, rows))
    out["not_doubtful"] = len(sure)
    out["not_doubtful_right"] = sum(map(right, sure))
    checked = [r for r in rows if "check" in r]
    out["checks"] = [sum(r["check"] in ("passed", "repaired") for r in checked), len(checked)]
    seconds = [r["seconds"] for r in rows if "seconds" in r]
    out["seconds_median"] = float(np.median(seconds)) if seconds else None
    return out


def confidence(args: argparse.Namespace) -> None:
    """Fit ``articulate.reconstruct.fitting.confidence.MOTION`` to results and print it."""
    from sklearn.linear_model import LogisticRegression
    from sklearn.model_selection import LeaveOneGroupOut, cross_val_predict

    lines = [line for path in args.source for line in path.read_text("utf-8").splitlines()]
    rows = [row for row in map(json.loads, lines) if "figures" in row]
    x = np.array([_evidence(row["figures"]).terms() for row in rows])
    y = np.array([right(row) for row in rows])
    ids = [row["id"] for row in rows]
    model = LogisticRegression(C=10.0)
    folds = LeaveOneGroupOut()
    p = cross_val_predict(model, x, y, groups=ids, cv=folds, method="predict_proba")[:, 1]
    model.fit(x, y)
    weights = [*model.intercept_, *model.coef_[0]]
    print(f"MOTION = ({', '.join(f'{weight:.2f}' for weight in weights)})")
    for limit in np.arange(0.4, 0.95, 0.05):
        kept = p >= limit
        print(f"limit {limit:.2f}: {kept.sum()} of {len(y)} kept, {y[kept].sum()} right")


def _evidence(figures: Mapping[str, float]) -> MotionEvidence:
    return MotionEvidence(
        category=figures["probability of the category"],
        joint=figures["probability of the joint"],
        error=figures["error of the motion"],
    )


def main() -> None:
    """Run one step."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "step", choices=["observe", "render", "make", "confidence"], help="step to run"
    )
    parser.add_argument("source", type=Path, nargs="+", help="index files; folder of videos")
    parser.add_argument("--half", default="", help="development or published; all if not given")
    parser.add_argument("--data", type=Path, help="folder with assets.json; else generated objects")
    parser.add_argument("--count", type=int, default=12, help="number of videos")
    parser.add_argument("--text", action="store_true", help="give the category as text")
    parser.add_argument("--library", type=Path, help="folder of PartNet-Mobility objects")
    parser.add_argument("--out", type=Path, help="file of the results; default: in the folder")
    parser.add_argument("--no-checks", dest="checks", action="store_false", help="no check-asset")
    args = parser.parse_args()
    steps = {"observe": observe, "render": render, "make": make, "confidence": confidence}
    steps[args.step](args)


if __name__ == "__main__":
    main()
