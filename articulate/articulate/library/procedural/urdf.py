"""Parts made of boxes, written as a URDF whose bytes depend on nothing but the parts.

Every visual is one mesh file; collision geometry is the boxes themselves, so that what is
hollow stays hollow in every simulator.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal
from xml.etree import ElementTree as ET  # noqa: TID251 - it only writes here, reads nothing

from articulate.asset import Vec3
from articulate.files import write_text
from articulate.library.procedural.boxes import Box, mass_properties, number, obj_text

Colour = tuple[float, float, float, float]
"""Red, green, blue, opacity, each in [0, 1]."""


@dataclass(frozen=True, kw_only=True)
class Shape:
    """Boxes that are seen as one mesh of one colour."""

    name: str
    """Name of the visual and of its mesh file, unique in the object."""
    boxes: tuple[Box, ...]
    """Boxes in the frame of the link."""
    material: str
    """Name of the colour, a key of the ``colours`` given to ``write_urdf``."""

    def seen_from(self, origin: Vec3) -> Shape:
        """The same shape in a parallel frame whose origin is at ``origin`` [m]."""
        return replace(self, boxes=tuple(box.seen_from(origin) for box in self.boxes))


@dataclass(frozen=True, kw_only=True)
class Motion:
    """How a part moves against its parent. The frames of both are parallel when closed."""

    name: str
    """Name of the joint."""
    kind: Literal["prismatic", "revolute"]
    """URDF's word."""
    parent: str
    """Name of the parent link."""
    origin_p: Vec3
    """Origin of the part's frame in the parent's frame, closed [m]."""
    axis: Vec3
    """Unit axis in the part's frame."""
    upper: float
    """Far end of opening [m or rad]; closed is 0."""
    damping: float
    """Viscous damping [N s/m or Nm s/rad]."""
    friction: float
    """Dry friction [N or Nm]."""
    effort: float
    """Largest effort [N or Nm]."""
    velocity: float
    """Largest speed [m/s or rad/s]."""


@dataclass(frozen=True, kw_only=True)
class Part:
    """One link and what moves it."""

    name: str
    """Name of the link."""
    shapes: tuple[Shape, ...]
    """What it is made of."""
    motion: Motion | None = None
    """None for the root."""

    @classmethod
    def moving(cls, name: str, motion: Motion, shapes_p: tuple[Shape, ...]) -> Part:
        """A link from shapes in the frame of its parent, closed."""
        return cls(
            name=name,
            shapes=tuple(shape.seen_from(motion.origin_p) for shape in shapes_p),
            motion=motion,
        )

    @property
    def boxes(self) -> tuple[Box, ...]:
        """Boxes of all shapes, in the frame of the link."""
        return tuple(box for shape in self.shapes for box in shape.boxes)


def write_urdf(
    name: str, parts: Sequence[Part], colours: Mapping[str, Colour], folder: Path
) -> Path:
    """Write ``<name>.urdf`` and ``meshes/*.obj`` into ``folder``; return the path of the URDF.

    Args:
        name: Name of the robot element and of the file.
        parts: Links, parents before children.
        colours: Red, green, blue and opacity in [0, 1] of each material.
        folder: Made if absent.
    """
    for part in parts:
        for shape in part.shapes:
            write_text(folder / "meshes" / f"{shape.name}.obj", obj_text(shape.boxes))
    path = folder / f"{name}.urdf"
    write_text(path, urdf_text(name, parts, colours))
    return path


def urdf_text(name: str, parts: Sequence[Part], colours: Mapping[str, Colour]) -> str:
    """The URDF alone, elements and attributes in a fixed order."""
    robot = ET.Element("robot", name=name)
    for material, rgba in colours.items():
        ET.SubElement(ET.SubElement(robot, "material", name=material), "color", rgba=_row(rgba))
    for part in parts:
        robot.append(_link(part))
    for part in parts:
        if part.motion is not None:
            robot.append(_joint(part.name, part.motion))
    ET.indent(robot)
    return f'<?xml version="1.0"?>\n{ET.tostring(robot, encoding="unicode")}\n'


def _link(part: Part) -> ET.Element:
    link = ET.Element("link", name=part.name)
    what = mass_properties(part.boxes)
    inertial = ET.SubElement(link, "inertial")
    ET.SubElement(inertial, "origin", xyz=_row(what.com_l), rpy="0 0 0")
    ET.SubElement(inertial, "mass", value=number(what.mass_kg))
    entries = {"ixx": (0, 0), "ixy": (0, 1), "ixz": (0, 2)}
    entries |= {"iyy": (1, 1), "iyz": (1, 2), "izz": (2, 2)}
    ET.SubElement(
        inertial, "inertia", {key: number(what.inertia_l[at]) for key, at in entries.items()}
    )
    for shape in part.shapes:
        visual = ET.SubElement(link, "visual", name=shape.name)
        ET.SubElement(visual, "origin", xyz="0 0 0", rpy="0 0 0")
        geometry = ET.SubElement(visual, "geometry")
        ET.SubElement(geometry, "mesh", filename=f"meshes/{shape.name}.obj")
        ET.SubElement(visual, "material", name=shape.material)
    for shape in part.shapes:
        for box in shape.boxes:
            collision = ET.SubElement(link, "collision", name=f"{shape.name}_{box.name}")
            ET.SubElement(collision, "origin", xyz=_row(box.centre), rpy="0 0 0")
            ET.SubElement(ET.SubElement(collision, "geometry"), "box", size=_row(box.size))
    return link


def _joint(child: str, motion: Motion) -> ET.Element:
    joint = ET.Element("joint", name=motion.name, type=motion.kind)
    ET.SubElement(joint, "parent", link=motion.parent)
    ET.SubElement(joint, "child", link=child)
    ET.SubElement(joint, "origin", xyz=_row(motion.origin_p), rpy="0 0 0")
    ET.SubElement(joint, "axis", xyz=_row(motion.axis))
    limit = {"lower": 0.0, "upper": motion.upper, "effort": motion.effort}
    limit["velocity"] = motion.velocity
    ET.SubElement(joint, "limit", {key: number(value) for key, value in limit.items()})
    dynamics = {"damping": number(motion.damping), "friction": number(motion.friction)}
    ET.SubElement(joint, "dynamics", dynamics)
    return joint


def _row(values: Iterable[float]) -> str:
    return " ".join(number(value) for value in values)
