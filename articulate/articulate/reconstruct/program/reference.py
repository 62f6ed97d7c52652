"""The language in one text, made from its tables: for prompts, and for people in a hurry."""

from __future__ import annotations

from articulate.reconstruct.program.language import (
    BOX_FIELDS,
    CONSTANTS,
    FUNCTIONS,
    HELPERS,
    MAX_ITEMS,
    MAX_LOOPS,
    PLACED,
    VECTOR_FIELDS,
)
from articulate.reconstruct.program.materials import MATERIALS

FRAME = """\
The world: metres and radians; front +x, back -x, right +y, left -y, up +z. A part is named by its
text. A vector is vec(x, y, z) or three numbers in brackets."""
JOINTS = """\
Axis, pivot and limits are those of the world while the joint is at 0, where the program puts the
parts. Positive positions turn by the right-hand rule, or slide along the axis. Place first, then
join: a joined part is not moved any more. Each part is the child of one joint at most."""


def reference() -> str:
    """What one needs to know to write a program, as plain text."""
    functions = [f"{f.line(name)}\n    {f.about}" for name, f in FUNCTIONS.items()]
    placements = [f"{name}: {words}" for name, words in PLACED.items()]
    return "\n".join(
        [
            "A program is a small part of Python that places parts and joins them.",
            FRAME,
            "",
            "Functions:",
            *functions,
            f"Helpers, as in Python or obvious: {', '.join(HELPERS)}, {', '.join(CONSTANTS)}.",
            f"Behind a dot: {', '.join(VECTOR_FIELDS)} of a vector; "
            f"{', '.join(BOX_FIELDS)} of a box.",
            "",
            "Placements of the child at the parent:",
            *placements,
            "With snap=True the child goes on until surfaces touch; clearance is the gap that is",
            "left, negative to sink in. With align=True the middles meet on the other axes first.",
            "",
            JOINTS,
            f"Materials: {', '.join(MATERIALS)}.",
            "",
            "There is: assignment, if, for over lists and range(), def at the top, one list",
            f"comprehension at a time; loops of {MAX_ITEMS} rounds, nested {MAX_LOOPS} deep.",
            "There is not: import, class, while, lambda, try, with, methods, slices, annotations,",
            "decorators, generators, names with two underscores.",
            "",
        ]
    )
