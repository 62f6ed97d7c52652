"""Part masks from a file: the part of each triangle of the input."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from articulate.errors import ConfigError, quote, shorten
from articulate.formats.mesh_file import load_scene
from articulate.npz_file import read_npz
from articulate.reconstruct.actors.protocol import PredictedJoint
from articulate.reconstruct.scan.panels import THIN
from articulate.reconstruct.scan.part_proposal import PartProposal
from articulate.reconstruct.scan.read_scan import Scan
from articulate.reconstruct.scan.scan_mesh import ScanMesh
from articulate.transforms import Array, Ints
from articulate.untrusted import load_json_object, read_bounded

MAX_BYTES = 50_000_000
"""Largest file of masks."""
MAX_PARTS = 200
"""Most parts of a file of masks."""
FACING, OUTSIDE = 0.7, 0.6
"""Component of a normal to the front, and the share of a part that faces it at least, of parts of
which only the outer surface is known."""
OUTERMOST = 0.7
"""Quantile of the depths of a front: above the walls of gaps, below the handles."""


def read_masks(path: Path, scan: Scan, mesh_file: Path) -> list[tuple[str, Ints]]:
    """Read the name and faces (K,) of each masked part, as faces of ``scan.mesh``.

    The file is an ``.npz`` with an integer array ``labels`` (N,), 0 for the body, and optionally
    ``names``; or a JSON object with ``labels`` or with ``parts``, a list of objects with ``name``
    and ``faces``. N is the number of triangles of the mesh file, in its order.

    Raises:
        ConfigError: The file cannot be read, or does not belong to the mesh.
    """
    centres = _input_centres(mesh_file)
    labels, names = _labels(path, len(centres))
    if not (labels > 0).any():
        raise ConfigError(f"--masks {shorten(path)}: marks no part; every label is 0")
    near = np.asarray(cKDTree(centres).query(scan.file_centres)[1])
    of_face = labels[near]
    found = [
        (name, np.flatnonzero(of_face == k + 1))
        for k, name in enumerate(names)
        if (of_face == k + 1).any()
    ]
    if not (of_face == 0).any():
        raise ConfigError(f"--masks {shorten(path)}: marks every triangle; leave the body at 0")
    return found


def skin(
    mesh: ScanMesh, faces: Ints, joint: PredictedJoint | None, *, closed: bool = False
) -> PartProposal:
    """Return a masked part for the builder of cavities.

    A door or drawer of which the mask covers only the outer surface gets a panel: on a closed
    shell, nothing is behind it.

    Args:
        mesh: The object; its front is +x.
        faces: Faces of the part (K,).
        joint: Its joint; None for a fixed part.
        closed: The mesh is a closed shell, on which a part is outer surface, and gaps beside it.
    """
    slides = joint is not None and joint.kind == "prismatic"
    part = PartProposal(
        kind="drawer" if slides else "door",
        faces=faces,
        joint="fixed" if joint is None else joint.kind,
        axis=np.array([1.0, 0.0, 0.0] if joint is None else joint.axis_o),
        pivot=np.zeros(3) if joint is None else np.array(joint.pivot_o),
        upper=0.0,
        confidence=1.0,
    )
    facing = faces[mesh.normals[faces, 0] > FACING]
    front_slides = slides and abs(part.axis[0]) > FACING
    if part.joint in {"fixed", "continuous"} or slides != front_slides or not len(facing):
        return part
    x = mesh.triangles[..., 0]
    front = float(np.quantile(x[facing].mean(axis=1), OUTERMOST))
    deep = THIN * mesh.size[0]
    if closed and (slides or abs(part.axis[2]) > FACING):
        faces = faces[x[faces].min(axis=1) > front - deep]
        facing = faces[mesh.normals[faces, 0] > FACING]
    elif mesh.areas[facing].sum() < OUTSIDE * mesh.areas[faces].sum() or np.ptp(x[faces]) > deep:
        return part
    corners = mesh.triangles[facing].reshape(-1, 3)
    low, high = corners[:, 1:].min(axis=0), corners[:, 1:].max(axis=0)
    if mesh.areas[facing].sum() < OUTSIDE * float(np.prod(high - low)):
        return part
    panel = np.concatenate([low, high])
    return replace(part, faces=faces, panel=panel, front=front, hollow=True)


def _input_centres(path: Path) -> Array:
    """Return the centre of each triangle of the file, in its order (N, 3)."""
    scene = load_scene(path)
    found = []
    for node in scene.graph.nodes_geometry:
        transform, name = scene.graph[node]
        geometry = scene.geometry[name]
        if hasattr(geometry, "triangles_center"):
            centres = np.asarray(geometry.triangles_center, dtype=np.float64)
            found.append(centres @ transform[:3, :3].T + transform[:3, 3])
    return np.concatenate(found)


def _labels(path: Path, count: int) -> tuple[Ints, list[str]]:
    """Return the label of each triangle (N,), 0 for the body, and the name of each part."""
    suffix = path.suffix.lower()
    if suffix not in {".npz", ".json"}:
        raise ConfigError(f"--masks {shorten(path)}: must be an .npz or .json file")
    if suffix == ".npz":
        labels, names = _from_npz(path)
    else:
        content = load_json_object(path, limit_bytes=MAX_BYTES, error=ConfigError)
        if "parts" in content:
            return _from_parts(path, content["parts"], count)
        labels, names = content.get("labels"), content.get("names", [])
    try:
        array = np.asarray(labels)
        if array.dtype.kind not in "iu" or array.ndim != 1:
            raise ValueError("labels must be a list of integers")
    except ValueError as error:
        raise ConfigError(f"--masks {shorten(path)}: {shorten(error)}") from None
    if len(array) != count:
        raise ConfigError(
            f"--masks {shorten(path)}: has {len(array)} labels, and the mesh {count} triangles"
        )
    array = array.astype(np.int64)
    if array.min() < 0 or array.max() > MAX_PARTS:
        raise ConfigError(f"--masks {shorten(path)}: labels must lie in [0, {MAX_PARTS}]")
    return array, _names(path, names, int(array.max()))


def _from_npz(path: Path) -> tuple[Any, Any]:
    content = read_bounded(path, MAX_BYTES, error=ConfigError)
    try:
        arrays = read_npz(content, MAX_BYTES)
        names = arrays["names"].tolist() if "names" in arrays else []
        return arrays["labels"], names
    except (ValueError, KeyError) as error:
        raise ConfigError(
            f"--masks {shorten(path)}: cannot be read ({shorten(error)}); it holds labels, one "
            "integer for each triangle"
        ) from None


def _from_parts(path: Path, parts: Any, count: int) -> tuple[Ints, list[str]]:
    if not isinstance(parts, list) or not 1 <= len(parts) <= MAX_PARTS:
        raise ConfigError(f"--masks {shorten(path)}: parts must be a list of 1 to {MAX_PARTS}")
    labels = np.zeros(count, dtype=np.int64)
    names = []
    for k, part in enumerate(parts):
        faces = part.get("faces") if isinstance(part, dict) else part
        names.append(str(part.get("name", "part")) if isinstance(part, dict) else "part")
        if not isinstance(faces, list) or not all(
            isinstance(face, int) and not isinstance(face, bool) for face in faces
        ):
            raise ConfigError(f"--masks {shorten(path)}: the faces of part {k} are no integers")
        index = np.asarray(faces, dtype=np.int64)
        if len(index) and not 0 <= index.min() <= index.max() < count:
            raise ConfigError(
                f"--masks {shorten(path)}: part {k} names a triangle above {count - 1}, the last"
            )
        labels[index] = k + 1
    return labels, _names(path, names, len(names))


def _names(path: Path, names: Any, count: int) -> list[str]:
    """Return a name for each part; ``part`` where none is given."""
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        raise ConfigError(f"--masks {shorten(path)}: names must be a list of texts")
    known: Sequence[str] = [*names, *["part"] * count][:count]
    for name in known:
        if not (0 < len(name) <= 60 and name.isprintable()):
            raise ConfigError(f"--masks {shorten(path)}: the name {quote(name)} is not accepted")
    return list(known)
