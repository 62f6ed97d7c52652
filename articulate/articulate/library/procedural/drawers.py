"""Drawers: a front, a tray behind it, a handle before it."""

from __future__ import annotations

from articulate.library.procedural.build import (
    Span,
    Spans,
    bar_handle,
    knob,
    shape,
    shrunk,
    slide,
    tray,
)
from articulate.library.procedural.urdf import Part

GAP_M = 0.003
"""Gap between a tray and what is round it [m]."""
TRAVEL_SHARE = 0.75
"""Travel of a drawer over the length of its tray."""


def drawer(
    name: str,
    parent: str,
    front: Spans,
    hole: tuple[Span, Span],
    rear_x: float,
    *,
    material: str,
    handle: str,
) -> Part:
    """Build a drawer that opens towards -x, in the object frame.

    Args:
        name: Name of the link.
        parent: Link that it slides in.
        front: Extent of the front panel.
        hole: Free space behind it in y and z [m].
        rear_x: Where the tray ends [m].
        material: Of the front.
        handle: ``bar``, ``knob`` or ``none``.
    """
    (hole_y, hole_z), (x, y, z) = hole, front
    low = hole_z[0] + GAP_M
    height = (low, low + 0.75 * (hole_z[1] - hole_z[0]))
    body = ((x[1], rear_x), shrunk(hole_y, GAP_M), height)
    middle = (x[0], (y[0] + y[1]) / 2, (z[0] + z[1]) / 2)
    shapes = [
        shape(f"{name}_front", material, {"panel": front}),
        shape(f"{name}_tray", "birch", tray(body, 0.011)),
    ]
    if handle == "bar":
        length = min(0.16, 0.6 * (y[1] - y[0]))
        shapes.append(bar_handle(f"{name}_handle", middle, length, upright=False))
    elif handle == "knob":
        shapes.append(knob(f"{name}_knob", middle, 0.015, 0.032, material="brass"))
    motion = slide(parent, name, middle, (-1.0, 0.0, 0.0), TRAVEL_SHARE * (rear_x - x[1]))
    return Part(name=name, shapes=tuple(shapes), motion=motion)
