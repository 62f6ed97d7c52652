"""The parts that a program is given: a name and triangles for each, read when they are needed."""

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

MOST_HULLS = 48
"""A part of more loose pieces is taken as one for contact."""
MOST_PARTS = 400
MOST_LETTERS = 100
"""Letters of a part's name."""
LEAST_AREA = 1e-12


class PartGeometry:
    """The geometry of one part in its own frame."""

    def __init__(self, name: str, load: Callable[[], tuple[Piece, ...]]) -> None:
        self.name = name
        self._load = load

    @cached_property
    def pieces(self) -> tuple[Piece, ...]:
        """What is seen of it, one mesh and colour each; empty for a part without geometry."""
        return self._load()

    @cached_property
    def triangles(self) -> Array:
        """Corners of all triangles (M, 3, 3)."""
        found = [np.asarray(piece.mesh.triangles) for piece in self.pieces]
        return np.concatenate(found) if found else np.zeros((0, 3, 3))

    @cached_property
    def hull(self) -> Hull:
        """Convex hull of all of it."""
        return hull_of(self.triangles.reshape(-1, 3))

    @cached_property
    def hulls(self) -> tuple[Hull, ...]:
        """Convex hulls of its loose pieces, for contact."""
        whole = joined([piece.mesh for piece in self.pieces])
        whole.merge_vertices()
        loose = trimesh.graph.connected_components(
            whole.edges_unique, nodes=np.arange(len(whole.vertices))
        )
        if not 1 <= len(loose) <= MOST_HULLS:
            return (self.hull,)
        return tuple(hull_of(whole.vertices.view(np.ndarray)[corners]) for corners in loose)


class Parts(Mapping[str, PartGeometry]):
    """Parts by name, in order."""

    def __init__(self, parts: Mapping[str, PartGeometry]) -> None:
        if not parts:
            raise AssetError("no parts were given; a program needs at least one mesh")
        if len(parts) > MOST_PARTS:
            raise AssetError(f"{len(parts)} parts were given; at most {MOST_PARTS} are accepted")
        self._parts = dict(parts)

    def __getitem__(self, name: str) -> PartGeometry:
        return self._parts[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._parts)

    def __len__(self) -> int:
        return len(self._parts)


def parts_of(given: Path | Mapping[str, Path | trimesh.Trimesh]) -> Parts:
    """Parts from a folder of meshes, a URDF, or a mapping from names to meshes.

    Args:
        given: A folder: each mesh file in it is a part, called after the file. A URDF: each of
            its links is a part in the link's own frame. A mapping: files or meshes.

    Raises:
        AssetError: There is none, or a name cannot be one.
    """
    if isinstance(given, Parts):
        return given
    if isinstance(given, Path):
        return _from_urdf(given) if given.suffix.lower() == ".urdf" else _from_folder(given)
    return Parts({name: _part(name, mesh) for name, mesh in given.items()})


def check_name(name: str) -> None:
    """Refuse what cannot be the name of a part.

    Raises:
        AssetError: It is empty, too long, or not all of it can be seen.
    """
    if not (0 < len(name) <= MOST_LETTERS and name.isprintable()):
        format_value = name if len(name) <= MOST_LETTERS else f"{name[:40]}…"
        raise AssetError(
            f"part {format_value!r}: a name has 1 to {MOST_LETTERS} characters that can be seen"
        )


def _part(name: str, mesh: Path | trimesh.Trimesh) -> PartGeometry:
    check_name(name)
    if isinstance(mesh, Path):
        return PartGeometry(name, lambda: _read(name, mesh))
    return PartGeometry(
        name, lambda: (Piece(name=name, mesh=_plain(name, mesh), rgba=GREY, link=name),)
    )


def _plain(name: str, mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    vertices = np.asarray(mesh.vertices, dtype=np.float64)
    if len(mesh.faces) == 0 or not np.isfinite(vertices).all() or mesh.area <= LEAST_AREA:
        raise AssetError(f"part {name}: the mesh has no area or is not finite")
    return trimesh.Trimesh(vertices, np.asarray(mesh.faces), process=False)


def _read(name: str, path: Path) -> tuple[Piece, ...]:
    if not path.is_file():
        raise AssetError(f"part {name}: {path} does not exist; give a mesh file")
    return tuple(
        Piece(name=f"{name} {group}", mesh=mesh, rgba=_four(colour), link=name)
        for group, mesh, colour in read_mesh(path, Repairs())
    )


def _four(colour: tuple[float, ...] | None) -> tuple[float, float, float, float]:
    if colour is None:
        return GREY
    return (colour[0], colour[1], colour[2], colour[3] if len(colour) > 3 else 1.0)


def mesh_files(folder: Path) -> dict[str, Path]:
    """The mesh files of a folder by what their parts are called.

    Raises:
        AssetError: There is none, or a name is taken twice.
    """
    if not folder.is_dir():
        raise AssetError(f"{folder}: does not exist; give a folder of meshes or a URDF")
    found: dict[str, Path] = {}
    for path in sorted(folder.iterdir()):
        if path.suffix.lower() not in FORMATS or not path.is_file():
            continue
        if path.stem in found:
            raise AssetError(f"{folder}: two meshes are called {path.stem}; rename one")
        found[path.stem] = path
    if not found:
        raise AssetError(f"{folder}: holds no mesh; {', '.join(FORMATS)} are read")
    return found


def _from_folder(folder: Path) -> Parts:
    return Parts({name: _part(name, path) for name, path in mesh_files(folder).items()})


def _from_urdf(path: Path) -> Parts:
    source = decompose_joints(read_urdf(path))
    loader = make_loader(source, ConvertConfig())
    return Parts(
        {name: PartGeometry(name, partial(_of_link, source, loader, name)) for name in source.links}
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
    pieces = [p for p in loader.part(body).visible if p.mesh.area > LEAST_AREA]
    return tuple(replace(piece, link=name) for piece in pieces)


def known(parts: Parts, name: str) -> str:
    """The end of a sentence about a name that is no part."""
    return nearest(name, list(parts)[:60])
