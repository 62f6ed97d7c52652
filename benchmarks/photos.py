"""Objects from one image with nothing else given: category, proportions, openable parts.

    python benchmarks/photos.py --data data --kind rendered --half published --count 60 --json
    python benchmarks/photos.py --data data --kind rendered --library data/assets/partnet

``rendered``: PartNet-Mobility objects under unknown cameras before textured backgrounds;
``procedural``: generated objects of other seeds; ``photos``: the photos of ``--wild``. With
``--library`` the category is recognized by renders of a folder of PartNet-Mobility objects, without
the object itself.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import sys
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from articulate.benchmark.dataset import open_dataset
from articulate.benchmark.split import half
from articulate.cache import cache_folder
from articulate.errors import ArticulateError
from articulate.library.procedural.categories import CATEGORIES
from articulate.reconstruct.fitting.categories import USUAL
from articulate.reconstruct.fitting.propose import propose
from articulate.reconstruct.make_object import part_meshes
from articulate.reconstruct.proposal import ObjectProposal
from articulate.reconstruct.query import image_query
from articulate.reconstruct.recognition.library_index import LibraryIndex, open_index
from articulate.render.parts import joint_bounds
from articulate.render.raster import Pixels
from articulate.render.rendered_photo import render_photo
from articulate.statistics import wilson

KINDS = {
    "drawer": "drawer",
    "door": "door",
    "flap": "door",
    "sash": "door",
    "leaf": "door",
    "lid": "lid",
    "cap": "lid",
    "mouth": "lid",
    "screen": "lid",
    "shaft": "lid",
}
"""Openable part by a word of its name."""
PROCEDURAL = (
    "cabinet",
    "chest_of_drawers",
    "fridge",
    "microwave",
    "oven",
    "dishwasher",
    "table_with_drawers",
)


@dataclass(frozen=True, kw_only=True)
class Item:
    """Image with its truth."""

    name: str
    category: str
    image: Pixels
    parts: Counter[str]
    """Number of openable parts of each kind."""
    proportions: tuple[float, float] | None
    """Width and depth over height, if known."""


def openable(names: list[str]) -> Counter[str]:
    """Count the openable parts by words of their names."""
    found: Counter[str] = Counter()
    for name in names:
        kind = next((k for word, k in KINDS.items() if word in name), None)
        if kind:
            found[kind] += 1
    return found


def rendered(data: Path, chosen: str, count: int) -> Iterator[Item]:
    """Yield renders of PartNet-Mobility objects of one half."""
    dataset = open_dataset(str(data / "assets.json"), data)
    ids = [i for i in dataset.ids() if half(i) == chosen and dataset.category(i) in USUAL]
    ids.sort(key=lambda i: hashlib.sha256(i.encode()).hexdigest())
    for k, object_id in enumerate(ids[:count]):
        true = dataset.load(object_id)
        low, high = joint_bounds(true.parts)
        depth, width, height = high - low
        photo = render_photo(true.parts, 5000 + k, occluded=k % 3 == 2)
        yield Item(
            name=object_id,
            category=true.category,
            image=photo.image,
            parts=openable([true.labels.get(j.joint.part, "") for j in true.joints]),
            proportions=(float(width / height), float(depth / height)),
        )


def procedural(chosen: str, count: int) -> Iterator[Item]:
    """Yield renders of generated objects; seeds from 2000 are published."""
    first = 2000 if chosen == "published" else 1
    for k in range(count):
        name, seed = PROCEDURAL[k % len(PROCEDURAL)], first + k
        category = CATEGORIES[name]
        parts = category.parts(seed)
        meshes = [
            mesh.with_vertices(mesh.vertices * [-1.0, -1.0, 1.0])  # front at +x
            for mesh in part_meshes(parts, category.palette)
        ]
        low, high = joint_bounds(meshes)
        depth, width, height = high - low
        photo = render_photo(meshes, 9000 + seed)
        yield Item(
            name=f"{name}:{seed}",
            category=category.partnet,
            image=photo.image,
            parts=openable([part.name for part in parts[1:]]),
            proportions=(float(width / height), float(depth / height)),
        )


def photos(wild: Path, chosen: str) -> Iterator[Item]:
    """Yield the real photos of one half."""
    for entry in json.loads((wild / "wild.json").read_text(encoding="utf-8"))["items"]:
        if entry["kind"] != "photo" or half(entry["id"]) != chosen:
            continue
        image = image_query(wild / entry["file"]).image
        assert image is not None
        parts: Counter[str] = Counter()
        for part in entry["truth"]["parts"]:
            kinds = openable([part["part"]])
            for kind in kinds:
                parts[kind] += part["count"]
        yield Item(
            name=entry["id"],
            category=entry["truth"]["category"],
            image=image,
            parts=parts,
            proportions=None,
        )


def score(item: Item, hinted: bool, library: LibraryIndex | None) -> dict[str, Any]:
    """Return the outcome of one image."""
    start = time.process_time()
    row: dict[str, Any] = {"name": item.name, "category": item.category}
    try:
        others = library and library.without({item.name.removeprefix("partnet_")})
        hints = {item.category: 1.0} if hinted else None
        found = propose(item.image, hints=hints, library=others)
    except ArticulateError as error:
        return {**row, "error": str(error), "seconds": time.process_time() - start}
    row["seconds"] = time.process_time() - start
    row |= _compare(item, found)
    return row


def _compare(item: Item, found: ObjectProposal) -> dict[str, Any]:
    ranked = list(next(s for s in found.trace if s.title == "Object and category").figures)
    parts = openable([part.name for part in found.parts])
    row: dict[str, Any] = {
        "found": found.category,
        "top1": found.category == item.category,
        "top5": item.category in ranked[:5],
        "confidence": round(found.confidence, 3),
        "doubtful": bool(found.doubts),
        "evidence": _evidence(found),
        "parts": dict(parts),
        "true_parts": dict(item.parts),
        "count": sum(parts.values()) == sum(item.parts.values()),
        "kinds": parts == item.parts,
    }
    if item.proportions is not None:
        figures = next(s for s in found.trace if s.title == "Box and camera").figures
        pair = (figures["width over height"], figures["depth over height"])
        errors = [abs(a / b - 1.0) for a, b in zip(pair, item.proportions, strict=True)]
        row["errors"] = [round(e, 3) for e in errors]
        row["proportions"] = max(errors) <= 0.15
    return row


def _evidence(found: ObjectProposal) -> dict[str, float | None]:
    """Return the arguments of ``fitting.confidence.Evidence``."""
    figures = next(s for s in found.trace if s.title == "Confidence").figures
    return {
        "category": figures["category"],
        "parts": figures.get("parts of the front"),
    }


def summary(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Return the share of right answers with its 95 % Wilson interval."""
    out: dict[str, Any] = {"images": len(rows), "errors": sum("error" in r for r in rows)}
    for name in ("top1", "top5", "count", "kinds", "proportions"):
        known = [bool(row.get(name, False)) for row in rows]
        share = wilson(sum(known), len(known))
        out[name] = {"share": share.value, "interval": [share.low, share.high]}
    sure = [row for row in rows if row.get("doubtful") is False]
    right = [row["top1"] and row["kinds"] for row in sure]
    out["not_doubtful"] = len(sure)
    out["precision"] = float(np.mean(right)) if right else None
    out["seconds_median"] = float(np.median([row["seconds"] for row in rows]))
    return out


def main() -> None:
    """Score all images and print the summary."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n\n")[0])
    parser.add_argument("--data", type=Path, help="folder with assets.json")
    parser.add_argument("--wild", type=Path, help="folder with wild.json and photos/")
    parser.add_argument("--kind", choices=["rendered", "procedural", "photos"], required=True)
    parser.add_argument("--half", choices=["development", "published"], default="development")
    parser.add_argument("--count", type=int, default=60)
    parser.add_argument("--category-given", action="store_true", help="give the true category")
    parser.add_argument("--library", type=Path, help="folder of PartNet-Mobility objects")
    parser.add_argument("--json", action="store_true", help="print the result as JSON")
    flags = parser.parse_args()
    if flags.kind == "photos":
        items = photos(flags.wild, flags.half)
    elif flags.kind == "rendered":
        items = rendered(flags.data, flags.half, flags.count)
    else:
        items = procedural(flags.half, flags.count)
    library = open_index(flags.library, cache_folder()) if flags.library else None
    rows = []
    for item in items:
        rows.append(score(item, flags.category_given, library))
        sys.stderr.write(f"{json.dumps(rows[-1])}\n")
    result = {"kind": flags.kind, "half": flags.half, "summary": summary(rows), "rows": rows}
    print(json.dumps(result, indent=1) if flags.json else json.dumps(result["summary"], indent=1))


if __name__ == "__main__":
    main()
