"""Combine the pieces of a mesh with several colours into one mesh again.

Collision shapes cannot be made from a body that is split into open sheets by colour, and handles
are found by the names of meshes.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from articulate.conversion.write_asset import numbers, obj_bytes
from articulate.files import write_bytes
from articulate.formats.load_meshes import Piece

OPAQUE = 1.0
"""OBJ readers disagree on the opacity of materials, so transparent pieces stay separate."""


def elements_of(pieces: Sequence[Piece]) -> list[list[Piece]]:
    """Group pieces that come from one element of the source, in order."""
    found: dict[tuple[str, str, int], list[Piece]] = {}
    for i, piece in enumerate(pieces):
        separate = i + 1 if piece.rgba[3] < OPAQUE else 0
        found.setdefault((piece.link, piece.element, separate), []).append(piece)
    return list(found.values())


def common_name(element: Sequence[Piece]) -> str:
    """Return the words that all names of an element share; the first name if there are none."""
    first, *others = (piece.name.split() for piece in element)
    return " ".join([word for word in first if all(word in other for other in others)] or first)


def write_element(element: Sequence[Piece], folder: Path, stem: str) -> None:
    """Write ``stem``.obj into ``folder``, with a material file if there are several pieces.

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
