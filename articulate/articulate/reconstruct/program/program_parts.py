"""Parts of a program: a name and triangles for each, read on first use."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from functools import cached_property, partial
from pathlib import Path

import numpy as np
import trimesh

from articulate.errors import AssetError, nearest
from articulate.formats.config import ConvertConfig
from articulate.formats.decompose_joints import decompose_joints
from articulate.formats.link_tree import Part as Body
from articulate.formats.load_meshes import GREY, Loader, Piece, joined
from articulate.formats.mesh_file import FORMATS, read_mesh
from articulate.formats.orient_collada import make_loader
from articulate.formats.read_urdf import read_urdf
from articulate.formats.repairs import Repairs
from articulate.formats.source_object import SourceObject
from articulate.reconstruct.program.contact_distance import Hull, hull_of
from articulate.transforms import Array

MAX_HULLS = 48
"""A part with more loose pieces is one piece for contact."""
MAX_PARTS = 400
MAX_NAME = 100
"""Longest name of a part [characters]."""
MIN_AREA = 1e-12


class ProgramPart:
    """Geometry of one part in its own frame."""

    def __init__(self, name: str, load: Callable[[], tuple[Piece, ...]]) -> None:
        self.name = name
        self._load = load

    @cached_property
    def pieces(self) -> tuple[Piece, ...]:
        """Visual pieces with one mesh and colour each; empty for a part without geometry."""
        return self._load()

    @cached_property
    def triangles(self) -> Array:
        """Corners of all triangles (M, 3, 3)."""
        found = [np.asarray(piece.mesh.triangles) for piece in self.pieces]
        return np.concatenate(found) if found else np.zeros((0, 3, 3))

    @cached_property
    def hull(self) -> Hull:
        """Convex hull of the part."""
        return hull_of(self.triangles.reshape(-1, 3))

    @cached_property
    def hulls(self) -> tuple[Hull, ...]:
        """Convex hulls of its loose pieces, for contact."""
        mesh = joined([piece.mesh for piece in self.pieces])
        mesh.merge_vertices()
        loose = trimesh.graph.connected_components(
            mesh.edges_unique, nodes=np.arange(len(mesh.vertices))
        )
        if not 1 <= len(loose) <= MAX_HULLS:
            return (self.hull,)
        return tuple(hull_of(mesh.vertices.view(np.ndarray)[corners]) for corners in loose)


class Parts(Mapping[str, ProgramPart]):
    """Parts by name, in order."""

    def __init__(self, parts: Mapping[str, ProgramPart]) -> None:
        if not parts:
            raise AssetError("there are no parts; a program needs at least one mesh")
        if len(parts) > MAX_PARTS:
            raise AssetError(f"there are {len(parts)} parts; at most {MAX_PARTS} are accepted")
        self._parts = dict(parts)

    def __getitem__(self, name: str) -> ProgramPart:
        return self._parts[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._parts)

    def __len__(self) -> int:
        return len(self._parts)


def parts_of(source: Path | Mapping[str, Path | trimesh.Trimesh]) -> Parts:
    """Read parts from a folder of meshes, a URDF, or a mapping from names to meshes.

    Args:
        source: A folder, of which each mesh file is a part with the name of the file; a URDF, of
            which each link is a part in its own frame; or a mapping to files or meshes.

    Raises:
        AssetError: There is no part, or a name is invalid.
    """
    if isinstance(source, Parts):
        return source
    if isinstance(source, Path):
        return _from_urdf(source) if source.suffix.lower() == ".urdf" else _from_folder(source)
    return Parts({name: _part(name, mesh) for name, mesh in source.items()})


def check_name(name: str) -> None:
    """Check the name of a part.

    Raises:
        AssetError: It is empty, too long, or contains invisible characters.
    """
    if not (0 < len(name) <= MAX_NAME and name.isprintable()):
        format_value = name if len(name) <= MAX_NAME else f"{name[:40]}…"
        raise AssetError(
            f"part {format_value!r}: a name has 1 to {MAX_NAME} characters that can be seen"
        )


def _part(name: str, mesh: Path | trimesh.Trimesh) -> ProgramPart:
    check_name(name)
    if isinstance(mesh, Path):
        return ProgramPart(name, lambda: _read(name, mesh))
    return ProgramPart(
        name, lambda: (Piece(name=name, mesh=_plain(name, mesh), rgba=GREY, link=name),)
    )


def _plain(name: str, mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    vertices = np.asarray(mesh.vertices, dtype=np.float64)
    if len(mesh.faces) == 0 or not np.isfinite(vertices).all() or mesh.area <= MIN_AREA:
        raise AssetError(f"part {name}: the mesh has no area or is not finite")
    return trimesh.Trimesh(vertices, np.asarray(mesh.faces), process=False)


def _read(name: str, path: Path) -> tuple[Piece, ...]:
    if not path.is_file():
        raise AssetError(f"part {name}: {path} does not exist; give a mesh file")
    return tuple(
        Piece(name=f"{name} {group}", mesh=mesh, rgba=rgba_of(colour), link=name)
        for group, mesh, colour in read_mesh(path, Repairs())
    )


def rgba_of(colour: tuple[float, ...] | None) -> tuple[float, float, float, float]:
    """Return a colour with its opacity, 1 by default; grey without a colour. All in [0, 1]."""
    if colour is None:
        return GREY
    return (colour[0], colour[1], colour[2], colour[3] if len(colour) > 3 else 1.0)


def mesh_files(folder: Path) -> dict[str, Path]:
    """Return the mesh files of a folder by part name.

    Raises:
        AssetError: There is none, or two have the same name.
    """
    if not folder.is_dir():
        raise AssetError(f"{folder}: does not exist; give a folder of meshes or a URDF")
    found: dict[str, Path] = {}
    for path in sorted(folder.iterdir()):
        if path.suffix.lower() not in FORMATS or not path.is_file():
            continue
        if path.stem in found:
            raise AssetError(f"{folder}: two meshes have the name {path.stem}; rename one")
        found[path.stem] = path
    if not found:
        raise AssetError(f"{folder}: contains no mesh; {', '.join(FORMATS)} are supported")
    return found


def _from_folder(folder: Path) -> Parts:
    return Parts({name: _part(name, path) for name, path in mesh_files(folder).items()})


def _from_urdf(path: Path) -> Parts:
    source = decompose_joints(read_urdf(path))
    loader = make_loader(source, ConvertConfig())
    return Parts(
        {name: ProgramPart(name, partial(_of_link, source, loader, name)) for name in source.links}
    )


def _of_link(source: SourceObject, loader: Loader, name: str) -> tuple[Piece, ...]:
    body = Body(
        name=name,
        parent=None,
        joint=None,
        T_sp=np.eye(4),
        T_pc=np.eye(4),
        members=((source.links[name], np.eye(4)),),
    )
    pieces = [p for p in loader.part(body).visible if p.mesh.area > MIN_AREA]
    return tuple(replace(piece, link=name) for piece in pieces)


def known(parts: Parts, name: str) -> str:
    """Suggest a part for an unknown name, as the end of a message."""
    return nearest(name, list(parts)[:60])
