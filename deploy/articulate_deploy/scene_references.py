"""What the scene and the object of a bundle refer to, looked through before an engine reads them.

Both are XML with nothing in it but the elements that ours are written with; the files that these
name must be meshes of the bundle, by plain names: an engine asks the disk for all others.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Mapping
from xml.parsers import expat

from articulate.errors import BundleError

SCENE_ELEMENTS = frozenset({
    "mujoco", "compiler", "option", "flag", "size", "asset", "mesh", "worldbody", "body",
    "inertial", "joint", "geom", "site", "contact", "exclude", "equality", "actuator", "general",
    "sensor",
})  # fmt: skip
"""Elements of an exported scene, none of which reads a file but ``mesh``."""
OBJECT_ELEMENTS = frozenset({
    "robot", "link", "inertial", "origin", "mass", "inertia", "collision", "geometry", "mesh",
    "box", "cylinder", "sphere", "joint", "parent", "child", "axis", "limit", "dynamics", "mimic",
})  # fmt: skip
"""Elements of an exported URDF, likewise."""
MESH_FOLDER = "meshes"
FOLDERS = frozenset({"meshdir", "texturedir", "assetdir"})
"""Attributes of a scene that name a folder."""
_PLAIN = re.compile(r"\w[\w.-]*")
_FOREIGN_LINE = re.compile(rb"(?:\A|[\r\n])[ \t\v\f]*[^vf#\s]")
"""A line of a Wavefront file that is neither corner, face nor remark; some end lines with CR."""
_LINE = re.compile(rb"v(?: -?\d[\d.e+-]*){3}|f((?: [1-9]\d{0,7}){3})")
"""A line as we write it: a corner, or a face and the numbers of its corners."""


def check_scene(text: str, meshes: Mapping[str, bytes], where: str) -> None:
    """Refuse a scene that refers to anything but ``meshes``, which have names without a folder.

    Raises:
        BundleError: It does, or is no scene.
    """
    for attribute, value in _attributes(text, "mujoco", SCENE_ELEMENTS, where):
        if attribute.startswith("file"):
            _check_file(value, value, meshes, where)
        elif attribute in FOLDERS and value != MESH_FOLDER:
            raise BundleError(f"{where}: refers to the folder {value[:60]!r}")
    _check_meshes(meshes, where)


def check_object(text: str, meshes: Mapping[str, bytes], where: str) -> None:
    """Refuse a URDF that refers to anything but ``meshes``, which have paths beside it.

    Raises:
        BundleError: It does, or is no URDF.
    """
    for attribute, value in _attributes(text, "robot", OBJECT_ELEMENTS, where):
        if attribute.startswith("file"):
            _check_file(value, value.removeprefix(f"{MESH_FOLDER}/"), meshes, where)
    _check_meshes(meshes, where)


def _attributes(
    text: str, root: str, known: Collection[str], where: str
) -> Iterator[tuple[str, str]]:
    """Names and values of all attributes; BundleError if it is not such a document."""
    if re.search(r"<[!?]", text):
        raise BundleError(f"{where}: refers to something outside of the bundle")
    elements: list[tuple[str, dict[str, str]]] = []
    parser = expat.ParserCreate()
    parser.StartElementHandler = lambda name, values: elements.append((name, values))
    try:
        parser.Parse(text, True)
    except expat.ExpatError as error:
        raise BundleError(f"{where}: not XML ({error}); export it again") from None
    if elements[0][0] != root:
        raise BundleError(f"{where}: begins with <{elements[0][0][:60]}> and not with <{root}>")
    for name, values in elements:
        if name not in known:
            raise BundleError(f"{where}: has an element <{name[:60]}>, which no export writes")
        yield from values.items()


def _check_file(file: str, name: str, meshes: Collection[str], where: str) -> None:
    if file not in meshes or not _PLAIN.fullmatch(name):
        raise BundleError(f"{where}: names {file[:60]!r}, which is not in it")


def _check_meshes(meshes: Mapping[str, bytes], where: str) -> None:
    """Meshes hold corners and faces, and name no other file: a material, a texture."""
    beside = where.rpartition("/")[0]
    for file, content in meshes.items():
        path = file if "/" in file else f"{MESH_FOLDER}/{file}"
        if not file.endswith(".obj") or _FOREIGN_LINE.search(content):
            raise BundleError(
                f"{beside}/{path}: holds more than corners and faces; export it again"
            )
        if not _is_mesh(content):
            raise BundleError(
                f"{beside}/{path}: is no mesh whose faces name its own corners; export it again"
            )


def _is_mesh(content: bytes) -> bool:
    """Whether faces name corners that are there: Bullet reads beyond the corners otherwise."""
    lines = [_LINE.fullmatch(line) for line in content.removesuffix(b"\n").split(b"\n")]
    faces = [line[1] for line in lines if line is not None and line[1] is not None]
    corners = len(lines) - len(faces)
    return (
        None not in lines
        and bool(faces)
        and all(int(word) <= corners for face in faces for word in face.split())
    )
