"""Reduce an MJCF file with its includes to shape, mass and motion: a text that names no file.

The file is not trusted, so MuJoCo does not read it. Its elements are copied one by one, only
those in the table ``KEPT``, so that nothing in it makes MuJoCo open a path, load a plug-in,
allocate memory or expand an entity. Sites, cameras, lights, sensors, keyframes and solver
settings do not describe the object and are skipped.
"""

from __future__ import annotations

import math
import os
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from lxml import etree

from articulate.errors import AssetError, quote
from articulate.formats.repairs import Repairs
from articulate.formats.source_object import MAX_GEOMETRIES, MAX_JOINTS, MAX_LINKS, free_name
from articulate.formats.xml_input import Element, read_markup, tag_of
from articulate.untrusted import open_regular

MAX_FILES = 64
"""Most files that are included, each time counted."""
MAX_DEPTH = 128
"""Deepest nesting of elements."""
MAX_ELEMENTS = 100_000
"""Most elements of all files together."""
MAX_SIZE = 3e8
"""Largest size that MuJoCo itself may allocate for one element of a file."""
MAX_FILE_BYTES = 300_000_000
"""Largest file that MuJoCo itself may read."""
UNITS = ["", *"KMGTPE"]
PRODUCTS = {
    "hfield": ("nrow", "ncol"),
    "texture": ("width", "height"),
    "numeric": ("size",),
    "composite": ("count",),
    "flexcomp": ("count",),
    "replicate": ("count",),
}
"""Attributes whose product is the size of an element."""
ROOTS = ("mujoco", "mujocoinclude")
INSIDE = frozenset({"body", "geom", "frame", "replicate"})
"""Elements of a fragment that belong into a world."""
_FRAME = "pos quat axisangle xyaxes zaxis euler"
KEPT = {
    "compiler": "angle eulerseq inertiafromgeom inertiagrouprange fitaabb settotalmass boundmass "
    "boundinertia",
    "default": "class",
    "asset": "",
    "mesh": "name class file scale refpos refquat vertex face builtin params inertia",
    "material": "name class rgba",
    "worldbody": "",
    "body": f"name childclass mocap {_FRAME}",
    "frame": f"name childclass {_FRAME}",
    "replicate": f"count offset sep childclass {_FRAME}",
    "inertial": f"{_FRAME} mass diaginertia fullinertia",
    "joint": "name class type pos axis range limited ref damping frictionloss armature stiffness",
    "freejoint": "name",
    "geom": f"name class type size {_FRAME} fromto mesh material rgba group contype conaffinity "
    "mass density shellinertia fitscale",
    "equality": "active",
}
"""Attributes that are read, by element; contact, solver and looks have presets."""
COUPLINGS = {
    "joint": "class joint1 joint2 polycoef active",
    "weld": "class body1 body2 active",
    "connect": "class body1 body2 anchor active",
}
"""Attributes that are read of the elements of ``<equality>``."""
WORDS = (
    "name class childclass type mesh material file builtin limited angle eulerseq inertiafromgeom "
    "fitscale fitaabb shellinertia mocap sep inertia joint1 joint2 body1 body2 active"
)
"""Attributes that are not numbers."""
_IN_BODY = "body frame replicate geom joint freejoint inertial"
PLACES = {
    "mujoco": "default asset worldbody equality",
    "default": "default mesh material joint geom equality",
    "asset": "mesh material",
    "equality": "joint weld connect",
    "worldbody": "body frame replicate geom",
    "body": _IN_BODY,
    "frame": _IN_BODY,
    "replicate": _IN_BODY,
}
"""Elements that are read, by parent."""
NOTED = {
    "actuator": "actuators",
    "tendon": "tendons",
    "contact": "contact pairs",
    "deformable": "deformable bodies",
    "flexcomp": "deformable bodies",
    "composite": "composites",
    "hfield": "height fields",
    "skin": "skins",
}
"""Elements that are left out with a note."""
GROUPS = ("actuator", "tendon", "contact", "deformable")
"""Those of them with several elements inside."""
UNREADABLE = {"attach": "another model attached to it", "model": "another model in its assets"}
SHAPELESS = ("site", "camera", "light", "plugin", "joint", "freejoint", "inertial")
"""Elements of a body that are left out without a note where they are not read."""
MAX_COPIES = 20_000
"""Most elements of the model after ``<replicate>``."""
LARGEST_RADIAN = 2.01 * math.pi
"""Largest angle from which a file without a unit is in radians, a full turn."""


@dataclass(frozen=True, kw_only=True)
class MjcfText:
    """An MJCF file reduced to shape, mass and motion."""

    name: str
    path: Path
    text: str
    meshes: Mapping[str, str]
    """File by name of the mesh, from the folder of ``path``."""
    textures: Mapping[str, str]
    """File by name of the material."""
    geoms: tuple[tuple[str, str], ...]
    """Name, and file and line, of each geom; in ``text`` its name is ``g{index}#``."""
    lines: Mapping[tuple[str, str], str]
    """File and line by ``body`` or ``joint`` and its name, or by ``equality`` and the name that it
    has in ``text``."""
    driven: frozenset[str]
    """Joints that an actuator drives."""
    files: Mapping[str, Path]
    """Included files, by reference."""
    repairs: Repairs

    def mesh_file(self, name: str) -> str:
        """Return the name of the file of mesh ``name`` in ``text``, which has no path."""
        return _mesh_file(self.meshes, name)


def read_text(path: Path) -> MjcfText:
    """Return the MJCF file at ``path`` with its includes, reduced to ``KEPT``.

    Raises:
        AssetError: It cannot be read, or holds something that cannot be left out.
    """
    repairs = Repairs()
    root, files = merge_includes(path, repairs)
    compiler: dict[str, str] = {}
    for element in root.iter():
        if tag_of(element) == "compiler":
            compiler.update(element.attrib)
    if compiler.get("coordinate", "local") != "local":
        raise AssetError(
            f"{path}: coordinate={quote(compiler['coordinate'])} is no longer read; save the model "
            "in local coordinates with MuJoCo 2.1"
        )
    name = re.sub(r"[^A-Za-z0-9_.-]+", "_", root.get("model") or path.stem)
    assets = _Assets(root, compiler)
    reduced = _Reduced(name, root, assets, repairs)
    out = etree.Element("mujoco")
    kept = {key: compiler[key] for key in KEPT["compiler"].split() if key in compiler}
    if "angle" not in compiler and _is_in_radians(root, repairs):
        kept["angle"] = "radian"
    etree.SubElement(out, "compiler", {**kept, "autolimits": "true"})
    for child in root:
        reduced.copy(child, out)
    reduced.tie()
    for what, count in sorted(reduced.left_out.items()):
        repairs.note(f"{count} {what} left out")
    return MjcfText(
        name=name,
        path=path,
        text=etree.tostring(out, encoding="unicode"),
        meshes=assets.meshes,
        textures=assets.textures,
        geoms=tuple(reduced.geoms),
        lines=reduced.lines,
        driven=frozenset(assets.driven),
        files=files,
        repairs=repairs,
    )


class _Assets:
    """Files of meshes and textures by name, and the joints with actuators."""

    def __init__(self, root: Element, compiler: Mapping[str, str]) -> None:
        self.meshes: dict[str, str] = {}
        self.materials: dict[str, str] = {}
        self.driven: set[str] = set()
        self.images: dict[str, str] = {}
        self.compiler = compiler
        for element in root.iter():
            parent = element.getparent()
            if parent is None:
                continue
            if tag_of(parent) == "asset":
                self.add(element, tag_of(element))
            elif tag_of(parent) == "actuator" and element.get("joint"):
                self.driven.add(element.get("joint"))

    @property
    def textures(self) -> dict[str, str]:
        """Image by material."""
        named = self.materials.items()
        return {name: self.images[image] for name, image in named if image in self.images}

    def add(self, element: Element, tag: str) -> None:
        file = (element.get("file") or "").strip().replace("\\", "/")
        stem = file.rsplit("/", 1)[-1].rsplit(".", 1)[0]
        if tag == "mesh":
            element.set("name", element.get("name") or stem)
            if file:
                self.meshes.setdefault(element.get("name"), self.reference(file, "meshdir"))
        elif tag == "texture" and file:
            name = element.get("name") or stem
            self.images.setdefault(name, self.reference(file, "texturedir"))
        elif tag == "material" and element.get("name"):
            layers = [layer.get("texture") for layer in element if layer.get("role") == "rgb"]
            image = element.get("texture") or next(iter(layers), None) or ""
            self.materials.setdefault(element.get("name"), image)

    def reference(self, file: str, folder: str) -> str:
        """Return the path at which MuJoCo looks for a file, from the folder of the model."""
        if self.compiler.get("strippath") == "true":
            file = file.rsplit("/", 1)[-1]
        inside = self.compiler.get(folder, self.compiler.get("assetdir", ""))
        absolute = file.startswith("/") or file[1:2] == ":"
        return file if absolute or not inside else f"{inside.rstrip('/')}/{file}"


class _Reduced:
    """Copy the elements that are read and make their names unique."""

    def __init__(self, model: str, root: Element, assets: _Assets, repairs: Repairs) -> None:
        self.model = model
        self.named = {"world"} | {e.get("name") for e in root.iter() if e.get("name")}
        self.assets = assets
        self.repairs = repairs
        self.left_out: dict[str, int] = {}
        self.geoms: list[tuple[str, str]] = []
        self.lines: dict[tuple[str, str], str] = {}
        self.used: dict[str, set[str]] = {"body": {"world"}}
        self.sites: dict[str, str] = {}
        """Body of each site."""
        self.coupled = 0
        self.ties: list[tuple[Element, Element]] = []
        """Constraints between bodies, and their copies."""
        self.times = 1.0
        """Number of copies of the current element."""
        self.elements = 0.0

    def copy(self, element: Element, into: Element) -> None:
        """Copy the parts of ``element`` that are read, with those below it."""
        tag, parent = tag_of(element), tag_of(into)
        if tag == "site" and element.get("name"):
            self.sites.setdefault(element.get("name"), _owner(into))
        if not self.is_read(element, tag, parent):
            return
        keys = (COUPLINGS if parent == "equality" else KEPT)[tag].split()
        if parent == "default":
            keys = [key for key in keys if key not in {"name", "file", "vertex", "face"}]
        made = etree.SubElement(into, tag)
        for key in keys:
            value = element.get(key)
            if value is not None and not self.is_foreign(key, value):
                made.set(key, self.value(element, key, value))
        if parent == "equality":
            self.couple(element, made, tag)
        elif parent != "default":
            self.name(element, made, tag)
        before = self.times
        if tag == "replicate":
            self.times *= max(float((made.get("count") or "1").split()[0]), 1.0)
        self.count(element)
        for child in element:
            self.copy(child, made)
        self.times = before

    def couple(self, element: Element, made: Element, tag: str) -> None:
        """Give a coupling a unique name, and keep its line."""
        name = f"e{self.coupled}#"
        self.coupled += 1
        made.set("name", name)
        self.lines["equality", name] = where(element)
        if tag != "joint":
            self.ties.append((element, made))

    def tie(self) -> None:
        """Set the bodies of constraints that name sites."""
        for element, made in self.ties:
            if element.get("site1") or element.get("site2"):
                for key, site in (("body1", "site1"), ("body2", "site2")):
                    made.set(key, self.sites.get(element.get(site) or "", "world"))
            if tag_of(made) == "connect":
                made.set("anchor", made.get("anchor") or "0 0 0")

    def count(self, element: Element) -> None:
        """Count one element, with its copies.

        Raises:
            AssetError: They are too many.
        """
        self.elements += self.times
        if self.elements > MAX_COPIES:
            raise AssetError(f"{where(element)}: more than {MAX_COPIES} elements with <replicate>")

    def reject_many(self, tag: str, element: Element) -> None:
        """Raise AssetError where ``element`` is a body, joint or geom too many."""
        for kind, count, most, name in (
            ("body", len(self.used["body"]) - 1, MAX_LINKS, "bodies"),  # without the world
            ("joint", len(self.used.get("joint", ())), MAX_JOINTS, "joints"),
            ("geom", len(self.geoms), MAX_GEOMETRIES, "geoms"),
        ):
            if tag == kind and count >= most:
                raise AssetError(f"{where(element)}: more than {most} {name}")

    def is_read(self, element: Element, tag: str, parent: str) -> bool:
        """Return whether the element is copied; note what is left out.

        Raises:
            AssetError: It cannot be left out.
        """
        if tag in UNREADABLE and parent in {"asset", "body", "frame", "worldbody"}:
            raise AssetError(
                f"{where(element)}: has {UNREADABLE[tag]} (<{tag}>), which is not read; save it "
                "as one model with MuJoCo first"
            )
        coupling = parent == "equality" and tag not in COUPLINGS
        if tag in NOTED or coupling:
            what = "constraints between bodies" if coupling else NOTED[tag]
            count = len(element) if tag in GROUPS else 1
            self.left_out[what] = self.left_out.get(what, 0) + count
            return False
        if tag not in PLACES.get(parent, "").split():
            if parent in {"body", "frame", "worldbody"} and tag not in SHAPELESS:
                self.repairs.add(f"unknown element <{tag}> left out ({where(element)})")
            return False
        name = element.get("name") or ""
        if parent == "asset" and name in self.used.setdefault(tag, set()):
            self.repairs.add(f"a second {tag} called {quote(name)} left out ({where(element)})")
            return False
        if parent == "asset":
            self.used[tag].add(name)
        return True

    def is_foreign(self, key: str, value: str) -> bool:
        """Return whether the attribute names a material that is not defined."""
        if key != "material" or value in self.assets.materials:
            return False
        self.repairs.note(f"material {quote(value)} is not defined: grey instead")
        return True

    def value(self, element: Element, key: str, text: str) -> str:
        """Return the attribute as MuJoCo reads it, numbers separated by spaces."""
        if key == "file":
            return _mesh_file(self.assets.meshes, element.get("name"))
        if key in WORDS.split():
            return text
        if "," in text:
            self.repairs.add(f"commas between numbers read as spaces ({where(element)})")
            text = text.replace(",", " ")
        place = f"{where(element)}: {key}={quote(text, 60)} of <{tag_of(element)}>"
        try:
            numbers = [float(word) for word in text.split()]
        except ValueError:
            raise AssetError(f"{place} is not made of numbers") from None
        if not all(math.isfinite(number) for number in numbers):
            raise AssetError(f"{place} is not finite")
        return text

    def name(self, element: Element, made: Element, tag: str) -> None:
        """Give geoms, bodies and joints unique names, and keep their lines."""
        own = element.get("name") or ""
        self.reject_many(tag, element)
        if tag == "geom":
            label = f"{own} {element.get('mesh') or ''}".strip()
            self.geoms.append((label, f"{where(element)} (geom {len(self.geoms)})"))
            made.set("name", f"g{len(self.geoms) - 1}#")
        elif tag in {"body", "joint"}:
            used = self.used.setdefault(tag, set())
            owner = _owner(made.getparent())
            if own:
                name = free_name(own, used)
            else:
                proposed = _body_name(element, self.model) if tag == "body" else f"{owner}_joint"
                name = free_name(proposed, used | self.named)
            if own and name != own:
                self.repairs.add(
                    f"a second {tag} is called {own}: renamed {name} ({where(element)})"
                )
            used.add(name)
            made.set("name", name)
            self.lines[tag, name] = where(element)


def _owner(made: Element) -> str:
    """Return the name of the body that ``made`` is or belongs to."""
    bodies = (e for e in (made, *made.iterancestors()) if tag_of(e) == "body")
    return next((body.get("name") for body in bodies), "world")


def _body_name(element: Element, model: str) -> str:
    """Return a name for a body without one: after its joint, else after the model."""
    names = (child.get("name") for child in element if tag_of(child) == "joint")
    joint = next((name for name in names if name), None)
    return f"{joint}_link" if joint else model


def _mesh_file(meshes: Mapping[str, str], name: str) -> str:
    suffix = "".join(re.findall(r"\.[A-Za-z0-9]+$", meshes[name])).lower()
    return f"mesh_{list(meshes).index(name)}{suffix}"


def _is_in_radians(root: Element, repairs: Repairs) -> bool:
    """Return whether a file without a unit of angles, degrees by default, has radians."""
    angles = [abs(angle) for element in root.iter() for angle in _angles(element)]
    largest = max(angles, default=0.0)
    if not 0.0 < largest <= LARGEST_RADIAN:
        return False
    repairs.add(f"angles have no unit and none is above {largest:.4g}: read as radians")
    return True


def _angles(element: Element) -> Iterator[float]:
    """Iterate over the angles of an element: of its frame and, for a hinge, of its range."""
    words = (element.get("euler") or "").replace(",", " ").split()
    words += (element.get("axisangle") or "").replace(",", " ").split()[3:]
    if tag_of(element) == "joint" and element.get("type", "hinge") == "hinge":
        words += f"{element.get('range') or ''} {element.get('ref') or ''}".split()
    for word in words:
        try:
            yield float(word)
        except ValueError:
            continue


def where(element: Element) -> str:
    """Return file and line of an element of :func:`merge_includes`."""
    return str(element.get("_at") or "?")


def merge_includes(path: Path, repairs: Repairs) -> tuple[Element, dict[str, Path]]:
    """Return the root element of ``path`` without ``<include>``, and the files by reference.

    A scene, which is an included file whose world has a ground or lights, is left out where the
    file itself also has a world.

    Raises:
        AssetError: A file cannot be read or is not MJCF, or they are too many.
    """
    files = _Files(path, repairs)
    root = files.parsed(path)
    if tag_of(root) not in ROOTS:
        raise AssetError(
            f"{path}: not MJCF: its root element is <{tag_of(root)[:60]}>, <mujoco> was expected"
        )
    files.include(root, path, 0)
    if tag_of(root) == "mujocoinclude":
        root = _wrapped(root)
        repairs.add("a fragment that other files include: read as a separate model")
    _without_scene(root, repairs)
    return root, files.found


class _Files:
    """Parse files and replace each ``<include>`` by the content of its file."""

    def __init__(self, path: Path, repairs: Repairs) -> None:
        self.path = path
        self.repairs = repairs
        self.found: dict[str, Path] = {}
        self.count = self.elements = 0

    def parsed(self, path: Path) -> Element:
        root = read_markup(path, self.repairs)
        at = path if path == self.path else path.name
        for element in root.iter():
            self.elements += 1
            element.set("_at", f"{at}:{element.sourceline}")
        if self.elements > MAX_ELEMENTS:
            raise AssetError(
                f"{self.path}: more than {MAX_ELEMENTS} elements with all that it includes"
            )
        return root

    def include(self, element: Element, path: Path, depth: int) -> None:
        """Replace each ``<include>`` below ``element`` by the content of its file."""
        if depth > MAX_DEPTH:
            raise AssetError(f"{where(element)}: elements nested deeper than {MAX_DEPTH}")
        for child in list(element):
            if tag_of(child) != "include":
                self.include(child, path, depth + 1)
                continue
            found = self.file(child, path)
            root = self.parsed(found)
            if tag_of(root) not in ROOTS:
                raise AssetError(
                    f"{where(child)}: included file {found.name} is not MJCF: its root element is "
                    f"<{tag_of(root)[:60]}>"
                )
            self.include(root, found, depth + 1)
            _mark_scene(root, found.name)
            for moved in list(root):
                child.addprevious(moved)
            element.remove(child)

    def file(self, element: Element, path: Path) -> Path:
        """Return the file of an ``<include>`` in ``path``: beside the main file, or beside it."""
        reference = (element.get("file") or "").strip().replace("\\", "/")
        self.count += 1
        if self.count > MAX_FILES:
            raise AssetError(f"{self.path}: includes more than {MAX_FILES} files")
        folders = list(dict.fromkeys((self.path.parent, path.parent)))
        for folder in folders:
            if reference and _is_file(folder / reference):
                self.found[reference] = folder / reference
                return folder / reference
        raise AssetError(
            f"{where(element)}: included file {quote(reference)} not found; looked in "
            f"{', '.join(f'{folder}/' for folder in folders)}. Put it there"
        )


def _is_file(path: Path) -> bool:
    try:
        return path.is_file()
    except OSError:  # a name that is too long
        return False


def check_native(path: Path) -> None:
    """Reject a file that would make MuJoCo itself allocate too much, or read special files.

    Args:
        path: An MJCF file that MuJoCo is to load as it is.

    Raises:
        AssetError: A size is too large, or a file that it names is not a regular one.
    """
    root, _ = merge_includes(path, Repairs())
    compiler: dict[str, str] = {}
    for element in root.iter():
        if tag_of(element) == "compiler":
            compiler.update(element.attrib)
    folders = ["", *(compiler.get(key, "") for key in ("assetdir", "meshdir", "texturedir"))]
    for element in root.iter():
        tag = tag_of(element)
        keys = element.attrib if tag == "size" else ()
        products: list[tuple[str, ...]] = [(str(key),) for key in keys] or [PRODUCTS.get(tag, ())]
        for product in products:
            size = math.prod(_size(element.get(key) or "") for key in product)
            if size > MAX_SIZE:
                names = " and ".join(product)
                raise AssetError(f"{where(element)}: {names} of <{tag}>: more than {MAX_SIZE:.0g}")
        files = [value for key, value in element.attrib.items() if key.startswith("file")]
        for file in {path.parent / folder / value for folder in folders for value in files}:
            if os.path.lexists(file):
                open_regular(file, limit_bytes=MAX_FILE_BYTES, error=AssetError).close()


def _size(text: str) -> float:
    """Return the product of the numbers of an attribute, each with a unit such as M or G."""
    found = re.findall(r"(\d+)\s*([KMGTPE]?)", text)
    return math.prod(float(number) * 1024.0 ** UNITS.index(unit) for number, unit in found)


def _mark_scene(root: Element, name: str) -> None:
    worlds = [child for child in root if tag_of(child) == "worldbody"]
    things = [child for world in worlds for child in world]
    if any(tag_of(thing) == "light" or thing.get("type") == "plane" for thing in things):
        for thing in things:
            thing.set("_scene", name)


def _without_scene(root: Element, repairs: Repairs) -> None:
    things = [c for world in root if tag_of(world) == "worldbody" for c in world]
    scene = [thing for thing in things if thing.get("_scene") is not None]
    own = [thing for thing in things if thing.get("_scene") is None and tag_of(thing) in INSIDE]
    if not (scene and own):
        return
    names = [thing.get("name") or "a body" for thing in scene if tag_of(thing) == "body"]
    beside = f" with {', '.join(names)}" if names else ""
    repairs.note(f"scene {scene[0].get('_scene')}{beside} left out")
    for thing in scene:
        thing.getparent().remove(thing)


def _wrapped(root: Element) -> Element:
    """Return a fragment as a complete model: elements of a body move into the world."""
    out = etree.Element("mujoco")
    out.attrib.update(root.attrib)
    world = etree.SubElement(out, "worldbody")
    for child in list(root):
        (world if tag_of(child) in INSIDE else out).append(child)
    return out
