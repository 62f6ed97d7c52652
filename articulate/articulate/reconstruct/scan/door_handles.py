"""Handles that turn on a single door: levers and knobs of room doors, wheels of safes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from articulate.reconstruct.scan.discs import knobs
from articulate.reconstruct.scan.fronts import all_fronts, moved_front
from articulate.reconstruct.scan.panels import Handle
from articulate.reconstruct.scan.part_proposal import PartProposal
from articulate.reconstruct.scan.segmentation import Segmentation
from articulate.transforms import Array, axis_angle_to_matrix

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
SHORT = 0.35
"""Largest length of a lever beside a dial, as a share of the height of the door."""
HINGE = 0.06
"""Bars nearer to an edge are hinges, as a share of the width of the door."""
ROOM = 0.4
"""Least area of the leaf of a room door that is ajar, as a share of the object."""
CONCENTRIC = 0.15
"""Largest distance of the centres of concentric handles, as a share of the smaller side."""
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
    for handle in _outermost(door.handles):
        wide, high = (float(side) for side in handle.size)
        room = _is_room_door(parts, panel, handle)
        share = max(wide, high) / float(sides.min())
        wheel = max(wide, high) < SQUARE * min(wide, high) and WHEEL[0] < share < WHEEL[1]
        if not wheel and (not room or high > LONG * wide):
            continue
        lever = room and wide > LONG * high
        proposal = _turning(parts, door.front, panel, handle, lever=lever, through=room)
        if proposal is not None:
            turning.append(replace(proposal, on=doors[0]))
    return turning


def _outermost(handles: Sequence[Handle]) -> list[Handle]:
    """Join concentric handles, such as the rings of a wheel."""
    joined: list[Handle] = []
    for handle in sorted(handles, key=lambda handle: -float(handle.size.max())):
        for k, outer in enumerate(joined):
            if np.linalg.norm(handle.centre - outer.centre) < CONCENTRIC * outer.size.min():
                joined[k] = replace(outer, height=max(outer.height, handle.height))
                break
        else:
            joined.append(handle)
    return joined


def _is_room_door(parts: Segmentation, panel: Array, handle: Handle) -> bool:
    """Return whether an object is a thin upright board with a handle at one side."""
    size, sides = parts.mesh.size, panel[2:] - panel[:2]
    middle = 0.5 * (panel[:2] + panel[2:])
    beside = abs(float(handle.centre[0] - middle[0])) > BESIDE * sides[0]
    return bool(size[0] < THIN * size[2] and size[2] > TALL * size[1] and beside)


def levers(parts: Segmentation, found: Sequence[PartProposal]) -> list[PartProposal]:
    """Propose short upright bars beside the dial of a single door, such as those of safes."""
    doors = [k for k, proposal in enumerate(found) if proposal.kind == "door"]
    dials = [proposal for proposal in found if proposal.kind == "knob" and proposal.on in doors]
    panel = found[doors[0]].panel if len(doors) == 1 and dials else None
    if panel is None:
        return []
    turning = []
    for handle in found[doors[0]].handles:
        wide, high = (float(side) for side in handle.size)
        dial = any(_covers(handle, proposal) for proposal in dials)
        edge = min(handle.rect[0] - panel[0], panel[2] - handle.rect[2])
        hinge = edge < HINGE * (panel[2] - panel[0])
        if dial or hinge or high < LONG * wide or high > SHORT * (panel[3] - panel[1]):
            continue
        proposal = _turning(parts, found[doors[0]].front, panel, handle, lever=False, through=False)
        if proposal is not None:
            y, z = float(handle.centre[0]), float(handle.rect[3] - 0.5 * wide)
            turning.append(
                replace(
                    proposal,
                    kind="switch",
                    joint="revolute",
                    pivot=np.array([found[doors[0]].front, y, z]),
                    upper=2.0 * LEVER_RAD,
                    evidence=("a lever beside a dial",),
                    on=doors[0],
                )
            )
    return turning


def _covers(handle: Handle, dial: PartProposal) -> bool:
    """Return whether the middle of a dial is on a handle."""
    middle = dial.pivot[1:]
    return bool((middle > handle.rect[:2]).all() and (middle < handle.rect[2:]).all())


def details_of_ajar(parts: Segmentation, door: PartProposal) -> list[PartProposal]:
    """Propose the dials and levers of a door that is ajar, found in its closed pose."""
    closing = axis_angle_to_matrix(door.axis, door.lower)
    local = Segmentation(parts.mesh.select(door.faces).transformed(closing, 1.0, np.zeros(3)))
    fronts = all_fronts(local)
    if not fronts:
        return []
    front = max(fronts, key=lambda front: front.panel.area)
    closed = [moved_front(local, front, "revolute", "left", "")]
    dials = knobs(local, np.zeros(len(door.faces), dtype=bool), closed)
    if local.mesh.areas.sum() > ROOM * parts.mesh.areas.sum():
        dials = turning_handles(local, closed) or dials
    return [
        replace(
            detail,
            faces=door.faces[detail.faces],
            axis=closing.T @ detail.axis,
            pivot=closing.T @ detail.pivot,
        )
        for detail in [*dials, *levers(local, [*closed, *dials])]
    ]


def _turning(
    parts: Segmentation, front: float, panel: Array, handle: Handle, *, lever: bool, through: bool
) -> PartProposal | None:
    """Return the shells of a handle, with ``through`` of both sides, as a part that turns."""
    back = float(parts.mesh.bounds[0, 0]) if through else front - handle.height
    low = np.array([back, *handle.rect[:2]])
    high = np.array([front + handle.height, *handle.rect[2:]])
    inside = parts.inside(parts.shells, low, high)
    proud = parts.shells.boxes[inside, 1, 0] > front + parts.near
    faces = parts.faces_of(parts.shells, inside if through else inside[proud])
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
