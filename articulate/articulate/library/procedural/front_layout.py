"""Furniture and appliances whose front is divided into drawers, doors, flaps and fixed panels.

The object frame has its origin on the floor under the middle, z up, the front towards -x. Left
and right are as seen from the front: left is +y.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from articulate.errors import ConfigError
from articulate.library.procedural.build import (
    LEFT,
    RIGHT,
    Piece,
    Span,
    Spans,
    around,
    bar_handle,
    cavity,
    corners_of,
    hinge,
    knob,
    linked,
    shape,
    shrunk,
    slide,
    swing,
)
from articulate.library.procedural.drawers import drawer
from articulate.library.procedural.urdf import Motion, Part, Shape

PanelKind = Literal["drawer", "door", "flap", "panel", "open", "gap"]
"""``panel``: fixed front; ``open``: shelf without front; ``gap``: nothing, as under a desk."""
HingeSide = Literal["", "left", "right", "top", "bottom"]
SlideDirection = Literal["", "left", "right"]
HandleKind = Literal["bar", "knob", "none"]
MOVING = ("drawer", "door", "flap")
GAP_M = 0.003
"""Gap around fronts [m]."""
EDGE_M = 0.0015
"""Room left beside the free edge of a door while it opens [m]."""
REAR_M = 0.02
"""Gap between a tray and the back [m]."""
MIN_FRONT_M = 0.06
"""Smallest width and height of a moving front [m]."""
OUTER_OPEN_RAD, INNER_OPEN_RAD = 1.75, 1.57
"""Range of doors that are hinged at the side of the object, and inside of it [rad]."""
FRONT_KG_M3, MAX_FLAP_KG = 400.0, 3.0
"""Density of hinged fronts, and largest mass of a flap [kg], which 30 N at its free edge must lift:
springs, which are not modelled, balance heavier ones."""
WALL_SHARE = 0.6
"""Thickness of a wall of a cell over that of the boards."""
INSIDE_M = 0.03
"""Smallest width and height of the space behind a moving front [m]."""
HANDLE_DEPTH_M = 0.06
"""Depth of handles before their fronts, and a gap [m]."""
HANDLE_ROOM_M = 0.03
"""Distance of a sliding door from the middle of the next one's handle [m]."""
TOLERANCE = 1e-6


def least_front_m(board_m: float) -> float:
    """Return the smallest width and height of a moving front of an object with such boards [m]."""
    return max(MIN_FRONT_M, 2.0 * WALL_SHARE * board_m + INSIDE_M)


@dataclass(frozen=True, kw_only=True)
class FrontPanel:
    """One rectangle of a front; edges are shares of the width and height of the front."""

    kind: PanelKind
    left: float
    """Left edge, 0 to 1 from the left."""
    right: float
    """Right edge, 0 to 1 from the left."""
    bottom: float
    """Lower edge, 0 to 1 from below."""
    top: float
    """Upper edge, 0 to 1 from below."""
    hinge: HingeSide = ""
    """Hinged edge: left or right of a door, top or bottom of a flap."""
    slide: SlideDirection = ""
    """Direction in which a sliding door opens, which has no hinge."""
    layer: int = 0
    """1: a sliding door before the plane of the other fronts, which passes before its neighbour.
    2: before their handles too."""
    handle: HandleKind = "bar"
    name: str = ""
    """Name of the link; by default ``<kind>_<number>``."""

    def __post_init__(self) -> None:
        """Check edges and hinge."""
        for low, high, names in (
            (self.left, self.right, "left and right"),
            (self.bottom, self.top, "bottom and top"),
        ):
            if not -TOLERANCE <= low < high <= 1.0 + TOLERANCE:
                raise ConfigError(
                    f"front panel: {names} are {low:g} and {high:g}; 0 <= low < high <= 1 is needed"
                )
        if (self.slide or self.layer) and (self.kind != "door" or not self.slide):
            raise ConfigError(f"front panel: only a sliding door has a layer, not a {self.kind}")
        kind = "panel" if self.slide else self.kind
        accepted = {"door": ("left", "right"), "flap": ("top", "bottom")}.get(kind, ("",))
        if self.hinge not in accepted:
            raise ConfigError(
                f"front panel: a {self.kind} has its hinge at {' or '.join(accepted) or 'no edge'}"
                f", not {self.hinge or 'none'}"
            )


@dataclass(frozen=True, kw_only=True)
class FrontLayout:
    """Carcass with a divided front."""

    panels: tuple[FrontPanel, ...]
    """Rectangles that do not overlap; what they leave free is a fixed front."""
    width_m: float
    """Width along y [m]."""
    depth_m: float
    """Depth along x without handles [m]."""
    height_m: float
    """Height with legs and worktop [m]."""
    base: Literal["plinth", "legs", "none"] = "plinth"
    base_m: float = 0.05
    """Height of plinth or legs [m]."""
    worktop_m: float = 0.018
    """Thickness of the board over the fronts [m]; 0: none."""
    board_m: float = 0.018
    """Thickness of walls and fronts [m]."""
    finish: str = "white_lacquer"
    """Material of the carcass."""
    front_finish: str = ""
    """Material of the fronts; by default that of the carcass."""
    handle_m: float = 0.16
    """Longest bar handle [m]."""
    name: str = "furniture"
    """Name of the object."""
    category: str = "StorageFurniture"
    """PartNet-Mobility's name of the category."""

    def __post_init__(self) -> None:
        """Check that there is room for every moving front."""
        if self.front_z[1] - self.front_z[0] < MIN_FRONT_M:
            raise ConfigError(
                f"{self.name}: a height of {self.height_m:g} m leaves no room for fronts"
            )
        least = least_front_m(self.board_m)
        for panel in self.panels:
            y, z = self.extent(panel)
            small = min(y[1] - y[0], z[1] - z[0])
            if panel.kind in MOVING and small < least - TOLERANCE:
                raise ConfigError(
                    f"{self.name}: a {panel.kind} of {y[1] - y[0]:.3f} x {z[1] - z[0]:.3f} m is "
                    f"too small; at least {least:g} m each way is needed: make the object "
                    "larger or give it fewer parts"
                )
        for k, one in enumerate(self.panels):
            for other in self.panels[k + 1 :]:
                wide = min(one.right, other.right) - max(one.left, other.left)
                high = min(one.top, other.top) - max(one.bottom, other.bottom)
                if wide > TOLERANCE and high > TOLERANCE:
                    raise ConfigError(f"{self.name}: two front panels overlap")

    @property
    def front_z(self) -> Span:
        """Extent of the fronts along z [m]."""
        low = 0.0 if self.base == "none" else self.base_m
        return (low, self.height_m - self.worktop_m)

    def extent(self, panel: FrontPanel) -> tuple[Span, Span]:
        """Extent of a panel along y and z [m]."""
        half, (low, high) = self.width_m / 2, self.front_z
        return (
            (half - panel.right * self.width_m, half - panel.left * self.width_m),
            (low + panel.bottom * (high - low), low + panel.top * (high - low)),
        )

    def parts(self) -> list[Part]:
        """Return the links, body first; parts are numbered from the top left by rows."""
        ordered = sorted(self.panels, key=lambda p: (-round(p.top, 2), round(p.left, 2)))
        body: dict[str, Piece] = {}
        fixed: dict[str, Piece] = {}
        moving: list[Part] = []
        numbers = dict.fromkeys(MOVING, 0)
        for k, panel in enumerate(ordered):
            y, z = self.extent(panel)
            if panel.kind == "gap":
                body |= self._sides(panel, y, z, k)
                continue
            cell = (self._body_x, y, z)
            hollow = min(y[1] - y[0], z[1] - z[0]) > 2.0 * self._wall_m + TOLERANCE
            body |= cavity(cell, self._wall_m, name=f"cell_{k}_") if hollow else {f"cell_{k}": cell}
            if panel.kind == "panel":
                fixed[f"panel_{k}"] = (self._front_x, y, z)
            if panel.kind in MOVING:
                name = panel.name or f"{panel.kind}_{numbers[panel.kind]}"
                numbers[panel.kind] += 1
                moving.append(self._moving(name, panel, y, z))
        shapes = [shape("body_carcass", self.finish, body | self._top_and_base())]
        if fixed:
            shapes.append(shape("body_front", self._front_finish, fixed))
        return linked([Part(name="body", shapes=tuple(shapes)), *moving])

    @property
    def _front_finish(self) -> str:
        return self.front_finish or self.finish

    @property
    def _wall_m(self) -> float:
        """Thickness of the walls of a cell; two of them are between two cells [m]."""
        return WALL_SHARE * self.board_m

    @property
    def _front_x(self) -> Span:
        return (-self.depth_m / 2, -self.depth_m / 2 + self.board_m)

    @property
    def _body_x(self) -> Span:
        return (self._front_x[1] + GAP_M, self.depth_m / 2)

    def _ahead_m(self, layer: int) -> float:
        """Return the distance of a layer of sliding doors before the other fronts [m]."""
        return (0.0, self.board_m + GAP_M, self.board_m + HANDLE_DEPTH_M)[layer]

    def _sides(self, gap: FrontPanel, y: Span, z: Span, number: int) -> dict[str, Piece]:
        """Return boards at the outer edges of a gap, which carry the worktop."""
        x, board = self._body_x, self.board_m
        pieces: dict[str, Piece] = {}
        if gap.left < TOLERANCE:
            pieces[f"side_{number}_left"] = (x, (y[1] - board, y[1]), z)
        if gap.right > 1.0 - TOLERANCE:
            pieces[f"side_{number}_right"] = (x, (y[0], y[0] + board), z)
        return pieces

    def _top_and_base(self) -> dict[str, Piece]:
        ahead = max((self._ahead_m(panel.layer) for panel in self.panels), default=0.0)
        x = (-self.depth_m / 2 - ahead, self.depth_m / 2)
        y = (-self.width_m / 2, self.width_m / 2)
        pieces: dict[str, Piece] = {}
        if self.worktop_m > 0.0:
            pieces["worktop"] = (x, y, (self.front_z[1], self.height_m))
        if self.base == "plinth":
            pieces["plinth"] = ((self._body_x[0] + 0.03, x[1]), y, (0.0, self.base_m))
        if self.base == "legs":
            for k, (a, b) in enumerate(corners_of(self._body_x, y, 0.03)):
                pieces[f"leg_{k}"] = (around(a, 0.04), around(b, 0.04), (0.0, self.base_m))
        return pieces

    def _moving(self, name: str, panel: FrontPanel, y: Span, z: Span) -> Part:
        y_front, z_front = shrunk(y, GAP_M / 2), shrunk(z, GAP_M / 2)
        if panel.hinge in {"left", "right"}:
            y_front = _free_to_swing(y_front, self.board_m, panel.hinge)
        elif panel.hinge:
            z_front = _free_to_swing(z_front, self.board_m, panel.hinge)
        ahead = self._ahead_m(panel.layer)
        front = ((self._front_x[0] - ahead, self._front_x[1] - ahead), y_front, z_front)
        if panel.kind == "drawer":
            hole = (shrunk(y, self._wall_m), shrunk(z, self._wall_m))
            rear = self.depth_m / 2 - self._wall_m - REAR_M
            return drawer(
                name, "body", front, hole, rear, material=self._front_finish, handle=panel.handle
            )
        density = FRONT_KG_M3
        if panel.kind == "flap":
            volume_m3 = math.prod(high - low for low, high in front)
            density = min(density, MAX_FLAP_KG / volume_m3)
        shapes = [shape(f"{name}_front", self._front_finish, {"panel": front}, density)]
        shapes += self._handle(name, panel, front)
        motion = _sliding(name, panel, front) if panel.slide else self._hinge(name, panel, front)
        return Part(name=name, shapes=tuple(shapes), motion=motion)

    def _hinge(self, name: str, panel: FrontPanel, front: Spans) -> Motion:
        x, y, z = front
        if panel.hinge in {"left", "right"}:
            side = LEFT if panel.hinge == "left" else RIGHT
            outer = panel.left < TOLERANCE if side == LEFT else panel.right > 1.0 - TOLERANCE
            at = (x[0], y[1] if side == LEFT else y[0], z[0])
            return swing("body", name, at, side, OUTER_OPEN_RAD if outer else INNER_OPEN_RAD)
        low = panel.hinge == "bottom"
        axis = (0.0, -1.0 if low else 1.0, 0.0)
        at = (x[0], (y[0] + y[1]) / 2, z[0] if low else z[1])
        return hinge("body", name, at, axis, INNER_OPEN_RAD, stiff=1.0 if low else 0.5)

    def _handle(self, name: str, panel: FrontPanel, front: Spans) -> list[Shape]:
        """Return the handle at the free edge, opposite to the hinge.

        That of a sliding door is at the edge that its neighbour does not cover.
        """
        if panel.handle == "none":
            return []
        x, y, z = front
        upright = panel.hinge in {"left", "right"} or panel.slide != ""
        across, along = (y, z) if upright else (z, y)
        inset = _handle_inset(across)
        # free edge, or rear edge of a sliding door, at the low end of y or z
        at_low = panel.hinge in {"left", "top"} or panel.slide == "left"
        edge = across[0] + inset if at_low else across[1] - inset
        middle = (along[0] + along[1]) / 2
        at = (x[0], edge, middle) if upright else (x[0], middle, edge)
        if panel.handle == "knob":
            return [knob(f"{name}_knob", at, 0.015, 0.032, material="brass")]
        length = max(0.05, min(self.handle_m, 0.6 * (along[1] - along[0])))
        return [bar_handle(f"{name}_handle", at, length, upright=upright)]


def grid(
    rows: int,
    columns: int,
    kind: PanelKind,
    *,
    area: tuple[float, float, float, float] = (0.0, 1.0, 0.0, 1.0),
    hinges: Sequence[HingeSide] = ("",),
    handle: HandleKind = "bar",
) -> tuple[FrontPanel, ...]:
    """Return equal panels in rows from the top and columns from the left.

    Args:
        rows: Panels above each other.
        columns: Panels beside each other.
        kind: Kind of all panels.
        area: Left, right, bottom and top of the region, in shares of the front.
        hinges: Hinged edge of each column, repeated.
        handle: Handle of all panels.
    """
    left, right, bottom, top = area
    wide, high = (right - left) / columns, (top - bottom) / rows
    return tuple(
        FrontPanel(
            kind=kind,
            left=left + c * wide,
            right=left + (c + 1) * wide,
            bottom=top - (r + 1) * high,
            top=top - r * high,
            hinge=hinges[c % len(hinges)],
            handle=handle,
        )
        for r in range(rows)
        for c in range(columns)
    )


def _handle_inset(across: Span) -> float:
    """Return the distance of a handle from the edge of its front [m]."""
    return min(0.045, 0.25 * (across[1] - across[0]))


def _sliding(name: str, panel: FrontPanel, front: Spans) -> Motion:
    """Return the joint of a sliding door, up to the handle of the door that it passes."""
    x, y, z = front
    travel = y[1] - y[0] - _handle_inset(y) - HANDLE_ROOM_M
    axis = (0.0, 1.0 if panel.slide == "left" else -1.0, 0.0)
    return slide("body", name, (x[0], (y[0] + y[1]) / 2, z[0]), axis, travel)


def _free_to_swing(span: Span, thick_m: float, hinge_at: HingeSide) -> Span:
    """Return the span of a door or flap from its hinge to a free edge that clears the next front.

    The hinge is at the front. The distance of the rear corner of the free edge from it is
    ``hypot(length, thick_m)``, which the gap must contain while the part opens.
    """
    low, high = span
    more = max(math.hypot(high - low, thick_m) - (high - low) + EDGE_M - GAP_M, 0.0)
    return (low + more, high) if hinge_at in {"left", "top"} else (low, high - more)
