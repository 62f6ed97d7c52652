"""Parts and joints of objects that are merged into one welded mesh, against the true ones.

python benchmarks/scans.py --data data --half development --limit 60
python benchmarks/scans.py --kitchen kitchen_cc_by/assets --half development --make
python benchmarks/scans.py --shells 10 --half development

``--data`` holds ``assets.json`` and its objects, of which those of PartNet-Mobility are used, or
with ``--others`` the URDFs of all other data sets;
``--kitchen`` is the folder of kitchen-assets-cc-by; ``--generated`` merges procedural objects
of all categories, ``--shells`` fuses depth images of some to closed surfaces; their seeds begin at
0 for development and at 1000 to publish. Each object is
written as one GLB without names, vertices merged at 1e-5 of the diagonal, and read as any scan.
``--make`` also writes and checks the asset. ``--masks`` gives the true part of each triangle,
``--view`` a rendered photo, or a video in which one joint is operated, by an unknown camera.
``--turned`` turns each object about the vertical, by a multiple of 90 degrees or by any angle, and
in the latter case also tilts it by up to 5 degrees; the angles depend on the hash of its id.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import statistics
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from articulate.benchmark.dataset import Dataset, LibraryDataset, open_dataset
from articulate.benchmark.operated_joint import Conditions
from articulate.benchmark.rendered_video import render_operated
from articulate.benchmark.split import half
from articulate.benchmark.truth import TrueObject, joints_in_urdf, true_object
from articulate.errors import UsageError
from articulate.formats.read_urdf import read_urdf
from articulate.library import ProceduralLibrary
from articulate.library.procedural.categories import CATEGORIES
from articulate.reconstruct.actors.protocol import PredictedJoint
from articulate.reconstruct.query import Query
from articulate.reconstruct.result import MakeRequest
from articulate.reconstruct.scan.make_scan import find_parts, make_scan, scan_parts, sized_by_masks
from articulate.reconstruct.scan.masks import read_masks, skin
from articulate.reconstruct.scan.part_proposal import PartProposal
from articulate.reconstruct.scan.read_scan import TURNS, Scan, ScanHints, read_scan, turned
from articulate.reconstruct.scan.scan_mesh import ScanMesh, weld
from articulate.reconstruct.scan.scan_parts import names_of
from articulate.reconstruct.scan.view_parts import add_view
from articulate.render.rendered_photo import render_photo
from articulate.transforms import Array, Ints
from scan_shells import fused_shell, nearest_part

FURNITURE = ("StorageFurniture", "Table", "Oven", "Dishwasher")
IOU = 0.5
"""Least overlap of areas of a matched part."""
AXIS_RAD = float(np.radians(15.0))
MOST_TILT_RAD = float(np.radians(5.0))
SIDE_SHARE = 0.3
"""Largest distance of two hinges, as a share of the part's size across the axis."""
TO_Y_UP = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
SHELLS = (
    *("cabinet", "chest_of_drawers", "table_with_drawers", "fridge", "microwave", "oven"),
    *("laptop", "trash_can", "bottle", "kitchen_pot"),
)
"""Categories of the closed shells."""
FIRST_PUBLISHED_SEED = 1000
HOW = Conditions(arm=1.0 / 3.0, person=0.0, tripod=0.0, other_joint=0.0, entire=True)
"""Conditions of the videos: the camera of rendered photos, hand-held, an arm in a third."""
CLASSES = {"revolute": "turn", "continuous": "turn", "prismatic": "slide"}


@dataclass(frozen=True, kw_only=True, eq=False)
class Merged:
    """An object as one mesh with the true part of each face."""

    mesh: ScanMesh
    part: Ints
    """Index of the true joint of each face (F,); -1 for the body."""


def merge(truth: TrueObject) -> Merged:
    """Weld the parts of an object into one mesh."""
    starts = np.cumsum([0, *(len(part.vertices) for part in truth.parts)])
    faces = [part.faces + start for part, start in zip(truth.parts, starts, strict=False)]
    owner = np.full(sum(len(part.faces) for part in truth.parts), -1, dtype=np.int64)
    at = 0
    for part in truth.parts:
        for k, joint in enumerate(truth.joints):
            if part.name in joint.rigid:
                owner[at : at + len(part.faces)] = k
        at += len(part.faces)
    mesh = weld(
        ScanMesh(
            vertices=np.concatenate([part.vertices for part in truth.parts]),
            faces=np.concatenate(faces),
            rgb=np.concatenate([part.rgb for part in truth.parts]),
            group=np.zeros(len(owner), dtype=np.int64),
        )
    )
    assert mesh.source is not None
    return Merged(mesh=mesh, part=owner[mesh.source])


def write(mesh: ScanMesh, path: Path) -> None:
    """Write a mesh as one GLB with y up, the front at +z, and a colour for each vertex."""
    rgba = np.c_[mesh.rgb, np.ones(len(mesh.rgb))]
    colours, of_face = np.unique(
        (255.0 * rgba).round().astype(np.uint8), axis=0, return_inverse=True
    )
    key = mesh.faces * len(colours) + of_face.ravel()[:, None]
    used, corners = np.unique(key, return_inverse=True)
    out = trimesh.Trimesh(
        mesh.vertices[used // len(colours)] @ TO_Y_UP.T,
        corners.reshape(-1, 3),
        vertex_colors=colours[used % len(colours)],
        process=False,
    )
    out.export(path)


def score(
    merged: Merged,
    truth: TrueObject,
    scan: Scan,
    found: Sequence[PartProposal],
    placed: ScanMesh,
) -> dict[str, Any]:
    """Return F1 at an area IoU of 0.5, and which joints of matched parts are right.

    ``placed`` is the merged mesh as it is in the file, in another pose.
    """
    mesh = scan.mesh
    centres = merged.mesh.triangles.mean(axis=1)
    in_file = placed.triangles.mean(axis=1) @ TO_Y_UP.T
    near = np.asarray(cKDTree(in_file).query(scan.file_centres)[1])
    part = merged.part[near]
    scale, rotation, shift = _similarity(centres[near], mesh.triangles.mean(axis=1))
    n_true, n_found = len(truth.joints), len(found)
    label = np.full(len(part), -1)
    for k, proposal in enumerate(found):
        label[proposal.faces] = k
    areas = mesh.areas
    both = (part >= 0) & (label >= 0)
    common = np.zeros((n_true, n_found))
    np.add.at(common, (part[both], label[both]), areas[both])
    of_true = np.bincount(part[part >= 0], areas[part >= 0], n_true)
    of_found = np.bincount(label[label >= 0], areas[label >= 0], n_found)
    iou = common / np.maximum(of_true[:, None] + of_found - common, 1e-12)
    joints, matched = [], 0
    while iou.size and iou.max() >= IOU:
        a, b = divmod(int(iou.argmax()), iou.shape[1])
        iou[a], iou[:, b] = -1.0, -1.0
        matched += 1
        if truth.joints[a].status != "compound":
            joint = _moved(truth.joints[a].joint, scale, rotation, shift)
            joints.append(_is_right(joint, found[b], mesh))
    seen = int((of_true > 0.0).sum())
    return {
        "true": seen,
        "found": n_found,
        "matched": matched,
        "f1": 2.0 * matched / max(seen + n_found, 1),
        "joints": joints,
    }


def _by_hash(mesh: ScanMesh, key: str, how: str) -> ScanMesh:
    """Turn a mesh about the vertical, and tilt it, by angles that depend on ``key``."""
    number = int(hashlib.sha256(key.encode()).hexdigest(), 16)
    if how == "quarters":
        return turned(mesh, TURNS[number % len(TURNS)])
    random = np.random.default_rng(number)
    yaw, direction, tilt = random.uniform([-np.pi, -np.pi, 0.0], [np.pi, np.pi, MOST_TILT_RAD])
    tilted = Rotation.from_rotvec(tilt * np.array([np.cos(direction), np.sin(direction), 0.0]))
    rotation = (tilted * Rotation.from_euler("z", yaw)).as_matrix()
    return mesh.transformed(rotation, 1.0, np.zeros(3))


def _similarity(source: Array, target: Array) -> tuple[float, Array, Array]:
    """Return scale, rotation and shift from ``source`` to ``target`` (N, 3)."""
    a, b = source - source.mean(axis=0), target - target.mean(axis=0)
    u, _, vt = np.linalg.svd(a.T @ b)
    sign = np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ vt))])
    rotation = (u @ sign @ vt).T
    scale = float(np.sqrt((b**2).sum() / max(float((a**2).sum()), 1e-300)))
    return scale, rotation, target.mean(axis=0) - scale * rotation @ source.mean(axis=0)


def _moved(joint: PredictedJoint, scale: float, rotation: Array, shift: Array) -> dict[str, Any]:
    axis = rotation @ np.asarray(joint.axis_o)
    return {
        "kind": joint.kind,
        "axis": axis / np.linalg.norm(axis),
        "pivot": scale * rotation @ np.asarray(joint.pivot_o) + shift,
    }


def _is_right(joint: dict[str, Any], found: PartProposal, mesh: ScanMesh) -> bool:
    """Return whether type, axis (undirected) and hinge side are right."""
    if CLASSES[joint["kind"]] != CLASSES[found.joint]:
        return False
    axis = joint["axis"]
    if abs(float(axis @ found.axis)) < np.cos(AXIS_RAD):
        return False
    if CLASSES[joint["kind"]] == "slide" or "continuous" in {joint["kind"], found.joint}:
        return True
    corners = mesh.triangles[found.faces].reshape(-1, 3)
    size = float(np.linalg.norm(np.ptp(corners - np.outer(corners @ axis, axis), axis=0)))
    offset = joint["pivot"] - found.pivot
    return bool(np.linalg.norm(offset - axis * (offset @ axis)) < SIDE_SHARE * size)


def objects(args: argparse.Namespace) -> Iterator[TrueObject]:
    """Yield the objects of the half, ordered by the SHA-256 of their id."""
    if args.shells or args.generated:
        library = ProceduralLibrary(2 * FIRST_PUBLISHED_SEED)
        categories = SHELLS if args.shells else sorted(CATEGORIES)
        dataset: Dataset = LibraryDataset("procedural", library)
        first = 0 if args.half == "development" else FIRST_PUBLISHED_SEED
        for k in range(args.skip, args.skip + (args.shells or args.generated)):
            category = categories[k % len(categories)]
            yield dataset.load(f"{category}-{first + k // len(categories):04d}")
        return
    if args.kitchen is not None:
        for path in sorted(args.kitchen.rglob("*.urdf")):
            if half(path.stem) == args.half:
                yield _of_urdf(path, path.stem, path.stem)
        return
    if args.others:
        yield from _others(args)
        return
    dataset = open_dataset(str(args.data / "assets.json"))
    ids = [i for i in dataset.ids() if i.startswith("partnet") and half(i) == args.half]
    ids.sort(key=lambda i: hashlib.sha256(i.encode()).hexdigest())
    for key in ids[args.skip : args.skip + args.limit]:
        yield dataset.load(key)


def _others(args: argparse.Namespace) -> Iterator[TrueObject]:
    """Yield the objects of other data sets with movable joints."""
    index = json.loads((args.data / "assets.json").read_text(encoding="utf-8"))["assets"]
    found = {entry["id"]: entry for entry in index if entry["format"] == "urdf"}
    ids = [i for i in found if not i.startswith("partnet") and half(i) == args.half]
    ids.sort(key=lambda i: hashlib.sha256(i.encode()).hexdigest())
    for key in ids[args.skip : args.skip + args.limit]:
        truth = _of_urdf(args.data / found[key]["path"], key, found[key]["category"])
        if truth.joints:
            yield truth


def _of_urdf(path: Path, object_id: str, category: str) -> TrueObject:
    """Read a URDF in metres with its own joints as the truth."""
    source = read_urdf(path)
    return true_object(
        source,
        joints_in_urdf(source),
        object_id=object_id,
        category=category,
        labels={},
        in_metres=False,
    )


def measure(truth: TrueObject, args: argparse.Namespace, folder: Path) -> dict[str, Any]:
    """Read, propose and score one object; make its asset with ``--make``."""
    merged = merge(truth)
    if args.shells:
        shell = fused_shell(merged.mesh)
        merged = Merged(mesh=shell, part=nearest_part(shell, merged.mesh, merged.part))
    path = folder / "scan.glb"  # a name may imply the category
    placed = merged.mesh
    if args.turned:
        placed = _by_hash(placed, truth.object_id, args.turned)
    write(placed, path)
    hints = ScanHints(text=truth.category if args.text else "")
    if args.masks:
        hints = replace(hints, masks=write_masks(merged, truth, folder / "masks.npz"))
    if args.view:
        hints = replace(hints, view=view_of(truth, args.view))
    start = time.monotonic()
    scan = read_scan(path, hints)
    if hints.masks is not None:
        masks = read_masks(hints.masks, scan, path)
        scan = sized_by_masks(scan, masks, hints)
        found = masked_parts(scan, path, hints)
    else:
        scan, found = find_parts(scan, hints)
    if hints.view is not None:
        found = list(add_view(scan.mesh, found, hints.view, smooth=scan.smooth).parts)
    row = {"id": truth.object_id, "category": truth.category, "faces": len(merged.mesh.faces)}
    row |= score(merged, truth, scan, found, placed)
    row["kinds"] = [proposal.kind for proposal in found]
    row["seconds"] = round(time.monotonic() - start, 2)
    if args.make:
        start = time.monotonic()
        try:
            request = MakeRequest(out=folder / "asset", cache=folder / "cache")
            result = make_scan(path, request, hints)
            row["verdict"], row["reasons"] = result.verdict, list(result.reasons)
        except UsageError as error:
            row["verdict"], row["reasons"] = "no parts", [str(error)]
        row["seconds"] = round(time.monotonic() - start, 2)
    return row


def view_of(truth: TrueObject, kind: str) -> Query | None:
    """Return a photo of the closed object, or a video in which one joint is operated.

    None if no camera shows the motion well.
    """
    if kind == "image":
        image = render_photo(truth.parts, 0).image
        return Query(modality="image", description="the image", image=image)
    found = render_operated(truth, 0, conditions=HOW)
    if found is None:
        return None
    video = found.video
    return Query(
        modality="video", description="the video", video=video.frames, times_s=video.times_s
    )


def write_masks(merged: Merged, truth: TrueObject, path: Path) -> Path:
    """Write the true part of each triangle, named as in the source."""
    names = [truth.labels.get(joint.joint.part, joint.joint.part) for joint in truth.joints]
    np.savez(path, labels=merged.part + 1, names=np.array(names or ["part"]))
    return path


def masked_parts(scan: Scan, path: Path, hints: ScanHints) -> list[PartProposal]:
    """Return the joints that were found for masks, with the faces of their parts."""
    assert hints.masks is not None
    named = read_masks(hints.masks, scan, path)
    joints = {joint.part: joint for joint in scan_parts(scan, path, hints).joints}
    names = names_of([name for name, _ in named])
    found = [(joints.get(name), faces) for name, (_, faces) in zip(names, named, strict=True)]
    return [
        skin(scan.mesh, faces, joint)
        for joint, faces in found
        if joint is not None and joint.kind != "fixed"
    ]


def summary(rows: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Return macro F1, right joints, verdicts and time."""
    joints = [right for row in rows for right in row["joints"]]
    furniture = [row["f1"] for row in rows if row["category"] in FURNITURE]
    by_category: dict[str, list[float]] = {}
    for row in rows:
        by_category.setdefault(row["category"], []).append(row["f1"])
    found: dict[str, Any] = {
        "objects": len(rows),
        "macro_f1": round(statistics.mean(row["f1"] for row in rows), 3),
        "macro_f1_furniture": round(statistics.mean(furniture), 3) if furniture else None,
        "furniture": len(furniture),
        "joints_right": round(statistics.mean(joints), 3) if joints else None,
        "joints": len(joints),
        "median_s": round(statistics.median(row["seconds"] for row in rows), 2),
        "by_category": {
            k: [round(statistics.mean(v), 2), len(v)] for k, v in sorted(by_category.items())
        },
    }
    verdicts = [row["verdict"] for row in rows if "verdict" in row]
    if verdicts:
        found["verdicts"] = {name: verdicts.count(name) for name in sorted(set(verdicts))}
        found["exact_and_passed"] = sum(
            row["matched"] == row["true"] == row["found"]
            and all(row["joints"])
            and row["verdict"] in {"passed", "doubtful"}
            for row in rows
        )
    return found


def main(argv: Sequence[str] | None = None) -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--data", type=Path, help="folder with assets.json")
    parser.add_argument("--kitchen", type=Path, help="folder of kitchen-assets-cc-by")
    parser.add_argument("--others", action="store_true", help="objects of other data sets")
    parser.add_argument("--generated", type=int, default=0, help="number of procedural objects")
    parser.add_argument("--shells", type=int, default=0, help="number of closed shells")
    parser.add_argument(
        "--half",
        choices=("development", "published"),
        default="development",
        help="half of the objects",
    )
    parser.add_argument("--limit", type=int, default=60, help="number of objects")
    parser.add_argument("--skip", type=int, default=0, help="objects to leave out at the start")
    parser.add_argument("--text", action="store_true", help="give the category as text")
    parser.add_argument("--view", choices=("image", "video"), help="show the object")
    parser.add_argument("--masks", action="store_true", help="give the true parts as masks")
    parser.add_argument("--turned", choices=("quarters", "any"), help="do not keep the front at +x")
    parser.add_argument("--make", action="store_true", help="write and check the assets")
    parser.add_argument("--json", action="store_true", help="print all rows as JSON")
    args = parser.parse_args(argv)
    sources = (args.data is not None, args.kitchen is not None, args.shells > 0, args.generated > 0)
    if sum(sources) != 1:
        parser.error("give one of --data, --kitchen, --generated and --shells")
    rows = []
    for truth in objects(args):
        with tempfile.TemporaryDirectory() as folder:
            rows.append(measure(truth, args, Path(folder)))
        if not args.json:
            print(_line(rows[-1]), flush=True)
    found = summary(rows)
    print(json.dumps({"summary": found, "rows": rows} if args.json else found, indent=2))
    return 0


def _line(row: dict[str, Any]) -> str:
    right = f"{sum(row['joints'])}/{len(row['joints'])}"
    kinds = " ".join(row["kinds"][:8])
    text = f"{row['id']:22} {row['category'][:14]:14} F1 {row['f1']:.2f} "
    text += f"{row['matched']} of {row['true']} joints {right:6} {row['seconds']:6.1f} s  {kinds}"
    return f"{text}  {row['verdict']} {row['reasons']}" if "verdict" in row else text


if __name__ == "__main__":
    raise SystemExit(main())
