"""An MJCF file with all that it includes, as one tree of elements that know where they stood."""

from __future__ import annotations

import re
from pathlib import Path

from lxml import etree

from articulate.errors import AssetError
from articulate.formats.repairs import Repairs
from articulate.formats.xml_input import Element, read_markup, tag_of

MAX_FILES = 64
"""Most files that are included, those included twice counted twice."""
MAX_DEPTH = 128
"""Deepest nesting of elements."""
MAX_ELEMENTS = 100_000
"""Most elements of all files together."""
ROOTS = ("mujoco", "mujocoinclude")
INSIDE = frozenset({"body", "geom", "frame", "replicate"})
"""What a fragment may hold that belongs into a world."""
_HEAD = 200_000
"""So many bytes are enough to find the first element, after the longest of licences."""


def root_tag(path: Path) -> str:
    """Name of the first element of an XML file; empty where it has none."""
    try:
        with path.open("rb") as stream:
            head = stream.read(_HEAD)
    except (OSError, ValueError):
        return ""
    head = re.sub(rb"<!--.*?-->|<\?.*?\?>", b"", head.replace(b"\0", b""), flags=re.DOTALL)
    found = re.search(rb"<\s*([A-Za-z_][\w.:-]*)", head)
    return found.group(1).decode() if found else ""


def is_mjcf(path: Path) -> bool:
    """Whether the file is MJCF, whatever it is called."""
    return root_tag(path) in ROOTS


def where(element: Element) -> str:
    """File and line of an element of ``merged``."""
    return str(element.get("_at") or "?")


def merged(path: Path, repairs: Repairs) -> tuple[Element, dict[str, Path]]:
    """The root element of ``path`` without ``<include>``, and the files included, by reference.

    A scene, an included file whose world has a ground or lights, stands round the object: it is
    left out wherever the file has a world of its own besides.

    Raises:
        AssetError: A file cannot be read or is not MJCF, or they are too many.
    """
    files = _Files(path, repairs)
    root = files.parsed(path)
    if tag_of(root) not in ROOTS:
        raise AssetError(
            f"{path}: not MJCF: its root element is <{tag_of(root)}>, <mujoco> was expected"
        )
    files.include(root, path, 0)
    if tag_of(root) == "mujocoinclude":
        root = _wrapped(root)
        repairs.add("a fragment that other files include: read as a model of its own")
    _without_scene(root, repairs)
    return root, files.found


class _Files:
    """Parses files and puts included ones in their places."""

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
        """Put the content of included files in place of each ``<include>`` below ``element``."""
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
                    f"<{tag_of(root)}>"
                )
            self.include(root, found, depth + 1)
            _mark_scene(root, found.name)
            for moved in list(root):
                child.addprevious(moved)
            element.remove(child)

    def file(self, element: Element, path: Path) -> Path:
        """The file that an ``<include>`` in ``path`` means: beside the first file, or beside it."""
        reference = (element.get("file") or "").strip().replace("\\", "/")
        self.count += 1
        if self.count > MAX_FILES:
            raise AssetError(f"{self.path}: includes more than {MAX_FILES} files")
        folders = list(dict.fromkeys((self.path.parent, path.parent)))
        for folder in folders:
            if reference and (folder / reference).is_file():
                self.found[reference] = folder / reference
                return folder / reference
        raise AssetError(
            f"{where(element)}: included file {reference!r} not found; looked in "
            f"{', '.join(f'{folder}/' for folder in folders)}. Put it there"
        )


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
    """A fragment as a whole model: what belongs into a body becomes the world's."""
    out = etree.Element("mujoco")
    out.attrib.update(root.attrib)
    world = etree.SubElement(out, "worldbody")
    for child in list(root):
        (world if tag_of(child) in INSIDE else out).append(child)
    return out
