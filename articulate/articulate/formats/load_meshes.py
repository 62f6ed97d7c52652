"""Load geometry of any format as plain triangles in the frame of a part."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import trimesh
from numpy.typing import NDArray

from articulate.errors import AssetError, quote
from articulate.formats.collada import is_z_up
from articulate.formats.config import ConvertConfig
from articulate.formats.link_tree import Part
from articulate.formats.mesh_file import TEXTURES, Y_FROM_Z, Group, read_mesh
from articulate.formats.mesh_paths import MissingMesh, found_elsewhere, resolve
from articulate.formats.source_object import SourceGeometry, SourceObject
from articulate.formats.textures import mean_colour
from articulate.transforms import Array

LEAST_AREA_M2 = 1e-9
"""Pieces of a smaller area are left out: 0.03 mm wide [m2]."""
SAME_DECIMALS = 4
"""Poses equal to this many digits are the same: files write angles as 1.5708."""
MAX_FACES = 6_000_000
"""Most triangles of all mesh files of an object."""
GREY = (0.7, 0.7, 0.7, 1.0)


@dataclass(frozen=True, kw_only=True)
class Piece:
    """One visual or collision element as triangles in the frame of its part."""

    name: str
    """Names of link, element, file and groups, separated by spaces."""
    mesh: trimesh.Trimesh
    rgba: tuple[float, float, float, float] = GREY
    primitive: SourceGeometry | None = None
    """Set where the source gives a primitive instead of a mesh."""
    link: str = ""
    """Link of the source it belongs to."""
    element: str = ""
    """Number of the link's visual or collision element that it comes from."""

    def scaled(self, factor: float) -> Piece:
        """Return the piece scaled by ``factor`` about the origin of its part."""
        mesh = self.mesh.copy()
        mesh.apply_scale(factor)
        primitive = self.primitive
        if primitive is not None:
            T_lg = np.array(primitive.T_lg)
            T_lg[:3, 3] *= factor
            size = tuple(factor * side for side in primitive.size)
            primitive = replace(primitive, T_lg=T_lg, size=size)
        return replace(self, mesh=mesh, primitive=primitive)

    def moved(self, T: Array) -> Piece:
        """Return the piece moved by the rigid transform ``T`` (4, 4), homogeneous."""
        mesh = self.mesh.copy()
        mesh.apply_transform(T)
        primitive = self.primitive
        if primitive is not None:
            primitive = replace(primitive, T_lg=T @ primitive.T_lg)
        return replace(self, mesh=mesh, primitive=primitive)


@dataclass(frozen=True, kw_only=True)
class PartGeometry:
    """Visual and collision geometry of a part."""

    visuals: tuple[Piece, ...]
    collisions: tuple[Piece, ...]
    collides_as_seen: bool
    """True if the collision elements are the visual ones at the same poses, or absent."""

    @property
    def visible(self) -> tuple[Piece, ...]:
        """The visual pieces, or the collision pieces where there are none."""
        return self.visuals or self.collisions

    def scaled(self, factor: float) -> PartGeometry:
        """Return the geometry scaled by ``factor``, without specks."""
        return PartGeometry(
            visuals=_large(p.scaled(factor) for p in self.visuals),
            collisions=_large(p.scaled(factor) for p in self.collisions),
            collides_as_seen=self.collides_as_seen,
        )

    def moved(self, T: Array) -> PartGeometry:
        """Return the geometry moved by the rigid transform ``T`` (4, 4), homogeneous."""
        return PartGeometry(
            visuals=tuple(p.moved(T) for p in self.visuals),
            collisions=tuple(p.moved(T) for p in self.collisions),
            collides_as_seen=self.collides_as_seen,
        )


def _sameness(element: SourceGeometry) -> tuple[object, ...]:
    """Return a key that is equal for the same geometry at the same pose."""
    place = tuple(np.round(element.T_lg, SAME_DECIMALS).ravel().tolist())
    own = None if element.triangles is None else element.triangles.tobytes()
    return (element.kind, element.filename, element.size, element.scale, own, place)


def _large(pieces: Iterable[Piece]) -> tuple[Piece, ...]:
    """Return the pieces that are more than specks."""
    return tuple(piece for piece in pieces if piece.mesh.area > LEAST_AREA_M2)


class Loader:
    """Load the geometry of an object, each mesh file once.

    Args:
        source: The object.
        config: Folders of meshes, and whether they may be missing.
        y_up: Turn COLLADA meshes with z up to y up.
    """

    def __init__(self, source: SourceObject, config: ConvertConfig, *, y_up: bool = False) -> None:
        self.source = source
        self.mesh_dirs = config.mesh_dirs
        self.allow_missing = config.allow_missing
        self.y_up = y_up
        self.files: dict[str, Path] = {}
        """Mesh files in use, by reference."""
        self._cache: dict[Path, list[Group]] = {}
        self._colours: dict[Path, tuple[float, float, float]] = {}
        self._faces = 0

    def part(self, part: Part) -> PartGeometry:
        """Load the geometry of one part.

        Raises:
            AbsentMesh: A mesh is absent and its link has nothing else.
            AssetError: A mesh is unreadable and its link has nothing else.
        """
        visuals: list[Piece] = []
        collisions: list[Piece] = []
        same = True
        for link, T_pl in part.members:
            missing: list[AssetError] = []
            for k, element in enumerate(link.visuals):
                own = self._pieces(element, link.name, T_pl, missing)
                visuals += [replace(piece, element=str(k)) for piece in own]
            for k, element in enumerate(link.collisions):
                own = self._pieces(element, link.name, T_pl, missing)
                collisions += [replace(piece, element=str(k)) for piece in own]
            kept = any(piece.link == link.name for piece in (*visuals, *collisions))
            if missing and not (kept and self.allow_missing):
                raise missing[0]
            for error in missing:
                self.source.repairs.add(f"left out: {error}")
            seen = {_sameness(e) for e in link.visuals}
            touched = {_sameness(e) for e in link.collisions}
            same = same and (not touched or seen == touched)
        return PartGeometry(
            visuals=tuple(visuals), collisions=tuple(collisions), collides_as_seen=same
        )

    def _pieces(
        self, element: SourceGeometry, link: str, T_pl: Array, missing: list[AssetError]
    ) -> list[Piece]:
        T_pg = T_pl @ element.T_lg
        if element.kind != "mesh":
            mesh = _primitive(element)
            mesh.apply_transform(T_pg)
            names = f"{link} {element.name}"
            placed = SourceGeometry(kind=element.kind, name="", T_lg=T_pg, size=element.size)
            rgba = element.rgba or GREY
            return [
                Piece(
                    name=names,
                    mesh=mesh,
                    rgba=rgba,
                    primitive=placed,
                    link=link,
                )
            ]
        if element.triangles is not None:
            mesh = trimesh.Trimesh(**trimesh.triangles.to_kwargs(element.triangles))
            mesh.apply_transform(T_pg)
            names = f"{link} {element.name}"
            rgba = element.rgba or GREY
            return [Piece(name=names, mesh=mesh, rgba=rgba, link=link)]
        try:
            path = resolve(element.filename, self.source.path, self.mesh_dirs)
            loaded = self._load(path)
        except AssetError as error:
            kind = MissingMesh if isinstance(error, MissingMesh) else AssetError
            missing.append(kind(f"{element.where}: {error}"))
            return []
        self.files[element.filename] = path
        if found_elsewhere(element.filename, self.source.path, path):
            at = _short(path, self.source.path)
            self.source.repairs.add(f"mesh {quote(element.filename)} was found at {at}")
        painted = self._texture_colour(element)
        pieces = []
        for group, mesh, colour in loaded:
            vertices = mesh.vertices * np.array(element.scale)
            faces = mesh.faces
            if np.prod(element.scale) < 0.0:
                faces = faces[:, ::-1]
                self.source.repairs.add(f"mirrored mesh {path.name}: face orientation reversed")
            copy = trimesh.Trimesh(trimesh.transform_points(vertices, T_pg), faces, process=False)
            rgba = element.rgba or (_four(colour) if colour else painted) or GREY
            names = f"{link} {element.name} {path.stem} {group}"
            pieces.append(Piece(name=names, mesh=copy, rgba=rgba, link=link))
        return pieces

    def _texture_colour(self, element: SourceGeometry) -> tuple[float, float, float, float] | None:
        """Return the mean colour of the image that the element names, if there is one."""
        if not element.texture or element.rgba:
            return None
        try:
            path = resolve(element.texture, self.source.path, self.mesh_dirs)
            if path not in self._colours:
                self._colours[path] = mean_colour(path)
        except AssetError as error:
            self.source.repairs.add(f"left out: {str(error).replace('mesh', 'texture', 1)}")
            return None
        self.files[element.texture] = path
        self.source.repairs.note(TEXTURES)
        return (*self._colours[path], 1.0)

    def _load(self, path: Path) -> list[Group]:
        if path not in self._cache:
            groups = read_mesh(path, self.source.repairs)
            self._faces += sum(len(mesh.faces) for _, mesh, _ in groups)
            if self._faces > MAX_FACES:
                raise AssetError(
                    f"mesh {path.name}: more than {MAX_FACES} triangles with the other meshes"
                )
            if self.y_up and is_z_up(path):
                for _, mesh, _ in groups:
                    mesh.apply_transform(Y_FROM_Z)
            self._cache[path] = groups
        return self._cache[path]


def _short(path: Path, urdf: Path) -> str:
    try:
        return path.relative_to(urdf.parent).as_posix()
    except ValueError:
        return str(path)


def _four(colour: tuple[float, ...]) -> tuple[float, float, float, float]:
    return (colour[0], colour[1], colour[2], max(colour[3], 0.2) if len(colour) > 3 else 1.0)


def _primitive(element: SourceGeometry) -> trimesh.Trimesh:
    if element.kind == "box":
        return trimesh.creation.box(extents=element.size)
    if element.kind == "cylinder":
        return trimesh.creation.cylinder(radius=element.size[0], height=element.size[1])
    if element.kind == "capsule":
        return trimesh.creation.capsule(radius=element.size[0], height=element.size[1])
    return trimesh.creation.icosphere(subdivisions=3, radius=element.size[0])


def bounds(geometry: PartGeometry, T: Array) -> NDArray[np.float64] | None:
    """Return the lowest and highest corner (2, 3) of the visible pieces, moved by ``T`` (4, 4).

    Lengths are in the units of the geometry.
    """
    corners = [trimesh.transform_points(piece.mesh.vertices, T) for piece in geometry.visible]
    if not corners:
        return None
    return np.array(
        [
            np.min([c.min(axis=0) for c in corners], axis=0),
            np.max([c.max(axis=0) for c in corners], axis=0),
        ]
    )


def joined(meshes: Sequence[trimesh.Trimesh]) -> trimesh.Trimesh:
    """Return one mesh of all triangles, in their order."""
    offsets = np.cumsum([0, *[len(mesh.vertices) for mesh in meshes]])[:-1]
    faces = [np.asarray(m.faces) + o for m, o in zip(meshes, offsets, strict=True)]
    vertices = [np.asarray(mesh.vertices) for mesh in meshes]
    return trimesh.Trimesh(np.vstack(vertices), np.vstack(faces), process=False)
