"""Limits, closed position and travel of each joint, from its source and its geometry."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from articulate.formats.config import ClosedChoice, ConvertConfig
from articulate.formats.link_tree import Part, poses_at, unit_axis
from articulate.formats.load_meshes import PartGeometry, bounds
from articulate.formats.repairs import Repairs
from articulate.formats.source_object import SourceJoint
from articulate.transforms import Array

TURN = 2.0 * math.pi
QUARTER = math.pi / 2
TWO_SIDES = math.radians(60.0)
"""A hinge that turns at least this far [rad] to both sides of 0 is closed at 0 if its geometry does
not decide: no door, lid or lever opens twice that far from limit to limit through 0."""
MEANINGLESS = {"hinge": 4.0 * math.pi, "slide": 100.0}
"""Limits of this size [rad, source units] or more are ignored."""
MAX_DEGREES = 720.0
"""Largest hinge limit that is read as degrees: two turns."""
SMALL_RANGE = math.radians(4.0)
"""Hinge range [rad] below which the unit of the file is questioned."""
OWN_SIZES = 10.0
"""Slide limits below this multiple of the part's size are kept: the file may be in millimetres."""
NEAR_ZERO = 0.05
"""Fraction of the range within which a limit counts as 0."""
WELL_INSIDE = 0.1
"""Fraction of the range between 0 and both limits above which 0 is a candidate for closed."""
TIE = 1.2
"""Boxes whose volumes differ by less than this factor are equally small."""
LEAST_SIDE = 0.01
"""Least side of a box, as a fraction of its longest: flat objects have a volume as well."""


@dataclass(frozen=True, kw_only=True)
class Travel:
    """Range and direction of a joint, in units of the source."""

    kind: Literal["slide", "hinge"]
    axis: Array
    """Unit axis in the frame of the child (3,)."""
    lower: float | None
    upper: float | None
    closed: float
    open: float
    closed_rule: str


BoxVolume = Callable[[float], float]
"""Volume of the box around a part and its parent at a joint position."""


def travel_of(
    joint: SourceJoint,
    geometry: PartGeometry,
    config: ConvertConfig,
    repairs: Repairs,
    box_volume: BoxVolume | None = None,
) -> Travel:
    """Determine limits and closed position of ``joint`` after repairs.

    Args:
        joint: Joint of the source.
        geometry: Geometry of the part that it moves.
        config: Options of the conversion; ``closed`` is used.
        repairs: Receives the changes.
        box_volume: Decides between closed positions where 0 is inside the range; None: the limit
            nearer to 0.
    """
    kind: Literal["slide", "hinge"] = "slide" if joint.kind == "prismatic" else "hinge"
    axis = unit_axis(joint)
    length = float(np.linalg.norm(joint.axis))
    if abs(length - 1.0) > 1e-6:
        repairs.add(f"axis of joint {joint.name} had length {length:.4g}: made 1")
    lower, upper = _limits(joint, kind, geometry, repairs)
    if kind == "slide" and (lower is None or upper is None):
        lower, upper = 0.0, _depth(geometry, axis)
        repairs.add(f"joint {joint.name} had no limits: 0 to {upper:.3g}, 0.8 of its depth")
    if lower is None or upper is None:
        backwards = joint.upper is not None and joint.upper <= 0.0 > (joint.lower or 0.0)
        far = -QUARTER if backwards else QUARTER
        rule = f"turns without end: closed is 0, open a quarter turn ({far:.3g})"
        return Travel(
            kind=kind, axis=axis, lower=None, upper=None, closed=0.0, open=far, closed_rule=rule
        )
    if joint.mimic is not None:  # its leader decides which positions occur
        box_volume = None
    closed, far, rule = closed_and_open(kind, lower, upper, config.closed, box_volume)
    if lower < closed < upper:
        kept = f"{min(closed, far):.4g} to {max(closed, far):.4g}"
        repairs.add(
            f"joint {joint.name} opens to both sides ({lower:.4g} to {upper:.4g}): closed is 0 and "
            f"{kept} is kept"
        )
        lower, upper = min(closed, far), max(closed, far)
    return Travel(
        kind=kind, axis=axis, lower=lower, upper=upper, closed=closed, open=far, closed_rule=rule
    )


def _limits(
    joint: SourceJoint, kind: str, geometry: PartGeometry, repairs: Repairs
) -> tuple[float | None, float | None]:
    if joint.kind == "continuous":
        if joint.lower is not None or joint.upper is not None:
            repairs.note(f"limits of the continuous joint {joint.name} left out: it turns")
        return None, None
    lower, upper = joint.lower, joint.upper
    if lower is None and upper is None:
        if kind == "hinge":
            repairs.add(f"joint {joint.name} had no limits: turns without end")
        return None, None
    lower, upper = lower or 0.0, upper or 0.0
    if lower > upper:
        repairs.add(f"limits of joint {joint.name} were swapped: {upper:g} to {lower:g}")
        lower, upper = upper, lower
    if kind == "hinge":
        lower, upper = _in_radians(joint.name, lower, upper, repairs)
    most = MEANINGLESS[kind]
    if kind == "slide":
        most = max(most, OWN_SIZES * _size(geometry))
    if upper - lower < 1e-6 or max(-lower, upper) >= most:
        repairs.add(
            f"limits of joint {joint.name} are meaningless ({lower:g} to {upper:g}): left out"
        )
        return None, None
    return lower, upper


def _in_radians(name: str, lower: float, upper: float, repairs: Repairs) -> tuple[float, float]:
    """Return the limits of a hinge in radians, converted if they are degrees."""
    if are_degrees(lower, upper):
        low, high = math.radians(lower), math.radians(upper)
        repairs.add(
            f"limits of joint {name} are degrees ({lower:g} to {upper:g}): read as {low:.4g} to "
            f"{high:.4g} rad"
        )
        return low, high
    degrees = math.degrees(upper - lower)
    if 0.0 < upper - lower < SMALL_RANGE and _off_multiples(degrees, QUARTER / 2.0) < 0.01:
        repairs.note(
            f"joint {name} turns by {degrees:.3g} degrees only; are its limits in radians, and the "
            "file declares degrees?"
        )
    return lower, upper


def are_degrees(lower: float, upper: float) -> bool:
    """Return whether limits of a hinge that should be in radians are degrees.

    Up to one turn they are radians, up to two turns if they are no round numbers. Beyond they
    are degrees, except for multiples of a quarter turn.
    """
    largest = max(abs(lower), abs(upper))
    if largest <= TURN + 0.01 or largest > MAX_DEGREES:
        return False
    if largest < MEANINGLESS["hinge"]:
        return _off_multiples(lower, 0.5) < 1e-9 and _off_multiples(upper, 0.5) < 1e-9
    integers = float(lower).is_integer() and float(upper).is_integer()
    return integers or max(_off_multiples(q, QUARTER) for q in (lower, upper)) > 2e-3


def _off_multiples(value: float, unit: float) -> float:
    """Distance from ``value`` to the nearest multiple of ``unit``."""
    return abs(value - round(value / unit) * unit)


def closed_and_open(
    kind: Literal["slide", "hinge"],
    lower: float,
    upper: float,
    choice: ClosedChoice,
    box_volume: BoxVolume | None,
) -> tuple[float, float, str]:
    """Return the closed position, the open one and the rule that chose them.

    Where 0 is well inside the range, the closed position is the one of lower limit, 0 and upper
    limit at which the box around the part and its parent is smallest. Otherwise it is the limit
    nearer to 0.
    """
    ends = {"lower": lower, "upper": upper, "zero": 0.0}
    if choice in ("lower", "upper") or (choice == "zero" and lower < 0.0 < upper):
        return _opened(ends, choice, f"closed is {_words(choice)} as requested")
    least = WELL_INSIDE * (upper - lower)
    if choice == "auto" and box_volume and -lower > least and upper > least:
        return _opened(ends, *_most_compact(kind, ends, box_volume))
    near = "lower" if abs(lower) <= abs(upper) else "upper"
    outside = "0 is no inner position: " if choice == "zero" else ""
    if abs(ends[near]) <= NEAR_ZERO * (upper - lower):
        return _opened(ends, near, f"{outside}closed is the {near} limit, which is 0")
    return _opened(ends, near, f"{outside}closed is the {near} limit, the nearer one to 0")


def _opened(ends: Mapping[str, float], closed: str, rule: str) -> tuple[float, float, str]:
    """Complete a closed position: open is the other limit, from 0 the farther one."""
    lower, upper = ends["lower"], ends["upper"]
    if closed != "zero":
        return ends[closed], upper if closed == "lower" else lower, rule
    alike = abs(upper + lower) <= NEAR_ZERO * (upper - lower)
    far = "upper" if alike or upper > -lower else "lower"
    why = "both sides are alike" if alike else "the wider side"
    return 0.0, ends[far], f"{rule}; it opens to the {far} limit ({why})"


def _most_compact(kind: str, ends: Mapping[str, float], box_volume: BoxVolume) -> tuple[str, str]:
    """Choose the closed position of a joint with 0 inside its range, and explain it."""
    volumes = {name: box_volume(q) for name, q in ends.items()}
    least = min(volumes.values())
    alike = [name for name, volume in volumes.items() if volume <= TIE * least]
    if len(alike) == 1:
        other = min(volume for name, volume in volumes.items() if name not in alike)
        return alike[0], (
            f"0 is inside the range, closed is {_words(alike[0])}: the box around the part and "
            f"its parent is {1.0 - least / other:.0%} smaller there"
        )
    lower, upper = ends["lower"], ends["upper"]
    tie = f"a tie of {' and '.join(map(_words, alike))}, whose boxes are equally small"
    if "zero" in alike and kind == "hinge" and min(-lower, upper) >= TWO_SIDES:
        return "zero", f"{tie}; closed is 0: it turns far to both sides"
    limits = [name for name in alike if name != "zero"] or ["lower", "upper"]
    near = min(limits, key=lambda name: abs(ends[name]))
    return near, f"{tie}; closed is the {near} limit{_nearness(lower, upper, limits)}"


def _nearness(lower: float, upper: float, limits: Sequence[str]) -> str:
    if len(limits) == 1:
        return ""
    alike = abs(upper + lower) <= NEAR_ZERO * (upper - lower)
    return ", both are equally near to 0" if alike else ", the nearer one to 0"


def _words(name: str) -> str:
    return "0" if name == "zero" else f"the {name} limit"


def box_volume_of(
    parts: Sequence[Part], geometry: Mapping[str, PartGeometry], part: Part
) -> BoxVolume:
    """Return the volume of the upright box around ``part``, what it carries, and its parent.

    All other joints are at 0. Without geometry of the parent, all other parts count.
    """
    assert part.joint is not None
    name = part.joint.name
    carried = {part.name}
    for other in parts:
        if other.parent in carried:
            carried.add(other.name)
    fixed = {part.parent} if part.parent and geometry[part.parent].visible else None
    members = [p.name for p in parts if p.name in carried or fixed is None or p.name in fixed]

    def volume(q: float) -> float:
        poses = poses_at(tuple(parts), {name: q})
        boxes = [bounds(geometry[member], poses[member]) for member in members]
        found = [box for box in boxes if box is not None]
        if not found:
            return 1.0
        sides = np.max([b[1] for b in found], axis=0) - np.min([b[0] for b in found], axis=0)
        return float(np.prod(np.maximum(sides, LEAST_SIDE * sides.max()))) or 1.0

    return volume


def _size(geometry: PartGeometry) -> float:
    """Return the longest side of the box around the visual geometry; 0 without it."""
    box = bounds(geometry, np.eye(4))
    return 0.0 if box is None else float((box[1] - box[0]).max())


def _depth(geometry: PartGeometry, axis: Array) -> float:
    along = [piece.mesh.vertices @ axis for piece in geometry.visible]
    if not along:
        return 1.0
    reach = max(float(a.max()) for a in along) - min(float(a.min()) for a in along)
    return 0.8 * reach if reach > 0.0 else 1.0
