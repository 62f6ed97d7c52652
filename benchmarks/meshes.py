"""Mesh reconstruction from one image with an unknown camera: Chamfer distance by method.

    python benchmarks/meshes.py --data data --half published --count 40 --index index --json

``retrieval`` returns the most similar other object of PartNet-Mobility, ``procedural`` the fitted
object of the procedural library. ``same object`` compares two samplings of the true surface, which
is also the figure of a scan: its parts keep the surface of the input. The published figures are
those of Articulate-Anything's table.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import sys
from collections.abc import Collection, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from articulate.benchmark.chamfer import N_POINTS, chamfer, surface_points
from articulate.benchmark.dataset import Dataset, open_dataset
from articulate.benchmark.split import half
from articulate.errors import ArticulateError
from articulate.reconstruct.fitting.propose import object_mask, propose
from articulate.reconstruct.make_object import part_meshes
from articulate.reconstruct.retrieval import RetrievalIndex, read_index, write_entry
from articulate.render.parts import PartMesh
from articulate.render.rendered_photo import RenderedPhoto, render_photo
from articulate.statistics import clustered_mean

PUBLISHED = {
    "Articulate-Anything, retrieval": 0.1007,
    "Real2Code, oracle": 0.229,
    "URDFormer, oracle": 0.429,
    "URDFormer, detector": 0.437,
}
"""Chamfer distance of the published table."""
METHODS = ("retrieval", "procedural", "same object")
FIRST_SEED = 7000
"""Seed of the camera of the first image."""


def build(dataset: Dataset, ids: Sequence[str], folder: Path) -> RetrievalIndex:
    """Return the index of the objects; entries that exist are kept."""
    entries = {i: folder / f"{i.replace('/', '_')}.npz" for i in ids}
    for object_id, path in entries.items():
        if not path.is_file():
            write_entry(path, dataset.load(object_id).parts)
            sys.stderr.write(f"index: {object_id}\n")
    return read_index(entries)


def images(dataset: Dataset, chosen: str, count: int) -> list[str]:
    """Return the ids of one half, ordered by the SHA-256 of the id."""
    ids = [i for i in dataset.ids() if half(i) == chosen]
    return sorted(ids, key=lambda i: hashlib.sha256(i.encode()).hexdigest())[:count]


def measure(
    dataset: Dataset,
    index: RetrievalIndex,
    object_id: str,
    seed: int,
    background: bool,
    exclude: Collection[str],
) -> dict[str, Any]:
    """Return the distances of one object by method; None where a method finds nothing."""
    true = dataset.load(object_id)
    photo = render_photo(true.parts, seed, plain=not background)
    rng = np.random.default_rng(seed)
    points = surface_points(true.parts, rng)
    row: dict[str, Any] = {"id": object_id, "category": true.category}
    row["same object"] = chamfer(points, surface_points(true.parts, rng))
    try:
        found = index.rank(photo.image, _mask(photo, background), {object_id, *exclude})[0]
        row["found"], row["score"] = found.object_id, round(found.score, 3)
        row["right category"] = dataset.category(found.object_id) == true.category
        other = surface_points(dataset.load(found.object_id).parts, rng)
        row["retrieval"] = chamfer(points, other)
    except ArticulateError as error:
        row |= {"retrieval": None, "right category": False, "error": str(error)}
    try:
        row["procedural"] = chamfer(points, surface_points(_fitted(photo), rng))
    except ArticulateError as error:
        row |= {"procedural": None, "procedural error": str(error)}
    return row


def _mask(photo: RenderedPhoto, background: bool) -> Any:
    """Return the pixels that are not white, or the salient ones before a background."""
    return object_mask(photo.image, None) if background else (photo.image < 255).any(axis=-1)


def _fitted(photo: RenderedPhoto) -> list[PartMesh]:
    """Return the fitted procedural object with its front at +x."""
    found = propose(photo.image)
    return [
        mesh.with_vertices(mesh.vertices * [-1.0, -1.0, 1.0])
        for mesh in part_meshes(found.parts, found.palette)
    ]


def summary(rows: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Return the mean of each method with a bootstrap over objects, and by category."""
    rng = np.random.default_rng(0)
    out: dict[str, Any] = {"objects": len(rows), "points": N_POINTS, "published": PUBLISHED}
    for method in METHODS:
        has = [row for row in rows if row[method] is not None]
        mean = clustered_mean([row[method] for row in has], [row["id"] for row in has], rng)
        out[method] = {
            "n": len(has),
            "mean": mean.mean,
            "interval": [mean.low, mean.high],
            "std": float(np.std([row[method] for row in has])),
        }
    out["right category"] = float(np.mean([row["right category"] for row in rows]))
    out["categories"] = {
        name: {
            method: float(np.mean(values))
            for method in METHODS
            if (
                values := [
                    row[method]
                    for row in rows
                    if row["category"] == name and row[method] is not None
                ]
            )
        }
        for name in sorted({row["category"] for row in rows})
    }
    return out


def main() -> None:
    """Measure all objects and print the summary."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--data", type=Path, required=True, help="folder with assets.json")
    parser.add_argument("--index", type=Path, required=True, help="folder of the index")
    parser.add_argument(
        "--half",
        choices=["development", "published"],
        default="development",
        help="half of the objects",
    )
    parser.add_argument("--count", type=int, default=40, help="number of objects")
    parser.add_argument("--exclude", nargs="*", default=[], help="further ids to leave out")
    parser.add_argument("--background", action="store_true", help="textured background")
    parser.add_argument("--json", action="store_true", help="print the result as JSON")
    flags = parser.parse_args()
    dataset = open_dataset(str(flags.data / "assets.json"), flags.data)
    index = build(dataset, dataset.ids(), flags.index)
    rows = []
    for k, object_id in enumerate(images(dataset, flags.half, flags.count)):
        row = measure(dataset, index, object_id, FIRST_SEED + k, flags.background, flags.exclude)
        rows.append(row)
        sys.stderr.write(f"{json.dumps(row)}\n")
    result = {"half": flags.half, "summary": summary(rows), "rows": rows}
    print(json.dumps(result if flags.json else result["summary"], indent=1))


if __name__ == "__main__":
    main()
