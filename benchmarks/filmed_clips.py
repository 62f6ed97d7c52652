"""What `articulate observe` says of filmed clips whose joints a person wrote down.

    python benchmarks/filmed_clips.py clips.json --set core

File names and categories are not used. The thresholds of `articulate.video.observe` were chosen
with these clips in view: the figure is no promise for others.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

import numpy as np

from articulate.errors import UsageError
from articulate.video.observe import observe_joint
from articulate.video.read_video import VideoReadOptions, read_video

WITHIN_DEG = 30.0


def judged(entry: dict[str, Any], folder: Path) -> dict[str, Any]:
    """Whether kind and axis are right, and what was said."""
    clip = read_video(folder / entry["file"], VideoReadOptions(longest_side_px=480, most_frames=72))
    try:
        seen = observe_joint(clip, entry["id"])
    except UsageError as error:
        return {"id": entry["id"], "kind_right": False, "axis_right": False, "said": str(error)}
    truth = np.asarray(entry["axis_image"], dtype=float)
    cosine = float(np.dot(seen.axis_c, truth) / np.linalg.norm(truth))
    if entry["joint_type"] != "prismatic":
        cosine = abs(cosine)
    off = float(np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))))
    turns = entry["joint_type"] in {"revolute", "continuous"}
    return {
        "id": entry["id"],
        "set": entry["set"],
        "kind_right": (seen.kind == "revolute") == turns,
        "axis_right": off <= WITHIN_DEG,
        "axis_off_deg": off,
        "said": seen.kind,
        "figures": dict(seen.figures),
    }


def main() -> None:
    """Print one line for each clip, and the shares."""
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    parser.add_argument("index", type=Path)
    parser.add_argument("--set", default="", help="core, extra or tracks; all if not given")
    args = parser.parse_args()
    entries = json.loads(args.index.read_text(encoding="utf-8"))["clips"]
    found = [
        judged(entry, args.index.parent) for entry in entries if args.set in ("", entry["set"])
    ]
    for record in found:
        print(json.dumps(record))
    right = sum(r["kind_right"] and r["axis_right"] for r in found)
    kinds = sum(r["kind_right"] for r in found)
    print(json.dumps({"n": len(found), "kind_and_axis_right": right, "kind_right": kinds}))


if __name__ == "__main__":
    main()
