"""Handles that turn on a single door: levers and knobs of room doors, wheels of safes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from articulate.reconstruct.scan.panels import Handle
from articulate.reconstruct.scan.part_proposal import PartProposal
from articulate.reconstruct.scan.segmentation import Segmentation
from articulate.transforms import Array

THIN, TALL = 0.2, 1.4
"""Largest depth of a room door and its least height, as shares of its height and its width."""
MAIN = 0.4
"""Least share of the front that a single door covers."""
BESIDE = 0.2
"""Least distance of the handle of a room door from its middle, as a share of the width."""
LONG, SQUARE = 1.3, 1.15
"""Ratio of the sides of a handle from which it is a bar, and up to which it may be a wheel."""
WHEEL = (0.2, 0.6)
"""Diameter of a wheel, as a share of the shorter side of its door."""
LEVER_RAD = float(np.radians(45.0))
"""Motion of a lever [rad]."""


def turning_handles(parts: Segmentation, found: Sequence[PartProposal]) -> list[PartProposal]:
    """Propose the lever or knob of a room door, or the wheel of a safe; a vertical bar is fixed.

    Args:
        parts: The object; its front is +x.
        found: Proposed fronts.
    """
    doors = [k for k, proposal in enumerate(found) if proposal.panel is not None]
    if len(doors) != 1 or found[doors[0]].kind != "door":
        return []
    door = found[doors[0]]
    panel = door.panel
    assert panel is not None
    sides = panel[2:] - panel[:2]
    if float(sides.prod()) < MAIN * float(parts.mesh.size[1:].prod()):
        return []
    turning = []
    for handle in door.handles:
        wide, high = (float(side) for side in handle.size)
        room = _is_room_door(parts, panel, handle)
        share = max(wide, high) / float(sides.min())
        wheel = max(wide, high) < SQUARE * min(wide, high) and WHEEL[0] < share < WHEEL[1]
        if not wheel and (not room or high > LONG * wide):
            continue
        lever = room and wide > LONG * high
        proposal = _turning(parts, door.front, panel, handle, lever=lever)
        if proposal is not None:
            turning.append(replace(proposal, on=doors[0]))
    return turning


def _is_room_door(parts: Segmentation, panel: Array, handle: Handle) -> bool:
    """Return whether an object is a thin upright board with a handle at one side."""
    size, sides = parts.mesh.size, panel[2:] - panel[:2]
    middle = 0.5 * (panel[:2] + panel[2:])
    beside = abs(float(handle.centre[0] - middle[0])) > BESIDE * sides[0]
    return bool(size[0] < THIN * size[2] and size[2] > TALL * size[1] and beside)


def _turning(
    parts: Segmentation, front: float, panel: Array, handle: Handle, *, lever: bool
) -> PartProposal | None:
    """Return the shells of a handle as a part that turns; None if there are none."""
    low = np.array([front - handle.height, *handle.rect[:2]])
    high = np.array([front + handle.height, *handle.rect[2:]])
    faces = parts.faces_of(parts.shells, parts.inside(parts.shells, low, high))
    if not len(faces):
        return None
    y, z = handle.centre
    inward = -float(np.sign(y - 0.5 * (panel[0] + panel[2])))
    if lever:  # it turns about its end at the edge of the door
        y -= inward * 0.5 * (handle.size[0] - handle.size[1])
    return PartProposal(
        kind="switch" if lever else "knob",
        faces=faces,
        joint="revolute" if lever else "continuous",
        axis=np.array([-inward if lever else 1.0, 0.0, 0.0]),
        pivot=np.array([front, y, z]),
        upper=LEVER_RAD if lever else 0.0,
        confidence=0.5,
        evidence=("a lever of a door" if lever else "a handle that turns on a door",),
    )
