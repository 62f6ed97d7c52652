"""Small assets of our own for tests: written as text, simulated in milliseconds."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from articulate.assets.asset import Asset, Handle, Joint, Link, save_asset
from articulate.simulator import mujoco

WIDTH_M, DEPTH_M, HEIGHT_M, WALL_M = 0.45, 0.42, 0.60, 0.016
"""Outer size of both objects (y, x, z) and thickness of their walls [m]."""
DRAWERS = 3
TRAVEL_M = 0.28
"""Travel of a drawer [m]."""

Box = tuple[tuple[float, float, float], tuple[float, float, float]]
"""Middle and half size of a box [m]."""


def make_cabinet(
    folder: Path, *, drawers: int = DRAWERS, travel_m: float = TRAVEL_M, slab_kg: float = 2.5
) -> Asset:
    """A cabinet of open-front drawers ``drawer_0`` (lowest) to ``drawer_{n-1}`` in ``folder``.

    It opens along -x; joint ``drawer_k_slide`` goes from 0 (closed) to ``travel_m``. Each drawer
    has a free horizontal bar handle. The damping is 5 N s/m and the dry friction 2 N.
    """
    links, joints, handles, bodies = [_carcass()], [], [], ""
    for k in range(drawers):
        name, pos = f"drawer_{k}", (-DEPTH_M / 2 - 0.011, 0.0, 0.116 + 0.19 * k)
        joint = Joint(
            name=f"{name}_slide",
            kind="slide",
            link=name,
            parent="carcass",
            axis_o=(-1.0, 0.0, 0.0),
            pivot_o=pos,
            lower=0.0,
            upper=travel_m,
            closed=0.0,
            open=travel_m,
            closed_rule="given",
            damping=5.0,
            frictionloss=2.0,
        )
        bodies += _body(name, pos, joint, (0.12, 0.0, -0.02), slab_kg, _drawer_boxes())
        bounds = ((-0.051, -0.225, -0.09), (0.355, 0.225, 0.09))
        links.append(_link(name, "carcass", pos, slab_kg, bounds))
        joints.append(joint)
        handles.append(_handle(name, joint.name, (-0.045, 0.0, 0.0), (0.0, 1.0, 0.0)))
    return _write("cabinet", folder, bodies, links, joints, handles)


def make_cupboard(
    folder: Path, *, degrees: float = 120.0, neighbour_m: float | None = None
) -> Asset:
    """A cupboard in ``folder`` with one ``door`` on the upright hinge ``door_hinge`` at its left.

    Closed at 0; it opens towards -x up to ``degrees``. The handle is a vertical bar at the right;
    ``neighbour_m`` to the right of it is a bar that does not move, like that of a second door.
    """
    pos = (-DEPTH_M / 2 - 0.011, WIDTH_M / 2, HEIGHT_M / 2)
    joint = Joint(
        name="door_hinge",
        kind="hinge",
        link="door",
        parent="carcass",
        axis_o=(0.0, 0.0, -1.0),
        pivot_o=pos,
        lower=0.0,
        upper=float(np.radians(degrees)),
        closed=0.0,
        open=float(np.radians(degrees)),
        closed_rule="given",
        damping=0.1,
        frictionloss=0.1,
    )
    edge = -WIDTH_M + 0.05
    boxes: list[Box] = [
        ((0.0, -WIDTH_M / 2, 0.0), (0.009, WIDTH_M / 2 - 0.002, HEIGHT_M / 2 - 0.002)),
        ((-0.045, edge, 0.0), (0.006, 0.006, 0.06)),
        ((-0.025, edge, -0.055), (0.016, 0.005, 0.005)),
        ((-0.025, edge, 0.055), (0.016, 0.005, 0.005)),
    ]
    body = _body("door", pos, joint, (0.0, -WIDTH_M / 2, 0.0), 3.0, boxes)
    bounds = ((-0.051, -0.448, -0.298), (0.009, -0.002, 0.298))
    links = [_carcass(), _link("door", "carcass", pos, 3.0, bounds)]
    handle = _handle("door", joint.name, (-0.045, edge, 0.0), (0.0, 0.0, 1.0))
    walls = _walls()
    if neighbour_m is not None:
        beside = (pos[0] - 0.045, pos[1] + edge - neighbour_m, pos[2])
        walls.append((beside, (0.006, 0.006, 0.06)))
    return _write("cupboard", folder, body, links, [joint], [handle], walls=walls)


def make_box(folder: Path, *, degrees: float = 50.0) -> Asset:
    """A box in ``folder`` whose lid ``lid`` turns about the level hinge ``lid_hinge`` at its rear.

    Closed at 0, where it lies flat; it opens upwards to ``degrees``. A bar along its front edge is
    its handle.
    """
    deep, wide, high = BOX_M
    pos = (deep / 2, 0.0, high)
    joint = Joint(
        name="lid_hinge",
        kind="hinge",
        link="lid",
        parent="carcass",
        axis_o=(0.0, 1.0, 0.0),
        pivot_o=pos,
        lower=0.0,
        upper=float(np.radians(degrees)),
        closed=0.0,
        open=float(np.radians(degrees)),
        closed_rule="given",
        damping=0.1,
        frictionloss=0.1,
    )
    boxes: list[Box] = [
        ((-deep / 2, 0.0, 0.01), (deep / 2, wide / 2, 0.006)),
        ((-deep - 0.045, 0.0, 0.01), (0.006, 0.06, 0.006)),
        ((-deep - 0.02, -0.055, 0.01), (0.02, 0.005, 0.005)),
        ((-deep - 0.02, 0.055, 0.01), (0.02, 0.005, 0.005)),
    ]
    d, w, h, t = deep / 2, wide / 2, high / 2, 0.005
    walls: list[Box] = [
        ((0.0, 0.0, t), (d, w, t)),
        ((0.0, -w + t, h), (d, t, h)),
        ((0.0, w - t, h), (d, t, h)),
        ((d - t, 0.0, h), (t, w, h)),
        ((-d + t, 0.0, h), (t, w, h)),
    ]
    body = _body("lid", pos, joint, (-deep / 2, 0.0, 0.01), 0.8, boxes)
    bounds = ((-deep - 0.051, -w, 0.004), (0.0, w, 0.016))
    rest = _link("carcass", None, (0.0, 0.0, 0.0), 3.0, ((-d, -w, 0.0), (d, w, high)))
    handle = _handle("lid", joint.name, (-deep - 0.045, 0.0, 0.01), (0.0, 1.0, 0.0))
    links = [rest, _link("lid", "carcass", pos, 0.8, bounds)]
    outer = ((-d - 0.051, -w, 0.0), (d, w, high + 0.016))
    return _write("box", folder, body, links, [joint], [handle], walls=walls, bounds=outer)


BOX_M = (0.18, 0.26, 0.15)
"""Outer size of the box without its lid (x, y, z) [m]."""


def _carcass() -> Link:
    half = (DEPTH_M / 2, WIDTH_M / 2)
    return _link(
        "carcass", None, (0.0, 0.0, 0.0), 20.0, ((-half[0], -half[1], 0.0), (*half, HEIGHT_M))
    )


def _link(
    name: str,
    parent: str | None,
    pos: tuple[float, float, float],
    mass_kg: float,
    bounds: tuple[tuple[float, float, float], tuple[float, float, float]],
) -> Link:
    return Link(
        name=name,
        parent=parent,
        pos_o=pos,
        quat_o=(1.0, 0.0, 0.0, 0.0),
        mass_kg=mass_kg,
        bounds_l=bounds,
    )


def _handle(
    link: str, joint: str, pos: tuple[float, float, float], along: tuple[float, float, float]
) -> Handle:
    return Handle(
        name=f"{link}_handle",
        link=link,
        joint=joint,
        pos_l=pos,
        normal_l=(-1.0, 0.0, 0.0),
        along_l=along,
        extent=(0.12, 0.012, 0.012),
        kind="bar",
        source="given",
    )


def _drawer_boxes() -> list[Box]:
    """Front, floor, two sides, back, and a bar on two posts."""
    return [
        ((0.0, 0.0, 0.0), (0.009, WIDTH_M / 2 - 0.002, 0.09)),
        ((0.18, 0.0, -0.08), (0.17, 0.19, 0.005)),
        ((0.18, -0.19, -0.02), (0.17, 0.005, 0.07)),
        ((0.18, 0.19, -0.02), (0.17, 0.005, 0.07)),
        ((0.35, 0.0, -0.02), (0.005, 0.19, 0.07)),
        ((-0.045, 0.0, 0.0), (0.006, 0.06, 0.006)),
        ((-0.025, -0.055, 0.0), (0.016, 0.005, 0.005)),
        ((-0.025, 0.055, 0.0), (0.016, 0.005, 0.005)),
    ]


def _walls() -> list[Box]:
    """Floor, top, two sides and back of the carcass."""
    d, w, h, t = DEPTH_M / 2, WIDTH_M / 2, HEIGHT_M / 2, WALL_M / 2
    return [
        ((0.0, 0.0, t), (d, w, t)),
        ((0.0, 0.0, 2 * h - t), (d, w, t)),
        ((0.0, -w + t, h), (d, t, h)),
        ((0.0, w - t, h), (d, t, h)),
        ((d - t, 0.0, h), (t, w, h)),
    ]


def _numbers(values: tuple[float, ...]) -> str:
    return " ".join(repr(float(v)) for v in values)


def _boxes(boxes: list[Box]) -> str:
    return "".join(
        f'<geom type="box" group="3" pos="{_numbers(pos)}" size="{_numbers(half)}"/>'
        for pos, half in boxes
    )


def _body(
    name: str,
    pos: tuple[float, float, float],
    joint: Joint,
    com: tuple[float, float, float],
    mass_kg: float,
    boxes: list[Box],
) -> str:
    assert joint.lower is not None
    assert joint.upper is not None
    limits = _numbers((joint.lower, joint.upper))
    return (
        f'<body name="{name}" pos="{_numbers(pos)}">'
        f'<joint name="{joint.name}" type="{joint.kind}" axis="{_numbers(joint.axis_o)}" '
        f'range="{limits}" damping="{joint.damping}" frictionloss="{joint.frictionloss}" '
        'armature="0.01"/>'
        f'<inertial pos="{_numbers(com)}" mass="{mass_kg}" diaginertia="0.05 0.05 0.05"/>'
        f"{_boxes(boxes)}</body>"
    )


def _write(
    name: str,
    folder: Path,
    bodies: str,
    links: list[Link],
    joints: list[Joint],
    handles: list[Handle],
    *,
    walls: list[Box] | None = None,
    bounds: tuple[tuple[float, float, float], tuple[float, float, float]] | None = None,
) -> Asset:
    """Write ``object.xml`` and ``asset.json``; parts do not meet the carcass or each other."""
    d, w = DEPTH_M / 2, WIDTH_M / 2
    walls = _walls() if walls is None else walls
    bounds = ((-d - 0.062, -w, 0.0), (d, w, HEIGHT_M)) if bounds is None else bounds
    folder.mkdir(parents=True, exist_ok=True)
    names = [link.name for link in links]
    pairs = [(a, b) for i, a in enumerate(names) for b in names[i + 1 :]]
    exclude = "".join(f'<exclude body1="{a}" body2="{b}"/>' for a, b in pairs)
    text = (
        f'<mujoco model="{name}"><compiler angle="radian" autolimits="true"/><worldbody>'
        f'<body name="carcass">{_boxes(walls)}{bodies}</body></worldbody>'
        f"<contact>{exclude}</contact></mujoco>\n"
    )
    (folder / "object.xml").write_text(text, encoding="utf-8")
    urdf = _urdf(name, mujoco.MjModel.from_xml_string(text))
    (folder / "object.urdf").write_text(urdf, encoding="utf-8")
    asset = Asset(
        name=name,
        category="StorageFurniture",
        links=tuple(links),
        joints=tuple(joints),
        handles=tuple(handles),
        bounds_o=bounds,
        source="made for tests",
        licence="MIT",
        folder=folder,
    )
    save_asset(asset)
    return asset


def _urdf(name: str, model: mujoco.MjModel) -> str:
    """The same object as URDF: bodies that are not turned, boxes, one joint each."""
    text = f'<robot name="{name}">'
    for b in range(1, model.nbody):
        x, y, z = (float(v) for v in model.body_inertia[b])
        text += (
            f'<link name="{model.body(b).name}"><inertial>'
            f'<origin xyz="{_numbers(tuple(model.body_ipos[b]))}"/>'
            f'<mass value="{float(model.body_mass[b])}"/>'
            f'<inertia ixx="{x}" ixy="0" ixz="0" iyy="{y}" iyz="0" izz="{z}"/></inertial>'
        )
        for g in np.flatnonzero(model.geom_bodyid == b):
            text += (
                f'<collision><origin xyz="{_numbers(tuple(model.geom_pos[g]))}"/><geometry>'
                f'<box size="{_numbers(tuple(2.0 * model.geom_size[g]))}"/></geometry></collision>'
            )
        text += "</link>"
    for j in range(model.njnt):
        body = int(model.jnt_bodyid[j])
        kind = "prismatic" if model.jnt_type[j] == mujoco.mjtJoint.mjJNT_SLIDE else "revolute"
        low, high = (float(v) for v in model.jnt_range[j])
        dof = int(model.jnt_dofadr[j])
        text += (
            f'<joint name="{model.joint(j).name}" type="{kind}">'
            f'<origin xyz="{_numbers(tuple(model.body_pos[body]))}"/>'
            f'<parent link="{model.body(int(model.body_parentid[body])).name}"/>'
            f'<child link="{model.body(body).name}"/>'
            f'<axis xyz="{_numbers(tuple(model.jnt_axis[j]))}"/>'
            f'<limit lower="{low}" upper="{high}" effort="1000" velocity="10"/>'
            f'<dynamics damping="{float(model.dof_damping[dof])}" '
            f'friction="{float(model.dof_frictionloss[dof])}"/></joint>'
        )
    return text + "</robot>\n"
