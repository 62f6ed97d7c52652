"""Tables of the language: functions, constants, attributes and limits.

They are used by the allow-list, by the interpreter in the child process and by the parent that
answers its calls. The module needs only the standard library.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

MAX_SOURCE = 200_000
"""Longest program [characters]; an object of 400 links has about 150,000."""
MAX_NODES = 60_000
"""Most nodes of the syntax tree."""
MAX_DEPTH = 40
"""Deepest nesting of the syntax tree, and of brackets."""
MAX_NUMBER = 1e9
"""Largest size of a number, written or computed."""
MAX_TEXT = 200
"""Longest text [characters], written or computed."""
MAX_ITEMS = 2_000
"""Most items of a list, tuple or dict, and most rounds of a loop."""
MAX_ROUNDS = 10_000
"""Most rounds of nested loops with literal ranges."""
MAX_LOOPS = 3
"""Deepest nesting of loops."""
MAX_STEPS = 200_000
"""Most expressions and statements that are evaluated in a run."""
MAX_POWER = 8.0
"""Largest size of an exponent."""

Returns = Literal["nothing", "name", "names", "box", "points"]
PLACEMENT_TEXTS: dict[str, str] = {
    "above": "on the parent, like a lamp on a cupboard",
    "above_inside": "under the parent's top from within, like the topmost shelf",
    "below": "under the parent, like a foot",
    "below_inside": "on the parent's bottom from within, like the lowest drawer",
    "left": "at the left side (-y), like a side table at a bed",
    "left_inside": "at the left wall from within",
    "right": "at the right side (+y)",
    "right_inside": "at the right wall from within",
    "front": "at the front (+x), like a door, or a handle on it",
    "front_inside": "flush with the parent's front, like the front of a closed drawer",
    "back": "at the back (-x), like a back panel",
    "back_inside": "at the back wall from within",
    "inside": "no motion; with `align=True` the centres are aligned",
}
"""Description of each placement; ``placement.TABLE`` has the numbers."""
PLACEMENTS = tuple(PLACEMENT_TEXTS)


@dataclass(frozen=True)
class Function:
    """A function that the parent process answers."""

    required: tuple[str, ...]
    """Names of the required arguments, in order."""
    optional: Mapping[str, Any]
    """Optional arguments with their defaults, in order."""
    returns: Returns
    about: str
    """Description for authors of programs."""

    @property
    def names(self) -> tuple[str, ...]:
        """All arguments in order."""
        return (*self.required, *self.optional)

    def line(self, name: str) -> str:
        """Return its signature."""
        optional = [f"{key}={value!r}" for key, value in self.optional.items()]
        return f"{name}({', '.join([*self.required, *optional])})"


_JOINT = {"name": None, "damping": None, "friction": None}
FUNCTIONS: dict[str, Function] = {
    "parts": Function((), {}, "names", "Names of all parts, in order."),
    "box": Function(
        ("part",), {}, "box", "Box around the part where it is now, along the world's axes."
    ),
    "corners": Function(
        ("part",), {}, "points", "The eight corners of that box: x, then y, then z, low first."
    ),
    "vertices": Function(
        ("part",), {}, "points", "At most 256 corners of the part's convex hull where it is now."
    ),
    "place": Function(
        ("part", "position"),
        {"rpy": (0.0, 0.0, 0.0)},
        "nothing",
        "Put the part's own origin at a point, turned by roll, pitch and yaw.",
    ),
    "move": Function(("part", "by"), {}, "nothing", "Move the part by a vector."),
    "rotate": Function(
        ("part", "axis", "angle"),
        {"pivot": None},
        "nothing",
        "Turn the part about an axis through a point, by default the centre of its box.",
    ),
    "place_relative_to": Function(
        ("child", "parent"),
        {"placement": "above", "clearance": 0.0, "snap": True, "align": False},
        "nothing",
        "Put the child at the parent; see the table of placements.",
    ),
    "frame": Function(("name",), {}, "name", "Add a link without geometry, at the world's origin."),
    "root": Function(
        ("part",), {}, "nothing", "Set the part that does not move; by default the first free one."
    ),
    "material": Function(("part", "material"), {}, "nothing", "Set the material of the part."),
    "fixed": Function(
        ("child", "parent"), {"name": None}, "name", "The child never moves against the parent."
    ),
    "revolute": Function(
        ("child", "parent", "axis", "pivot", "lower", "upper"),
        _JOINT,
        "name",
        "The child turns about an axis through a pivot, from lower to upper.",
    ),
    "continuous": Function(
        ("child", "parent", "axis", "pivot"),
        _JOINT,
        "name",
        "The child turns about an axis through a pivot without limits.",
    ),
    "prismatic": Function(
        ("child", "parent", "axis", "lower", "upper"),
        {"pivot": None, **_JOINT},
        "name",
        "The child slides along an axis, from lower to upper.",
    ),
    "mimic": Function(
        ("follower", "leader"),
        {"multiplier": 1.0, "offset": 0.0},
        "nothing",
        "The position of a joint is that of another one, times the multiplier, plus the offset.",
    ),
}
"""Functions that the parent process answers."""

HELPERS: dict[str, tuple[int, int]] = {
    "vec": (3, 3), "dot": (2, 2), "cross": (2, 2), "norm": (1, 1), "unit": (1, 1),
    "abs": (1, 1), "min": (1, 20), "max": (1, 20), "sum": (1, 1), "round": (1, 2), "len": (1, 1),
    "float": (1, 1), "int": (1, 1), "range": (1, 3), "enumerate": (1, 1), "zip": (2, 2),
    "sqrt": (1, 1), "sin": (1, 1), "cos": (1, 1), "tan": (1, 1), "asin": (1, 1), "acos": (1, 1),
    "atan2": (2, 2), "radians": (1, 1), "degrees": (1, 1),
}  # fmt: skip
"""Functions of the interpreter, with the least and the most arguments."""

CONSTANTS: dict[str, float] = {"pi": math.pi}
VECTOR_FIELDS = ("x", "y", "z")
BOX_FIELDS = ("low", "high", "centre", "center", "size")
ATTRIBUTES = frozenset({*VECTOR_FIELDS, *BOX_FIELDS})
"""Names that are allowed after a dot."""
RESERVED = frozenset({*FUNCTIONS, *HELPERS, *CONSTANTS})
"""Names that a program must not assign."""


@dataclass(frozen=True)
class RuleViolation:
    """Violation of a rule: its position and an alternative."""

    line: int
    """From 1; 0 if no line is known."""
    column: int
    """From 1; 0 if no column is known."""
    message: str
    kind: str = "rule"
    """``syntax``, ``rule`` (a rule of the language), ``value`` (an error at run time)."""
