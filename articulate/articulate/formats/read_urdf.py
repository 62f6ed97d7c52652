"""Read a URDF, which may be damaged or hostile, into plain data."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from lxml import etree

from articulate.errors import AssetError, quote
from articulate.formats.repairs import Repairs
from articulate.formats.source_object import (
    JOINT_KINDS,
    LARGEST,
    Rgba,
    SourceGeometry,
    SourceInertial,
    SourceJoint,
    SourceLink,
    SourceObject,
    check_counts,
    free_name,
)
from articulate.formats.xml_input import Element, child_of, children_of, read_markup, tag_of
from articulate.transforms import Array, pose, rpy_to_matrix

_HASH = re.compile(r"(partnet_)?u?(?=[a-f-]*[0-9])[0-9a-f][0-9a-f-]{14,}")
"""Meaningless robot names, as in PartNet-Mobility."""
HARMLESS_MACROS = frozenset({"property", "arg", "macro"})
"""Elements of xacro that add nothing to the object where they are."""


def read_urdf(path: Path) -> SourceObject:
    """Read the URDF at ``path``.

    Raises:
        AssetError: It cannot be read, is not a URDF, or is a xacro that was not expanded.
    """
    repairs = Repairs()
    root = read_markup(path, repairs)
    if tag_of(root) != "robot":
        raise AssetError(
            f"{path}: not a URDF: its root element is <{tag_of(root)[:60]}>, <robot> was expected"
        )
    _check_macros(path, root, repairs)
    reader = _Reader(path, root, repairs)
    links = _links(reader, root)
    joints = _joints(reader, root)
    for joint in joints:
        if joint.parent not in links and joint.parent.lower() == "world":
            repairs.add(f"link {joint.parent} is not declared: used as the ground")
            links[joint.parent] = SourceLink(name=joint.parent)
    name = _object_name(path, root.get("name") or "")
    return SourceObject(name=name, path=path, links=links, joints=tuple(joints), repairs=repairs)


def _links(reader: _Reader, root: Element) -> dict[str, SourceLink]:
    links: dict[str, SourceLink] = {}
    elements: dict[str, Element] = {}
    found = children_of(root, "link")
    geometries = sum(len(children_of(e, tag)) for e in found for tag in ("visual", "collision"))
    check_counts(reader.path, len(found), len(children_of(root, "joint")), geometries)
    for element in found:
        link = reader.link(element)
        if link.name not in links:
            links[link.name], elements[link.name] = link, element
        elif _alike(element, elements[link.name]):
            reader.repairs.add(f"link {link.name} is defined twice, identically: read once")
        else:
            raise AssetError(
                f"{reader.at(element)}: a second link is called {quote(link.name)} and differs "
                "from the first; rename one, and use its name in its joints"
            )
    if not links:
        raise AssetError(f"{reader.path}: not a URDF: it has no <link>")
    return links


def _joints(reader: _Reader, root: Element) -> list[SourceJoint]:
    joints: dict[str, SourceJoint] = {}
    elements: dict[str, Element] = {}
    used = {(e.get("name") or "").strip() for e in children_of(root, "joint")}
    for element in children_of(root, "joint"):
        joint = reader.joint(element)
        if joint.name in joints:
            if _alike(element, elements[joint.name]):
                reader.repairs.add(f"joint {joint.name} is defined twice, identically: read once")
                continue
            name = free_name(joint.name, used)
            reader.repairs.add(
                f"a second joint is called {joint.name}: renamed {name} (line {element.sourceline})"
            )
            joint = replace(joint, name=name)
        used.add(joint.name)
        joints[joint.name], elements[joint.name] = joint, element
    return list(joints.values())


def _alike(one: Element, two: Element) -> bool:
    """Return whether two elements are equal but for white space."""
    texts = [etree.tostring(element, with_tail=False) for element in (one, two)]
    return len({re.sub(rb"\s+", b"", text) for text in texts}) == 1


def _check_macros(path: Path, root: Element, repairs: Repairs) -> None:
    """Reject a xacro whose macros or includes leave parts out; note what else is left of one.

    Raises:
        AssetError: A macro is called, a file included or an element conditional.
    """
    names = list(_macros(root))
    if not names:
        return
    listed = ", ".join(sorted(set(names))[:6])
    message = f"macros are not expanded ({listed})"
    if set(names) <= HARMLESS_MACROS and children_of(root, "link"):
        repairs.add(f"{message}: run xacro on the file first")
    else:
        raise AssetError(
            f"{path}: {message}: run xacro on the file first: xacro {path.name} > object.urdf"
        )


def _macros(element: Element) -> Iterator[str]:
    """Iterate over elements that only xacro expands, by name; not those inside definitions."""
    for child in element:
        if not isinstance(child.tag, str):
            continue
        name = tag_of(child).rsplit(":", 1)[-1][:60]
        if "xacro" in child.tag or (name == "include" and tag_of(element) == "robot"):
            yield name
        if not ("xacro" in child.tag and name == "macro"):
            yield from _macros(child)


def _object_name(path: Path, robot: str) -> str:
    """Return the robot's name; the file's or folder's where it is absent or meaningless."""
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
    """Convert elements to plain data, with file and line in every message."""

    def __init__(self, path: Path, root: Element, repairs: Repairs) -> None:
        self.path = path
        self.repairs = repairs
        self.colours: dict[str, Rgba] = {}
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
                f"{self.at(element)}: {key}={quote(text)} of <{tag_of(element)}> is not made of "
                f"numbers{how}"
            ) from None
        if len(values) != len(default):
            raise AssetError(
                f"{self.at(element)}: {key}={quote(text)} of <{tag_of(element)}> has {len(values)} "
                f"numbers; {len(default)} were expected"
            )
        return values

    def number(self, element: Element | None, key: str, most: float = math.inf) -> float | None:
        """Return a number, or None where it is absent, not finite or of size ``most``."""
        if element is None or element.get(key) is None:
            return None
        value = self.numbers(element, key, (0.0,))[0]
        if not (math.isfinite(value) and abs(value) < most):
            self.repairs.add(f"{key}={element.get(key)[:60]} ignored (line {element.sourceline})")
            return None
        return value

    def finite(self, element: Element, key: str, default: tuple[float, ...]) -> tuple[float, ...]:
        values = self.numbers(element, key, default)
        if not all(math.isfinite(v) and abs(v) < 1e6 for v in values):
            raise AssetError(
                f"{self.at(element)}: {key}={quote(element.get(key))} of <{tag_of(element)}> is "
                "not finite, or beyond the size of any object"
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
                f"{self.at(shape)}: geometry <{kind[:60]}> is not known; "
                "mesh, box, cylinder, sphere and capsule are accepted"
            )
        filename = (shape.get("filename") or "").strip()
        if kind == "mesh" and not filename:
            raise AssetError(f"{self.at(shape)}: <mesh> without a filename")
        if any(side <= 0.0 for side in size):
            raise AssetError(f"{self.at(shape)}: <{kind}> has a side of {min(size)}")
        scale = (shape.get("scale") or "1 1 1").replace(",", " ").split()
        if len(scale) == 1:  # one factor for all, a common slip
            shape.set("scale", " ".join(scale * 3))
        factors = self.finite(shape, "scale", (1.0, 1.0, 1.0))
        if any(abs(f) < 1e-9 for f in factors):
            raise AssetError(
                f"{self.at(shape)}: scale={quote(shape.get('scale'))} flattens the mesh"
            )
        if "${" in filename or "$(" in filename:
            raise AssetError(
                f"{self.at(shape)}: filename={quote(filename)} of <mesh>; expand the xacro first"
            )
        return SourceGeometry(
            kind=kind,  # type: ignore[arg-type]  # checked above
            name=(element.get("name") or "").strip(),
            T_lg=self.origin(element),
            size=size,
            filename=filename,
            scale=(factors[0], factors[1], factors[2]),
            rgba=self.colour(element),
            texture=self.texture(element),
            where=self.at(shape),
        )

    def colour(self, element: Element) -> Rgba | None:
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

    def _rgba(self, material: Element) -> Rgba | None:
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
        except AssetError as error:  # it can be computed from the shapes
            self.repairs.add(f"inertial of link {link.get('name')} ignored: {error}")
            return None

    def joint(self, element: Element) -> SourceJoint:
        name = self.name(element)
        kind = (element.get("type") or "").strip()
        if kind.lower() in JOINT_KINDS and kind not in JOINT_KINDS:
            self.repairs.add(f"type {quote(kind)} of joint {name} read as {kind.lower()!r}")
            kind = kind.lower()
        if kind not in JOINT_KINDS:
            hint = "; write a ball joint as three revolute ones" if "spher" in kind.lower() else ""
            raise AssetError(
                f"{self.at(element)}: joint {quote(name)} is of type {quote(kind)}; "
                f"{', '.join(JOINT_KINDS)} are accepted{hint}"
            )
        ends = [child_of(element, "parent"), child_of(element, "child")]
        parent, child = ("" if e is None else (e.get("link") or "").strip() for e in ends)
        if not parent or not child:
            raise AssetError(f"{self.at(element)}: joint {quote(name)} lacks a parent or a child")
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
        """Return the travel of a screw for one turn: ``<thread_pitch value="…"/>``, any prefix."""
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
