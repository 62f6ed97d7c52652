"""Building blocks of objects: shapes from spans, joints, handles, trays."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from articulate.assets.asset import Vec3
from articulate.library.procedural.materials import PALETTE
from articulate.library.procedural.solids import Box, Loft, Ring, Rod, Solid
from articulate.library.procedural.urdf import Motion, Part, Shape
from articulate.transforms import Array

Span = tuple[float, float]
"""Lower and higher end along one axis [m]."""
Spans = tuple[Span, Span, Span]
"""A box, by its extent along x, y and z [m]."""
Piece = Spans | Box | Loft | Ring | Rod
"""Element of a shape: a solid without name and density, or the extent of a box."""
LEFT, RIGHT = 1.0, -1.0
"""Sides of an object along y as seen from the front."""


def shape(
    name: str, material: str, pieces: Mapping[str, Piece], density_kg_m3: float | None = None
) -> Shape:
    """Build a shape of one solid for each of ``pieces``.

    Args:
        name: Unique in the object; contains "handle" or "knob" for a piece to grasp.
        material: Key of the palette.
        pieces: Extents or solids, by name.
        density_kg_m3: Instead of the material's.
    """
    density = PALETTE[material].density_kg_m3 if density_kg_m3 is None else density_kg_m3
    solids: list[Solid] = []
    for key, piece in pieces.items():
        solid = box(piece) if isinstance(piece, tuple) else piece
        solids.append(replace(solid, name=key, density_kg_m3=density))
    return Shape(name=name, material=material, solids=tuple(solids))


def box(spans: Spans) -> Box:
    """Build a box of these extents."""
    x, y, z = spans
    return Box(low=(x[0], y[0], z[0]), high=(x[1], y[1], z[1]))


def corners_of(x: Span, y: Span, by: float) -> list[tuple[float, float]]:
    """Four places ``by`` inside the corners of a floor plan, for legs and feet."""
    return [(a, b) for a in shrunk(x, by) for b in shrunk(y, by)]


def around(middle: float, length: float) -> Span:
    """Return the span of ``length`` round ``middle``."""
    return (middle - length / 2, middle + length / 2)


def shrunk(span: Span, by: float) -> Span:
    """Return the span, shorter by ``by`` at both ends."""
    return (span[0] + by, span[1] - by)


def tray(outer: Spans, wall_m: float, *, name: str = "") -> dict[str, Piece]:
    """Floor and four walls of a box that is open above."""
    (x, y, z), wall = outer, wall_m
    inner_x, above = shrunk(x, wall), (z[0] + wall, z[1])
    return {
        f"{name}floor": (x, y, (z[0], above[0])),
        f"{name}front": ((x[0], inner_x[0]), y, above),
        f"{name}rear": ((inner_x[1], x[1]), y, above),
        f"{name}left": (inner_x, (y[1] - wall, y[1]), above),
        f"{name}right": (inner_x, (y[0], y[0] + wall), above),
    }


def cavity(outer: Spans, wall_m: float, *, name: str = "") -> dict[str, Piece]:
    """Five walls of a box that is open in front, towards -x."""
    (x, y, z), wall = outer, wall_m
    within, inner_y, inner_z = (x[0], x[1] - wall), shrunk(y, wall), shrunk(z, wall)
    return {
        f"{name}rear": ((within[1], x[1]), y, z),
        f"{name}bottom": (within, y, (z[0], inner_z[0])),
        f"{name}top": (within, y, (inner_z[1], z[1])),
        f"{name}left": (within, (inner_y[1], y[1]), inner_z),
        f"{name}right": (within, (y[0], inner_y[0]), inner_z),
    }


def crown(x: Span, y: Span, z: Span, bevel_m: float) -> Loft:
    """Build a flat top over ``x`` and ``y`` that is narrower by ``bevel_m`` all round above."""

    def outline(by: float, at: float) -> tuple[Vec3, ...]:
        (x0, x1), (y0, y1) = shrunk(x, by), shrunk(y, by)
        return ((x0, y0, at), (x1, y0, at), (x1, y1, at), (x0, y1, at))

    return Loft(low=outline(0.0, z[0]), high=outline(bevel_m, z[1]))


def lined(name: str, outer: Spans, walls_m: tuple[float, float], finish: str) -> list[Shape]:
    """Build the cavity of an appliance: outer walls of ``finish`` and a liner."""
    (x, y, z), (wall, liner) = outer, walls_m
    within = ((x[0], x[1] - wall), shrunk(y, wall), shrunk(z, wall))
    return [
        shape(f"{name}_shell", finish, cavity(outer, wall)),
        shape(f"{name}_liner", "liner", cavity(within, liner)),
    ]


def frame(
    outer: tuple[Span, Span], inner: tuple[Span, Span], x: Span, *, name: str = ""
) -> dict[str, Piece]:
    """Build an upright frame ``x`` thick between an outer and an inner extent in y and z."""
    (y, z), (iy, iz) = outer, inner
    return {
        f"{name}above": (x, y, (iz[1], z[1])),
        f"{name}below": (x, y, (z[0], iz[0])),
        f"{name}left": (x, (iy[1], y[1]), iz),
        f"{name}right": (x, (y[0], iy[0]), iz),
    }


def bar_handle(
    name: str, at: Vec3, length_m: float, *, upright: bool, material: str = "dark_steel"
) -> Shape:
    """Build a round bar on two posts before an upright front; ``at`` is its middle there."""
    x, y, z = at
    radius, out = 0.007, x - 0.045

    def ends(half: float) -> tuple[Vec3, ...]:
        return tuple((out, y, z + d) if upright else (out, y + d, z) for d in (-half, half))

    low, high = ends(length_m / 2)
    pieces: dict[str, Piece] = {"bar": Rod(start=low, end=high, radius_m=radius)}
    for key, end in zip(("post_a", "post_b"), ends(length_m / 2 - 0.012), strict=True):
        pieces[key] = Rod(start=(x, *end[1:]), end=end, radius_m=0.8 * radius)
    return shape(name, material, pieces, 2700.0)


def knob(
    name: str,
    at: Vec3,
    radius_m: float,
    length_m: float,
    *,
    axis: int = 0,
    material: str = "chrome",
) -> Shape:
    """Round knob that protrudes from ``at``: towards -x, or up where ``axis`` is 2."""
    sign = 1.0 if axis == 2 else -1.0
    along = sign * np.eye(3)[axis]
    neck, end = (_vec(np.asarray(at) + d * along) for d in (0.4 * length_m, length_m))
    pieces: dict[str, Piece] = {
        "stem": Rod(start=at, end=neck, radius_m=0.6 * radius_m),
        "head": Rod(start=neck, end=end, radius_m=radius_m),
    }
    return shape(name, material, pieces)


def bow(points: Sequence[Vec3], radius_m: float, *, name: str = "rod") -> dict[str, Piece]:
    """Round bars along a line of ``points``."""
    pairs = itertools.pairwise(points)
    return {f"{name}_{k}": Rod(start=a, end=b, radius_m=radius_m) for k, (a, b) in enumerate(pairs)}


def arc(centre: Vec3, u: Vec3, v: Vec3, radius_m: float, span_rad: Span, count: int) -> list[Vec3]:
    """``count`` + 1 points of a circle: ``u`` is where the angle is 0, ``v`` a right angle on."""
    turn = np.linspace(*span_rad, count + 1)
    points = np.asarray(centre) + radius_m * (
        np.cos(turn)[:, None] * np.asarray(u) + np.sin(turn)[:, None] * np.asarray(v)
    )
    return [_vec(point) for point in points]


def linked(parts_o: Sequence[Part]) -> list[Part]:
    """Parts whose shapes and joints stand in the object frame, each in its own."""
    at: dict[str, Vec3] = {}
    out = []
    for part in parts_o:
        motion = part.motion
        if motion is None:
            at[part.name] = (0.0, 0.0, 0.0)
            out.append(part)
            continue
        origin = motion.origin_p
        at[part.name] = origin
        motion = replace(motion, origin_p=_vec(np.subtract(origin, at[motion.parent])))
        shapes = tuple(own.seen_from(origin) for own in part.shapes)
        out.append(Part(name=part.name, shapes=shapes, motion=motion))
    return out


def slide(parent: str, part: str, at: Vec3, axis: Vec3, upper: float) -> Motion:
    """Build the joint ``<part>_slide``: a drawer on rollers."""
    return Motion(
        name=f"{part}_slide",
        kind="prismatic",
        parent=parent,
        origin_p=at,
        axis=axis,
        upper=round(upper, 3),
        damping=5.0,
        friction=2.0,
        effort=100.0,
        velocity=1.0,
    )


def hinge(
    parent: str, part: str, at: Vec3, axis: Vec3, upper: float, *, stiff: float = 0.2
) -> Motion:
    """Build joint ``<part>_hinge``; ``stiff``: its damping [Nm s/rad] and dry friction [Nm]."""
    return Motion(
        name=f"{part}_hinge",
        kind="revolute",
        parent=parent,
        origin_p=at,
        axis=axis,
        upper=upper,
        damping=stiff,
        friction=stiff,
        effort=50.0,
        velocity=3.0,
    )


def swing(parent: str, part: str, at: Vec3, side: float, upper: float = 1.75) -> Motion:
    """Build the hinge of a door whose edge on ``side`` stays and that opens towards -x."""
    return hinge(parent, part, at, (0.0, 0.0, -side), upper)


def turning(parent: str, part: str, at: Vec3, axis: Vec3, *, stiff: float = 0.02) -> Motion:
    """Build the joint ``<part>_turn``, which turns without end."""
    motion = hinge(parent, part, at, axis, 0.0, stiff=stiff)
    return replace(motion, name=f"{part}_turn", kind="continuous")


def _vec(v: Sequence[float] | Array) -> Vec3:
    return (float(v[0]), float(v[1]), float(v[2]))
