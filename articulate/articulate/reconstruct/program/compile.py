"""Write an object of a program as a URDF with meshes, masses, damping and friction."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal
from xml.sax.saxutils import quoteattr

import numpy as np

from articulate.checks.force import FORCE_N
from articulate.conversion.write_asset import numbers, origin_element
from articulate.errors import AssetError, UsageError
from articulate.files import write_text
from articulate.geometry.inertia import Inertial
from articulate.geometry.presets import MASS_KG, joint_preset
from articulate.reconstruct.program.elements import common_name, elements_of, write_element
from articulate.reconstruct.program.mass import inertial_of, scaled
from articulate.reconstruct.program.materials import EFFORT, MATERIALS, VELOCITY
from articulate.reconstruct.program.program_parts import Parts
from articulate.reconstruct.program.result import ObjectJoint, ProgramObject
from articulate.transforms import Array, apply, inverse, pose, quat_to_matrix

MoveKind = Literal["slide", "hinge", "fixed"]
LIFTED, GRAVITY = 0.7, 9.81
"""Share of the reference force that lifts a lid; acceleration of free fall [m/s^2]."""


@dataclass(frozen=True, kw_only=True)
class LinkPlan:
    """One link, ready to be written."""

    name: str
    T_wl: Array
    """Pose in the world, every joint at 0 (4, 4)."""
    T_lp: Array
    """Pose of the part's own frame in the link (4, 4)."""
    joint: ObjectJoint | None
    """Joint to its parent; None for the root."""


def link_plans(built: ProgramObject) -> dict[str, LinkPlan]:
    """Return the links by name, parents first.

    The origin of a link is its joint's pivot, with the rotation of the part's frame. Without a
    pivot it is the part's frame, and for the root the world frame.
    """
    joint_of = {joint.child: joint for joint in built.joints}
    T_wp = {part.name: pose(part.pos_w, quat_to_matrix(part.quat_w)) for part in built.parts}
    plans: dict[str, LinkPlan] = {}

    def plan(name: str) -> None:
        joint = joint_of.get(name)
        T_wl = np.eye(4) if joint is None else T_wp[name].copy()
        if joint is not None and joint.pivot_w is not None:
            T_wl[:3, 3] = joint.pivot_w
        T_lp = inverse(T_wl) @ T_wp[name]
        plans[name] = LinkPlan(name=name, T_wl=T_wl, T_lp=T_lp, joint=joint)

    for name in _parents_first(built):
        plan(name)
    return plans


def _parents_first(built: ProgramObject) -> list[str]:
    children: dict[str, list[str]] = {}
    for joint in built.joints:
        children.setdefault(joint.parent, []).append(joint.child)
    order = [built.root]
    for name in order:  # grows during the loop
        order += children.get(name, [])
    if len(order) != len(built.parts):
        raise AssetError(f"{built.root}: {len(built.parts) - len(order)} parts have no parent")
    return order


def write_object(
    built: ProgramObject, parts: Parts, out: Path, *, source: str = "", name: str = "object"
) -> Path:
    """Write ``<name>.urdf`` with its meshes, the data and the program into ``out``.

    The URDF is written last, and an earlier one is removed first, so that it exists only with all
    other files.

    Args:
        built: Object of a program.
        parts: Geometry of its parts.
        out: Folder, made if absent.
        source: Source of the program, written beside it.
        name: Name of the object and of the file.

    Raises:
        AssetError: A part's mesh cannot be read.
        UsageError: The folder cannot be written.
    """
    plans = link_plans(built)
    path = out / f"{name}.urdf"
    lines = ['<?xml version="1.0"?>', f"<robot name={quoteattr(name)}>"]
    masses = _masses(built, parts, plans)  # may raise, so before anything is written
    _remove(path)
    for k, link in enumerate(plans.values()):
        lines += _link(link, k, parts, masses.get(link.name), out)
    groups = _groups(plans)
    for link in plans.values():
        if link.joint is not None:
            moved = sum(masses[n].mass_kg for n in groups[link.name] if n in masses)
            lines += _joint(link, link.joint, plans[link.joint.parent], moved)
    write_text(out / "built.json", built.json())
    if source:
        write_text(out / "program.py", source)
    write_text(path, "\n".join([*lines, "</robot>"]) + "\n")
    return path


def _remove(path: Path) -> None:
    try:
        path.unlink(missing_ok=True)
    except OSError as error:
        raise UsageError(
            f"{path}: cannot be written ({error.strerror}); choose another --out"
        ) from None


def _link(link: LinkPlan, k: int, parts: Parts, inertial: Inertial | None, out: Path) -> list[str]:
    lines = [f"  <link name={quoteattr(link.name)}>"]
    if inertial is not None:
        lines += _inertial(inertial)
    origin = origin_element(link.T_lp)
    pieces = parts[link.name].pieces if link.name in parts else ()
    for i, element in enumerate(elements_of(pieces)):
        stem = f"p{k:03d}_{i:03d}"
        write_element(element, out / "meshes", stem)
        name = f"name={quoteattr(common_name(element))}"
        geometry = [
            f"      {origin}",
            f'      <geometry><mesh filename="meshes/{stem}.obj"/></geometry>',
        ]
        colour = f'<color rgba="{numbers(element[0].rgba)}"/>'
        painted = [f'      <material name="m{stem[1:]}">{colour}</material>'] * (len(element) == 1)
        lines += [f"    <visual {name}>", *geometry, *painted, "    </visual>"]
        lines += [f"    <collision {name}>", *geometry, "    </collision>"]
    return [*lines, "  </link>"]


def _inertial(found: Inertial) -> list[str]:
    t = found.inertia_p
    entries = {"ixx": (0, 0), "ixy": (0, 1), "ixz": (0, 2)}
    entries |= {"iyy": (1, 1), "iyz": (1, 2), "izz": (2, 2)}
    tensor = " ".join(f'{key}="{numbers(t[at])}"' for key, at in entries.items())
    return [
        "    <inertial>",
        f'      <origin xyz="{numbers(found.com_p)}" rpy="0 0 0"/>',
        f'      <mass value="{numbers(found.mass_kg)}"/>',
        f"      <inertia {tensor}/>",
        "    </inertial>",
    ]


def _joint(link: LinkPlan, joint: ObjectJoint, parent: LinkPlan, mass_kg: float) -> list[str]:
    lines = [
        f'  <joint name={quoteattr(joint.name)} type="{joint.kind}">',
        f"    {origin_element(inverse(parent.T_wl) @ link.T_wl)}",
        f"    <parent link={quoteattr(parent.name)}/>",
        f"    <child link={quoteattr(link.name)}/>",
    ]
    if joint.kind == "fixed" or joint.axis_w is None:
        return [*lines, "  </joint>"]
    lines.append(f'    <axis xyz="{numbers(link.T_wl[:3, :3].T @ np.array(joint.axis_w))}"/>')
    kind = _move_kind(joint)
    assert kind != "fixed"
    limit = f'effort="{numbers(EFFORT[kind])}" velocity="{numbers(VELOCITY[kind])}"'
    if joint.lower is not None and joint.upper is not None:
        limit = f'lower="{numbers(joint.lower)}" upper="{numbers(joint.upper)}" {limit}'
    lines.append(f"    <limit {limit}/>")
    preset = joint_preset(kind, mass_kg)
    damping = preset.damping if joint.damping is None else joint.damping
    friction = preset.frictionloss if joint.friction is None else joint.friction
    lines.append(f'    <dynamics damping="{numbers(damping)}" friction="{numbers(friction)}"/>')
    if joint.mimic is not None:
        leader, multiplier, offset = joint.mimic
        lines.append(
            f"    <mimic joint={quoteattr(leader)} "
            f'multiplier="{numbers(multiplier)}" offset="{numbers(offset)}"/>'
        )
    return [*lines, "  </joint>"]


def _move_kind(joint: ObjectJoint | None) -> MoveKind:
    if joint is None or joint.kind == "fixed":
        return "fixed"
    return "slide" if joint.kind == "prismatic" else "hinge"


def _liftable_kg(
    plans: Mapping[str, LinkPlan], own: Mapping[str, Inertial], first: LinkPlan, parts: Parts
) -> float:
    """Return the largest mass about a level hinge that the reference force lifts at the edge [kg].

    Springs balance heavier doors that fall open and lids; programs do not describe them.
    """
    joint = first.joint
    if joint is None or joint.axis_w is None or _move_kind(joint) != "hinge":
        return np.inf
    axis = np.asarray(joint.axis_w, dtype=np.float64) / np.linalg.norm(joint.axis_w)
    total = sum(inertial.mass_kg for inertial in own.values())
    weighted = [i.mass_kg * apply(plans[n].T_wl, i.com_p) for n, i in own.items()]
    corners = [
        apply(plans[n].T_wl @ plans[n].T_lp, np.asarray(piece.mesh.vertices))
        for n in own
        if n in parts
        for piece in parts[n].pieces
    ]

    def distance(points: Array) -> Array:
        return np.asarray(np.linalg.norm(np.cross(points - first.T_wl[:3, 3], axis), axis=-1))

    lever = float(distance(sum(weighted, np.zeros(3)) / total)) * float(np.hypot(*axis[:2]))
    reach = max((float(distance(points).max()) for points in corners), default=0.0)
    return LIFTED * FORCE_N * reach / max(GRAVITY * lever, 1e-9)


def _groups(plans: Mapping[str, LinkPlan]) -> dict[str, list[str]]:
    """Return groups of links that are fixed to each other, by each link."""
    groups: dict[str, list[str]] = {}
    for name, link in plans.items():
        if link.joint is not None and link.joint.kind == "fixed":
            groups[name] = groups[link.joint.parent]
            groups[name].append(name)
        else:
            groups[name] = [name]
    return groups


def _masses(
    built: ProgramObject, parts: Parts, plans: Mapping[str, LinkPlan]
) -> dict[str, Inertial]:
    """Compute mass properties by link; each rigid group gets a total in the usual range."""
    materials = {part.name: MATERIALS[part.material] for part in built.parts}
    found = {}
    for name, link in plans.items():
        pieces = parts[name].pieces if name in parts else ()
        inertial = inertial_of(pieces, materials[name], link.T_lp)
        if inertial is not None:
            found[name] = inertial
    for name, members in _groups(plans).items():
        if members[0] != name:
            continue
        kind = _move_kind(plans[name].joint)
        low, high = MASS_KG[kind]
        total = sum(found[n].mass_kg for n in members if n in found)
        if total > 0.0:
            own = {n: found[n] for n in members if n in found}
            high = max(min(high, _liftable_kg(plans, own, plans[name], parts)), low)
            factor = float(np.clip(total, low, high)) / total
            found |= {n: scaled(found[n], factor) for n in members if n in found}
        elif kind != "fixed":  # a moving link without geometry: simulators need some mass
            found[name] = Inertial(mass_kg=low, com_p=np.zeros(3), inertia_p=1e-5 * np.eye(3))
    return found
