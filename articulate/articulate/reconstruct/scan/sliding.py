"""Sliding doors and windows: two equal panels beside each other in different planes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from articulate.reconstruct.scan.fronts import Front
from articulate.reconstruct.scan.panels import Panel
from articulate.reconstruct.scan.part_proposal import PartProposal
from articulate.reconstruct.scan.segmentation import Segmentation
from articulate.transforms import Array

EQUAL = 0.25
"""Largest difference of the sides of the two panels, as a share."""
LAPPED, APART = 0.3, 0.1
"""Largest overlap of the panels and largest gap between them, as shares of a side."""
PLANES = (0.004, 0.25)
"""Distance of the two planes, as a share of the diagonal of the object."""
BEHIND = 0.8
"""Least distance of the two planes, as a share of the thickness of the front panel."""
THIN = 0.15
"""Largest depth of a window, as a share of its diagonal."""
HALF = (0.4, 0.55)
"""Width or height of a sash, as a share of that of its window."""
TRAVEL = 0.8
"""Travel of a panel, as a share of its side."""


def with_sliding(
    parts: Segmentation, found: Sequence[PartProposal], fronts: Sequence[Front]
) -> list[PartProposal]:
    """Return the proposals, with doors that slide past an equal panel.

    Args:
        parts: The object; its front is +x.
        found: Proposed parts.
        fronts: All panels of the front, whether they move or not.
    """
    return [_slid(parts, proposal, [front.panel for front in fronts]) for proposal in found]


def _slid(parts: Segmentation, door: PartProposal, panels: Sequence[Panel]) -> PartProposal:
    thin = parts.mesh.size[0] < THIN * parts.mesh.diagonal  # without room for a drawer
    kinds = {"door", "flap", "drawer"} if thin else {"door", "flap"}
    if door.kind not in kinds or door.panel is None:
        return door
    own = next((panel for panel in panels if (panel.rect == door.panel).all()), None)
    for panel in panels:
        ahead = panel if own is None or panel.front > own.front else own
        apart = abs(panel.front - door.front) / parts.mesh.diagonal
        axis = _axis_past(door.panel, panel.rect)
        clear = abs(panel.front - door.front) > BEHIND * (ahead.front - ahead.back)
        if axis is not None and clear and PLANES[0] < apart < PLANES[1]:
            return _past(door, axis, "an equal panel beside it in another plane")
    sash = _sash_axis(parts, door) if thin else None
    return door if sash is None else _past(door, sash, "a fixed pane beside it in another plane")


def _past(door: PartProposal, axis: Array, reason: str) -> PartProposal:
    """Return a panel that slides past another one."""
    assert door.panel is not None
    side = float(np.abs((door.panel[2:] - door.panel[:2]) @ axis[1:]))
    return replace(
        door,
        kind="door",
        joint="prismatic",
        axis=axis,
        upper=TRAVEL * side,
        hollow=False,
        evidence=(reason,),
    )


def _sash_axis(parts: Segmentation, sash: PartProposal) -> Array | None:
    """Return the direction to an equal closed surface of a window in another plane (3,), or None.

    The panel and this surface fill the frame of the window.
    """
    rect, view = sash.panel, parts.view
    assert rect is not None
    low, high = parts.mesh.bounds[:, 1:]
    for axis in (0, 1):
        side = float(rect[axis + 2] - rect[axis])
        if not HALF[0] < side / (high - low)[axis] < HALF[1]:
            continue
        for sign in (1.0, -1.0):
            step = np.zeros(2)
            step[axis] = sign * (1.0 - 0.5 * LAPPED) * side
            shifted = rect + np.tile(step, 2)
            if (shifted[:2] < low).any() or (shifted[2:] > high).any():
                continue
            middle, half = 0.5 * (shifted[:2] + shifted[2:]), 0.25 * (rect[2:] - rect[:2])
            rows, columns = view.window(np.r_[middle - half, middle + half])
            depth = view.depth[rows, columns]
            if not depth.size or not np.isfinite(depth).all():
                continue
            apart = abs(float(np.median(depth)) - sash.front) / parts.mesh.diagonal
            if PLANES[0] < apart < PLANES[1]:
                return np.array([0.0, *(step / np.linalg.norm(step))])
    return None


def _axis_past(rect: Array, other: Array) -> Array | None:
    """Return the direction from a rectangle to an equal one beside it (3,); None if it is not."""
    size, offset = rect[2:] - rect[:2], 0.5 * (other[:2] + other[2:] - rect[:2] - rect[2:])
    if (np.abs(other[2:] - other[:2] - size) > EQUAL * size).any():
        return None
    for k in (0, 1):
        steps = abs(float(offset[k] / size[k]))
        level = abs(float(offset[1 - k] / size[1 - k])) < EQUAL
        if level and 1.0 - LAPPED < steps < 1.0 + APART:
            axis = np.zeros(3)
            axis[k + 1] = np.sign(offset[k])
            return axis
    return None
