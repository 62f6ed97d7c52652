"""Loading geometry: every format becomes plain triangles in the frame of a part."""

from __future__ import annotations

import logging
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray

from articulate.convert.paths import resolve
from articulate.convert.read import SourceGeometry, SourceObject
from articulate.convert.tree import Part
from articulate.errors import AssetError
from articulate.transforms import Array

logging.getLogger("trimesh").setLevel(logging.ERROR)

FORMATS = (".obj", ".stl", ".dae", ".glb", ".gltf", ".ply", ".off")
MAX_BYTES = 300_000_000
"""Largest mesh file that is read."""
LEAST_AREA_M2 = 1e-9
"""Pieces of a smaller area are left out: a speck of 0.03 mm [m2]."""
GREY = (0.7, 0.7, 0.7, 1.0)


@dataclass(frozen=True, kw_only=True)
class Piece:
    """One visual or collision element as triangles in the frame of its part."""

    name: str
    """Names it goes by: link, element, file, groups, separated by blanks."""
    mesh: trimesh.Trimesh
    rgba: tuple[float, float, float, float] = GREY
    primitive: SourceGeometry | None = None
    """Set where the source gives a primitive instead of a mesh."""
    link: str = ""
    """Link of the source it belongs to."""
    element: str = ""
    """Where the element stands that it comes from; one per material otherwise."""

    def scaled(self, factor: float) -> Piece:
        """The same piece, ``factor`` times as large about the origin of its part."""
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
        """The same piece, moved by the rigid transform ``T`` (4, 4)."""
        mesh = self.mesh.copy()
        mesh.apply_transform(T)
        primitive = self.primitive
        if primitive is not None:
            primitive = replace(primitive, T_lg=T @ primitive.T_lg)
        return replace(self, mesh=mesh, primitive=primitive)


@dataclass(frozen=True, kw_only=True)
class PartGeometry:
    """Everything that a part shows and touches with."""

    visuals: tuple[Piece, ...]
    collisions: tuple[Piece, ...]
    collides_as_seen: bool
    """The collision elements name the same files as the visual ones, or there are none."""

    @property
    def shown(self) -> tuple[Piece, ...]:
        """The visual pieces, or the collision pieces where nothing is to be seen."""
        return self.visuals or self.collisions

    def scaled(self, factor: float) -> PartGeometry:
        """The same geometry, ``factor`` times as large."""
        return PartGeometry(
            visuals=_large(p.scaled(factor) for p in self.visuals),
            collisions=_large(p.scaled(factor) for p in self.collisions),
            collides_as_seen=self.collides_as_seen,
        )

    def moved(self, T: Array) -> PartGeometry:
        """The same geometry, moved by ``T`` (4, 4)."""
        return PartGeometry(
            visuals=tuple(p.moved(T) for p in self.visuals),
            collisions=tuple(p.moved(T) for p in self.collisions),
            collides_as_seen=self.collides_as_seen,
        )


def _large(pieces: Iterable[Piece]) -> tuple[Piece, ...]:
    """The pieces that have an area worth the name."""
    return tuple(piece for piece in pieces if piece.mesh.area > LEAST_AREA_M2)


class Loader:
    """Reads each mesh file once."""

    def __init__(self, source: SourceObject, mesh_dirs: tuple[Path, ...], allow_missing: bool):
        self.source = source
        self.mesh_dirs = mesh_dirs
        self.allow_missing = allow_missing
        self.files: dict[str, Path] = {}
        """Mesh files in use, by reference."""
        self._cache: dict[Path, list[tuple[str, trimesh.Trimesh, tuple[float, ...] | None]]] = {}

    def part(self, part: Part) -> PartGeometry:
        """Geometry of one part.

        Raises:
            AssetError: A mesh is absent or unreadable and its link has nothing else.
        """
        visuals: list[Piece] = []
        collisions: list[Piece] = []
        same = True
        for link, T_pl in part.members:
            missing: list[AssetError] = []
            for element in link.visuals:
                visuals += self._pieces(element, link.name, T_pl, missing)
            for element in link.collisions:
                collisions += self._pieces(element, link.name, T_pl, missing)
            kept = any(piece.link == link.name for piece in (*visuals, *collisions))
            if missing and not (kept and self.allow_missing):
                raise missing[0]
            for error in missing:
                self.source.repairs.add(f"left out: {error}")
            seen = {(e.kind, e.filename, e.size) for e in link.visuals}
            touched = {(e.kind, e.filename, e.size) for e in link.collisions}
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
                    element=element.where,
                )
            ]
        try:
            path = resolve(element.filename, self.source.path, self.mesh_dirs)
            loaded = self._load(path)
        except AssetError as error:
            missing.append(AssetError(f"{element.where}: {error}"))
            return []
        self.files[element.filename] = path
        pieces = []
        for group, mesh, colour in loaded:
            vertices = mesh.vertices * np.array(element.scale)
            faces = mesh.faces
            if np.prod(element.scale) < 0.0:
                faces = faces[:, ::-1]
                self.source.repairs.add(f"mirrored mesh {path.name}: winding turned back")
            copy = trimesh.Trimesh(trimesh.transform_points(vertices, T_pg), faces, process=False)
            rgba = element.rgba or (_four(colour) if colour else GREY)
            names = f"{link} {element.name} {path.stem} {group}"
            pieces.append(Piece(name=names, mesh=copy, rgba=rgba, link=link, element=element.where))
        return pieces

    def _load(self, path: Path) -> list[tuple[str, trimesh.Trimesh, tuple[float, ...] | None]]:
        if path not in self._cache:
            self._cache[path] = _read_mesh(path, self.source)
        return self._cache[path]


def _read_mesh(
    path: Path, source: SourceObject
) -> list[tuple[str, trimesh.Trimesh, tuple[float, ...] | None]]:
    if path.suffix.lower() not in FORMATS:
        raise AssetError(f"mesh {path.name}: format not known; {', '.join(FORMATS)} are")
    if path.stat().st_size > MAX_BYTES:
        raise AssetError(f"mesh {path.name}: larger than {MAX_BYTES} bytes")
    options: dict[str, Any] = {}
    if path.suffix.lower() == ".obj":
        options = {"split_objects": True, "group_material": True}
    try:
        scene = trimesh.load_scene(path, **options)
        meshes = [(name, mesh) for name, mesh in _placed(scene) if len(mesh.faces)]
    except Exception as error:  # noqa: BLE001  # readers of foreign formats raise anything
        text = (str(error).splitlines() or [""])[0][:200]
        raise AssetError(
            f"mesh {path.name}: cannot be read ({type(error).__name__}: {text})"
        ) from None
    if not meshes:
        raise AssetError(f"mesh {path.name}: has no triangles")
    out: list[tuple[str, trimesh.Trimesh, tuple[float, ...] | None]] = []
    for name, mesh in meshes:
        plain = _plain(mesh)
        if plain is None:
            source.repairs.add(f"mesh {path.name}: a group without area left out")
            continue
        if any(_same_faces(plain, other) for _, other, _ in out):
            continue  # the back of a sheet in another material
        out.append((name, plain, _colour(mesh)))
    if not out:
        raise AssetError(f"mesh {path.name}: has no area")
    return out


def _placed(scene: trimesh.Scene) -> list[tuple[str, trimesh.Trimesh]]:
    found = []
    for node in scene.graph.nodes_geometry:
        T, name = scene.graph[node]
        geometry = scene.geometry[name]
        if isinstance(geometry, trimesh.Trimesh):
            mesh = geometry.copy()
            mesh.apply_transform(T)
            found.append((str(name), mesh))
    return found


def _plain(mesh: trimesh.Trimesh) -> trimesh.Trimesh | None:
    """Triangles alone, equal vertices merged, double and empty faces gone."""
    vertices = np.asarray(mesh.vertices, dtype=np.float64)
    faces = np.asarray(mesh.faces)
    faces = faces[np.isfinite(vertices[faces]).all(axis=(1, 2))]
    plain = trimesh.Trimesh(np.where(np.isfinite(vertices), vertices, 0.0), faces, process=False)
    plain.merge_vertices()
    _, first = np.unique(np.sort(plain.faces, axis=1), axis=0, return_index=True)
    keep = np.zeros(len(plain.faces), dtype=bool)
    keep[first] = True
    keep &= plain.area_faces > 1e-14 * max(plain.scale, 1e-9) ** 2
    plain.update_faces(keep)
    plain.remove_unreferenced_vertices()
    if len(plain.faces) == 0 or plain.area <= 0.0:
        return None
    return plain


def _same_faces(one: trimesh.Trimesh, other: trimesh.Trimesh) -> bool:
    """Whether both consist of the same triangles, turned round or not."""
    if len(one.faces) != len(other.faces) or not np.allclose(one.bounds, other.bounds):
        return False
    centres = [np.sort(m.triangles_center.round(6), axis=0) for m in (one, other)]
    return bool(np.allclose(centres[0], centres[1], atol=1e-5))


def _colour(mesh: trimesh.Trimesh) -> tuple[float, ...] | None:
    material = getattr(mesh.visual, "material", None)
    if material is None:
        colours = getattr(mesh.visual, "main_color", None)
        defined = getattr(mesh.visual, "defined", False)
        return tuple(float(c) / 255.0 for c in colours) if defined and colours is not None else None
    image = getattr(material, "image", None) or getattr(material, "baseColorTexture", None)
    colour = np.asarray(material.main_color, dtype=np.float64) / 255.0
    if image is not None:
        mean = np.asarray(image.convert("RGB").resize((8, 8))).reshape(-1, 3).mean(axis=0) / 255.0
        colour[:3] = mean
    return tuple(float(c) for c in colour)


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
    """Lowest and highest corner (2, 3) of what the part shows, moved by ``T`` (4, 4)."""
    corners = [trimesh.transform_points(piece.mesh.vertices, T) for piece in geometry.shown]
    if not corners:
        return None
    return np.array(
        [
            np.min([c.min(axis=0) for c in corners], axis=0),
            np.max([c.max(axis=0) for c in corners], axis=0),
        ]
    )


def joined(meshes: Sequence[trimesh.Trimesh]) -> trimesh.Trimesh:
    """One mesh of the triangles of all, in their order."""
    offsets = np.cumsum([0, *[len(mesh.vertices) for mesh in meshes]])[:-1]
    faces = [np.asarray(m.faces) + o for m, o in zip(meshes, offsets, strict=True)]
    vertices = [np.asarray(mesh.vertices) for mesh in meshes]
    return trimesh.Trimesh(np.vstack(vertices), np.vstack(faces), process=False)
