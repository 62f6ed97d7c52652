"""Parts of an object for actors and programs, without joints.

All parts are in one frame ``o``: z is up, the front is +x. Parts of a library are moved to stand on
z = 0, as in the benchmark; parts of the user keep their positions.
"""

from __future__ import annotations

import json
import re
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Literal

import numpy as np
import trimesh

from articulate.conversion.metric_size import category_of, is_normalised
from articulate.conversion.provenance import ORIGIN_FILE
from articulate.errors import AssetError, UsageError, shorten
from articulate.formats.config import ConvertConfig
from articulate.formats.load_meshes import Piece
from articulate.formats.orient_collada import make_loader
from articulate.formats.part_names import plain_label, semantic_names
from articulate.formats.read_urdf import read_urdf
from articulate.library import PartNetLibrary, ProceduralLibrary
from articulate.library.partnet import URDF_NAME
from articulate.reconstruct.actors.protocol import TraceStep
from articulate.reconstruct.link_meshes import (
    HALF_TURN,
    link_pieces,
    link_poses,
    merge_pieces,
)
from articulate.reconstruct.mesh_groups import groups_of
from articulate.reconstruct.program.program_parts import (
    Parts,
    ProgramPart,
    check_name,
    mesh_files,
    parts_of,
    rgba_of,
)
from articulate.render.parts import PartMesh, joint_bounds
from articulate.transforms import Array, pose
from articulate.untrusted import load_json_object

Pieces = dict[str, tuple[Piece, ...]]
Up = Literal["auto", "z", "y"]
Front = Literal["x", "-x", "y", "-y"]
SCENES = (".glb", ".gltf")
"""Formats with several named parts in a file."""
FROM_Y_UP = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
"""Rotation from glTF, which has y up and its front along +z."""
QUARTERS: Mapping[Front, int] = {"x": 0, "y": 3, "-x": 2, "-y": 1}
"""Quarter turns about z that turn a front to +x."""
MAX_GAP = 0.5
"""Largest gap between a part and all others, as a share of their diagonal."""
MAX_SIZE_RATIO = 300.0
"""Largest ratio of the diagonals of two parts in the same unit."""


@dataclass(frozen=True, kw_only=True, eq=False)
class PartSet:
    """Placed parts and their origin."""

    name: str
    """Name of the object."""
    meshes: tuple[PartMesh, ...]
    """Parts for actors: triangles in ``o``."""
    parts: Parts
    """The same parts for programs."""
    labels: Mapping[str, str]
    """Label of each part by name, without words that reveal a joint."""
    kind: str = ""
    """Kind of object, for example ``washing machine``; empty if unknown."""
    category: str = "unknown"
    source: str = "unknown"
    licence: str = "unknown"
    normalised: bool = False
    """True if lengths are those of a data set that scales all objects to one size."""
    placed: bool = True
    """False if each part has the centre of its box at the origin."""
    aligned: bool = True
    """False if the parts are those of a similar object, which the camera of the query does not
    show."""
    trace: tuple[TraceStep, ...] = ()
    """Stages of the choice of the parts."""

    def with_placements(self, placements: Mapping[str, Array]) -> PartSet:
        """Return the parts moved by their poses (4, 4) in ``o``."""
        poses = {mesh.name: placements.get(mesh.name, np.eye(4)) for mesh in self.meshes}
        meshes = tuple(mesh.moved(poses[mesh.name]) for mesh in self.meshes)
        pieces = {
            n: tuple(p.moved(poses[n]) for p in part.pieces) for n, part in self.parts.items()
        }
        return replace(self, meshes=meshes, parts=_parts(pieces), placed=True)

    def write_origin(self, folder: Path) -> None:
        """Write the origin of the parts beside a URDF in ``folder``."""
        content = {"source": self.source, "licence": self.licence, "category": self.category}
        (folder / ORIGIN_FILE).write_text(json.dumps(content), encoding="utf-8")
        if self.normalised:
            meta = json.dumps({"model_cat": self.category})
            (folder / "meta.json").write_text(meta, encoding="utf-8")


def read_part_set(path: Path, *, up: Up = "auto", front: Front = "x") -> PartSet:
    """Read parts from a folder of meshes, a URDF, or a GLB.

    Args:
        path: A folder with one mesh for each part; a URDF, whose joints are set to 0; a GLB or glTF
            file with one named mesh for each part.
        up: Upward axis of the files; ``auto``: y for a GLB or glTF file, z for all others.
        front: Direction of the object's front, after ``up`` is applied.

    Raises:
        AssetError: There are no parts, or they do not belong together.
    """
    suffix = path.suffix.lower()
    try:
        exists = path.exists()
    except OSError as error:  # a name that is too long, a folder without permission
        where = shorten(path)
        raise AssetError(f"{where}: cannot be read ({error.strerror}); give another path") from None
    if not exists:
        raise AssetError(f"{path}: does not exist; give a folder of meshes, a URDF or a GLB")
    if path.is_file() and suffix not in {".urdf", *SCENES}:
        raise AssetError(f"{path}: must be a folder or a .urdf, .glb or .gltf file")
    is_scene = path.is_file() and suffix in SCENES
    T = _upright(up == "y" or (up == "auto" and is_scene), front)
    names = semantic_names(path.parent if path.is_file() else path)
    names |= _labels_file(path if path.is_dir() else path.parent)
    if is_scene:
        pieces = _named(groups_of(path))
    elif path.is_file():
        return _from_urdf(path, T, names)
    else:
        inside = sorted(path.glob("*.urdf"))
        if len(inside) == 1:
            return _from_urdf(inside[0], T, names)
        pieces = {
            name: tuple(
                Piece(name=name, mesh=mesh, rgba=rgba_of(rgba), link=name)
                for _, mesh, rgba in groups_of(file)
            )
            for name, file in _files(path).items()
        }
    name = path.stem if path.is_file() else path.resolve().name
    part_set = _part_set(name, pieces, T, names)
    return replace(part_set, source=path.name)


def library_part_set(name: str) -> PartSet:
    """Read the parts of a library's object, without its joints.

    Args:
        name: A procedural category with or without a seed (``cabinet``, ``cabinet:3``,
            ``cabinet-0003``), or the folder of a PartNet-Mobility object.

    Raises:
        AssetError: The object does not exist.
        UsageError: The folder contains no object.
    """
    folder = Path(name)
    try:
        is_folder = folder.is_dir()
    except OSError as error:
        raise AssetError(f"--library {shorten(name)}: cannot be read ({error.strerror})") from None
    if is_folder:
        return _partnet(folder)
    library = ProceduralLibrary()
    found = re.fullmatch(r"([^:]+):(\d{1,9})", name)
    if found:
        object_id = f"{found[1]}-{int(found[2]):04d}"
    elif ":" in name:
        raise UsageError(
            f"--library {shorten(name)}: the seed after the category is no number; "
            "give one, e.g. cabinet:3"
        )
    else:
        object_id = name if re.search(r"-\d+$", name) else f"{name}-0000"
    library.parse(object_id)
    with tempfile.TemporaryDirectory() as temporary:
        part_set = _on_floor(library.write(object_id, Path(temporary)))
    source, licence = f"{library.source} {object_id}", library.licence
    return replace(
        part_set,
        name=object_id.replace("-", "_"),
        kind=object_id.partition("-")[0].replace("_", " "),
        category=library.category(object_id),
        source=source,
        licence=licence,
    )


def separate_part_set(name: str, pieces: Pieces, *, source: str, licence: str) -> PartSet:
    """Create a part set whose parts are centred at the origin and are yet to be placed."""
    meshes = tuple(merge_pieces(n, found) for n, found in pieces.items())
    return PartSet(
        name=name,
        meshes=meshes,
        parts=_parts(pieces),
        labels={n: plain_label(n) for n in pieces},
        source=source,
        licence=licence,
        placed=False,
    )


def _partnet(folder: Path) -> PartSet:
    if not (folder / URDF_NAME).is_file():
        PartNetLibrary(folder)  # rejects a folder without objects
        raise AssetError(
            f"--library {folder}: contains several objects; give the folder of one of them, "
            "or let a model choose with --actor vlm"
        )
    library = PartNetLibrary(folder.resolve().parent)
    object_id = folder.resolve().name
    part_set = _on_floor(library.folder / object_id / URDF_NAME)
    return replace(
        part_set,
        name=f"object_{object_id}",
        kind=category_words(library.category(object_id)),
        category=library.category(object_id),
        source=f"{library.source} {object_id}",
        licence=library.licence,
        normalised=True,
    )


def _on_floor(urdf: Path) -> PartSet:
    """Read the links of a library's URDF, turned from -x to +x and moved to stand on z = 0."""
    part_set = _from_urdf(urdf, pose(np.zeros(3), HALF_TURN), semantic_names(urdf.parent))
    down = pose([0.0, 0.0, -float(joint_bounds(part_set.meshes)[0, 2])])
    pieces = {n: tuple(p.moved(down) for p in part.pieces) for n, part in part_set.parts.items()}
    return replace(
        part_set,
        parts=_parts(pieces),
        meshes=tuple(mesh.moved(down) for mesh in part_set.meshes),
    )


def _upright(y_up: bool, front: Front) -> Array:
    """Return the pose (4, 4) of the files' frame in ``o``."""
    rot = FROM_Y_UP if y_up else np.eye(3)
    k = QUARTERS[front]
    c, s = [(1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0)][k]
    return pose(np.zeros(3), np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]) @ rot)


def _files(folder: Path) -> dict[str, Path]:
    """Return the mesh files of a folder by name."""
    parts_of(folder)
    return mesh_files(folder)


def _labels_file(folder: Path) -> dict[str, str]:
    """Read labels by part from a ``labels.json`` in or beside the folder."""
    for path in (folder / "labels.json", folder.resolve().parent / "labels.json"):
        try:
            content = load_json_object(path)
        except UsageError:
            continue
        return {key: value for key, value in content.items() if isinstance(value, str)}
    return {}


def _named(groups: Sequence[tuple[str, trimesh.Trimesh, tuple[float, ...] | None]]) -> Pieces:
    """Group pieces by the names of a file's meshes."""
    found: dict[str, list[Piece]] = {}
    for name, mesh, rgba in groups:
        piece = Piece(name=name, mesh=mesh, rgba=rgba_of(rgba), link=name)
        found.setdefault(name, []).append(piece)
    return {name: tuple(pieces) for name, pieces in found.items()}


def _from_urdf(path: Path, T_os: Array, names: Mapping[str, str]) -> PartSet:
    source = read_urdf(path)
    poses = link_poses(source)
    loader = make_loader(source, ConvertConfig())
    pieces = {n: link_pieces(loader, source, n, poses[n]) for n in source.links}
    part_set = _part_set(path.stem, {n: p for n, p in pieces.items() if p}, T_os, names)
    category = category_of(path, ConvertConfig())
    return replace(
        part_set,
        source=path.name,
        kind=category_words(category),
        category=category,
        normalised=is_normalised(path),
    )


def _part_set(name: str, pieces: Pieces, T_os: Array, names: Mapping[str, str]) -> PartSet:
    for part in pieces:
        check_name(part)
    placed = {n: tuple(p.moved(T_os) for p in found) for n, found in pieces.items()}
    if len(placed) < 2:
        raise AssetError(
            f"{name}: {len(placed)} part{'s' * (len(placed) != 1)}; a joint needs two or more, "
            "one mesh for each part"
        )
    meshes = tuple(merge_pieces(n, found) for n, found in placed.items())
    _check_together(name, meshes)
    labels = {n: plain_label(names.get(n, n)) for n in placed}
    return PartSet(name=name, meshes=meshes, parts=_parts(placed), labels=labels)


def _parts(pieces: Mapping[str, tuple[Piece, ...]]) -> Parts:
    return Parts({n: ProgramPart(n, partial(tuple, found)) for n, found in pieces.items()})


def _check_together(name: str, meshes: Sequence[PartMesh]) -> None:
    """Check that the parts can be those of one placed object."""
    boxes = np.stack([mesh.bounds for mesh in meshes])
    diagonals = np.linalg.norm(boxes[:, 1] - boxes[:, 0], axis=-1)
    centres = boxes.mean(axis=1)
    large, small = int(np.argmax(diagonals)), int(np.argmin(diagonals))
    if diagonals[large] > MAX_SIZE_RATIO * diagonals[small]:
        raise AssetError(
            f"{name}: the parts do not belong together: {meshes[large].name} is "
            f"{diagonals[large] / diagonals[small]:.0f} times as large as {meshes[small].name}; "
            "give all in one unit"
        )
    if float(np.abs(centres).max()) < 1e-6 * diagonals[large]:
        raise AssetError(
            f"{name}: all parts are centred at the origin; give them at their positions "
            "when every joint is at 0"
        )
    for k, mesh in enumerate(meshes):
        others = np.delete(boxes, k, axis=0)
        gaps = np.maximum(0.0, np.maximum(others[:, 0] - boxes[k, 1], boxes[k, 0] - others[:, 1]))
        gap = float(np.linalg.norm(gaps, axis=-1).min())
        extent = float(np.linalg.norm(others[:, 1].max(axis=0) - others[:, 0].min(axis=0)))
        if gap > MAX_GAP * max(extent, float(diagonals[k])):
            raise AssetError(
                f"{name}: the parts do not belong together: {mesh.name} is {gap:.3g} m from all "
                f"others, whose extent is {extent:.3g} m; give placed parts of one object"
            )


def category_words(category: str) -> str:
    """Split the name of a category: ``WashingMachine`` becomes ``washing machine``."""
    return "" if category == "unknown" else re.sub(r"(?<=[a-z])(?=[A-Z])", " ", category).lower()
