"""One mesh file of any format as plain triangles by group and material."""

from __future__ import annotations

import io
import logging
import re
import struct
import warnings
from pathlib import Path

import numpy as np
import trimesh
from numpy.typing import NDArray

from articulate.errors import AssetError, quote, shorten
from articulate.formats.collada import read_unit
from articulate.formats.gltf import check_gltf
from articulate.formats.repairs import Repairs
from articulate.formats.textures import IMAGE_FORMATS, MAX_PIXELS, MeshFiles, mean_of
from articulate.untrusted import memory_limit, read_bounded

logging.getLogger("trimesh").setLevel(logging.ERROR)

FORMATS = (".obj", ".stl", ".dae", ".glb", ".gltf", ".ply", ".off", ".msh")
MAX_BYTES = 200_000_000
"""Largest mesh file that is read."""
MAX_TEXT_BYTES = 100_000_000
"""Largest mesh file in a text format, which takes ten times as much memory as its size."""
MAX_FACES = 3_000_000
"""Most triangles of a mesh file."""
MAX_GROUPS = 500
"""An OBJ with more objects, groups and materials is read without them."""
MAX_GROUP_LINES = 50_000
"""An OBJ with more lines that begin a group is read without groups at once."""
MAX_COMBINATIONS = 2_000
"""As above, for different combinations of object, group and material."""
MAX_MATERIALS = 4_000
"""Most materials of an OBJ; reading takes quadratic time in their number."""
MAX_COMPARED = 50_000_000
"""Most triangles compared to find groups that repeat each other."""
READ_BYTES = 1_500_000_000
"""Memory that reading one file may take."""
FARTHEST = 1e6
"""Triangles with a corner farther out than this are left out, in units of the file."""
TEXTURES = "textures were replaced by the mean colour of each"
MSH_HEADER = 4
"""Counts of vertices, normals, texture coordinates and faces, each a little-endian int32."""

Y_FROM_Z = np.array([[1, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]], dtype=np.float64)
"""Turns the z axis to the y axis (4, 4)."""

Group = tuple[str, trimesh.Trimesh, tuple[float, ...] | None]
"""Name of the group, its triangles, and its colour if the file has one."""


def read_mesh(path: Path, repairs: Repairs) -> list[Group]:
    """Read the groups of the mesh file at ``path``, in its units; those of COLLADA in metres.

    Raises:
        AssetError: It cannot be read, is too large, or has no area.
    """
    if path.suffix.lower() not in FORMATS:
        raise AssetError(f"mesh {path.name}: format not known; {', '.join(FORMATS)} are accepted")
    try:
        with (
            warnings.catch_warnings(),
            np.errstate(all="ignore"),
            memory_limit(READ_BYTES),
        ):
            warnings.simplefilter("ignore")  # the result is checked below
            return _groups(path, repairs)
    except AssetError:
        raise
    except MemoryError:
        raise AssetError(
            f"mesh {path.name}: takes more than {READ_BYTES} bytes of memory; simplify it"
        ) from None
    except Exception as error:  # noqa: BLE001  # readers of foreign formats raise anything
        # The text of the error may quote the file, which a link may have outside the object.
        text = "" if path.is_symlink() else shorten(error)
        raise AssetError(
            f"mesh {path.name}: cannot be read ({text or type(error).__name__})"
        ) from None


def load_scene(path: Path) -> trimesh.Scene:
    """Load a mesh file that :func:`read_mesh` has accepted, with its materials and colours.

    Raises:
        AssetError: As :func:`read_mesh`.
    """
    suffix = path.suffix.lower()
    with memory_limit(READ_BYTES):
        return _scene(path, _content(path, suffix), suffix, MeshFiles(path))


def read_msh(content: bytes) -> trimesh.Trimesh:
    """Read MuJoCo's old binary mesh format; the convex hull of the vertices without faces.

    The header is followed by vertices (3 float32 each), normals (3), texture coordinates (2) and
    faces (3 int32).

    Raises:
        ValueError: The counts do not agree with the size of the file, or with each other.
    """
    if len(content) < 4 * MSH_HEADER:
        raise ValueError("too short for an .msh header")
    vertices, normals, coordinates, faces = np.frombuffer(content, "<i4", MSH_HEADER).tolist()
    size = 4 * (MSH_HEADER + 3 * vertices + 3 * normals + 2 * coordinates + 3 * faces)
    if min(vertices, normals, coordinates, faces) < 0 or size != len(content):
        raise ValueError(f"the header gives {size} bytes, the file has {len(content)}")
    corners = np.frombuffer(content, "<f4", 3 * vertices, 4 * MSH_HEADER).astype(np.float64)
    index = np.frombuffer(content, "<i4", 3 * faces, size - 12 * faces).astype(np.int64)
    if faces and not 0 <= index.min() <= index.max() < vertices:
        raise ValueError("a face names a vertex that does not exist")
    if not faces:
        return trimesh.PointCloud(corners.reshape(-1, 3)).convex_hull
    return trimesh.Trimesh(corners.reshape(-1, 3), index.reshape(-1, 3), process=False)


def _groups(path: Path, repairs: Repairs) -> list[Group]:
    suffix, name = path.suffix.lower(), path.name
    content = _content(path, suffix)
    unit = read_unit(content, name, repairs) if suffix == ".dae" else 1.0
    files = MeshFiles(path)
    meshes = [
        group
        for group in _placed(_scene(path, content, suffix, files), name)
        if len(group[1].faces)
    ]
    for key, reason in files.problems.items():
        repairs.note(f"mesh {name}: {quote(key)} {reason}; its plain colour is used")
    if not meshes:
        raise AssetError(f"mesh {name}: has no triangles")
    out: list[Group] = []
    boxes = np.full((len(meshes), 6), np.inf)  # of those in ``out``, compared all at once
    compared = 0
    for group, mesh in meshes:
        plain = _plain(mesh, name, repairs)
        if plain is None:
            repairs.add(f"mesh {name}: a group without area left out")
            continue
        box = np.asarray(plain.bounds).ravel()
        close = np.flatnonzero(np.isclose(box, boxes[: len(out)]).all(axis=1))
        near = [k for k in close if len(out[k][1].faces) == len(plain.faces)]
        compared += len(near) * len(plain.faces)
        if compared > MAX_COMPARED:
            raise AssetError(f"mesh {name}: too many groups in one place; merge them")
        if any(_same_faces(plain, out[k][1]) for k in near):
            repairs.note(f"mesh {name}: the same triangles in another material left out")
            continue  # the back of a sheet
        if unit != 1.0:
            plain.apply_scale(unit)
        boxes[len(out)] = np.asarray(plain.bounds).ravel()
        out.append((group, plain, _colour(mesh, name, repairs)))
    if not out:
        raise AssetError(f"mesh {name}: has no area")
    return out


def _content(path: Path, suffix: str) -> bytes:
    """Return the bytes of a mesh file, after what can be checked before it is parsed."""
    content = read_bounded(path, MAX_BYTES, error=AssetError)
    binary = suffix in {".glb", ".msh"} or content[:200].find(b"format binary") > 0
    if suffix == ".stl" and len(content) >= 84:
        faces = struct.unpack_from("<I", content, 80)[0]
        binary = len(content) == 84 + 50 * faces
        if binary and faces > MAX_FACES:
            raise AssetError(
                f"mesh {path.name}: {faces} triangles; at most {MAX_FACES} are accepted"
            )
    if not binary and len(content) > MAX_TEXT_BYTES:
        raise AssetError(
            f"mesh {path.name}: larger than {MAX_TEXT_BYTES} bytes, the most of a text format"
        )
    if suffix in {".glb", ".gltf"}:
        check_gltf(content, path.name)
    return content


def _scene(path: Path, content: bytes, suffix: str, files: MeshFiles) -> trimesh.Scene:
    def load(**options: bool) -> trimesh.Scene:
        stream = io.BytesIO(content)
        return trimesh.load_scene(stream, file_type=suffix[1:], resolver=files, **options)

    if suffix == ".msh":
        return trimesh.Scene(read_msh(content))
    if suffix != ".obj":
        return load()
    if _has_many_groups(content, path.name):
        return load()
    scene = load(split_objects=True, split_groups=True, group_material=True)
    return scene if len(scene.geometry) <= MAX_GROUPS else load()


def _has_many_groups(content: bytes, name: str) -> bool:
    """Return whether an OBJ has too many groups to be read separately.

    Raises:
        AssetError: It has too many materials to be read at all.
    """
    lines = re.findall(rb"^(o|g|usemtl)[ \t]+(.*)", content, re.MULTILINE)
    materials = len({material for key, material in lines if key == b"usemtl"})
    if materials > MAX_MATERIALS:
        raise AssetError(
            f"mesh {name}: {materials} materials; at most {MAX_MATERIALS} are accepted"
        )
    current: dict[bytes, bytes] = {}
    combinations = set()
    for key, group in lines[: MAX_GROUP_LINES + 1]:
        current[key] = group
        combinations.add(tuple(current.values()))
    return len(lines) > MAX_GROUP_LINES or len(combinations) > MAX_COMBINATIONS


def _placed(scene: trimesh.Scene, file: str) -> list[tuple[str, trimesh.Trimesh]]:
    """Return every mesh with its transforms applied, counted before any is copied."""
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
    """Return the triangles with equal vertices merged, without duplicate and empty faces."""
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
    """Return whether both consist of the same triangles, of either orientation."""
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
            known = image.format is None or image.format in IMAGE_FORMATS  # None: made in memory
            if not known or image.width * image.height > MAX_PIXELS:
                raise ValueError("format or size not accepted")
            colour[:3] = mean_of(image)
            repairs.note(TEXTURES)
        except ValueError as error:
            repairs.add(f"mesh {name}: a texture left out: {error}")
    return tuple(float(c) for c in colour)
