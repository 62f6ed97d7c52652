"""Panels of furniture from the parts of a front."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from articulate.library.procedural.front_layout import (
    MIN_FRONT_M,
    MOVING,
    FrontPanel,
    HingeSide,
    PanelKind,
)
from articulate.reconstruct.fitting.front_network import KINDS, FrontPart
from articulate.transforms import Array

SAME_EDGE = 0.03
"""Edges that are closer than this share of the front are one."""
PANELS: dict[str, tuple[PanelKind, HingeSide]] = {
    "drawer": ("drawer", ""),
    "door_left": ("door", "left"),
    "door_right": ("door", "right"),
    "flap": ("flap", "bottom"),
}
"""Panel of each kind of part."""


def panels_of(parts: Sequence[FrontPart], low: float, high: float) -> tuple[FrontPanel, ...]:
    """Return the panels of parts, with common edges.

    Args:
        parts: Parts that do not overlap.
        low: Height of the lower edge of the panels in the front, as a share of it.
        high: Height of their upper edge.
    """
    across = _snapped([edge for part in parts for edge in (part.left, part.right)])
    up = _snapped([(v - low) / (high - low) for part in parts for v in (part.bottom, part.top)])
    out = []
    for k, part in enumerate(parts):
        left, right = across[2 * k : 2 * k + 2]
        bottom, top = up[2 * k : 2 * k + 2]
        if left < right and bottom < top:
            kind, side = PANELS[part.kind]
            out.append(
                FrontPanel(kind=kind, left=left, right=right, bottom=bottom, top=top, hinge=side)
            )
    return tuple(out)


def with_fixed(
    panels: Sequence[FrontPanel], fixed: PanelKind, below: PanelKind
) -> tuple[FrontPanel, ...]:
    """Return panels with others that fill what they leave free.

    Args:
        panels: Panels that do not overlap.
        fixed: Kind of the added ones.
        below: Kind of the added ones that reach the lower edge.
    """
    x = np.unique([0.0, 1.0, *(p.left for p in panels), *(p.right for p in panels)])
    y = np.unique([0.0, 1.0, *(p.bottom for p in panels), *(p.top for p in panels)])
    free = np.ones((len(y) - 1, len(x) - 1), dtype=bool)
    for p in panels:
        free[(y[:-1] >= p.bottom) & (y[1:] <= p.top), :] &= ~(
            (x[:-1] >= p.left) & (x[1:] <= p.right)
        )
    added = []
    while free.any():
        row, column = (int(k) for k in np.argwhere(free)[0])
        stop = column + 1
        while stop < free.shape[1] and free[row, stop]:
            stop += 1
        end = row + 1
        while end < free.shape[0] and free[end, column:stop].all():
            end += 1
        free[row:end, column:stop] = False
        added.append(
            FrontPanel(
                kind=below if row == 0 else fixed,
                left=float(x[column]),
                right=float(x[stop]),
                bottom=float(y[row]),
                top=float(y[end]),
            )
        )
    return (*panels, *added)


def fixed_if_small(
    panel: FrontPanel, width_m: float, height_m: float, least_m: float = MIN_FRONT_M
) -> FrontPanel:
    """Return a panel, without its joint if it is too small for one.

    Args:
        panel: Panel of a front.
        width_m: Width of the front [m].
        height_m: Height of the front [m].
        least_m: Smallest width and height of a moving front [m].
    """
    sides = ((panel.right - panel.left) * width_m, (panel.top - panel.bottom) * height_m)
    if panel.kind in MOVING and min(sides) < 1.05 * least_m:
        return replace(panel, kind="panel", hinge="")
    return panel


def certainty(parts: Sequence[FrontPart]) -> float:
    """Return how sure the parts of a front are, in [0, 1]: the least certain one.

    The two sides of a hinge count as one kind.
    """
    doors = [KINDS.index("door_left"), KINDS.index("door_right")]
    sure = [max(p.kinds.max(), p.kinds[doors].sum()) * p.support for p in parts]
    return float(min(sure, default=0.0))


def _snapped(edges: Sequence[float]) -> Array:
    """Return edges (N,) in [0, 1] where those that are close together are equal."""
    values = np.array([0.0, 1.0, *np.clip(edges, 0.0, 1.0)])
    order = np.argsort(values, kind="stable")
    groups = np.split(order, np.flatnonzero(np.diff(values[order]) >= SAME_EDGE) + 1)
    for group in groups:
        at = 0.0 if 0 in group else 1.0 if 1 in group else values[group].mean()
        values[group] = at
    return np.round(values[2:], 4)
