"""Write an edited object as a URDF with meshes, and as a program."""

from __future__ import annotations

from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np

from articulate.conversion.write_asset import inertial_element, numbers, obj_bytes, origin_element
from articulate.files import write_bytes, write_text
from articulate.formats.load_meshes import Piece
from articulate.reconstruct.program.elements import common_name, elements_of, write_element
from articulate.reconstruct.program.materials import EFFORT, VELOCITY
from articulate.studio.mass import moved_mass
from articulate.studio.model import StudioJoint, StudioLink, StudioModel
from articulate.transforms import Array, pose

URDF_NAME = "object.urdf"


def write_model(model: StudioModel, folder: Path) -> Path:
    """Write ``object.urdf`` and ``meshes/`` into ``folder``; return the path of the URDF.

    The frame of a link is parallel to the object frame, with its origin on the axis of its joint.
    Links without a known mass have none; the checks derive it from the geometry.

    Raises:
        UsageError: The folder cannot be written.
    """
    origins = {link.name: _origin(link) for link in model.links}
    lines = ['<?xml version="1.0"?>', f"<robot name={quoteattr(model.name)}>"]
    for k, link in enumerate(model.links):
        lines += _link(link, k, origins[link.name], folder)
    for link in model.links:
        if link.joint is not None:
            offset = origins[link.name] - origins[link.joint.parent]
            lines += _joint(link.name, link.joint, offset)
    path = folder / URDF_NAME
    write_text(path, "\n".join([*lines, "</robot>"]) + "\n")
    return path


def _origin(link: StudioLink) -> Array:
    return np.zeros(3) if link.joint is None else np.asarray(link.joint.pivot_o)


def _link(link: StudioLink, k: int, origin: Array, folder: Path) -> list[str]:
    lines = [f"  <link name={quoteattr(link.name)}>"]
    T = pose(-origin)
    if link.inertial is not None:
        lines += inertial_element(moved_mass(link.inertial, T))
    for layer, pieces in (("visual", link.visuals), ("collision", link.collisions)):
        groups = elements_of([piece.moved(T) for piece in pieces])
        for i, element in enumerate(groups):
            lines += _element(element, layer, f"{layer[0]}{k:03d}_{i:03d}", folder)
    return [*lines, "  </link>"]


def _element(element: list[Piece], layer: str, stem: str, folder: Path) -> list[str]:
    first = element[0]
    origin = origin_element(np.eye(4))
    if len(element) == 1 and first.primitive is not None and first.primitive.kind != "capsule":
        primitive = first.primitive
        origin = origin_element(primitive.T_lg)
        if primitive.kind == "box":
            shape = f'<box size="{numbers(primitive.size)}"/>'
        elif primitive.kind == "sphere":
            shape = f'<sphere radius="{numbers(primitive.size[0])}"/>'
        else:
            radius, length = (numbers(value) for value in primitive.size[:2])
            shape = f'<cylinder radius="{radius}" length="{length}"/>'
    else:
        shape = f'<mesh filename="meshes/{stem}.obj"/>'
        if layer == "visual":
            write_element(element, folder / "meshes", stem)
        else:
            for j, piece in enumerate(element):
                write_bytes(folder / "meshes" / _part_file(stem, j), obj_bytes(piece.mesh))
    if layer == "collision" and "mesh" in shape:
        return [
            line
            for j in range(len(element))
            for line in _lines(layer, element[j : j + 1], origin,
                               f'<mesh filename="meshes/{_part_file(stem, j)}"/>')
        ]  # fmt: skip
    return _lines(layer, element, origin, shape, f"m{stem}")


def _part_file(stem: str, j: int) -> str:
    return f"{stem}_{j}.obj" if j else f"{stem}.obj"


def _lines(
    layer: str, element: list[Piece], origin: str, shape: str, material: str = ""
) -> list[str]:
    lines = [
        f"    <{layer} name={quoteattr(common_name(element))}>",
        f"      {origin}",
        f"      <geometry>{shape}</geometry>",
    ]
    if layer == "visual" and len(element) == 1:
        colour = f'<color rgba="{numbers(element[0].rgba)}"/>'
        lines.append(f'      <material name="{material}">{colour}</material>')
    return [*lines, f"    </{layer}>"]


def _joint(child: str, joint: StudioJoint, offset: Array) -> list[str]:
    lines = [
        f'  <joint name={quoteattr(joint.name)} type="{joint.kind}">',
        f"    {origin_element(pose(offset))}",
        f"    <parent link={quoteattr(joint.parent)}/>",
        f"    <child link={quoteattr(child)}/>",
    ]
    if joint.kind == "fixed":
        return [*lines, "  </joint>"]
    lines.append(f'    <axis xyz="{numbers(joint.axis_o)}"/>')
    kind = "slide" if joint.kind == "prismatic" else "hinge"
    limit = f'effort="{numbers(EFFORT[kind])}" velocity="{numbers(VELOCITY[kind])}"'
    if joint.lower is not None and joint.upper is not None:
        limit = f'lower="{numbers(joint.lower)}" upper="{numbers(joint.upper)}" {limit}'
    lines.append(f"    <limit {limit}/>")
    dynamics = [
        f'{key}="{numbers(value)}"'
        for key, value in (("damping", joint.damping), ("friction", joint.friction))
        if value is not None
    ]
    if dynamics:
        lines.append(f"    <dynamics {' '.join(dynamics)}/>")
    if joint.mimic is not None:
        leader, multiplier, offset_q = joint.mimic
        lines.append(
            f'    <mimic joint={quoteattr(leader)} multiplier="{numbers(multiplier)}" '
            f'offset="{numbers(offset_q)}"/>'
        )
    return [*lines, "  </joint>"]
