"""Kinds of the cells of a front: drawer, door, flap or fixed panel, by shape and handle."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from articulate.library.procedural.front_layout import FrontPanel, HandleKind, HingeSide
from articulate.reconstruct.fitting.front_parse import FrontCell

ASPECT = 1.25
"""Width over height at which drawers and doors are equally likely without a handle."""
WITHOUT_HANDLE, NO_HANDLES = 0.5, 0.75
"""Certainty of a part without a handle, beside parts with one and on a front without any."""
STACKED = 1.2
"""Gain of the logit of a drawer for each similar cell of its stack beyond two."""
STRIP = 0.11
"""Side of a cell, as a share of the front, below which it is a plinth, a worktop or a stile."""
SIDE_OFF = 0.17
"""Distance of a handle from the middle of a door that gives the hinge, as a share of the width."""


@dataclass(frozen=True, kw_only=True)
class CellKind:
    """Cell with the probability that it is a drawer."""

    cell: FrontCell
    p_drawer: float
    aspect: float
    """Width over height."""


def classify_cell(cell: FrontCell, front_aspect: float) -> CellKind:
    """Return the kind of one cell of a front whose width over height is ``front_aspect``."""
    width, height = cell.right - cell.left, cell.top - cell.bottom
    aspect = front_aspect * width / max(height, 1e-6)
    logit = 2.2 * np.log(aspect / ASPECT)
    handle = cell.handle
    if handle is not None:
        off = abs((handle.u - cell.left) / width - 0.5)
        if handle.direction == "upright":
            logit -= 2.5
        else:
            logit += 1.5 if off < SIDE_OFF else -1.5
    return CellKind(cell=cell, p_drawer=float(1.0 / (1.0 + np.exp(-logit))), aspect=aspect)


def classify_cells(cells: Sequence[FrontCell], front_aspect: float) -> list[CellKind]:
    """Return the kind of each cell; cells of a stack of three or more are rather drawers."""
    kinds = []
    for cell in cells:
        kind = classify_cell(cell, front_aspect)
        stack = [c for c in cells if _in_stack(cell, c)]
        logit = np.log(kind.p_drawer / (1.0 - kind.p_drawer)) + STACKED * max(0, len(stack) - 2)
        kinds.append(replace(kind, p_drawer=float(1.0 / (1.0 + np.exp(-logit)))))
    return kinds


def _in_stack(cell: FrontCell, other: FrontCell) -> bool:
    """Return whether two cells have the same sides and similar heights."""
    ratio = (other.top - other.bottom) / max(cell.top - cell.bottom, 1e-6)
    same = abs(cell.left - other.left) < 0.04 and abs(cell.right - other.right) < 0.04
    return same and 0.5 < ratio < 2.0


def panels_of(kinds: Sequence[CellKind]) -> tuple[FrontPanel, ...]:
    """Return the panels of furniture: drawers, doors and fixed strips."""
    out = []
    for k, kind in enumerate(kinds):
        cell = kind.cell
        if is_strip(kind):
            out.append(_panel(cell, "panel", ""))
        elif kind.p_drawer > 0.5:
            out.append(_panel(cell, "drawer", "", _handle_kind(kind)))
        else:
            out.append(_panel(cell, "door", hinge_side(kinds, k), _handle_kind(kind)))
    return tuple(out)


def structure_confidence(kinds: Sequence[CellKind]) -> float:
    """Return how sure the division of a front is, in [0, 1]: its least certain openable part."""
    openable = [kind for kind in kinds if not is_strip(kind)]
    handles = any(kind.cell.handle for kind in openable)
    shares = []
    for kind in openable:
        share = max(kind.p_drawer, 1.0 - kind.p_drawer) * min(1.0, kind.cell.evidence + 0.1)
        if kind.cell.handle is None:
            share *= WITHOUT_HANDLE if handles else NO_HANDLES
        shares.append(share)
    return min(shares, default=0.0)


def is_strip(kind: CellKind) -> bool:
    """Return whether a cell is a plinth, a board or a stile: thin and without a handle."""
    cell = kind.cell
    if cell.handle is not None:
        return False
    level = cell.bottom < 0.01 or cell.top > 0.99
    upright = cell.left < 0.01 or cell.right > 0.99
    thin = cell.top - cell.bottom < STRIP, cell.right - cell.left < STRIP
    return (level and thin[0]) or (upright and thin[1]) or kind.aspect > 9.0 or kind.aspect < 0.1


def hinge_side(kinds: Sequence[CellKind], k: int) -> HingeSide:
    """Return the hinged edge of a door: opposite to its handle, or outer edges of a pair."""
    kind = kinds[k]
    cell, handle = kind.cell, kind.cell.handle
    if handle is not None:
        off = (handle.u - cell.left) / (cell.right - cell.left) - 0.5
        if abs(off) > SIDE_OFF:
            return "left" if off > 0.0 else "right"
    beside = [
        j
        for j, other in enumerate(kinds)
        if j != k
        and abs(other.cell.top - kind.cell.top) < 0.03
        and abs(other.cell.bottom - kind.cell.bottom) < 0.03
        and not is_strip(other)
    ]
    row = sorted([k, *beside], key=lambda j: kinds[j].cell.left)
    return "left" if row.index(k) % 2 == 0 and len(row) > 1 else "right"


def _handle_kind(kind: CellKind) -> HandleKind:
    if kind.cell.handle is not None and kind.cell.handle.direction == "compact":
        return "knob"
    return "bar"


def _panel(cell: FrontCell, kind: str, hinge: HingeSide, handle: HandleKind = "bar") -> FrontPanel:
    return FrontPanel(
        kind=kind,  # type: ignore[arg-type]
        left=max(0.0, cell.left),
        right=min(1.0, cell.right),
        bottom=max(0.0, cell.bottom),
        top=min(1.0, cell.top),
        hinge=hinge,
        handle=handle,
    )
