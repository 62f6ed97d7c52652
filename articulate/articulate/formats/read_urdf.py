"""Reading a URDF into plain data, trusting nothing in it."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
from lxml import etree

from articulate.errors import AssetError
from articulate.formats.repairs import Repairs
from articulate.formats.source_object import (
    JOINT_KINDS,
    LARGEST,
    MAX_LINKS,
    SourceGeometry,
    SourceInertial,
    SourceJoint,
    SourceLink,
    SourceObject,
    free_name,
)
from articulate.formats.xml_input import (
    Element,
    child_of,
    children_of,
    read_markup,
    tag_of,
)
from articulate.transforms import Array, pose, rpy_to_matrix

_HASH = re.compile(r"(partnet_)?u?(?=[a-f-]*[0-9])[0-9a-f][0-9a-f-]{14,}")
"""Names that say nothing to people, as PartNet-Mobility gives them to its robots."""


def read_urdf(path: Path) -> SourceObject:
    """What stands in the URDF at ``path``.

    Raises:
        AssetError: It cannot be read, is no URDF, or its tree is broken.
    """
    repairs = Repairs()
    root = read_markup(path, repairs)
    if tag_of(root) != "robot":
        raise AssetError(
            f"{path}: not a URDF: its root element is <{tag_of(root)}>, <robot> was expected"
        )
    reader = _Reader(path, root, repairs)
    links = _links(reader, root)
    joints = _joints(reader, root)
    for joint in joints:
        if joint.parent not in links and joint.parent.lower() == "world":
            repairs.add(f"link {joint.parent} is not declared: taken as the ground")
            links[joint.parent] = SourceLink(name=joint.parent)
    _note_macros(root, repairs)
    name = _object_name(path, root.get("name") or "")
    return SourceObject(name=name, path=path, links=links, joints=tuple(joints), repairs=repairs)


def _links(reader: _Reader, root: Element) -> dict[str, SourceLink]:
    links: dict[str, SourceLink] = {}
    elements: dict[str, Element] = {}
    for element in children_of(root, "link"):
        link = reader.link(element)
        if link.name not in links:
            links[link.name], elements[link.name] = link, element
        elif _alike(element, elements[link.name]):
            reader.repairs.add(f"link {link.name} stands twice in the file, alike: read once")
        else:
            raise AssetError(
                f"{reader.at(element)}: a second link is called {link.name!r} and differs from the "
                "first; rename one, and say in its joints which is meant"
            )
    if not links and _macros(root):
        raise AssetError(
            f"{reader.path}: a xacro, not a URDF; expand it first: xacro {reader.path.name} > "
            "object.urdf"
        )
    if not links:
        raise AssetError(f"{reader.path}: not a URDF: it has no <link>")
    if len(links) > MAX_LINKS:
        raise AssetError(f"{reader.path}: {len(links)} links; at most {MAX_LINKS} are accepted")
    return links


def _joints(reader: _Reader, root: Element) -> list[SourceJoint]:
    joints: dict[str, SourceJoint] = {}
    elements: dict[str, Element] = {}
    taken = {(e.get("name") or "").strip() for e in children_of(root, "joint")}
    for element in children_of(root, "joint"):
        joint = reader.joint(element)
        if joint.name in joints:
            if _alike(element, elements[joint.name]):
                reader.repairs.add(f"joint {joint.name} stands twice in the file, alike: read once")
                continue
            name = free_name(joint.name, taken)
            reader.repairs.add(
                f"a second joint is called {joint.name}: renamed {name} (line {element.sourceline})"
            )
            joint = replace(joint, name=name)
        taken.add(joint.name)
        joints[joint.name], elements[joint.name] = joint, element
    return list(joints.values())


def _alike(one: Element, two: Element) -> bool:
    """Whether two elements say the same in the same words."""
    texts = [etree.tostring(element, with_tail=False) for element in (one, two)]
    return len({re.sub(rb"\s+", b"", text) for text in texts}) == 1


def _macros(root: Element) -> list[str]:
    """Elements that only the xacro program would expand, by name."""
    names = (str(e.tag) for e in root.iter() if isinstance(e.tag, str))
    return sorted({name.rsplit("}", 1)[-1] for name in names if "xacro" in name})


def _note_macros(root: Element, repairs: Repairs) -> None:
    left = _macros(root)
    if left:
        repairs.add(f"macros are not expanded ({', '.join(left[:6])}): run xacro on the file first")


def _object_name(path: Path, robot: str) -> str:
    """The robot's name, or one of the file's where that is absent or a number for machines."""
    name = robot.strip()
    if path.name == "mobility.urdf" and (not name or _HASH.fullmatch(name)):
        name = f"partnet_{path.resolve().parent.name}"
    elif not name or _HASH.fullmatch(name):
        name = path.stem
    return re.sub(r"[^A-Za-z0-9_.-]+", "_", name)


def _texture(material: Element) -> str:
    texture = child_of(material, "texture")
    return "" if texture is None else (texture.get("filename") or "").strip()


class _Reader:
    """Turns elements into source nouns, with file and line in every message."""

    def __init__(self, path: Path, root: Element, repairs: Repairs) -> None:
        self.path = path
        self.repairs = repairs
        self.colours: dict[str, tuple[float, float, float, float]] = {}
        self.textures: dict[str, str] = {}
        for material in root.iter():
            if tag_of(material) == "material" and material.get("name"):
                rgba = self._rgba(material)
                if rgba is not None:
                    self.colours.setdefault(material.get("name"), rgba)
                if _texture(material):
                    self.textures.setdefault(material.get("name"), _texture(material))

    def at(self, element: Element) -> str:
        return f"{self.path}:{element.sourceline}"

    def numbers(self, element: Element, key: str, default: tuple[float, ...]) -> tuple[float, ...]:
        text = element.get(key)
        if text is None:
            return default
        if "," in text:
            self.repairs.add(f"commas between numbers read as spaces (line {element.sourceline})")
            text = text.replace(",", " ")
        try:
            values = tuple(float(word.replace("_", "?")) for word in text.split())
        except ValueError:
            how = "; expand the xacro first" if "${" in text else ""
            raise AssetError(
                f"{self.at(element)}: {key}={text!r} of <{tag_of(element)}> is not made of "
                f"numbers{how}"
            ) from None
        if len(values) != len(default):
            raise AssetError(
                f"{self.at(element)}: {key}={text!r} of <{tag_of(element)}> has {len(values)} "
                f"numbers; {len(default)} were expected"
            )
        return values

    def number(self, element: Element | None, key: str, most: float = math.inf) -> float | None:
        """A single number, or None where it is absent, not finite or of size ``most``."""
        if element is None or element.get(key) is None:
            return None
        value = self.numbers(element, key, (0.0,))[0]
        if not (math.isfinite(value) and abs(value) < most):
            self.repairs.add(
                f"{key}={element.get(key)} taken as absent (line {element.sourceline})"
            )
            return None
        return value

    def finite(self, element: Element, key: str, default: tuple[float, ...]) -> tuple[float, ...]:
        values = self.numbers(element, key, default)
        if not all(math.isfinite(v) and abs(v) < 1e6 for v in values):
            raise AssetError(
                f"{self.at(element)}: {key}={element.get(key)!r} of <{tag_of(element)}> is not "
                "finite, or far beyond any object"
            )
        return values

    def name(self, element: Element) -> str:
        name = (element.get("name") or "").strip()
        if not name:
            raise AssetError(f"{self.at(element)}: <{tag_of(element)}> without a name")
        return name

    def origin(self, element: Element) -> Array:
        origin = child_of(element, "origin")
        if origin is None:
            return pose(np.zeros(3))
        xyz = self.finite(origin, "xyz", (0.0, 0.0, 0.0))
        rpy = self.finite(origin, "rpy", (0.0, 0.0, 0.0))
        return pose(np.array(xyz), rpy_to_matrix(np.array(rpy)))

    def link(self, element: Element) -> SourceLink:
        return SourceLink(
            name=self.name(element),
            visuals=self.geometries(element, "visual"),
            collisions=self.geometries(element, "collision"),
            inertial=self.inertial(element),
        )

    def geometries(self, link: Element, tag: str) -> tuple[SourceGeometry, ...]:
        found = []
        for element in children_of(link, tag):
            geometry = child_of(element, "geometry")
            shape = (
                None
                if geometry is None
                else next((c for c in geometry if isinstance(c.tag, str)), None)
            )
            if shape is None:
                self.repairs.add(f"<{tag}> without geometry left out (line {element.sourceline})")
                continue
            found.append(self.geometry(element, shape))
        return tuple(found)

    def geometry(self, element: Element, shape: Element) -> SourceGeometry:
        kind = tag_of(shape)
        size: tuple[float, ...] = ()
        if kind == "box":
            size = self.finite(shape, "size", (1.0, 1.0, 1.0))
        elif kind in {"cylinder", "capsule"}:
            size = (
                self.finite(shape, "radius", (0.0,))[0],
                self.finite(shape, "length", (0.0,))[0],
            )
        elif kind == "sphere":
            size = self.finite(shape, "radius", (0.0,))
        elif kind != "mesh":
            raise AssetError(
                f"{self.at(shape)}: geometry <{kind}> is not known; "
                "mesh, box, cylinder, sphere and capsule are"
            )
        if kind == "mesh" and not (shape.get("filename") or "").strip():
            raise AssetError(f"{self.at(shape)}: <mesh> without a filename")
        if any(side <= 0.0 for side in size):
            raise AssetError(f"{self.at(shape)}: <{kind}> has a side of {min(size)}")
        scale = (shape.get("scale") or "1 1 1").replace(",", " ").split()
        if len(scale) == 1:  # one factor for all, a common slip
            shape.set("scale", " ".join(scale * 3))
        factors = self.finite(shape, "scale", (1.0, 1.0, 1.0))
        if any(abs(f) < 1e-9 for f in factors):
            raise AssetError(f"{self.at(shape)}: scale={shape.get('scale')!r} flattens the mesh")
        return SourceGeometry(
            kind=kind,  # type: ignore[arg-type]  # checked above
            name=(element.get("name") or "").strip(),
            T_lg=self.origin(element),
            size=size,
            filename=(shape.get("filename") or "").strip(),
            scale=(factors[0], factors[1], factors[2]),
            rgba=self.colour(element),
            texture=self.texture(element),
            where=self.at(shape),
        )

    def colour(self, element: Element) -> tuple[float, float, float, float] | None:
        material = child_of(element, "material")
        if material is None:
            return None
        return self._rgba(material) or self.colours.get(material.get("name") or "")

    def texture(self, element: Element) -> str:
        material = child_of(element, "material")
        if material is None:
            return ""
        own = _texture(material)
        return own or self.textures.get(material.get("name") or "", "")

    def _rgba(self, material: Element) -> tuple[float, float, float, float] | None:
        colour = child_of(material, "color")
        if colour is None or colour.get("rgba") is None:
            return None
        try:
            values = [float(v) for v in colour.get("rgba").replace(",", " ").split()]
        except ValueError:
            return None
        values = [min(max(v, 0.0), 1.0) for v in values if math.isfinite(v)]
        if len(values) == 3:
            values.append(1.0)
        return (values[0], values[1], values[2], values[3]) if len(values) == 4 else None

    def inertial(self, link: Element) -> SourceInertial | None:
        element = child_of(link, "inertial")
        if element is None:
            return None
        try:
            mass = self.number(child_of(element, "mass"), "value", LARGEST)
            tensor = child_of(element, "inertia")
            if mass is None or tensor is None:
                return None
            keys = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
            xx, xy, xz, yy, yz, zz = (self.number(tensor, key, LARGEST) or 0.0 for key in keys)
            inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
            return SourceInertial(mass=mass, T_li=self.origin(element), inertia=inertia)
        except AssetError as error:  # it can be computed, so that nothing hangs on it
            self.repairs.add(f"inertial of link {link.get('name')} left out: {error}")
            return None

    def joint(self, element: Element) -> SourceJoint:
        name = self.name(element)
        kind = (element.get("type") or "").strip()
        if kind.lower() in JOINT_KINDS and kind not in JOINT_KINDS:
            self.repairs.add(f"type {kind!r} of joint {name} read as {kind.lower()!r}")
            kind = kind.lower()
        if kind not in JOINT_KINDS:
            hint = "; write a ball joint as three revolute ones" if "spher" in kind.lower() else ""
            raise AssetError(
                f"{self.at(element)}: joint {name!r} is of type {kind!r}; "
                f"{', '.join(JOINT_KINDS)} are accepted{hint}"
            )
        ends = [child_of(element, "parent"), child_of(element, "child")]
        parent, child = ("" if e is None else (e.get("link") or "").strip() for e in ends)
        if not parent or not child:
            raise AssetError(f"{self.at(element)}: joint {name!r} lacks a parent or a child")
        axis = child_of(element, "axis")
        limit = child_of(element, "limit")
        dynamics = child_of(element, "dynamics")
        mimic = child_of(element, "mimic")
        direction = (1.0, 0.0, 0.0) if axis is None else self.finite(axis, "xyz", (1.0, 0.0, 0.0))
        return SourceJoint(
            name=name,
            kind=kind,
            parent=parent,
            child=child,
            T_pc=self.origin(element),
            axis=(direction[0], direction[1], direction[2]),
            lower=self.number(limit, "lower"),
            upper=self.number(limit, "upper"),
            damping=self.number(dynamics, "damping", LARGEST),
            friction=self.number(dynamics, "friction", LARGEST),
            mimic=None if mimic is None else self.mimic(mimic),
            pitch=self.pitch(element),
            where=self.at(element),
        )

    def pitch(self, element: Element) -> float | None:
        """Way of a screw for one turn: ``<thread_pitch value="…"/>`` under any prefix."""
        for child in element:
            if tag_of(child).rsplit(":", 1)[-1] in {"thread_pitch", "screw_thread_pitch"}:
                if child.get("value") is None and child.text:
                    child.set("value", child.text.strip())
                return self.number(child, "value", 1e3)
        return self.number(element, "pitch", 1e3)

    def mimic(self, element: Element) -> tuple[str, float, float] | None:
        multiplier = self.number(element, "multiplier", LARGEST)
        joint = (element.get("joint") or "").strip()
        if not joint:
            self.repairs.add(f"<mimic> without a joint left out (line {element.sourceline})")
            return None
        return (
            joint,
            1.0 if multiplier is None else multiplier,
            self.number(element, "offset", LARGEST) or 0.0,
        )
