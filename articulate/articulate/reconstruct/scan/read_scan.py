"""Read one mesh file: weld it, turn it upright, and scale it to metres."""

from __future__ import annotations

import io
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np
import trimesh

from articulate.conversion.metric_size import (
    LEAST_M,
    LONGEST_SIDE_M,
    MOST_M,
    OTHER_M,
    UNITS_M,
    likely_unit,
)
from articulate.errors import AssetError, shorten
from articulate.formats.load_meshes import GREY
from articulate.formats.mesh_file import FORMATS, MAX_BYTES, READ_BYTES
from articulate.reconstruct.mesh_groups import groups_of
from articulate.reconstruct.part_set import FROM_Y_UP, QUARTERS, Front, Up
from articulate.reconstruct.query import Query
from articulate.reconstruct.scan.alignment import aligned
from articulate.reconstruct.scan.cells import components, edges_of
from articulate.reconstruct.scan.scan_mesh import ScanMesh, weld
from articulate.transforms import Array, Ints
from articulate.untrusted import memory_limit, read_bounded

SCENES = (".glb", ".gltf")
LEAST_FACES = 12
"""A box has 12 triangles; fewer show no object with parts."""
MANY_FACES = 200_000
"""Meshes with more triangles are simplified."""
COARSE_SHARE = 1.0 / 600.0
"""Side of the cells to which the vertices of a large mesh are merged, a share of the diagonal."""
ONE_SURFACE = 0.5
"""Least area of the largest surface of the mesh of a scanner, as a share."""
DENSE_FACES, DENSE_SIDE = 30_000, 0.02
"""Meshes of scanners have more triangles, all smaller than this share of the diagonal."""
SMOOTHINGS, LARGEST_MOVE = 12, 0.0015
"""Steps of the filter against noise, and the largest motion of a corner, as a share of the
diagonal: the filter deforms thin bars."""
FLAT_SHARE = 1e-3
"""Smallest side of an object, as a share of its largest."""
APART = 0.25
"""Gap between two objects, as a share of the diagonal of the larger one."""
LARGE = 0.3
"""Diagonal of a second object, as a share of that of the first one."""
LIKELY = 1.6
"""Largest ratio of the size in the file to that usual for the category, and its inverse."""
MAX_CLUSTERS = 300
"""Most connected surfaces whose gaps are measured; smaller ones are ignored."""
TURNS: tuple[Front, ...] = ("x", "y", "-y", "-x")


@dataclass(frozen=True, kw_only=True)
class ScanHints:
    """Facts about a mesh that its file does not contain."""

    up: Up = "auto"
    """Upward axis of the file; ``auto``: y for a GLB or glTF file, z for all others."""
    front: Front | Literal["auto"] = "auto"
    """Direction of the front after ``up`` is applied; ``auto``: where most front panels are."""
    text: str = ""
    """Description, such as "a cabinet with two doors"."""
    height_m: float | None = None
    """Height [m]; None: as in the file, or usual for the category."""
    masks: Path | None = None
    """File with a part for each face; None: the parts are found."""
    view: Query | None = None
    """Video that begins or ends with the object closed, or image of the closed object."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Scan:
    """A mesh in metres, upright, with the assumptions that this took."""

    name: str
    mesh: ScanMesh
    """Frame ``o``: z up, standing on z = 0, centred at x = y = 0 [m]."""
    file_centres: Array
    """Centre of each face in the frame and unit of the file (F, 3)."""
    category: str = "unknown"
    smooth: bool = False
    """True for a dense surface as of a scanner, whose noise was removed."""
    assumptions: tuple[str, ...] = ()


def read_scan(path: Path, hints: ScanHints) -> Scan:
    """Read the mesh of an object.

    Raises:
        AssetError: It cannot be read, is no single object, or has too few triangles.
    """
    mesh = _read(path)
    n_input = len(mesh.faces)
    _check(path, mesh)
    assumptions = []
    if n_input > MANY_FACES:
        mesh = weld(mesh, COARSE_SHARE)
        assumptions.append(f"{n_input} triangles were simplified to {len(mesh.faces)}")
    else:
        mesh = weld(mesh)
    if len(mesh.faces) < LEAST_FACES:
        raise AssetError(_too_few(path, len(mesh.faces)))
    _check_single(path, mesh)
    smooth = _is_dense(mesh)
    if smooth:
        mesh = _smoothed(mesh)
        assumptions.append("the noise of the surface was smoothed")
    file_centres = mesh.triangles.mean(axis=1)
    y_up = hints.up == "y" or (hints.up == "auto" and path.suffix.lower() in SCENES)
    rotation = FROM_Y_UP if y_up else np.eye(3)
    mesh = mesh.transformed(rotation, 1.0, np.zeros(3))
    if hints.up == "auto":
        assumptions.append(f"the axis {'y' if y_up else 'z'} of the file is up; --up changes this")
    if hints.front != "auto":
        mesh = turned(mesh, hints.front)
    mesh, change = aligned(mesh)
    if change:
        assumptions.append(change)
    category = category_in(hints.text)
    scale, reason = scale_of(mesh, category, hints.height_m)
    if reason:
        assumptions.append(reason)
    mesh = standing(mesh.transformed(np.eye(3), scale, np.zeros(3)))
    return Scan(
        name=re.sub(r"\W+", "_", path.stem).strip("_") or "scan",
        mesh=mesh,
        file_centres=file_centres,
        category=category,
        smooth=smooth,
        assumptions=tuple(assumptions),
    )


def _is_dense(mesh: ScanMesh) -> bool:
    """Return whether most of a mesh is one surface of small triangles, as those of scanners are."""
    if len(mesh.faces) < DENSE_FACES:
        return False
    side = np.sqrt(np.quantile(mesh.areas, 0.99))
    if side > DENSE_SIDE * mesh.diagonal:
        return False
    shells = components(mesh, edges_of(mesh), colour=False)
    return bool(shells.area.max() > ONE_SURFACE * shells.area.sum())


def _smoothed(mesh: ScanMesh) -> ScanMesh:
    """Return the mesh with its noise removed, by Taubin's filter, which keeps the volume."""
    surface = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    trimesh.smoothing.filter_taubin(surface, iterations=SMOOTHINGS)
    move = np.asarray(surface.vertices, dtype=np.float64) - mesh.vertices
    length = np.linalg.norm(move, axis=1, keepdims=True)
    move *= np.minimum(1.0, LARGEST_MOVE * mesh.diagonal / np.maximum(length, 1e-12))
    return replace(mesh, vertices=mesh.vertices + move)


def turned(mesh: ScanMesh, front: Front) -> ScanMesh:
    """Return the mesh turned about z so that ``front`` becomes +x."""
    c, s = [(1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0)][QUARTERS[front]]
    return mesh.transformed(
        np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]), 1.0, np.zeros(3)
    )


def standing(mesh: ScanMesh) -> ScanMesh:
    """Return the mesh on z = 0, centred at x = y = 0."""
    centre = mesh.bounds.mean(axis=0)
    return mesh.transformed(np.eye(3), 1.0, np.array([-centre[0], -centre[1], -mesh.bounds[0, 2]]))


def category_in(text: str) -> str:
    """Return PartNet-Mobility's category that a text names, or ``unknown``."""
    words = re.sub(r"[^a-z]", "", text.lower())
    others = {"cabinet": "StorageFurniture", "drawers": "StorageFurniture", "desk": "Table"}
    others |= {
        "fridge": "Refrigerator",
        "bin": "TrashCan",
        "stove": "Oven",
        "cupboard": "StorageFurniture",
    }
    names = {key.lower(): key for key in LONGEST_SIDE_M} | others
    found = [name for name in names if name in words]
    return names[max(found, key=len)] if found else "unknown"


def _read(path: Path) -> ScanMesh:
    if path.suffix.lower() not in FORMATS:
        raise AssetError(f"{shorten(path)}: not a mesh file; {', '.join(FORMATS)} are accepted")
    try:
        exists = path.is_file()
    except OSError as error:
        raise AssetError(f"{shorten(path)}: cannot be read ({error.strerror})") from None
    if not exists:
        raise AssetError(f"{shorten(path)}: no such file; give a mesh, e.g. a .glb")
    groups = groups_of(path)
    if path.suffix.lower() != ".msh":
        _check_finite(path)
    names = tuple(dict.fromkeys(name for name, _, _ in groups))
    starts = np.cumsum([0, *(len(mesh.vertices) for _, mesh, _ in groups)])
    return ScanMesh(
        vertices=np.concatenate([np.asarray(m.vertices, dtype=np.float64) for _, m, _ in groups]),
        faces=np.concatenate(
            [np.asarray(m.faces) + s for (_, m, _), s in zip(groups, starts, strict=False)]
        ).astype(np.int64),
        rgb=np.concatenate([_colours(mesh, rgba) for _, mesh, rgba in groups]),
        group=np.concatenate(
            [np.full(len(m.faces), names.index(name), dtype=np.int64) for name, m, _ in groups]
        ),
        names=names,
    )


def _colours(mesh: trimesh.Trimesh, rgba: tuple[float, ...] | None) -> Array:
    return np.tile(
        np.array((GREY if rgba is None else rgba)[:3], dtype=np.float64), (len(mesh.faces), 1)
    )


def _check_finite(path: Path) -> None:
    """Reject a file with corners that are not numbers."""
    bad = total = 0
    with memory_limit(READ_BYTES):
        content = io.BytesIO(read_bounded(path, MAX_BYTES, error=AssetError))
        options = {"process": False, "skip_materials": True}
        scene = trimesh.load_scene(content, file_type=path.suffix.lower()[1:], **options)
    for geometry in scene.geometry.values():
        vertices = np.asarray(geometry.vertices, dtype=np.float64)
        bad += int((~np.isfinite(vertices).all(axis=-1)).sum())
        total += len(vertices)
    if bad:
        raise AssetError(
            f"{shorten(path)}: {bad} of {total} corners are not finite numbers; export it again"
        )


def _too_few(path: Path, count: int) -> str:
    return (
        f"{shorten(path)}: has {count} triangle{'s' * (count != 1)}; an object with parts has at "
        f"least {LEAST_FACES}"
    )


def _check(path: Path, mesh: ScanMesh) -> None:
    if len(mesh.faces) < LEAST_FACES:
        raise AssetError(_too_few(path, len(mesh.faces)))
    if mesh.size.min() < FLAT_SHARE * mesh.size.max():
        size = " x ".join(f"{side:.3g}" for side in mesh.size)
        raise AssetError(f"{shorten(path)}: is flat ({size}); give the mesh of an entire object")


def _check_single(path: Path, mesh: ScanMesh) -> None:
    """Reject a mesh of several objects that are apart from each other."""
    boxes = _surface_boxes(mesh)
    order = np.argsort(-np.linalg.norm(boxes[:, 1] - boxes[:, 0], axis=1), kind="stable")
    clusters = [boxes[k] for k in order[:MAX_CLUSTERS]]
    merged = True
    while merged:
        merged = False
        for k in range(len(clusters)):
            for j in range(k + 1, len(clusters)):
                larger = max(_diagonal(clusters[k]), _diagonal(clusters[j]))
                if _gap(clusters[k], clusters[j]) < APART * larger:
                    clusters[k] = np.stack([
                        np.minimum(clusters[k][0], clusters[j][0]),
                        np.maximum(clusters[k][1], clusters[j][1]),
                    ])  # fmt: skip
                    del clusters[j]
                    merged = True
                    break
            if merged:
                break
    clusters.sort(key=_diagonal, reverse=True)
    large = [box for box in clusters if _diagonal(box) > LARGE * _diagonal(clusters[0])]
    if len(large) > 1:
        gap = min(_gap(large[0], other) for other in large[1:])
        raise AssetError(
            f"{shorten(path)}: contains {len(large)} objects apart from each other (gap "
            f"{gap:.3g}); give a mesh of one object"
        )


def _surface_boxes(mesh: ScanMesh) -> Array:
    """Return the boxes of the surfaces that share no vertex (C, 2, 3)."""
    pairs = np.concatenate([mesh.faces[:, [0, 1]], mesh.faces[:, [1, 2]]])
    label = trimesh.graph.connected_component_labels(pairs, node_count=len(mesh.vertices))
    used = np.unique(mesh.faces)
    _, label = np.unique(label[used], return_inverse=True)
    count = int(label.max()) + 1
    low, high = np.full((count, 3), np.inf), np.full((count, 3), -np.inf)
    np.minimum.at(low, label.ravel(), mesh.vertices[used])
    np.maximum.at(high, label.ravel(), mesh.vertices[used])
    return np.stack([low, high], axis=1)


def _diagonal(box: Array) -> float:
    return float(np.linalg.norm(box[1] - box[0]))


def _gap(one: Array, other: Array) -> float:
    return float(np.linalg.norm(np.maximum(0.0, np.maximum(other[0] - one[1], one[0] - other[1]))))


def scale_of(mesh: ScanMesh, category: str, height_m: float | None) -> tuple[float, str]:
    """Return the factor to metres, and the assumption behind it."""
    longest = float(mesh.size.max())
    if height_m is not None:
        return height_m / float(mesh.size[2]), ""
    typical = LONGEST_SIDE_M.get(category)
    if typical is not None and not typical / LIKELY <= longest <= LIKELY * typical:
        return typical / longest, (
            f"the longest side is {typical:g} m, as usual for {category}; --size sets the height"
        )
    if LEAST_M * 10.0 <= longest <= MOST_M / 2.0:
        return 1.0, f"the file is in metres: its longest side is {longest:.2f} m; --size changes it"
    unit = likely_unit(longest, typical)
    if unit is not None:
        size_m = UNITS_M[unit] * longest
        return UNITS_M[unit], (
            f"the file is in {unit}: its longest side is {size_m:.2f} m; --size changes it"
        )
    return OTHER_M / longest, (
        f"the unit of the file is unknown ({longest:.3g} long): its longest side is set to "
        f"{OTHER_M:g} m; --size changes it"
    )


def groups_by_name(mesh: ScanMesh) -> Sequence[tuple[str, Ints]]:
    """Return the faces of each named mesh of the file."""
    return [(name, np.flatnonzero(mesh.group == k)) for k, name in enumerate(mesh.names)]
