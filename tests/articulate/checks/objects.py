"""Small objects of boxes, written as MJCF, whose behaviour is known in closed form."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from articulate.assets.asset import Asset, Handle, Joint, Link, Vec3, save_asset

Box = tuple[Vec3, Vec3]
"""Middle and half size of a box [m]."""


@dataclass(frozen=True, kw_only=True)
class Part:
    """A moving part; its frame has the axes of the object."""

    name: str
    kind: Literal["slide", "hinge"]
    axis: Vec3
    pos: Vec3 = (0.0, 0.0, 0.0)
    """Origin, and a point on the axis, in the frame of its parent [m]."""
    span: float | None = 0.3
    """From closed (0) to open [m or rad]; None turns without end."""
    boxes: tuple[Box, ...] = ()
    shown: tuple[Box, ...] | None = None
    """What is seen; None: the same boxes."""
    mass_kg: float = 2.0
    com: Vec3 = (0.0, 0.0, 0.0)
    inertia: float = 0.02
    damping: float = 0.0
    friction: float = 0.0
    more: str = ""
    """Further attributes of its joint."""
    handle: Vec3 | None = None
    """Place of its handle in its frame [m]."""
    parent: str = "body"
    follows: str | None = None
    """Part whose joint this one's follows one to one."""

    @property
    def joint(self) -> str:
        """Name of its joint."""
        return f"{self.name}_joint"


def make_object(
    folder: Path,
    *parts: Part,
    body: tuple[Box, ...] = (((0.0, 0.0, -1.0), (0.1, 0.1, 0.1)),),
    shown: tuple[Box, ...] | None = None,
    excluded: bool = True,
    options: str = "",
) -> Asset:
    """An asset of a fixed ``body`` and moving ``parts``.

    Args:
        folder: Where it is written.
        parts: Moving parts; parents before children.
        body: Collision boxes of the fixed body.
        shown: What is seen of it; None: the same boxes.
        excluded: Whether no two links touch each other in the engine.
        options: Further elements of the MJCF.
    """
    links = [_link("body", None, 20.0, (0.0, 0.0, 0.0))]
    joints, handles = [], []
    origin = {"body": (0.0, 0.0, 0.0)}
    for part in parts:
        at = origin[part.parent]
        pos: Vec3 = (at[0] + part.pos[0], at[1] + part.pos[1], at[2] + part.pos[2])
        origin[part.name] = pos
        links.append(_link(part.name, part.parent, part.mass_kg, pos))
        joints.append(_joint(part, pos))
        if part.handle is not None:
            handles.append(_handle(part, part.handle))
    names = [link.name for link in links]
    pairs = [(a, b) for i, a in enumerate(names) for b in names[i + 1 :]] if excluded else []
    contact = "".join(f'<exclude body1="{a}" body2="{b}"/>' for a, b in pairs)
    equality = "".join(
        f'<joint joint1="{p.joint}" joint2="{p.follows}_joint" polycoef="0 1 0 0 0"/>'
        for p in parts
        if p.follows is not None
    )
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "object.xml").write_text(
        f'<mujoco><compiler angle="radian" autolimits="true"/>{options}<worldbody>'
        f'<body name="body">{_geoms(body, shown)}{_children("body", parts)}</body></worldbody>'
        f"<contact>{contact}</contact><equality>{equality}</equality></mujoco>\n",
        encoding="utf-8",
    )
    asset = Asset(
        name=folder.name,
        category="unknown",
        links=tuple(links),
        joints=tuple(joints),
        handles=tuple(handles),
        bounds_o=((-0.5, -0.5, 0.0), (0.5, 0.5, 1.0)),
        source="made for tests",
        licence="MIT",
        folder=folder,
    )
    save_asset(asset)
    return asset


def _link(name: str, parent: str | None, mass_kg: float, pos: Vec3) -> Link:
    return Link(
        name=name,
        parent=parent,
        pos_o=pos,
        quat_o=(1.0, 0.0, 0.0, 0.0),
        mass_kg=mass_kg,
        bounds_l=((-0.5, -0.5, -0.5), (0.5, 0.5, 0.5)),
    )


def _joint(part: Part, pos: Vec3) -> Joint:
    return Joint(
        name=part.joint,
        kind=part.kind,
        link=part.name,
        parent=part.parent,
        axis_o=part.axis,
        pivot_o=pos,
        lower=None if part.span is None else min(part.span, 0.0),
        upper=None if part.span is None else max(part.span, 0.0),
        closed=0.0,
        open=1.5707963267948966 if part.span is None else part.span,
        closed_rule="given",
        damping=part.damping,
        frictionloss=part.friction,
    )


def _handle(part: Part, pos: Vec3) -> Handle:
    return Handle(
        name=f"{part.name}_handle",
        link=part.name,
        joint=part.joint,
        pos_l=pos,
        normal_l=(-1.0, 0.0, 0.0),
        along_l=(0.0, 1.0, 0.0),
        extent=(0.1, 0.01, 0.01),
        kind="bar",
        source="given",
    )


def _children(parent: str, parts: tuple[Part, ...]) -> str:
    return "".join(_body(part, parts) for part in parts if part.parent == parent)


def _body(part: Part, parts: tuple[Part, ...]) -> str:
    limits = ""
    if part.span is not None:
        limits = f' range="{min(part.span, 0.0)!r} {max(part.span, 0.0)!r}"'
    i = part.inertia
    return (
        f'<body name="{part.name}" pos="{_numbers(part.pos)}">'
        f'<joint name="{part.joint}" type="{part.kind}" axis="{_numbers(part.axis)}"{limits} '
        f'damping="{part.damping!r}" frictionloss="{part.friction!r}" {part.more}/>'
        f'<inertial pos="{_numbers(part.com)}" mass="{part.mass_kg!r}" diaginertia="{i} {i} {i}"/>'
        f"{_geoms(part.boxes, part.shown)}{_children(part.name, parts)}</body>"
    )


def _geoms(boxes: tuple[Box, ...], shown: tuple[Box, ...] | None) -> str:
    seen = boxes if shown is None else shown
    return "".join(
        [_geom(box, 'group="3"') for box in boxes]
        + [_geom(box, 'group="2" contype="0" conaffinity="0"') for box in seen]
    )


def _geom(box: Box, rest: str) -> str:
    return f'<geom type="box" pos="{_numbers(box[0])}" size="{_numbers(box[1])}" {rest}/>'


def _numbers(values: tuple[float, ...]) -> str:
    return " ".join(repr(float(v)) for v in values)
