"""Write the asset: MJCF, canonical URDF and meshes, with fixed order and full digits."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np
import trimesh

from articulate.assets.asset import Handle, Joint, handle_frame
from articulate.formats.load_meshes import Piece
from articulate.formats.source_object import free_name
from articulate.geometry.collision import is_handle
from articulate.geometry.inertia import Inertial
from articulate.geometry.presets import (
    ROLLING_FRICTION_M,
    SLIDING_FRICTION,
    TORSIONAL_FRICTION_M,
)
from articulate.geometry.shapes import Shape
from articulate.transforms import Array, matrix_to_quat, matrix_to_rpy

MOVED_M = 1e-12
DRY = ' solimpfriction="0.9999 0.9999 0.001"'
"""Stops creep under dry friction: by default MuJoCo lets a joint of 0.8 kg creep at 21 mm/s under a
third of its frictionloss, and at 63 mm/s under nine tenths; with this at 0.03 mm/s or less."""
SHORT = {"slide": 0.005, "hinge": 0.1}
"""For a travel shorter than this [m or rad] the remaining creep matters ..."""
STIFF = ' solreffriction="0.004 1"'
"""... and a fifth of it does not: the shortest time constant of friction at steps of 2 ms."""


@dataclass(frozen=True, kw_only=True)
class Body:
    """One part in its final form, in metres."""

    name: str
    parent: str | None
    T_pc: Array
    """Pose in the parent body, or the identity for the root (4, 4)."""
    visuals: tuple[Piece, ...]
    shapes: tuple[Shape, ...]
    inertial: Inertial
    joint: Joint | None
    axis_l: Array | None
    """Axis of its joint in its own frame (3,)."""
    armature: float = 0.0
    frames: tuple[tuple[str, Array], ...] = ()
    """Links of the source that are fixed in it: names and poses (4, 4)."""


@dataclass(frozen=True, kw_only=True)
class Mimic:
    """A joint that follows another one, in units of the asset."""

    joint: str
    leader: str
    multiplier: float
    offset: float


def numbers(values: Sequence[float] | Array | float) -> str:
    """Format numbers with 12 significant digits, separated by spaces."""
    flat = np.atleast_1d(np.asarray(values, dtype=np.float64)).ravel()
    return " ".join(f"{v:.12g}" for v in np.where(np.abs(flat) < MOVED_M, 0.0, flat))


def mesh_files(bodies: Sequence[Body]) -> dict[str, bytes]:
    """Return the content of every mesh file by name, as OBJ."""
    return {name: obj_bytes(of.mesh) for name, of in _meshed(bodies).items()}


def _meshed(bodies: Sequence[Body]) -> dict[str, Piece | Shape]:
    """Return the pieces and shapes that have a mesh file, by its name."""
    found: dict[str, Piece | Shape] = {}
    for b, body in enumerate(bodies):
        for i, piece in enumerate(body.visuals):
            found[f"v{b:02d}_{i:03d}.obj"] = piece
        for i, shape in enumerate(body.shapes):
            if shape.kind == "hull":
                found[f"c{b:02d}_{i:03d}.obj"] = shape
    return found


def obj_bytes(mesh: trimesh.Trimesh) -> bytes:
    """Return vertices and triangles as OBJ text, in the units of the mesh."""
    if len(mesh.vertices) < 4:  # a single triangle: MuJoCo needs four corners
        mesh = mesh.subdivide()
    vertices = np.asarray(mesh.vertices, dtype=np.float64)
    vertices = np.where(np.abs(vertices) < MOVED_M, 0.0, vertices)
    faces = np.asarray(mesh.faces) + 1
    text = "v %.12g %.12g %.12g\n" * len(vertices) % tuple(vertices.ravel().tolist())
    return (text + "f %d %d %d\n" * len(faces) % tuple(faces.ravel().tolist())).encode()


def mjcf(
    name: str,
    bodies: Sequence[Body],
    handles: Sequence[Handle],
    excludes: Sequence[tuple[str, str]],
    mimics: Sequence[Mimic] = (),
) -> str:
    """Return the object as MJCF text."""
    friction = numbers([SLIDING_FRICTION, TORSIONAL_FRICTION_M, ROLLING_FRICTION_M])
    lines = [
        f"<mujoco model={quoteattr(name)}>",
        '  <compiler angle="radian" meshdir="meshes" autolimits="true"/>',
        "  <default>",
        '    <default class="visual">',
        '      <geom type="mesh" group="2" contype="0" conaffinity="0"/>',
        '      <mesh inertia="shell"/>',
        "    </default>",
        '    <default class="collision">',
        f'      <geom group="3" condim="4" friction="{friction}"/>',
        '      <mesh maxhullvert="32"/>',
        "    </default>",
        "  </default>",
        "  <asset>",
    ]
    for file in _meshed(bodies):
        kind = "visual" if file.startswith("v") else "collision"
        lines.append(f'    <mesh name="{file[:-4]}" class="{kind}" file="{file}"/>')
    lines += ["  </asset>", "  <worldbody>"]
    lines += _mjcf_body(bodies[0], bodies, handles, _site_names(bodies, handles), 2)
    lines += ["  </worldbody>"]
    if excludes:
        lines.append("  <contact>")
        for one, two in excludes:
            lines.append(f"    <exclude body1={quoteattr(one)} body2={quoteattr(two)}/>")
        lines.append("  </contact>")
    if mimics:
        lines.append("  <equality>")
        for m in mimics:
            poly = numbers([m.offset, m.multiplier, 0.0, 0.0, 0.0])
            lines.append(
                f"    <joint joint1={quoteattr(m.joint)} joint2={quoteattr(m.leader)} "
                f'polycoef="{poly}"/>'
            )
        lines.append("  </equality>")
    lines.append("</mujoco>")
    return "\n".join(lines) + "\n"


def _site_names(bodies: Sequence[Body], handles: Sequence[Handle]) -> dict[str, str]:
    """Return the name of the site of each frame; handles keep theirs."""
    frames = [name for body in bodies for name, _ in body.frames]
    handle_names = {handle.name for handle in handles}
    used = handle_names | set(frames)
    names = {}
    for name in frames:
        names[name] = free_name(name, used) if name in handle_names else name
        used.add(names[name])
    return names


def _mjcf_body(
    body: Body,
    bodies: Sequence[Body],
    handles: Sequence[Handle],
    sites: Mapping[str, str],
    depth: int,
) -> list[str]:
    pad = "  " * depth
    b = list(bodies).index(body)
    lines = [f"{pad}<body name={quoteattr(body.name)}{_frame(body.T_pc)}>"]
    i = body.inertial
    t = i.inertia_p
    full = numbers([t[0, 0], t[1, 1], t[2, 2], t[0, 1], t[0, 2], t[1, 2]])
    lines.append(
        f'{pad}  <inertial pos="{numbers(i.com_p)}" mass="{numbers(i.mass_kg)}" '
        f'fullinertia="{full}"/>'
    )
    if body.joint is not None and body.axis_l is not None:
        lines.append(_mjcf_joint(body.joint, body.axis_l, body.armature, f"{pad}  "))
    for k, piece in enumerate(body.visuals):
        lines.append(
            f'{pad}  <geom class="visual" mesh="v{b:02d}_{k:03d}" rgba="{numbers(piece.rgba)}"/>'
        )
    for k, shape in enumerate(body.shapes):
        lines.append(_mjcf_shape(shape, body.name, b, k, f"{pad}  "))
    for handle in handles:
        if handle.link == body.name:
            frame = _frame(handle_frame(handle))
            lines.append(
                f'{pad}  <site name={quoteattr(handle.name)}{frame} size="0.005" group="4"/>'
            )
    for name, T_bf in body.frames:
        site = quoteattr(sites[name])
        lines.append(f'{pad}  <site name={site}{_frame(T_bf)} size="0.002" group="5"/>')
    for child in bodies:
        if child.parent == body.name:
            lines += _mjcf_body(child, bodies, handles, sites, depth + 1)
    lines.append(f"{pad}</body>")
    return lines


def _frame(T: Array) -> str:
    text = ""
    if np.abs(T[:3, 3]).max() > MOVED_M:
        text += f' pos="{numbers(T[:3, 3])}"'
    if not np.array_equal(T[:3, :3], np.eye(3)):
        text += f' quat="{numbers(matrix_to_quat(T[:3, :3]))}"'
    return text


def _mjcf_joint(joint: Joint, axis_l: Array, armature: float, pad: str) -> str:
    text = f'{pad}<joint name={quoteattr(joint.name)} type="{joint.kind}" axis="{numbers(axis_l)}"'
    dry = DRY
    if joint.lower is not None and joint.upper is not None:
        text += f' range="{numbers([joint.lower, joint.upper])}"'
        dry += STIFF if joint.upper - joint.lower < SHORT[joint.kind] else ""
    return text + (
        f' damping="{numbers(joint.damping)}" frictionloss="{numbers(joint.frictionloss)}"'
        f' armature="{numbers(armature)}"{dry}/>'
    )


def _mjcf_shape(shape: Shape, body: str, b: int, k: int, pad: str) -> str:
    role = "handle" if is_handle(shape.piece) else "collision"
    text = f'{pad}<geom name={quoteattr(f"{body}_{role}_{k}")} class="collision"'
    if shape.kind == "hull":
        return f'{text} type="mesh" mesh="c{b:02d}_{k:03d}"/>'
    size = {
        "box": shape.half,
        "cylinder": (shape.half[0], shape.half[2]),
        "sphere": shape.half[:1],
    }[shape.kind]
    return f'{text} type="{shape.kind}" size="{numbers(size)}"{_frame(shape.T_ps)}/>'


def inertial_element(inertial: Inertial) -> list[str]:
    """Return the lines of the inertial element of a URDF link, whose frame is the part's."""
    t = inertial.inertia_p
    return [
        "    <inertial>",
        f'      <origin xyz="{numbers(inertial.com_p)}" rpy="0 0 0"/>',
        f'      <mass value="{numbers(inertial.mass_kg)}"/>',
        f'      <inertia ixx="{numbers(t[0, 0])}" ixy="{numbers(t[0, 1])}" '
        f'ixz="{numbers(t[0, 2])}" iyy="{numbers(t[1, 1])}" iyz="{numbers(t[1, 2])}" '
        f'izz="{numbers(t[2, 2])}"/>',
        "    </inertial>",
    ]


def urdf(name: str, bodies: Sequence[Body], mimics: Sequence[Mimic] = ()) -> str:
    """Return the object as canonical URDF text: one frame for each body, meshes baked."""
    lines = ['<?xml version="1.0"?>', f"<robot name={quoteattr(name)}>"]
    for b, body in enumerate(bodies):
        lines.append(f"  <link name={quoteattr(body.name)}>")
        lines += inertial_element(body.inertial)
        for k, piece in enumerate(body.visuals):
            lines += [
                "    <visual>",
                f'      <geometry><mesh filename="meshes/v{b:02d}_{k:03d}.obj"/></geometry>',
                f'      <material name="m{b:02d}_{k:03d}"><color rgba="{numbers(piece.rgba)}"/>'
                "</material>",
                "    </visual>",
            ]
        for k, shape in enumerate(body.shapes):
            lines += ["    <collision>", *_urdf_shape(shape, b, k), "    </collision>"]
        lines.append("  </link>")
    used = {body.joint.name for body in bodies if body.joint is not None}
    for body in bodies:
        for frame, T_bf in body.frames:
            lines += _urdf_frame(body.name, frame, free_name(f"{frame}_fixed", used), T_bf)
        if body.joint is not None and body.axis_l is not None:
            lines += _urdf_joint(body, body.joint, body.axis_l, mimics)
    lines.append("</robot>")
    return "\n".join(lines) + "\n"


def origin_element(T: Array) -> str:
    """Return a pose (4, 4) [m] as the element ``<origin>`` of URDF."""
    return f'<origin xyz="{numbers(T[:3, 3])}" rpy="{numbers(matrix_to_rpy(T[:3, :3]))}"/>'


def _urdf_shape(shape: Shape, b: int, k: int) -> list[str]:
    if shape.kind == "hull":
        inner = f'<mesh filename="meshes/c{b:02d}_{k:03d}.obj"/>'
    elif shape.kind == "box":
        inner = f'<box size="{numbers(2.0 * np.array(shape.half))}"/>'
    elif shape.kind == "cylinder":
        radius, length = numbers(shape.half[0]), numbers(2.0 * shape.half[2])
        inner = f'<cylinder radius="{radius}" length="{length}"/>'
    else:
        inner = f'<sphere radius="{numbers(shape.half[0])}"/>'
    return [f"      {origin_element(shape.T_ps)}", f"      <geometry>{inner}</geometry>"]


def _urdf_frame(body: str, frame: str, joint: str, T_bf: Array) -> list[str]:
    """Return a link with an explicit mass of 0: PyBullet uses 1 kg where there is none."""
    return [
        f"  <link name={quoteattr(frame)}>",
        '    <inertial><mass value="0"/><inertia ixx="0" ixy="0" ixz="0" iyy="0" iyz="0" izz="0"/>'
        "</inertial>",
        "  </link>",
        f'  <joint name={quoteattr(joint)} type="fixed">',
        f"    {origin_element(T_bf)}",
        f"    <parent link={quoteattr(body)}/>",
        f"    <child link={quoteattr(frame)}/>",
        "  </joint>",
    ]


def _urdf_joint(body: Body, joint: Joint, axis_l: Array, mimics: Sequence[Mimic]) -> list[str]:
    kind = "prismatic" if joint.kind == "slide" else "revolute"
    limit = ""
    if joint.lower is None or joint.upper is None:
        kind = "continuous"
    else:
        limit = (
            f'    <limit lower="{numbers(joint.lower)}" upper="{numbers(joint.upper)}" '
            'effort="1000" velocity="10"/>'
        )
    lines = [
        f'  <joint name={quoteattr(joint.name)} type="{kind}">',
        f"    {origin_element(body.T_pc)}",
        f"    <parent link={quoteattr(body.parent or '')}/>",
        f"    <child link={quoteattr(body.name)}/>",
        f'    <axis xyz="{numbers(axis_l)}"/>',
        *([limit] if limit else []),
        f'    <dynamics damping="{numbers(joint.damping)}" '
        f'friction="{numbers(joint.frictionloss)}"/>',
    ]
    for m in mimics:
        if m.joint == joint.name:
            lines.append(
                f"    <mimic joint={quoteattr(m.leader)} "
                f'multiplier="{numbers(m.multiplier)}" offset="{numbers(m.offset)}"/>'
            )
    return [*lines, "  </joint>"]


def write_meshes(folder: Path, files: dict[str, bytes]) -> None:
    """Write mesh files into ``folder``, which is a temporary one."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, content in files.items():
        (folder / name).write_bytes(content)
