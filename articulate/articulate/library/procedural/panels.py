"""Shapes made of upright boxes, by their extents."""

from __future__ import annotations

from collections.abc import Mapping

from articulate.library.procedural.boxes import Box
from articulate.library.procedural.urdf import Shape

Span = tuple[float, float]
"""Lower and higher end along one axis [m]."""
Spans = tuple[Span, Span, Span]
"""A box, by its extent along x, y and z [m]."""


def panels(name: str, material: str, spans: Mapping[str, Spans], density_kg_m3: float) -> Shape:
    """A shape of one box for each of ``spans``."""
    boxes = (
        Box(
            name=piece,
            low=(x[0], y[0], z[0]),
            high=(x[1], y[1], z[1]),
            density_kg_m3=density_kg_m3,
        )
        for piece, (x, y, z) in spans.items()
    )
    return Shape(name=name, material=material, boxes=tuple(boxes))


def tray(name: str, material: str, outer: Spans, wall_m: float, density_kg_m3: float) -> Shape:
    """A box that is open above, ``wall_m`` thick all round and below."""
    (x, y, z), wall = outer, wall_m
    inner_x, above = (x[0] + wall, x[1] - wall), (z[0] + wall, z[1])
    spans = {
        "floor": (x, y, (z[0], z[0] + wall)),
        "front": ((x[0], inner_x[0]), y, above),
        "rear": ((inner_x[1], x[1]), y, above),
        "left": (inner_x, (y[1] - wall, y[1]), above),
        "right": (inner_x, (y[0], y[0] + wall), above),
    }
    return panels(name, material, spans, density_kg_m3)
