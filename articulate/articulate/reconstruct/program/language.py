"""The tables of the language: functions, constants, attributes and bounds.

Read by the guard, by the interpreter in the child process and by the parent that answers its
calls; needs the standard library alone.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

MAX_SOURCE = 200_000
"""Longest program [characters]: an object of 400 links, written out, has some 150,000."""
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
"""Most rounds of loops inside loops, as far as their ranges are written as numbers."""
MAX_LOOPS = 3
"""Deepest nesting of loops."""
MAX_STEPS = 200_000
"""Most expressions and statements that are evaluated in a run."""
MAX_POWER = 8.0
"""Largest size of an exponent."""

Returns = Literal["nothing", "name", "names", "box", "points"]
PLACED: dict[str, str] = {
    "above": "it stands on the parent, like a lamp on a cupboard",
    "above_inside": "it hangs under the parent's roof, like the topmost shelf",
    "below": "it is under the parent, like a foot",
    "below_inside": "it stands on the parent's floor, like the lowest drawer",
    "left": "it leans at the left side (-y), like a side table at a bed",
    "left_inside": "it leans at the left wall from within",
    "right": "it leans at the right side (+y)",
    "right_inside": "it leans at the right wall from within",
    "front": "it sits before the parent (+x), like a door, or a handle on it",
    "front_inside": "it is flush with the parent's front, like the front of a closed drawer",
    "back": "it is behind the parent (-x), like a back panel",
    "back_inside": "it stands at the back wall from within",
    "inside": "it stays; with `align=True` its middle goes to the parent's",
}
"""Where the child ends, in words, by placement; the numbers stand in ``placement.TABLE``."""
PLACEMENTS = tuple(PLACED)


@dataclass(frozen=True)
class Function:
    """A function that the parent process answers."""

    required: tuple[str, ...]
    """Names of the arguments that must be given, in order."""
    optional: Mapping[str, Any]
    """The others with their values if they are not given, in order."""
    returns: Returns
    about: str
    """One sentence for those who write programs."""

    @property
    def names(self) -> tuple[str, ...]:
        """All arguments in order."""
        return (*self.required, *self.optional)

    def line(self, name: str) -> str:
        """Its head as one would write it."""
        optional = [f"{key}={value!r}" for key, value in self.optional.items()]
        return f"{name}({', '.join([*self.required, *optional])})"


_JOINT = {"name": None, "damping": None, "friction": None}
FUNCTIONS: dict[str, Function] = {
    "parts": Function((), {}, "names", "Names of all parts that were given, in order."),
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
        "Turn the part about an axis through a point, by default the middle of its box.",
    ),
    "place_relative_to": Function(
        ("child", "parent"),
        {"placement": "above", "clearance": 0.0, "snap": True, "align": False},
        "nothing",
        "Put the child at the parent; see the table of placements.",
    ),
    "frame": Function(("name",), {}, "name", "Add a link without geometry, at the world's origin."),
    "root": Function(
        ("part",), {}, "nothing", "Say which part stands still; by default the first free one."
    ),
    "material": Function(("part", "material"), {}, "nothing", "Say what the part is made of."),
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
        "The child turns about an axis through a pivot without end.",
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
        "A joint goes where another one is, times the multiplier, plus the offset.",
    ),
}
"""What a program may ask of the parent process."""

HELPERS: dict[str, tuple[int, int]] = {
    "vec": (3, 3), "dot": (2, 2), "cross": (2, 2), "norm": (1, 1), "unit": (1, 1),
    "abs": (1, 1), "min": (1, 20), "max": (1, 20), "sum": (1, 1), "round": (1, 2), "len": (1, 1),
    "float": (1, 1), "int": (1, 1), "range": (1, 3), "enumerate": (1, 1), "zip": (2, 2),
    "sqrt": (1, 1), "sin": (1, 1), "cos": (1, 1), "tan": (1, 1), "asin": (1, 1), "acos": (1, 1),
    "atan2": (2, 2), "radians": (1, 1), "degrees": (1, 1),
}  # fmt: skip
"""Functions that the interpreter knows itself, with the least and the most arguments."""

CONSTANTS: dict[str, float] = {"pi": math.pi}
VECTOR_FIELDS = ("x", "y", "z")
BOX_FIELDS = ("low", "high", "centre", "center", "size")
ATTRIBUTES = frozenset({*VECTOR_FIELDS, *BOX_FIELDS})
"""All that may stand behind a dot."""
RESERVED = frozenset({*FUNCTIONS, *HELPERS, *CONSTANTS})
"""Names that a program may not give to its own values."""


@dataclass(frozen=True)
class RuleViolation:
    """Where a program breaks a rule, and what to do about it."""

    line: int
    """From 1; 0 if no line is to blame."""
    column: int
    """From 1; 0 if no column is to blame."""
    message: str
    kind: str = "guard"
    """``syntax``, ``guard`` (a rule of the language), ``value`` (seen while running)."""
