"""Simple furniture with handles of widely varied shape, to train the generalist policy.

The categories of the procedural library have one kind of handle each, within millimetres. Here one
drawer, door or lid of a plain box has a bar, a knob or a plate of any size that the gripper holds,
anywhere on its front, and hinges are at all edges. Parts without a handle have a projecting edge;
fingers close on it, or hook it where the part is thicker than the gripper opens.
Shallow handles leave little room behind them, double doors have two handles side by side, and the
handles of small doors are near the hinge. Levers turn about the direction of approach.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from articulate.assets.asset import Vec3
from articulate.files import write_json
from articulate.library.procedural.build import (
    LEFT,
    RIGHT,
    Piece,
    Span,
    around,
    cavity,
    hinge,
    linked,
    shape,
    shrunk,
    slide,
    swing,
    tray,
)
from articulate.library.procedural.categories import LICENCE
from articulate.library.procedural.urdf import Motion, Part, write_urdf

KINDS = (
    "panel_drawer", "panel_door", "panel_lid",
    "panel_wide_door", "panel_edge_door", "panel_edge_drawer", "panel_thin_lid",
    "panel_shallow_drawer", "panel_shallow_door", "panel_double_door",
    "panel_hook_drawer", "panel_hook_door", "panel_hook_lid",
    "panel_small_door", "panel_lever_door",
)  # fmt: skip
"""Names of the objects; the last word is what moves. New ones are added at the end: the random
numbers depend on the order."""
HOOK_BOARD_M = (0.078, 0.11)
"""Thickness of parts that are hooked [m]."""
MAX_HELD_M = 0.062
"""Largest thickness between the fingers [m]; objects are scaled by up to 1.1."""
GAP_M, BOARD_M = 0.003, 0.016
"""Gap round a moving part, and thickness of boards [m]."""
HANDLES = ("bar", "knob", "plate")

Frame = tuple[int, int, int]
"""Axes of the object along a handle, across it and outward; outward is -x or +z."""
FRONT_LEVEL, FRONT_UPRIGHT, ABOVE, ABOVE_TURNED = (1, 2, 0), (2, 1, 0), (1, 0, 2), (0, 1, 2)


class Sampler:
    """Random numbers of one object."""

    def __init__(self, kind: str, seed: int) -> None:
        """Seed by the object's id."""
        self.rng = np.random.default_rng([KINDS.index(kind), seed])

    def between(self, low: float, high: float) -> float:
        """Return a uniform number."""
        return float(self.rng.uniform(low, high))

    def log_between(self, low: float, high: float) -> float:
        """Return a number with a uniform logarithm."""
        return float(np.exp(self.rng.uniform(np.log(low), np.log(high))))

    def chance(self, share: float) -> bool:
        """Return True with the probability ``share``."""
        return bool(self.rng.random() < share)


def handle_pieces(
    s: Sampler, at: Vec3, frame: Frame, room_m: float, *, shallow: bool = False
) -> dict[str, Piece]:
    """Return the solids of a handle.

    Args:
        s: Random numbers.
        at: Its middle on the surface [m].
        frame: Its axes.
        room_m: Largest length [m].
        shallow: Stay within 8 to 30 mm of the surface.
    """

    def placed(along: Span, across: Span, out: Span) -> Piece:
        spans = [(0.0, 0.0)] * 3
        spans[frame[0]] = (at[frame[0]] + along[0], at[frame[0]] + along[1])
        spans[frame[1]] = (at[frame[1]] + across[0], at[frame[1]] + across[1])
        sign = -1.0 if frame[2] == 0 else 1.0
        ends = sorted(at[frame[2]] + sign * c for c in out)
        spans[frame[2]] = (ends[0], ends[1])
        return (spans[0], spans[1], spans[2])

    kind = HANDLES[int(s.rng.choice(3, p=(0.45, 0.35, 0.2)))]
    if kind == "bar":
        length = min(s.between(0.07, 0.32), room_m)
        thick, deep = s.log_between(0.007, 0.035), s.log_between(0.007, 0.03)
        clear, half = s.between(0.022, 0.055), length / 2
        if shallow:
            thick, deep, clear = 0.7 * thick, 0.4 * deep, 0.3 * clear
        side, foot = around(0.0, thick), min(0.012, thick)
        return {
            "bar": placed((-half, half), side, (clear, clear + deep)),
            "post_a": placed((-half, foot - half), side, (0.0, clear)),
            "post_b": placed((half - foot, half), side, (0.0, clear)),
        }
    if kind == "knob":
        wide = min(s.between(0.015, MAX_HELD_M), room_m)
        thick = wide if s.chance(0.6) else s.between(0.012, MAX_HELD_M)
        stem, head = s.between(0.006, 0.03), s.between(0.014, 0.04)
        if shallow:
            stem, head = 0.5 * stem, 0.4 * head
        return {
            "stem": placed(around(0.0, 0.5 * wide), around(0.0, 0.5 * thick), (0.0, stem)),
            "head": placed(around(0.0, wide), around(0.0, thick), (stem, stem + head)),
        }
    length, thick = min(s.between(0.04, 0.2), room_m), s.log_between(0.005, 0.04)
    out = s.between(0.025, 0.05) * (0.4 if shallow else 1.0)
    return {"plate": placed(around(0.0, length), around(0.0, thick), (0.0, out))}


def panel_parts(kind: str, seed: int) -> list[Part]:
    """Return the links of an object, z up, the front towards -x, floor at z = 0."""
    s = Sampler(kind, seed)
    if kind == "panel_lid":
        return _lid(s)
    if kind == "panel_thin_lid":
        return _thin_lid(s)
    hook = "hook" in kind
    if kind == "panel_hook_lid":
        return _thick_lid(s)
    if kind == "panel_lever_door":
        return _lever(s)
    drawer, edge, double = kind.endswith("drawer"), hook or "edge" in kind, "double" in kind
    small = kind == "panel_small_door"
    wide = s.between(0.11, 0.26) if small else s.between(0.2, 0.65)
    high = s.between(0.11, 0.32) if drawer else s.between(0.2, 0.6)
    deep = s.between(0.3, 0.5) if drawer else s.between(0.2, 0.4)
    board_m = BOARD_M if kind in KINDS[:2] else s.log_between(0.008, 0.045)
    density = None
    if hook:  # hollow or of foam
        board_m, density = s.between(*HOOK_BOARD_M), s.log_between(15.0, 80.0)
    y, z = around(0.0, wide), (0.02, 0.02 + high)
    front = (-deep / 2 - board_m - GAP_M, -deep / 2 - GAP_M)
    body_x = (-deep / 2, deep / 2)
    shell = {**cavity((body_x, y, z), BOARD_M), "foot": (body_x, y, (0.0, z[0]))}
    body = Part(name="body", shapes=(shape("body_shell", "birch", shell),))
    pieces: dict[str, Piece] = {"board": (front, y, z)}
    if drawer:
        at = (front[0], 0.3 * wide * s.between(-1, 1), sum(z) / 2 + 0.25 * high * s.between(-1, 1))
        frame, room = (FRONT_LEVEL, 0.35 * wide) if s.chance(0.8) else (FRONT_UPRIGHT, 0.5 * high)
        hole = shrunk(y, BOARD_M + GAP_M), (z[0] + BOARD_M + GAP_M, z[1] - BOARD_M - 0.02)
        rear = body_x[1] - BOARD_M - 0.02
        inside = tray(((front[1], rear), *hole), 0.01)
        motion = slide("body", "panel", at, (-1.0, 0.0, 0.0), s.between(0.5, 0.85) * deep)
        if edge:
            pieces["lip"] = (front, y, (z[1], z[1] + s.between(0.02, 0.05)))
        shapes = [
            shape("panel_board", "oak", pieces, density),
            shape("panel_tray", "birch", inside),
        ]
    else:
        at, frame, room, motion = _door(
            s,
            front[0],
            y,
            z,
            anywhere=small or kind == "panel_wide_door",
            double=double,
            small=small,
        )
        if edge:
            side = 1.0 if at[1] > 0.0 else -1.0
            ends = sorted((side * wide / 2, side * (wide / 2 + s.between(0.02, 0.05))))
            pieces["lip"] = (front, (ends[0], ends[1]), z)
        shapes = [shape("panel_board", "oak", pieces, density)]
    if not edge:
        shallow = "shallow" in kind or (double and s.chance(0.6))
        handle = handle_pieces(s, at, frame, room, shallow=shallow)
        shapes.append(shape("panel_handle", "dark_steel", handle, 2000.0))
        if double:
            free = wide / 2 if at[1] > 0.0 else -wide / 2
            beside = {name: _mirrored(piece, free) for name, piece in (pieces | handle).items()}
            body = replace(body, shapes=(*body.shapes, shape("next_door", "oak", beside)))
    return linked([body, Part(name="panel", shapes=tuple(shapes), motion=motion)])


def _mirrored(piece: Piece, y: float) -> Piece:
    """Return a box on the other side of the plane at ``y``."""
    assert isinstance(piece, tuple)  # panels have boxes only
    low, high = piece[1]
    return (piece[0], (2.0 * y - high, 2.0 * y - low), piece[2])


def _door(
    s: Sampler, x: float, y: Span, z: Span, *, anywhere: bool, double: bool, small: bool
) -> tuple[Vec3, Frame, float, Motion]:
    """Return place, axes and room of the handle of a door, and its hinge.

    The handle is near the free edge, very near on ``double`` doors, or ``anywhere`` on a door about
    a vertical axis; on ``small`` doors it is level as often as upright.
    """
    wide, high, upper = y[1] - y[0], z[1] - z[0], s.between(1.2, 2.4)
    edge = s.between(0.05, 0.12)
    if anywhere:
        edge = s.between(0.025 if small else 0.04, (0.5 if small else 0.65) * wide)
    if double:
        edge = s.between(0.018, 0.045)
    if anywhere or double or s.chance(0.75):
        side = LEFT if s.chance(0.5) else RIGHT
        at = (x, side * (edge - wide / 2), sum(z) / 2 + 0.25 * high * s.between(-1, 1))
        frame, room = (
            (FRONT_UPRIGHT, 0.5 * high)
            if double or s.chance(0.5 if small else 0.75)
            else (FRONT_LEVEL, 1.6 * edge)
        )
        return at, frame, room, swing("body", "panel", (x, side * wide / 2, z[0]), side, upper)
    below = s.chance(0.7)
    near, far = (z[0], z[1] - edge) if below else (z[1], z[0] + edge)
    at = (x, 0.2 * wide * s.between(-1, 1), far)
    axis = (0.0, -1.0 if below else 1.0, 0.0)
    frame, room = (FRONT_LEVEL, 0.5 * wide) if s.chance(0.75) else (FRONT_UPRIGHT, 1.6 * edge)
    return at, frame, room, hinge("body", "panel", (x, 0.0, near), axis, min(upper, 1.6))


def _lid(s: Sampler) -> list[Part]:
    """Return a box with a lid that turns about its rear edge."""
    wide, deep, high = s.between(0.2, 0.5), s.between(0.18, 0.4), s.between(0.12, 0.4)
    thick = s.between(0.01, 0.03)
    x, y = around(0.0, deep), around(0.0, wide)
    walls = tray((x, y, (0.0, high)), 0.012)
    box = Part(name="body", shapes=(shape("body_walls", "birch", walls),))
    low = high + GAP_M
    top = (low, low + thick)
    edge = s.between(0.03, 0.1)
    place = s.rng.random()
    board = shape("panel_board", "oak", {"board": (x, y, top)}, 500.0)
    if place < 0.4:
        at = (x[0] + edge, 0.2 * wide * s.between(-1, 1), top[1])
        turned = s.chance(0.3)
        frame, room = (ABOVE_TURNED, 1.6 * edge) if turned else (ABOVE, 0.5 * wide)
        pieces = handle_pieces(s, at, frame, room)
    else:
        out, length = s.between(0.025, 0.045), s.between(0.05, 0.16)
        middle = around(0.25 * wide * s.between(-1, 1), length)
        pieces = {"lip": ((x[0] - out, x[0]), middle, top)}
        if place > 0.7:  # lips on both sides
            along = around(x[0] + s.between(0.3, 0.55) * deep, min(length, 0.5 * deep))
            pieces = {
                "left": (along, (y[1], y[1] + out), top),
                "right": (along, (y[0] - out, y[0]), top),
            }
    handle = shape("panel_handle", "dark_steel", pieces, 1500.0)
    upper = s.between(1.2, 2.0)
    motion = hinge("body", "panel", (x[1], 0.0, low), (0.0, 1.0, 0.0), upper, stiff=0.1)
    return linked([box, Part(name="panel", shapes=(board, handle), motion=motion)])


def _thin_lid(s: Sampler) -> list[Part]:
    """Return a flat box, as of a laptop or a case, with a thin lid that projects in front."""
    wide, deep = s.between(0.22, 0.45), s.between(0.18, 0.35)
    high, thick = s.log_between(0.015, 0.1), s.log_between(0.006, 0.02)
    x, y, low = around(0.0, deep), around(0.0, wide), high + GAP_M
    box = Part(name="body", shapes=(shape("body_box", "dark_steel", {"box": (x, y, (0.0, high))}),))
    out = s.between(0.008, 0.04)
    length = s.between(0.06, wide) if s.chance(0.5) else wide
    middle = around(0.5 * (wide - length) * s.between(-1, 1), length)
    pieces: dict[str, Piece] = {
        "board": (x, y, (low, low + thick)),
        "lip": ((x[0] - out, x[0]), middle, (low, low + thick)),
    }
    board = shape("panel_board", "oak", pieces, s.between(500.0, 2000.0))
    at, upper = (x[1], 0.0, low), s.between(1.5, 2.3)
    motion = hinge("body", "panel", at, (0.0, 1.0, 0.0), upper, stiff=s.log_between(0.02, 0.3))
    return linked([box, Part(name="panel", shapes=(board,), motion=motion)])


def _thick_lid(s: Sampler) -> list[Part]:
    """Return a box with a thick lid that projects in front, as of a cooler or a freezer."""
    wide, deep, high = s.between(0.25, 0.5), s.between(0.2, 0.35), s.between(0.2, 0.45)
    x, y, low = around(0.0, deep), around(0.0, wide), high + GAP_M
    walls = tray((x, y, (0.0, high)), 0.02)
    box = Part(name="body", shapes=(shape("body_walls", "birch", walls),))
    out, thick = s.between(0.045, 0.07), s.between(*HOOK_BOARD_M)
    lid: dict[str, Piece] = {"board": ((x[0] - out, x[1]), y, (low, low + thick))}
    at, upper = (x[1], 0.0, low + thick), s.between(1.2, 1.6)
    motion = hinge("body", "panel", at, (0.0, 1.0, 0.0), upper, stiff=s.log_between(0.05, 0.3))
    board = shape("panel_board", "oak", lid, s.between(40.0, 150.0))
    return linked([box, Part(name="panel", shapes=(board,), motion=motion)])


def _lever(s: Sampler) -> list[Part]:
    """Return a box with a lever on its front that turns about the front's normal, as on a safe."""
    wide, high, deep = s.between(0.25, 0.5), s.between(0.25, 0.5), s.between(0.2, 0.35)
    x, y = around(0.0, deep), around(0.0, wide)
    body = Part(name="body", shapes=(shape("body_box", "birch", {"box": (x, y, (0.0, high))}),))
    length, thick = s.between(0.07, 0.2), s.log_between(0.007, 0.03)
    clear, out = s.between(0.025, 0.05), s.log_between(0.01, 0.03)
    turn = int(s.rng.integers(4))  # to the right, up, to the left, down
    level = turn % 2 == 0
    arm = (-0.5 * thick, length) if turn < 2 else (-length, 0.5 * thick)
    across = around(0.0, thick)
    ends = (arm, across) if level else (across, arm)
    at = (x[0], 0.3 * wide * s.between(-1, 1), high * s.between(0.4, 0.6))
    placed = [(at[k + 1] + a, at[k + 1] + b) for k, (a, b) in enumerate(ends)]
    front = at[0] - clear
    hub = (around(at[1], thick), around(at[2], thick))
    pieces: dict[str, Piece] = {
        "arm": ((front - out, front), placed[0], placed[1]),
        "hub": ((front, at[0] - GAP_M), *hub),
    }
    axis = (1.0 if s.chance(0.5) else -1.0, 0.0, 0.0)
    motion = hinge("body", "panel", at, axis, s.between(0.7, 1.5))
    lever = shape("panel_handle", "dark_steel", pieces, 2000.0)
    return linked([body, Part(name="panel", shapes=(lever,), motion=motion)])


def write_panel(object_id: str, folder: Path) -> Path:
    """Write the object ``<kind>-<seed>`` below ``folder``, unless it is there; return its URDF."""
    kind, _, seed = object_id.rpartition("-")
    file = folder / object_id / f"{kind}.urdf"
    if not file.exists():
        write_urdf(kind, panel_parts(kind, int(seed)), file.parent)
        category = "Box" if kind.endswith("lid") else "StorageFurniture"
        origin = {"source": f"{kind}, seed {seed}", "licence": LICENCE, "category": category}
        write_json(file.parent / "source.json", origin)
    return file
