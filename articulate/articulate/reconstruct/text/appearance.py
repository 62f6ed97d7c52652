"""Changes to generated parts: materials, fixed and removed parts, another hinged edge."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace

import numpy as np

from articulate.assets.asset import Vec3
from articulate.library.procedural.build import LEFT, RIGHT, bar_handle, hinge, swing
from articulate.library.procedural.materials import PALETTE
from articulate.library.procedural.urdf import Part, Shape
from articulate.reconstruct.text.vocabulary import COLOURS, MATERIALS

SURFACES = {"furniture": "lacquer", "appliance": "sheet", "small": "plastic"}
"""Surface of a colour on each kind of object."""
OPEN_RAD = 1.57
"""Range of a door whose hinged edge was moved [rad]."""


def palette_entry(word: str, kind: str) -> str:
    """Return the palette's name of a material or colour word.

    Args:
        word: Word, or a colour and ``plastic``.
        kind: ``furniture``, ``appliance`` or ``small``.
    """
    words = word.split()
    if "plastic" in words:
        colour = next((COLOURS[w] for w in words if w in COLOURS), "grey")
        return f"{colour}_plastic"
    if word in COLOURS:
        return f"{COLOURS[word]}_{SURFACES[kind]}"
    return MATERIALS[word]


def recoloured(
    parts: Iterable[Part], material: str, selected: Callable[[Part, Shape], bool]
) -> list[Part]:
    """Return the parts with the material of the selected shapes replaced; masses are kept."""
    assert material in PALETTE, material
    return [
        replace(
            part,
            shapes=tuple(
                replace(own, material=material) if selected(part, own) else own
                for own in part.shapes
            ),
        )
        for part in parts
    ]


def is_handle(own: Shape) -> bool:
    """Return whether a shape is a handle or knob."""
    return "handle" in own.name or "knob" in own.name


def without(parts: Sequence[Part], names: Iterable[str]) -> list[Part]:
    """Return the parts without those links and the links on them."""
    removed = set(names)
    kept = []
    for part in parts:
        if part.name in removed or (part.motion is not None and part.motion.parent in removed):
            removed.add(part.name)
        else:
            kept.append(part)
    return kept


def fixed(parts: Sequence[Part], names: Iterable[str]) -> list[Part]:
    """Return the parts with those links merged into their parents."""
    out = list(parts)
    for name in names:
        part = next(p for p in out if p.name == name)
        assert part.motion is not None
        x, y, z = part.motion.origin_p
        moved = tuple(own.seen_from((-x, -y, -z)) for own in part.shapes)
        parent = part.motion.parent
        out = [
            replace(p, shapes=p.shapes + moved) if p.name == parent else p
            for p in out
            if p.name != name
        ]
    return out


def rehinged(parts: Sequence[Part], name: str, side: str) -> list[Part]:
    """Return the parts with the door ``name`` hinged at another edge and its handle opposite.

    Args:
        parts: Links; the parent of the door is the root.
        name: Link of the door.
        side: ``left``, ``right``, ``top`` or ``bottom`` as seen from the front.
    """
    return [_rehinged(part, side) if part.name == name else part for part in parts]


def _rehinged(part: Part, side: str) -> Part:
    motion = part.motion
    assert motion is not None
    x, y, z = motion.origin_p
    shapes = [own.seen_from((-x, -y, -z)) for own in part.shapes if not is_handle(own)]
    corners = np.vstack([solid.mesh()[0] for own in shapes for solid in own.solids])
    low, high = corners.min(axis=0), corners.max(axis=0)
    middle = (low + high) / 2
    front = float(low[0])
    upright = side in {"left", "right"}
    if upright:
        sign = LEFT if side == "left" else RIGHT
        edge = float(high[1] if side == "left" else low[1])
        at: Vec3 = (front, edge, float(low[2]))
        turned = swing(motion.parent, part.name, at, sign, OPEN_RAD)
        grip: Vec3 = (
            front,
            float(low[1] + 0.03 if side == "left" else high[1] - 0.03),
            float(middle[2]),
        )
    else:
        below = side == "bottom"
        at = (front, float(middle[1]), float(low[2] if below else high[2]))
        axis: Vec3 = (0.0, -1.0 if below else 1.0, 0.0)
        turned = hinge(motion.parent, part.name, at, axis, OPEN_RAD, stiff=1.0)
        grip = (front, float(middle[1]), float(high[2] - 0.03 if below else low[2] + 0.03))
    turned = replace(turned, damping=motion.damping, friction=motion.friction, name=motion.name)
    length = 0.6 * float((high - low)[2 if upright else 1])
    handles = [own for own in part.shapes if is_handle(own)]
    if handles:
        bar = bar_handle(handles[0].name, grip, length, upright=upright)
        shapes.append(replace(bar, material=handles[0].material))
    return replace(part, shapes=tuple(own.seen_from(at) for own in shapes), motion=turned)
