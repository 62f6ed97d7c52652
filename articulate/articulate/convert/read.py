"""Reading a URDF into plain data, trusting nothing in it."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np
from lxml import etree

from articulate.convert.repairs import Repairs
from articulate.errors import AssetError
from articulate.transforms import Array, pose, rpy_to_matrix

MAX_BYTES = 20_000_000
"""Largest URDF that is read."""
JOINT_KINDS = ("revolute", "continuous", "prismatic", "fixed")

_HASH = re.compile(r"(partnet_)?u?(?=[a-f-]*[0-9])[0-9a-f][0-9a-f-]{14,}")
"""Names that say nothing to people, as PartNet-Mobility gives them to its robots."""

# Element of a third-party library without stubs.
Element = Any


@dataclass(frozen=True, kw_only=True)
class SourceGeometry:
    """One visual or collision element."""

    kind: Literal["mesh", "box", "cylinder", "sphere", "capsule"]
    name: str
    T_lg: Array
    """Pose of the geometry in its link (4, 4), in units of the source."""
    size: tuple[float, ...] = ()
    """Full sides of a box; radius and length of a cylinder or capsule; radius of a sphere."""
    filename: str = ""
    scale: tuple[float, float, float] = (1.0, 1.0, 1.0)
    rgba: tuple[float, float, float, float] | None = None
    where: str = ""
    """File and line, for messages."""


@dataclass(frozen=True, kw_only=True)
class SourceInertial:
    """Mass, centre of mass and inertia as they stand in the file."""

    mass: float
    T_li: Array
    """Pose of the inertial frame in the link (4, 4)."""
    inertia: Array
    """Inertia about the centre of mass in the inertial frame (3, 3)."""


@dataclass(frozen=True, kw_only=True)
class SourceLink:
    """One ``<link>``."""

    name: str
    visuals: tuple[SourceGeometry, ...] = ()
    collisions: tuple[SourceGeometry, ...] = ()
    inertial: SourceInertial | None = None


@dataclass(frozen=True, kw_only=True)
class SourceJoint:
    """One ``<joint>``."""

    name: str
    kind: str
    parent: str
    child: str
    T_pc: Array
    """Pose of the child in its parent with the joint at 0 (4, 4)."""
    axis: tuple[float, float, float] = (1.0, 0.0, 0.0)
    lower: float | None = None
    upper: float | None = None
    damping: float | None = None
    friction: float | None = None
    mimic: tuple[str, float, float] | None = None
    """Joint that is followed, multiplier, offset."""
    where: str = ""


@dataclass(frozen=True, kw_only=True)
class SourceObject:
    """What a URDF says."""

    name: str
    path: Path
    links: dict[str, SourceLink]
    joints: tuple[SourceJoint, ...]
    repairs: Repairs = field(default_factory=Repairs)


def read_urdf(path: Path) -> SourceObject:
    """What stands in the URDF at ``path``.

    Raises:
        AssetError: It cannot be read, is no URDF, or its tree is broken.
    """
    repairs = Repairs()
    root = _parse(path, repairs)
    if _tag(root) != "robot":
        raise AssetError(
            f"{path}: not a URDF: its root element is <{_tag(root)}>, <robot> was expected"
        )
    reader = _Reader(path, root, repairs)
    links: dict[str, SourceLink] = {}
    for element in _children(root, "link"):
        link = reader.link(element)
        if link.name in links:
            raise AssetError(f"{reader.at(element)}: a second link is called {link.name!r}")
        links[link.name] = link
    if not links:
        raise AssetError(f"{path}: not a URDF: it has no <link>")
    joints: list[SourceJoint] = []
    for element in _children(root, "joint"):
        joint = reader.joint(element)
        if joint.name in {other.name for other in joints}:
            raise AssetError(f"{reader.at(element)}: a second joint is called {joint.name!r}")
        joints.append(joint)
    name = _object_name(path, root.get("name") or "")
    return SourceObject(name=name, path=path, links=links, joints=tuple(joints), repairs=repairs)


def _object_name(path: Path, robot: str) -> str:
    """The robot's name, or one of the file's where that is absent or a number for machines."""
    name = robot.strip()
    if path.name == "mobility.urdf" and (not name or _HASH.fullmatch(name)):
        name = f"partnet_{path.resolve().parent.name}"
    elif not name or _HASH.fullmatch(name):
        name = path.stem
    return re.sub(r"[^A-Za-z0-9_.-]+", "_", name)


def _parse(path: Path, repairs: Repairs) -> Element:
    try:
        size = path.stat().st_size
        content = path.read_bytes() if size <= MAX_BYTES else b""
    except OSError as error:
        raise AssetError(f"{path}: cannot be read ({error.strerror})") from None
    if size > MAX_BYTES:
        raise AssetError(f"{path}: {size} bytes; a URDF of at most {MAX_BYTES} is accepted")
    if re.search(rb"<!\s*(DOCTYPE|ENTITY)", content, re.IGNORECASE):
        raise AssetError(f"{path}: has a DOCTYPE or entities, which are refused; remove them")
    start = content.find(b"<")
    if start < 0:
        raise AssetError(f"{path}: not a URDF: no XML in it")
    if content[:start].strip(b"\xef\xbb\xbf \t\r\n"):
        repairs.add("text before the first element was skipped")
    lead = content[:start].count(b"\n")
    content = content[start:]
    parser = etree.XMLParser(
        resolve_entities=False,
        no_network=True,
        load_dtd=False,
        huge_tree=False,
        recover=True,
        remove_comments=True,
    )
    try:
        root = etree.fromstring(content, parser)
    except (etree.XMLSyntaxError, ValueError) as error:
        raise AssetError(f"{path}: not XML: {_first_line(error)}") from None
    for entry in parser.error_log:
        if entry.domain_name == "NAMESPACE":
            repairs.add(f"undeclared XML prefix ignored (line {entry.line + lead})")
            continue
        raise AssetError(f"{path}:{entry.line + lead}: not XML: {entry.message.strip()}")
    if root is None:
        raise AssetError(f"{path}: not a URDF: no XML in it")
    return root


def _first_line(error: Exception) -> str:
    return str(error).splitlines()[0] if str(error) else type(error).__name__


def _tag(element: Element) -> str:
    return str(element.tag).rsplit("}", 1)[-1] if isinstance(element.tag, str) else ""


def _children(element: Element, tag: str) -> list[Element]:
    return [child for child in element if _tag(child) == tag]


def _child(element: Element, tag: str) -> Element | None:
    found = _children(element, tag)
    return found[0] if found else None


class _Reader:
    """Turns elements into source nouns, with file and line in every message."""

    def __init__(self, path: Path, root: Element, repairs: Repairs) -> None:
        self.path = path
        self.repairs = repairs
        self.colours: dict[str, tuple[float, float, float, float]] = {}
        for material in root.iter():
            if _tag(material) == "material" and material.get("name"):
                rgba = self._rgba(material)
                if rgba is not None:
                    self.colours.setdefault(material.get("name"), rgba)

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
            values = tuple(float(word) for word in text.split())
        except ValueError:
            raise AssetError(
                f"{self.at(element)}: {key}={text!r} of <{_tag(element)}> is not made of numbers"
            ) from None
        if len(values) != len(default):
            raise AssetError(
                f"{self.at(element)}: {key}={text!r} of <{_tag(element)}> has {len(values)} "
                f"numbers; {len(default)} were expected"
            )
        return values

    def number(self, element: Element | None, key: str) -> float | None:
        """A single number, or None where it is absent or not finite."""
        if element is None or element.get(key) is None:
            return None
        value = self.numbers(element, key, (0.0,))[0]
        if not math.isfinite(value):
            self.repairs.add(
                f"{key}={element.get(key)} taken as absent (line {element.sourceline})"
            )
            return None
        return value

    def finite(self, element: Element, key: str, default: tuple[float, ...]) -> tuple[float, ...]:
        values = self.numbers(element, key, default)
        if not all(math.isfinite(v) and abs(v) < 1e6 for v in values):
            raise AssetError(
                f"{self.at(element)}: {key}={element.get(key)!r} of <{_tag(element)}> is not finite"
            )
        return values

    def name(self, element: Element) -> str:
        name = (element.get("name") or "").strip()
        if not name:
            raise AssetError(f"{self.at(element)}: <{_tag(element)}> without a name")
        return name

    def origin(self, element: Element) -> Array:
        origin = _child(element, "origin")
        if origin is None:
            return pose(np.zeros(3))
        xyz = self.finite(origin, "xyz", (0.0, 0.0, 0.0))
        rpy = self.finite(origin, "rpy", (0.0, 0.0, 0.0))
        return pose(np.array(xyz), rpy_to_matrix(np.array(rpy)))

    def link(self, element: Element) -> SourceLink:
        inertial = _child(element, "inertial")
        return SourceLink(
            name=self.name(element),
            visuals=self.geometries(element, "visual"),
            collisions=self.geometries(element, "collision"),
            inertial=None if inertial is None else self.inertial(inertial),
        )

    def geometries(self, link: Element, tag: str) -> tuple[SourceGeometry, ...]:
        found = []
        for element in _children(link, tag):
            geometry = _child(element, "geometry")
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
        kind = _tag(shape)
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
            where=self.at(shape),
        )

    def colour(self, element: Element) -> tuple[float, float, float, float] | None:
        material = _child(element, "material")
        if material is None:
            return None
        return self._rgba(material) or self.colours.get(material.get("name") or "")

    def _rgba(self, material: Element) -> tuple[float, float, float, float] | None:
        colour = _child(material, "color")
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

    def inertial(self, element: Element) -> SourceInertial | None:
        mass = self.number(_child(element, "mass"), "value")
        tensor = _child(element, "inertia")
        if mass is None or tensor is None:
            return None
        keys = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
        xx, xy, xz, yy, yz, zz = (self.number(tensor, key) or 0.0 for key in keys)
        inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        return SourceInertial(mass=mass, T_li=self.origin(element), inertia=inertia)

    def joint(self, element: Element) -> SourceJoint:
        name = self.name(element)
        kind = (element.get("type") or "").strip()
        if kind.lower() in JOINT_KINDS and kind not in JOINT_KINDS:
            self.repairs.add(f"type {kind!r} of joint {name} read as {kind.lower()!r}")
            kind = kind.lower()
        if kind not in JOINT_KINDS:
            raise AssetError(
                f"{self.at(element)}: joint {name!r} is of type {kind!r}; "
                f"{', '.join(JOINT_KINDS)} are accepted"
            )
        ends = [_child(element, "parent"), _child(element, "child")]
        parent, child = ("" if e is None else (e.get("link") or "").strip() for e in ends)
        if not parent or not child:
            raise AssetError(f"{self.at(element)}: joint {name!r} lacks a parent or a child")
        axis = _child(element, "axis")
        limit = _child(element, "limit")
        dynamics = _child(element, "dynamics")
        mimic = _child(element, "mimic")
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
            damping=self.number(dynamics, "damping"),
            friction=self.number(dynamics, "friction"),
            mimic=None if mimic is None else self.mimic(mimic),
            where=self.at(element),
        )

    def mimic(self, element: Element) -> tuple[str, float, float] | None:
        multiplier = self.number(element, "multiplier")
        joint = (element.get("joint") or "").strip()
        if not joint:
            return None
        return (
            joint,
            1.0 if multiplier is None else multiplier,
            self.number(element, "offset") or 0,
        )
