"""Checks of the scene and the object of a bundle before a simulator reads them.

Both are XML of the elements and attributes that exports contain; the files that these name must be
meshes of the bundle, since simulators read other names from the disk. Values that determine
memory or time are bounded.
"""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Collection, Mapping
from xml.parsers import expat

from articulate.errors import BundleError, quote, shorten

SCENE_ELEMENTS = frozenset({
    "mujoco", "compiler", "option", "flag", "size", "asset", "mesh", "worldbody", "body",
    "inertial", "joint", "geom", "site", "contact", "exclude", "equality", "actuator", "general",
    "sensor",
})  # fmt: skip
"""Elements of an exported scene, of which only ``mesh`` reads a file."""
SCENE_ATTRIBUTES = frozenset({
    "active", "actuatorfrclimited", "actuatorfrcrange", "actuatorgravcomp", "angle", "armature",
    "autolimits", "axis", "biasprm", "biastype", "body1", "body2", "ccd_iterations",
    "ccd_tolerance", "conaffinity", "condim", "cone", "contype", "ctrllimited", "ctrlrange",
    "damping", "data", "density", "diaginertia", "dyntype", "file", "forcelimited", "forcerange",
    "friction", "frictionloss", "gainprm", "gaintype", "gap", "gear", "gravcomp", "gravity",
    "group", "impratio", "inertia", "inertiafromgeom", "integrator", "iterations", "joint",
    "joint1", "joint2", "limited", "ls_iterations", "ls_tolerance", "magnetic", "margin", "mass",
    "memory", "mesh", "meshdir", "model", "name", "noslip_iterations", "noslip_tolerance", "num",
    "polycoef", "pos", "priority", "quat", "range", "reduce", "ref", "rgba", "size", "solimp",
    "solimpfriction", "solimplimit", "solmix", "solref", "solreffriction", "solreflimit",
    "solver", "springref", "stiffness", "subtree1", "subtree2", "timestep", "tolerance", "type",
    "viscosity", "wind",
    # flags of `option`
    "constraint", "equality", "limit", "contact", "spring", "damper", "clampctrl", "warmstart",
    "filterparent", "actuation", "refsafe", "sensor", "midphase", "eulerdamp", "autoreset",
    "nativeccd", "island", "multiccd",
})  # fmt: skip
"""Attributes of an exported scene."""
SCENE_LIMITS = {
    "memory": 1 << 28, "iterations": 1000, "ls_iterations": 1000, "noslip_iterations": 1000,
    "ccd_iterations": 1000, "num": 100,
}  # fmt: skip
"""Largest values of attributes that determine memory [bytes] or time."""
OBJECT_ELEMENTS = frozenset({
    "robot", "link", "inertial", "origin", "mass", "inertia", "collision", "geometry", "mesh",
    "box", "cylinder", "sphere", "joint", "parent", "child", "axis", "limit", "dynamics", "mimic",
})  # fmt: skip
"""Elements of an exported URDF, likewise."""
OBJECT_ATTRIBUTES = frozenset({
    "damping", "effort", "filename", "friction", "ixx", "ixy", "ixz", "iyy", "iyz", "izz", "joint",
    "length", "link", "lower", "multiplier", "name", "offset", "radius", "rpy", "scale", "size",
    "type", "upper", "value", "velocity", "xyz",
})  # fmt: skip
"""Attributes of an exported URDF."""
MAX_ELEMENTS = {"body": 500, "link": 500, "joint": 500, "geom": 5000, "collision": 5000}
"""Most elements of a kind."""
MAX_OTHERS = 20_000
"""Most elements of each other kind."""
MAX_XML = 16 << 20
"""Largest XML file [characters]."""
MAX_DEPTH = 200
"""Deepest nesting of elements."""
MAX_VALUE = 2000
"""Longest value of an attribute."""
MAX_NUMBER = 1e10
"""Largest number in an attribute."""
NAMES = frozenset({
    "name", "model", "mesh", "file", "filename", "joint", "joint1", "joint2", "body1", "body2",
    "subtree1", "subtree2", "link",
})  # fmt: skip
"""Attributes with names rather than numbers."""
MAX_MESH_LINES = 500_000
"""Most vertices and faces of all meshes of a file together."""
MAX_COORDINATE_M = 1e3
"""Largest coordinate of a vertex [m]."""
MESH_FOLDER = "meshes"
FOLDERS = frozenset({"meshdir", "texturedir", "assetdir"})
"""Attributes of a scene that name a folder."""
_PLAIN = re.compile(r"\w[\w.-]*")
_FOREIGN_LINE = re.compile(rb"(?:\A|[\r\n])[ \t\v\f]*[^vf#\s]")
"""A line of a Wavefront file that is neither vertex, face nor comment; some lines end with CR."""
_LINE = re.compile(rb"v( -?\d[\d.e+-]*)( -?\d[\d.e+-]*)( -?\d[\d.e+-]*)|f((?: [1-9]\d{0,7}){3})")
"""A line as exports write it: a vertex, or a face and the numbers of its vertices."""


def check_scene(text: str, meshes: Mapping[str, bytes], where: str) -> None:
    """Check that a scene refers only to ``meshes``, by names without a folder.

    Raises:
        BundleError: It refers to another file, is too large, or is not an exported scene.
    """
    attributes = _attributes(text, "mujoco", SCENE_ELEMENTS, SCENE_ATTRIBUTES, where)
    for attribute, value in attributes:
        if attribute == "file":
            _check_file(value, value, meshes, where)
        elif attribute in FOLDERS and value != MESH_FOLDER:
            raise BundleError(f"{where}: refers to the folder {quote(value, 60)}")
        elif attribute in SCENE_LIMITS:
            most = SCENE_LIMITS[attribute]
            if not re.fullmatch(r"\d{1,12}", value) or int(value) > most:
                raise BundleError(
                    f"{where}: {attribute} is {quote(value, 60)}; it must be at most {most}"
                )
    _check_meshes(meshes, where)


def check_object(text: str, meshes: Mapping[str, bytes], where: str) -> None:
    """Check that a URDF refers only to ``meshes``, by paths relative to it.

    Raises:
        BundleError: It refers to another file, is too large, or is not an exported URDF.
    """
    for attribute, value in _attributes(text, "robot", OBJECT_ELEMENTS, OBJECT_ATTRIBUTES, where):
        if attribute == "filename":
            _check_file(value, value.removeprefix(f"{MESH_FOLDER}/"), meshes, where)
    _check_meshes(meshes, where)


class _Elements:
    """Attributes of an XML file, collected while it is parsed; stops at the first violation."""

    def __init__(
        self, root: str, elements: Collection[str], attributes: Collection[str], where: str
    ) -> None:
        self.found: list[tuple[str, str]] = []
        self._root, self._elements, self._attributes = root, elements, attributes
        self._where = where
        self._depth = 0
        self._counts: Counter[str] = Counter()

    def start(self, name: str, values: dict[str, str]) -> None:
        if not self._counts and name != self._root:
            raise BundleError(
                f"{self._where}: begins with <{shorten(name, 60)}> and not with <{self._root}>"
            )
        if name not in self._elements:
            raise BundleError(
                f"{self._where}: has an element <{shorten(name, 60)}>, which no export writes"
            )
        self._counts[name] += 1
        self._depth += 1
        most = MAX_ELEMENTS.get(name, MAX_OTHERS)
        if self._counts[name] > most or self._depth > MAX_DEPTH:
            raise BundleError(
                f"{self._where}: has more than {most} elements <{name}> or {MAX_DEPTH} levels"
            )
        for attribute, value in values.items():
            if attribute not in self._attributes or len(value) > MAX_VALUE:
                raise BundleError(
                    f"{self._where}: has an attribute {shorten(attribute, 60)} of "
                    f"{len(value)} characters, which no export writes"
                )
            if attribute not in NAMES and not all(map(_is_moderate, value.split())):
                raise BundleError(
                    f"{self._where}: {attribute} is {quote(value, 60)}; numbers must be finite and "
                    f"at most {MAX_NUMBER:g}"
                )
            self.found.append((attribute, value))

    def end(self, _: str) -> None:
        self._depth -= 1


def _attributes(
    text: str, root: str, elements: Collection[str], attributes: Collection[str], where: str
) -> list[tuple[str, str]]:
    """Return names and values of all attributes.

    Raises:
        BundleError: It is not an XML file of these elements and attributes.
    """
    if len(text) > MAX_XML:
        raise BundleError(f"{where}: longer than {MAX_XML >> 20} million characters")
    if re.search(r"<[!?]", text):
        raise BundleError(f"{where}: refers to something outside of the bundle")
    handler = _Elements(root, elements, attributes, where)
    parser = expat.ParserCreate()
    parser.StartElementHandler, parser.EndElementHandler = handler.start, handler.end
    try:
        parser.Parse(text, True)
    except expat.ExpatError as error:
        raise BundleError(f"{where}: not XML ({error}); export it again") from None
    return handler.found


def _check_file(file: str, name: str, meshes: Collection[str], where: str) -> None:
    if file not in meshes or not _PLAIN.fullmatch(name):
        raise BundleError(f"{where}: names {quote(file, 60)}, which is not in it")


def _check_meshes(meshes: Mapping[str, bytes], where: str) -> None:
    """Check that meshes hold vertices and faces only, and no material or texture file."""
    beside = where.rpartition("/")[0]
    lines = 0
    for file, content in meshes.items():
        path = file if "/" in file else f"{MESH_FOLDER}/{file}"
        lines += content.count(b"\n") + 1
        if lines > MAX_MESH_LINES:
            raise BundleError(
                f"{beside}/{path}: the meshes have more than {MAX_MESH_LINES} vertices and faces"
            )
        if not file.endswith(".obj") or _FOREIGN_LINE.search(content):
            raise BundleError(
                f"{beside}/{path}: holds more than vertices and faces; export it again"
            )
        if not _is_mesh(content):
            raise BundleError(
                f"{beside}/{path}: not a mesh of finite vertices and faces between them; export it "
                "again"
            )


def _is_mesh(content: bytes) -> bool:
    """Return whether all vertices are finite and all faces refer to them.

    Bullet would read beyond its array of vertices otherwise.
    """
    vertices, faces, highest = 0, 0, 0
    for line in content.removesuffix(b"\n").split(b"\n"):
        match = _LINE.fullmatch(line)
        if match is None:
            return False
        if match[4] is not None:
            faces += 1
            highest = max(highest, *map(int, match[4].split()))
        else:
            vertices += 1
            if not all(_is_coordinate(match[k]) for k in (1, 2, 3)):
                return False
    return faces > 0 and highest <= vertices


def _is_moderate(word: str) -> bool:
    """Return whether a word of an attribute is text or a finite number that is not too large."""
    try:
        return abs(float(word)) <= MAX_NUMBER
    except ValueError:
        return True


def _is_coordinate(text: bytes) -> bool:
    try:
        value = float(text)
    except ValueError:
        return False
    return math.isfinite(value) and abs(value) <= MAX_COORDINATE_M
