"""Reference of the language as text, generated from its tables: for prompts and users."""

from __future__ import annotations

from articulate.reconstruct.program.language import (
    BOX_FIELDS,
    CONSTANTS,
    FUNCTIONS,
    HELPERS,
    MAX_ITEMS,
    MAX_LOOPS,
    PLACEMENT_TEXTS,
    VECTOR_FIELDS,
)
from articulate.reconstruct.program.materials import MATERIALS

FRAME = """\
The world: metres and radians; front +x, back -x, right +y, left -y, up +z. A part is named by its
text. A vector is vec(x, y, z) or three numbers in brackets."""
JOINTS = """\
Axis and pivot are in the world frame with the joint at 0, where the program places the parts.
Positive positions turn by the right-hand rule, or slide along the axis. Place parts first, then
join them: joined parts cannot be moved. Each part is the child of at most one joint."""


def reference() -> str:
    """Return the reference as plain text."""
    functions = [f"{f.line(name)}\n    {f.about}" for name, f in FUNCTIONS.items()]
    placements = [f"{name}: {words}" for name, words in PLACEMENT_TEXTS.items()]
    return "\n".join(
        [
            "A program is a small part of Python that places parts and joins them.",
            FRAME,
            "",
            "Functions:",
            *functions,
            f"Helpers, as in Python or mathematics: {', '.join(HELPERS)}, {', '.join(CONSTANTS)}.",
            f"Attributes: {', '.join(VECTOR_FIELDS)} of a vector; "
            f"{', '.join(BOX_FIELDS)} of a box.",
            "",
            "Placements of the child at the parent:",
            *placements,
            "With snap=True the child moves until surfaces touch; clearance is the remaining gap,",
            "negative for an overlap. With align=True the other axes are centred first.",
            "",
            JOINTS,
            f"Materials: {', '.join(MATERIALS)}.",
            "",
            "Allowed: assignment, if, for over lists and range(), def at the top, one list",
            f"comprehension at a time; loops of {MAX_ITEMS} rounds, nested {MAX_LOOPS} deep.",
            "Not allowed: import, class, while, lambda, try, with, methods, slices, annotations,",
            "decorators, generators, names with two underscores.",
            "",
        ]
    )
