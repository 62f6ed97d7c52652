"""Comparison of a proposal with the object that its text describes."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from typing import Any

import numpy as np

from articulate.library.procedural.truth import origins
from articulate.library.procedural.urdf import Part, Shape
from articulate.reconstruct.proposal import ObjectProposal

KINDS = {
    "leaf": "door",
    "flap": "door",
    "fridge_door": "door",
    "freezer_door": "door",
    "power_knob": "knob",
    "time_knob": "knob",
    "sash": "window",
    "bail": "handle",
    "hot": "handle",
    "cold": "handle",
}
AXES = {"depth": 0, "width": 1, "height": 2}
TOLERANCE = 0.02


def kind_of(part: Part) -> str:
    plain = part.name.rstrip("0123456789").rstrip("_")
    return KINDS.get(plain, plain)


def is_handle(shape: Shape) -> bool:
    return "handle" in shape.name or "knob" in shape.name


def spans(parts: list[Part], at: Mapping[str, np.ndarray]) -> np.ndarray:
    """Lowest and highest corner (2, 3) [m] of parts without handles."""
    corners = [
        solid.mesh()[0] + at[part.name]
        for part in parts
        for shape in part.shapes
        if not is_handle(shape)
        for solid in shape.solids
    ]
    points = np.vstack(corners)
    return np.stack([points.min(axis=0), points.max(axis=0)])


def differences(expected: Mapping[str, Any], proposal: ObjectProposal) -> list[str]:
    """List what of the expected object the proposal lacks."""
    out = []
    parts = list(proposal.parts)
    at = {name: np.asarray(value) for name, value in origins(parts).items()}
    moving = [part for part in parts if part.motion is not None]
    counts = Counter(kind_of(part) for part in moving)
    if proposal.category != expected["category"]:
        out.append(f"category {proposal.category}")
    for kind, wanted in expected["parts"].items():
        low, high = wanted if isinstance(wanted, list) else (wanted, wanted)
        if not low <= counts[kind] <= high:
            out.append(f"{counts[kind]} {kind}, not {wanted}")
    boxes = {
        part.name: spans([part], at)
        for part in moving
        if any(not is_handle(shape) for shape in part.shapes)
    }
    out += _sizes(expected, proposal, parts, at)
    by: dict[str, list[np.ndarray]] = {}
    for part in moving:
        if part.name in boxes:
            by.setdefault(kind_of(part), []).append(boxes[part.name])
    for first, second in expected.get("above", ()):
        lowest = min(b[0, 2] for b in by.get(first, [np.zeros((2, 3))]))
        highest = max(b[1, 2] for b in by.get(second, [np.full((2, 3), 9.0)]))
        if lowest < highest - 0.005:
            out.append(f"{first} is not above {second}")
    for first, second in expected.get("left_of", ()):  # left is +y
        lowest = min(b[0, 1] for b in by.get(first, [np.zeros((2, 3)) - 9]))
        highest = max(b[1, 1] for b in by.get(second, [np.full((2, 3), 9.0)]))
        if lowest < highest - 0.005:
            out.append(f"{first} is not left of {second}")
    for first, second in expected.get("between", ()):
        ys = [float(b[:, 1].mean()) for b in by.get(second, [])]
        inner = [float(b[:, 1].mean()) for b in by.get(first, [])]
        if not ys or not inner or not min(ys) < min(inner) <= max(inner) < max(ys):
            out.append(f"{first} is not between {second}")
    for kind, grid in expected.get("grid", {}).items():
        rows = len({round(float(b[:, 2].mean()), 2) for b in by.get(kind, [])})
        columns = len({round(float(b[:, 1].mean()), 2) for b in by.get(kind, [])})
        if [rows, columns] != grid:
            out.append(f"{kind}s in {rows} x {columns}, not {grid}")
    for kind, sides in expected.get("hinges", {}).items():
        found = [hinge_side(p, at) for p in moving if kind_of(p) == kind]
        if sorted(found) != sorted(sides):
            out.append(f"{kind} hinged {found}, not {sides}")
    return out + _appearance(expected, moving, parts)


def _sizes(
    expected: Mapping[str, Any],
    proposal: ObjectProposal,
    parts: list[Part],
    at: Mapping[str, np.ndarray],
) -> list[str]:
    measured = parts
    if proposal.category == "Door":
        measured = [part for part in parts if part.name == "leaf"]
    if proposal.category == "KitchenPot":
        measured = [part for part in parts if part.name == "pot"]
    if proposal.category == "Laptop":
        measured = [part for part in parts if part.name == "base"]
    extent = np.ptp(spans(measured, at), axis=0)
    if proposal.category == "KitchenPot":  # loops on both sides
        extent[1] = extent[0]
    out = []
    for name, wanted in expected.get("size_m", {}).items():
        # rims, lips and the lintel of a pot, box or door are outside of the nominal size
        slack = 0.035 if proposal.category in {"Box", "TrashCan", "Suitcase", "Bucket"} else 0.012
        value = float(extent[AXES[name]])
        if proposal.category in {"TrashCan", "Bucket"} and name != "height":
            wall = [p for p in parts if p.motion is None]
            value = float(np.ptp(spans(wall, at), axis=0)[1])
        if abs(value - wanted) > TOLERANCE * wanted + (slack if slack > 0.02 else 0.005):
            out.append(f"{name} {value:.3f}, not {wanted}")
    return out


def hinge_side(part: Part, at: Mapping[str, np.ndarray]) -> str:
    """Edge at which a door turns, seen from the front."""
    assert part.motion is not None
    middle = spans([part], at).mean(axis=0)
    axis = int(np.abs(part.motion.axis).argmax())
    if axis == 2:
        return "left" if at[part.name][1] > middle[1] else "right"
    return "top" if at[part.name][2] > middle[2] else "bottom"


def _appearance(expected: Mapping[str, Any], moving: list[Part], parts: list[Part]) -> list[str]:
    out = []
    shapes = [shape for part in parts for shape in part.shapes]
    handle = expected.get("handle")
    kinds = {
        "knob" if "knob" in shape.name else "bar"
        for part in moving
        for shape in part.shapes
        if is_handle(shape)
    }
    if handle and kinds != ({handle} - {"none"}):
        out.append(f"handles {sorted(kinds)}, not {handle}")
    material = expected.get("material")
    if material and not any(s.material.startswith(material) for s in shapes):
        out.append(f"no {material} in {sorted({s.material for s in shapes})}")
    return out
