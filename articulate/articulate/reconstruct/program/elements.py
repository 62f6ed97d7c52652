"""Elements: what was one mesh of several colours in the source is one mesh again.

A body whose colours lie in files of their own is a heap of open sheets to whoever makes collision
shapes of it, and a handle that has lost its name is no handle.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from articulate.conversion.write_asset import numbers, obj_bytes
from articulate.files import write_bytes
from articulate.formats.load_meshes import Piece

OPAQUE = 1.0
"""OBJ materials carry no opacity that readers agree on: what is seen through stays by itself."""


def elements_of(pieces: Sequence[Piece]) -> list[list[Piece]]:
    """``pieces`` that come from one element of the source together, in order."""
    found: dict[tuple[str, str, int], list[Piece]] = {}
    for i, piece in enumerate(pieces):
        alone = i + 1 if piece.rgba[3] < OPAQUE else 0
        found.setdefault((piece.link, piece.element, alone), []).append(piece)
    return list(found.values())


def words_of(element: Sequence[Piece]) -> str:
    """The words that all pieces of an element go by, those of the first where they share none."""
    first, *others = (piece.name.split() for piece in element)
    return " ".join([word for word in first if all(word in other for other in others)] or first)


def write_element(element: Sequence[Piece], folder: Path, stem: str) -> None:
    """Write ``stem``.obj into ``folder``, with a file of materials where there are several pieces.

    Raises:
        UsageError: It cannot be written.
    """
    if len(element) == 1:
        write_bytes(folder / f"{stem}.obj", obj_bytes(element[0].mesh))
        return
    colours, lines, count = [], [f"mtllib {stem}.mtl"], 1
    for k, piece in enumerate(element):
        colours += [f"newmtl m{k}", f"Kd {numbers(piece.rgba[:3])}"]
        lines += [f"v {numbers(corner)}" for corner in np.asarray(piece.mesh.vertices)]
        lines += [f"usemtl m{k}"]
        lines += [f"f {a} {b} {c}" for a, b, c in (np.asarray(piece.mesh.faces) + count).tolist()]
        count += len(piece.mesh.vertices)
    write_bytes(folder / f"{stem}.mtl", ("\n".join(colours) + "\n").encode())
    write_bytes(folder / f"{stem}.obj", ("\n".join(lines) + "\n").encode())
