"""Write the true joints in Real2Code's format, the upper bound of its boxes and edges.

python benchmarks/real2code_labels.py --data data --half published --out labels
articulate benchmark data/assets.json --data data --predictions real2code:labels --split published
"""

from __future__ import annotations

import argparse
from pathlib import Path

from articulate.benchmark.dataset import open_dataset
from articulate.benchmark.imported_predictions import file_name
from articulate.benchmark.real2code import write_real2code
from articulate.benchmark.split import half
from articulate.benchmark.truth import TrueObject
from articulate.files import write_text


def label(subject: TrueObject) -> str:
    """Return the label of an object; its body is the first part that no joint moves."""
    moving = {name for joint in subject.joints for name in joint.moves}
    fixed = [part for part in subject.parts if part.name not in moving]
    body = (fixed or list(subject.parts))[0]
    parts = [body, *(part for part in subject.parts if part is not body)]
    joints = {joint.joint.part: joint.joint for joint in subject.joints}
    return write_real2code([p.bounds for p in parts], [joints.get(p.name) for p in parts])


def main() -> None:
    """Write one file for each object."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--data", type=Path, required=True, help="folder with assets.json")
    parser.add_argument(
        "--half",
        choices=["development", "published"],
        default="development",
        help="half of the objects",
    )
    parser.add_argument("--out", type=Path, required=True, help="folder of the labels")
    flags = parser.parse_args()
    dataset = open_dataset(str(flags.data / "assets.json"), flags.data)
    for object_id in dataset.ids():
        if half(object_id) == flags.half:
            write_text(flags.out / f"{file_name(object_id)}.txt", label(dataset.load(object_id)))


if __name__ == "__main__":
    main()
