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
            side = float(np.abs((door.panel[2:] - door.panel[:2]) @ axis[1:]))
            return replace(
                door,
                kind="door",
                joint="prismatic",
                axis=axis,
                upper=TRAVEL * side,
                hollow=False,
                evidence=("an equal panel beside it in another plane",),
            )
    return door


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
