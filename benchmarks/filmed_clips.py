"""Evaluate `articulate observe` on recorded videos whose joints a person noted.

    python benchmarks/filmed_clips.py clips.json wild.json --half published

File names and categories are not used. The classifiers are learned from rendered videos; the
development half of the recorded ones was used to compare designs.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from articulate.benchmark.split import half
from articulate.errors import UsageError
from articulate.video.observe import LONGEST_PX, MOST_FRAMES, Observation, observe_joint
from articulate.video.read_video import VideoReadOptions, read_video

WITHIN_DEG = 30.0


def entries(index: Path) -> Iterator[dict[str, Any]]:
    """Yield id, path, joint type and the noted axis of each video of an index."""
    content = json.loads(index.read_text(encoding="utf-8"))
    for item in content.get("clips", []):
        yield {**item, "path": index.parent / item["file"]}
    for item in content.get("items", []):
        if item["kind"] == "clip":
            yield {**item["truth"], "id": item["id"], "path": index.parent / item["file"]}


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


def main() -> None:
    """Print one line for each video, and the shares."""
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    parser.add_argument("index", type=Path, nargs="+")
    parser.add_argument("--half", default="", help="development or published; all if not given")
    args = parser.parse_args()
    found = []
    for entry in (entry for index in args.index for entry in entries(index)):
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


if __name__ == "__main__":
    main()
