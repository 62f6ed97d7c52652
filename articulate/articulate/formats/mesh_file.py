"""One mesh file as plain triangles by group and material, whatever its format."""

from __future__ import annotations

import logging
import os
import re
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray

from articulate.errors import AssetError
from articulate.formats.collada_instances import check_instances
from articulate.formats.msh import read_msh
from articulate.formats.repairs import Repairs
from articulate.formats.texture_colour import MAX_PIXELS

logging.getLogger("trimesh").setLevel(logging.ERROR)

FORMATS = (".obj", ".stl", ".dae", ".glb", ".gltf", ".ply", ".off", ".msh")
MAX_BYTES = 300_000_000
"""Largest mesh file that is read."""
MAX_FACES = 3_000_000
"""Most triangles of a mesh file."""
MAX_GROUPS = 500
"""An OBJ of more objects, groups and materials is read without them."""
FARTHEST = 1e6
"""Triangles with a corner farther out than this are left out, in units of the file."""
TEXTURES = "textures were replaced by the mean colour of each"

Y_FROM_Z = np.array([[1, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]], dtype=np.float64)
"""Turns what points along z to point along y (4, 4)."""

Group = tuple[str, trimesh.Trimesh, tuple[float, ...] | None]
"""Name of the group, its triangles, and its colour if the file gives one."""


def read_mesh(path: Path, repairs: Repairs) -> list[Group]:
    """The groups of the mesh file at ``path``.

    Raises:
        AssetError: It cannot be read, or nothing of it has an area.
    """
    if path.suffix.lower() not in FORMATS:
        raise AssetError(f"mesh {path.name}: format not known; {', '.join(FORMATS)} are")
    try:
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")  # readers complain of what is judged here
            return _groups(path, repairs)
    except AssetError:
        raise
    except Exception as error:  # noqa: BLE001  # readers of foreign formats raise anything
        text = (str(error).splitlines() or [""])[0][:200]
        raise AssetError(
            f"mesh {path.name}: cannot be read ({type(error).__name__}: {text})"
        ) from None


def named_by(path: Path) -> list[Path]:
    """Files that exist and that the mesh file at ``path`` names: materials and pictures."""
    suffix, found = path.suffix.lower(), []
    if suffix == ".obj":
        for name in re.findall(rb"^mtllib\s+(.+?)\s*$", path.read_bytes(), re.MULTILINE):
            library = path.parent / os.fsdecode(name)
            if library.is_file():
                maps = re.findall(rb"^\s*map_\w+\s+(?:.*\s)?(\S+)\s*$", library.read_bytes(), re.M)
                found += [library, *(library.parent / os.fsdecode(m) for m in maps)]
    elif suffix in {".dae", ".gltf"}:
        pattern = rb"<init_from>\s*(.+?)\s*<|\"uri\"\s*:\s*\"([^\"]{1,500})\""
        for match in re.finditer(pattern, path.read_bytes()):
            found.append(path.parent / os.fsdecode(match.group(1) or match.group(2)))
    return [file for file in dict.fromkeys(found) if _is_file(file)]


def is_z_up(path: Path) -> bool:
    """Whether the file at ``path`` is a COLLADA mesh that says that z points up."""
    if path.suffix.lower() != ".dae":
        return False
    said = re.search(rb"<up_axis>\s*([XYZ]_UP)", path.read_bytes())
    return said is not None and said.group(1) == b"Z_UP"


def _is_file(path: Path) -> bool:
    try:
        return path.is_file()
    except (OSError, ValueError):  # a name too long, or with a null byte
        return False


def _groups(path: Path, repairs: Repairs) -> list[Group]:
    if path.stat().st_size > MAX_BYTES:
        raise AssetError(f"mesh {path.name}: larger than {MAX_BYTES} bytes")
    unit = _collada_unit(path, repairs) if path.suffix.lower() == ".dae" else 1.0
    meshes = [(name, mesh) for name, mesh in _placed(_scene(path), path.name) if len(mesh.faces)]
    if not meshes:
        raise AssetError(f"mesh {path.name}: has no triangles")
    out: list[Group] = []
    boxes = np.full((len(meshes), 6), np.inf)  # of those in ``out``, compared all at once
    for name, mesh in meshes:
        plain = _plain(mesh, path.name, repairs)
        if plain is None:
            repairs.add(f"mesh {path.name}: a group without area left out")
            continue
        box = np.asarray(plain.bounds).ravel()
        near = np.flatnonzero(np.isclose(box, boxes[: len(out)]).all(axis=1))
        if any(_same_faces(plain, out[k][1]) for k in near):
            repairs.note(f"mesh {path.name}: the same triangles in another material left out")
            continue  # the back of a sheet
        if unit != 1.0:
            plain.apply_scale(unit)
        boxes[len(out)] = np.asarray(plain.bounds).ravel()
        out.append((name, plain, _colour(mesh, path.name, repairs)))
    if not out:
        raise AssetError(f"mesh {path.name}: has no area")
    return out


def _scene(path: Path) -> trimesh.Scene:
    if path.suffix.lower() == ".msh":
        return trimesh.Scene(read_msh(path))
    if path.suffix.lower() != ".obj":
        return trimesh.load_scene(path)
    scene = trimesh.load_scene(path, split_objects=True, split_groups=True, group_material=True)
    return scene if len(scene.geometry) <= MAX_GROUPS else trimesh.load_scene(path)


def _collada_unit(path: Path, repairs: Repairs) -> float:
    """Length of the unit of a COLLADA file [m]; its markup is checked before anything reads it."""
    content = path.read_bytes()
    if content[:2] == b"PK":
        raise AssetError(f"mesh {path.name}: an archive; unpack it first")
    content = content.replace(b"\0", b"")  # whatever the encoding
    if re.search(rb"<!\s*(DOCTYPE|ENTITY|ELEMENT|ATTLIST)", content, re.IGNORECASE):
        raise AssetError(f"mesh {path.name}: has a DOCTYPE or entities, which are refused")
    check_instances(path.read_bytes(), path.name)
    axis = re.search(rb"<up_axis>\s*([XY]_UP)", content)
    if axis:
        repairs.note(f"mesh {path.name} says {axis.group(1).decode()}: taken as it is, as in ROS")
    said = re.search(rb"<unit[^>]*?meter\s*=\s*[\"']\s*([\d.eE+-]+)", content)
    unit = float(said.group(1)) if said else 1.0
    if not 1e-6 <= unit <= 1e6 or abs(unit - 1.0) < 1e-9:
        return 1.0
    repairs.note(f"mesh {path.name} is measured in units of {unit:g} m")
    return unit


def _placed(scene: trimesh.Scene, file: str) -> list[tuple[str, trimesh.Trimesh]]:
    """Every mesh at every place where the file has it, counted before any is copied."""
    places = [scene.graph[node] for node in scene.graph.nodes_geometry]
    placed = [(T, str(name), scene.geometry[name]) for T, name in places]
    placed = [place for place in placed if isinstance(place[2], trimesh.Trimesh)]
    faces = sum(len(geometry.faces) for _, _, geometry in placed)
    if faces > MAX_FACES:
        raise AssetError(f"mesh {file}: {faces} triangles; at most {MAX_FACES} are accepted")
    found = []
    for T, name, geometry in placed:
        mesh = geometry.copy()
        if mesh.vertices.ndim != 2 or mesh.vertices.shape[1] != 3:
            raise AssetError(f"mesh {file}: a corner without three coordinates")
        mesh.apply_transform(T)
        found.append((name, mesh))
    return found


def _plain(mesh: trimesh.Trimesh, name: str, repairs: Repairs) -> trimesh.Trimesh | None:
    """Triangles alone, equal vertices merged, double and empty faces gone."""
    vertices = np.asarray(mesh.vertices, dtype=np.float64)
    faces: NDArray[np.int64] = np.asarray(mesh.faces)
    if len(faces) and not 0 <= faces.min() <= faces.max() < len(vertices):
        raise AssetError(f"mesh {name}: a face names a corner that does not exist")
    finite, close = np.isfinite(vertices), np.abs(vertices) < FARTHEST
    near: NDArray[np.bool_] = np.asarray((finite & close).all(axis=1))
    if not near[faces].all():
        repairs.add(f"mesh {name}: triangles with corners at infinity left out")
    faces = faces[near[faces].all(axis=1)]
    plain = trimesh.Trimesh(np.where(near[:, None], vertices, 0.0), faces, process=False)
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
    if len(one.faces) != len(other.faces):
        return False
    centres = [np.sort(m.triangles_center.round(6), axis=0) for m in (one, other)]
    return bool(np.allclose(centres[0], centres[1], atol=1e-5))


def _colour(mesh: trimesh.Trimesh, name: str, repairs: Repairs) -> tuple[float, ...] | None:
    material = getattr(mesh.visual, "material", None)
    if material is None:
        colours = getattr(mesh.visual, "main_color", None)
        defined = getattr(mesh.visual, "defined", False)
        return tuple(float(c) / 255.0 for c in colours) if defined and colours is not None else None
    image = getattr(material, "image", None) or getattr(material, "baseColorTexture", None)
    colour = np.asarray(material.main_color, dtype=np.float64) / 255.0
    if image is not None:
        try:
            colour[:3] = _mean(image)
            repairs.note(TEXTURES)
        except (OSError, ValueError, SyntaxError, AssetError):
            repairs.add(f"mesh {name}: a texture that cannot be read left out")
    return tuple(float(c) for c in colour)


def _mean(image: Any) -> NDArray[np.float64]:
    """Mean colour of a picture of PIL (3,)."""
    if image.width * image.height > MAX_PIXELS:
        raise AssetError("too large")
    pixels = np.asarray(image.convert("RGB").resize((8, 8)), dtype=np.float64)
    return np.asarray(pixels.reshape(-1, 3).mean(axis=0) / 255.0)
