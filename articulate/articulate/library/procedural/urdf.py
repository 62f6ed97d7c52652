"""Write parts made of solids as a URDF whose bytes depend on the parts only.

Every visual is one mesh file; the collision geometry consists of the convex pieces of the solids,
so that cavities stay free in every simulator.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal
from xml.etree import ElementTree as ET  # noqa: TID251 - it only writes here, reads nothing

from articulate.assets.asset import Vec3
from articulate.files import write_bytes, write_text
from articulate.library.procedural.materials import PALETTE, Material, texture
from articulate.library.procedural.meshes import hull_text, mass_properties, number, obj_text
from articulate.library.procedural.solids import Collider, Solid


@dataclass(frozen=True, kw_only=True)
class Shape:
    """Solids of one material and one visual mesh."""

    name: str
    """Name of the visual and of its mesh file, unique in the object."""
    solids: tuple[Solid, ...]
    """Solids in the frame of the link."""
    material: str
    """Name of the material, a key of the ``palette`` given to ``write_urdf``."""

    def seen_from(self, origin: Vec3) -> Shape:
        """Return the same shape in a parallel frame whose origin is at ``origin`` [m]."""
        return replace(self, solids=tuple(solid.seen_from(origin) for solid in self.solids))


@dataclass(frozen=True, kw_only=True)
class Motion:
    """Joint between a part and its parent, whose frames are parallel when closed."""

    name: str
    """Name of the joint."""
    kind: Literal["prismatic", "revolute", "continuous"]
    """URDF's word."""
    parent: str
    """Name of the parent link."""
    origin_p: Vec3
    """Origin of the part's frame in the parent's frame, closed [m]."""
    axis: Vec3
    """Unit axis in the part's frame."""
    upper: float
    """Far end of opening [m or rad]; closed is 0. Ignored for continuous joints."""
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
    """One link and its joint."""

    name: str
    """Name of the link."""
    shapes: tuple[Shape, ...]
    """Shapes of the link."""
    motion: Motion | None = None
    """None for the root."""

    @classmethod
    def moving(cls, name: str, motion: Motion, shapes_p: Iterable[Shape]) -> Part:
        """Build a link from shapes in the frame of its parent, closed."""
        return cls(
            name=name,
            shapes=tuple(shape.seen_from(motion.origin_p) for shape in shapes_p),
            motion=motion,
        )

    @property
    def solids(self) -> tuple[Solid, ...]:
        """Solids of all shapes, in the frame of the link."""
        return tuple(solid for shape in self.shapes for solid in shape.solids)


def write_urdf(
    name: str, parts: Sequence[Part], folder: Path, palette: Mapping[str, Material] = PALETTE
) -> Path:
    """Write ``<name>.urdf`` and ``meshes/`` into ``folder``; return the path of the URDF.

    Args:
        name: Name of the robot element and of the file.
        parts: Links, parents before children.
        folder: Made if absent.
        palette: Materials by name.
    """
    meshes = folder / "meshes"
    for part in parts:
        for shape in part.shapes:
            grain = palette[shape.material].grain
            tile_m = palette[shape.material].tile_m
            text = obj_text(shape.solids, shape.material if grain else "", tile_m)
            write_text(meshes / f"{shape.name}.obj", text)
            for key, collider in _colliders(shape):
                if collider.mesh is not None:
                    write_text(meshes / "collision" / f"{key}.obj", hull_text(collider.mesh))
    textures = {key: m for key, m in _used(parts, palette).items() if m.grain}
    for key, material in textures.items():
        write_bytes(meshes / f"{key}.png", texture(key, material))
    if textures:
        write_text(meshes / "materials.mtl", "\n".join(map(_mtl, textures)))
    path = folder / f"{name}.urdf"
    write_text(path, urdf_text(name, parts, palette))
    return path


def urdf_text(name: str, parts: Sequence[Part], palette: Mapping[str, Material] = PALETTE) -> str:
    """Return the text of the URDF, elements and attributes in a fixed order."""
    robot = ET.Element("robot", name=name)
    for key, material in _used(parts, palette).items():
        element = ET.SubElement(robot, "material", name=key)
        ET.SubElement(element, "color", rgba=_row(material.rgba))
        if material.grain:
            ET.SubElement(element, "texture", filename=f"meshes/{key}.png")
    for part in parts:
        robot.append(_link(part))
    for part in parts:
        if part.motion is not None:
            robot.append(_joint(part.name, part.motion))
    ET.indent(robot)
    return f'<?xml version="1.0"?>\n{ET.tostring(robot, encoding="unicode")}\n'


def _used(parts: Sequence[Part], palette: Mapping[str, Material]) -> dict[str, Material]:
    """Materials of ``parts`` in the order of the palette."""
    names = {shape.material for part in parts for shape in part.shapes}
    return {key: material for key, material in palette.items() if key in names}


def _mtl(name: str) -> str:
    """Material of an OBJ with its texture, unchanged."""
    return f"newmtl {name}\nKd 1 1 1\nmap_Kd {name}.png\n"


def _colliders(shape: Shape) -> list[tuple[str, Collider]]:
    """Convex pieces of a shape with names that are unique in the object."""
    found = []
    for solid in shape.solids:
        pieces = solid.colliders()
        for k, piece in enumerate(pieces):
            number_k = f"_{k}" if len(pieces) > 1 else ""
            found.append((f"{shape.name}_{solid.name}{number_k}", piece))
    return found


def _link(part: Part) -> ET.Element:
    link = ET.Element("link", name=part.name)
    what = mass_properties(part.solids)
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
        for key, piece in _colliders(shape):
            link.append(_collision(key, piece))
    return link


def _collision(name: str, piece: Collider) -> ET.Element:
    collision = ET.Element("collision", name=name)
    ET.SubElement(collision, "origin", xyz=_row(piece.centre), rpy=_row(piece.rpy))
    geometry = ET.SubElement(collision, "geometry")
    if piece.kind == "box":
        ET.SubElement(geometry, "box", size=_row(piece.size))
    elif piece.kind == "cylinder":
        radius, length = (number(value) for value in piece.size)
        ET.SubElement(geometry, "cylinder", radius=radius, length=length)
    else:
        ET.SubElement(geometry, "mesh", filename=f"meshes/collision/{name}.obj")
    return collision


def _joint(child: str, motion: Motion) -> ET.Element:
    joint = ET.Element("joint", name=motion.name, type=motion.kind)
    ET.SubElement(joint, "parent", link=motion.parent)
    ET.SubElement(joint, "child", link=child)
    ET.SubElement(joint, "origin", xyz=_row(motion.origin_p), rpy="0 0 0")
    ET.SubElement(joint, "axis", xyz=_row(motion.axis))
    limit = {"lower": 0.0, "upper": motion.upper, "effort": motion.effort}
    limit["velocity"] = motion.velocity
    if motion.kind == "continuous":
        del limit["lower"], limit["upper"]
    ET.SubElement(joint, "limit", {key: number(value) for key, value in limit.items()})
    dynamics = {"damping": number(motion.damping), "friction": number(motion.friction)}
    ET.SubElement(joint, "dynamics", dynamics)
    return joint


def _row(values: Iterable[float]) -> str:
    return " ".join(number(value) for value in values)
