"""The boxes of which a cabinet is made.

Fronts lie before the carcass and cover its edges, under the worktop; a gap runs around every
one of them. A drawer is a front with a tray behind it, a door is a plate that turns about its
outer front edge, so that it clears its neighbours at every angle.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

from articulate.library.procedural.build import Span, Spans, box
from articulate.library.procedural.materials import Material
from articulate.library.procedural.urdf import Motion, Part, Shape

GAP_M = 0.003
"""Gap between what moves and what does not [m]."""
PLINTH_M = 0.04
"""Height of the fronts over the floor [m]."""
REAR_M = 0.02
"""Gap between a closed tray and the back [m]."""
TRAY_SHARE = 0.75
"""Thickness of a tray's boards over the thickness of the panels; height over that of its bay."""
DOOR_OPEN_RAD = 1.75
"""Widest opening of a door [rad], 100 degrees."""
HANDLE_DENSITY_KG_M3 = 2700.0
"""Density of aluminium [kg/m^3]."""
EDGE_M = 0.02
"""Margin of a handle from the edges of its front [m]."""
DOOR_EDGE_M = 0.04
"""The same across a door that is wide enough: the finger of an open gripper at one of two doors
must pass between their handles [m]."""
MATERIALS = {
    "carcass": Material(rgba=(0.82, 0.80, 0.76, 1.0)),
    "front": Material(rgba=(0.72, 0.53, 0.34, 1.0)),
    "tray": Material(rgba=(0.90, 0.87, 0.80, 1.0)),
    "handle": Material(rgba=(0.25, 0.26, 0.28, 1.0)),
}
"""Materials by name."""


@dataclass(frozen=True, kw_only=True)
class Bay:
    """Space of one drawer or door in the plane of the fronts."""

    name: str
    """Name of the link."""
    y: Span
    """Extent of the front along y [m]."""
    z: Span
    """Extent of the front along z [m]."""
    inner_y: Span
    """Free space of the carcass behind it along y [m]."""
    inner_z: Span
    """Free space of the carcass behind it along z [m]."""
    hinge_side: int = 0
    """+1 or -1: a door, hinged at its +y or -y edge; 0: a drawer."""

    @property
    def width_m(self) -> float:
        """Width of the front [m]."""
        return self.y[1] - self.y[0]

    @property
    def height_m(self) -> float:
        """Height of the front [m]."""
        return self.z[1] - self.z[0]


@dataclass(frozen=True, kw_only=True)
class CabinetSize:
    """Every dimension of one cabinet; the fields are described in ``CabinetConfig``."""

    width_m: float
    depth_m: float
    height_m: float
    n_drawers: int
    n_doors: int
    arrangement: str
    panel_m: float
    handle: str
    handle_length_m: float
    handle_thickness_m: float
    handle_clear_m: float
    travel_share: float
    density_kg_m3: float

    @property
    def front_x(self) -> Span:
        """Extent of the fronts along x [m]."""
        return (-self.depth_m / 2, -self.depth_m / 2 + self.panel_m)

    @property
    def body_x(self) -> Span:
        """Extent of the carcass behind the fronts along x [m]."""
        return (self.front_x[1] + GAP_M, self.depth_m / 2)

    @property
    def inner_y(self) -> Span:
        """Free space between the sides along y [m]."""
        half = self.width_m / 2 - self.panel_m
        return (-half, half)

    @property
    def inner_z(self) -> Span:
        """Free space between bottom and worktop along z [m]."""
        return (PLINTH_M + self.panel_m, self.height_m - self.panel_m)

    @property
    def divided(self) -> bool:
        """True with a panel between drawers and doors."""
        return self.n_drawers > 0 and self.n_doors > 0

    @property
    def divider_at(self) -> float:
        """Middle of that panel along z, or along y where they are beside each other [m]."""
        if self.arrangement == "beside":
            return self.width_m * (0.5 - 1.0 / (1.0 + max(1, self.n_doors)))
        share = self.n_drawers / (self.n_drawers + 2.5)
        above = share if self.arrangement == "drawers_above" else 1.0 - share
        low, high = PLINTH_M, self.height_m - self.panel_m
        return high - above * (high - low)

    @property
    def longest_handle_m(self) -> float:
        """Longest bar that every front holds [m]."""
        rooms = [bay.height_m if bay.hinge_side else bay.width_m for bay in self.bays()]
        return min(rooms) - 2 * EDGE_M

    def with_handle_length(self, length_m: float) -> CabinetSize:
        """Return the same with bars of that length."""
        return dataclasses.replace(self, handle_length_m=length_m)

    def bays(self) -> tuple[Bay, ...]:
        """Drawers from the top, then doors from the left (+y)."""
        half = GAP_M / 2
        y = (-self.width_m / 2 + half, self.width_m / 2 - half)
        z = (PLINTH_M + half, self.height_m - self.panel_m - half)
        drawers = doors = (y, z, self.inner_y, self.inner_z)
        if self.divided:
            at, board = self.divider_at, self.panel_m / 2
            if self.arrangement == "beside":
                drawers = ((at, y[1]), z, (at + board, self.inner_y[1]), self.inner_z)
                doors = ((y[0], at), z, (self.inner_y[0], at - board), self.inner_z)
            else:
                above = (y, (at, z[1]), self.inner_y, (at + board, self.inner_z[1]))
                below = (y, (z[0], at), self.inner_y, (self.inner_z[0], at - board))
                over = self.arrangement == "drawers_above"
                drawers, doors = (above, below) if over else (below, above)
        return (*_drawer_bays(self.n_drawers, *drawers), *_door_bays(self, *doors))


def cabinet_parts(size: CabinetSize) -> list[Part]:
    """Carcass, drawers and doors, each in the frame of its link."""
    parts = [Part(name="carcass", shapes=(_carcass(size),))]
    for number, bay in enumerate(size.bays()):
        parts.append(_door(size, bay, number) if bay.hinge_side else _drawer(size, bay, number))
    return parts


def _drawer_bays(
    count: int,
    y: Span,
    z: Span,
    inner_y: Span,
    inner_z: Span,
) -> list[Bay]:
    bays = []
    for i in range(count):
        step = (z[1] - z[0]) / count
        low, high = z[1] - (i + 1) * step, z[1] - i * step
        bays.append(
            Bay(
                name=f"drawer_{i}",
                y=_inset(y),
                z=_inset((low, high)),
                inner_y=inner_y,
                inner_z=(max(low, inner_z[0]), min(high, inner_z[1])),
            )
        )
    return bays


def _door_bays(
    size: CabinetSize,
    y: Span,
    z: Span,
    inner_y: Span,
    inner_z: Span,
) -> list[Bay]:
    bays = []
    for i in range(size.n_doors):
        step = (y[1] - y[0]) / size.n_doors
        span = (y[1] - (i + 1) * step, y[1] - i * step)
        left = i == 0 and size.n_doors == 2  # a single door turns at its right edge
        bays.append(
            Bay(
                name=f"door_{i}",
                y=_inset(span),
                z=_inset(z),
                inner_y=inner_y,
                inner_z=inner_z,
                hinge_side=1 if left else -1,
            )
        )
    return bays


def _inset(span: Span) -> Span:
    return (span[0] + GAP_M / 2, span[1] - GAP_M / 2)


def _carcass(size: CabinetSize) -> Shape:
    board, half = size.panel_m, size.width_m / 2
    body, (inner_low, inner_high) = size.body_x, size.inner_z
    rear = (size.depth_m / 2 - board / 2, size.depth_m / 2)
    within = (body[0], rear[0])
    boxes = {
        "left": (body, (half - board, half), (0.0, inner_high)),
        "right": (body, (-half, board - half), (0.0, inner_high)),
        "top": ((size.front_x[0], body[1]), (-half, half), (inner_high, size.height_m)),
        "bottom": (within, size.inner_y, (PLINTH_M, inner_low)),
        "back": (rear, size.inner_y, (PLINTH_M, inner_high)),
        "kick": ((body[0] + PLINTH_M, body[0] + PLINTH_M + board), size.inner_y, (0.0, PLINTH_M)),
    }
    if size.divided:
        at = (size.divider_at - board / 2, size.divider_at + board / 2)
        beside = size.arrangement == "beside"
        spans = (at, size.inner_z) if beside else (size.inner_y, at)
        boxes["divider"] = (within, *spans)
    return _shape("carcass", "carcass", boxes, size.density_kg_m3)


def _drawer(size: CabinetSize, bay: Bay, number: int) -> Part:
    origin = (size.front_x[0], sum(bay.y) / 2, sum(bay.z) / 2)
    front = _front(size, bay)
    board = TRAY_SHARE * size.panel_m
    x0, x1 = size.front_x[1], size.depth_m / 2 - size.panel_m / 2 - REAR_M
    y0, y1 = bay.inner_y[0] + GAP_M, bay.inner_y[1] - GAP_M
    z0, free = bay.inner_z[0] + GAP_M, bay.inner_z[1] - bay.inner_z[0] - 2 * GAP_M
    floor, top = z0 + board, z0 + TRAY_SHARE * free
    tray = _shape(
        f"{bay.name}_tray",
        "tray",
        {
            "floor": ((x0, x1), (y0, y1), (z0, floor)),
            "left": ((x0, x1), (y1 - board, y1), (floor, top)),
            "right": ((x0, x1), (y0, y0 + board), (floor, top)),
            "rear": ((x1 - board, x1), (y0 + board, y1 - board), (floor, top)),
        },
        size.density_kg_m3,
    )
    motion = Motion(
        name=f"{bay.name}_slide",
        kind="prismatic",
        parent="carcass",
        origin_p=origin,
        axis=(-1.0, 0.0, 0.0),
        upper=round(size.travel_share * (x1 - x0), 3),
        damping=5.0,
        friction=2.0,
        effort=100.0,
        velocity=1.0,
    )
    handle = _handle(size, number, middle_y=0.0, upright=False)
    return _part(bay.name, motion, (front, tray), handle)


def _door(size: CabinetSize, bay: Bay, number: int) -> Part:
    outer, inner = (bay.y[1], bay.y[0]) if bay.hinge_side > 0 else bay.y
    origin = (size.front_x[0], outer, sum(bay.z) / 2)
    front = _front(size, bay)
    motion = Motion(
        name=f"{bay.name}_hinge",
        kind="revolute",
        parent="carcass",
        origin_p=origin,
        axis=(0.0, 0.0, -float(bay.hinge_side)),
        upper=DOOR_OPEN_RAD,
        damping=0.2,
        friction=0.2,
        effort=50.0,
        velocity=3.0,
    )
    margin = min(DOOR_EDGE_M, max(EDGE_M, bay.width_m / 2 - size.handle_thickness_m))
    from_edge = margin + size.handle_thickness_m / 2
    at_y = inner - outer + bay.hinge_side * from_edge
    handle = _handle(size, number, middle_y=at_y, upright=True)
    return _part(bay.name, motion, (front,), handle)


def _front(size: CabinetSize, bay: Bay) -> Shape:
    spans = {"panel": (size.front_x, bay.y, bay.z)}
    return _shape(f"{bay.name}_front", "front", spans, size.density_kg_m3)


def _handle(size: CabinetSize, number: int, *, middle_y: float, upright: bool) -> Shape:
    """Build the handle in the frame of its link, at the middle of the front's height."""
    half, clear = size.handle_thickness_m / 2, size.handle_clear_m
    if size.handle == "knob":
        head, stem = (-half, half), (-half / 2, half / 2)
        pieces = {
            "head": ((-clear - half, -clear), head, head),
            "stem": ((-clear, 0.0), stem, stem),
        }
    else:
        end = size.handle_length_m / 2
        thick = (-half, half)
        posts = ((-end, 2 * half - end), (end - 2 * half, end))
        pieces = {
            "bar": ((-clear - 2 * half, -clear), (-end, end), thick),
            "post_a": ((-clear, 0.0), posts[0], thick),
            "post_b": ((-clear, 0.0), posts[1], thick),
        }
    if upright:
        pieces = {name: (x, z, y) for name, (x, y, z) in pieces.items()}
    placed = {
        name: (x, (y[0] + middle_y, y[1] + middle_y), z) for name, (x, y, z) in pieces.items()
    }
    return _shape(f"handle_{number}", "handle", placed, HANDLE_DENSITY_KG_M3)


def _shape(name: str, material: str, spans: dict[str, Spans], density_kg_m3: float) -> Shape:
    boxes = (
        dataclasses.replace(box(extent), name=piece, density_kg_m3=density_kg_m3)
        for piece, extent in spans.items()
    )
    return Shape(name=name, material=material, solids=tuple(boxes))


def _part(name: str, motion: Motion, shapes_o: tuple[Shape, ...], handle: Shape) -> Part:
    """Build a link from shapes in the object frame and a handle in its own."""
    part = Part.moving(name, motion, shapes_o)
    return dataclasses.replace(part, shapes=(*part.shapes, handle))
