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
TOLERANCE, SLACK_M = 0.02, 0.005
"""Largest relative and absolute difference of a size; rims and gaps are included."""


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
    out += _sizes(expected, proposal, parts, at)
    out += _arrangement(expected, moving, at)
    for kind, sides in expected.get("hinges", {}).items():
        found = [hinge_side(p, at) for p in moving if kind_of(p) == kind]
        if sorted(found) != sorted(sides):
            out.append(f"{kind} hinged {found}, not {sides}")
    return out + _appearance(expected, moving, parts)


def _arrangement(
    expected: Mapping[str, Any], moving: list[Part], at: Mapping[str, np.ndarray]
) -> list[str]:
    """Compare the positions of parts; left is +y."""
    by: dict[str, list[np.ndarray]] = {}
    for part in moving:
        if any(not is_handle(shape) for shape in part.shapes):
            by.setdefault(kind_of(part), []).append(spans([part], at))
    out = []
    for key, axis in (("above", 2), ("left_of", 1)):
        for first, second in expected.get(key, ()):
            lowest = min((box[0, axis] for box in by.get(first, [])), default=-np.inf)
            highest = max((box[1, axis] for box in by.get(second, [])), default=np.inf)
            if lowest < highest - 0.005:
                out.append(f"{first} is not {key.replace('_', ' ')} {second}")
    for first, second in expected.get("between", ()):
        outer = [float(box[:, 1].mean()) for box in by.get(second, [])]
        inner = [float(box[:, 1].mean()) for box in by.get(first, [])]
        if not outer or not inner or not min(outer) < min(inner) <= max(inner) < max(outer):
            out.append(f"{first} is not between {second}")
    for kind, grid in expected.get("grid", {}).items():
        middles = np.array([box.mean(axis=0) for box in by.get(kind, [])]).round(2)
        found = [len(set(middles[:, axis])) for axis in (2, 1)] if len(middles) else [0, 0]
        if found != grid:
            out.append(f"{kind}s in {found}, not {grid}")
    return out


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
    if proposal.category in {"Suitcase", "TrashCan"}:
        measured = [part for part in parts if part.name not in {"pull", "pedal"}]
    extent = np.ptp(spans(measured, at), axis=0)
    if proposal.category == "KitchenPot":  # without the loops on both sides
        extent[1] = extent[0]
    out = []
    for name, wanted in expected.get("size_m", {}).items():
        value = float(extent[AXES[name]])
        if abs(value - wanted) > TOLERANCE * wanted + SLACK_M:
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
