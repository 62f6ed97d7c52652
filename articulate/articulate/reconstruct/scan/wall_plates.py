"""Toggles, rockers and dials on a wall plate."""

from __future__ import annotations

import numpy as np

from articulate.reconstruct.scan.discs import is_round
from articulate.reconstruct.scan.part_proposal import PartProposal
from articulate.reconstruct.scan.segmentation import Segmentation, touching
from articulate.transforms import Array, Ints

SLIM = 0.3
"""Largest thickness of a plate, as a share of its shorter side."""
COVER = 0.9
"""Least share of the width and height of the object that the plate covers."""
PLATE_AREA = 0.5
"""Least area of the plate, as a share of the object."""
LARGEST, SMALLEST = 0.75, 0.03
"""Largest and least side of a switch, as a share of that of the plate."""
CENTRED = 0.1
"""Largest distance of the middle of all switches from that of the plate, as a share of its side."""
OUTER = 0.5
"""Shells that end in this share of the height of the switch, from its top, move."""
MOST = 8
"""Most switches of a plate."""
TRAVEL_RAD = 0.3
"""Motion of a toggle or rocker to each side [rad]."""


def switch_parts(parts: Segmentation) -> list[PartProposal]:
    """Propose the switches of a wall plate; none if the object is another."""
    plate = _plate(parts)
    if plate is None:
        return []
    cells, boxes = parts.shells, parts.shells.boxes
    front = float(boxes[plate, 1, 0])
    before = np.flatnonzero(boxes[:, 1, 0] > front + parts.near)
    before = before[before != plate]
    sides = boxes[plate, 1] - boxes[plate, 0]
    groups = []
    for group in touching(parts, before):
        box = np.stack([boxes[group, 0].min(axis=0), boxes[group, 1].max(axis=0)])
        share = np.ptp(box, axis=0)[1:] / sides[1:]
        if share.max() > LARGEST:
            return []
        if share.max() > SMALLEST:
            groups.append(group)
    if not 0 < len(groups) <= MOST:
        return []
    middles = [boxes[group].reshape(-1, 3).mean(axis=0) for group in groups]
    offset = np.mean(middles, axis=0) - boxes[plate].mean(axis=0)
    if (np.abs(offset[1:]) > CENTRED * sides[1:]).any():
        return []
    return [_switch(parts, cells.boxes, group, front) for group in groups]


def _plate(parts: Segmentation) -> int | None:
    """Return the shell of a plate at the back of all others; None without one."""
    mesh, cells = parts.mesh, parts.shells
    k = int(np.argmax(cells.area))
    box, sides = cells.boxes[k], np.ptp(cells.boxes[k], axis=0)
    if cells.area[k] < PLATE_AREA * cells.area.sum() or cells.count < 2:
        return None
    if (sides[1:] < COVER * mesh.size[1:]).any() or sides[0] > SLIM * sides[1:].min():
        return None
    behind = box[0, 0] - mesh.bounds[0, 0]
    return k if behind < parts.near else None


def _switch(parts: Segmentation, boxes: Array, group: Ints, front: float) -> PartProposal:
    """Return the shells of a group that protrude most as a dial, or as a toggle or rocker."""
    reach = float(boxes[group, 1, 0].max()) - front
    outer = group[boxes[group, 1, 0] > front + OUTER * reach]
    faces = parts.faces_of(parts.shells, outer)
    corners = parts.mesh.triangles[faces].reshape(-1, 3)
    centre = 0.5 * (corners.min(axis=0) + corners.max(axis=0))
    dial = is_round(corners[:, 1:])
    return PartProposal(
        kind="knob" if dial else "switch",
        faces=faces,
        joint="continuous" if dial else "revolute",
        axis=np.array([1.0, 0.0, 0.0] if dial else [0.0, -1.0, 0.0]),
        pivot=np.array([front, centre[1], centre[2]]),
        lower=0.0 if dial else -TRAVEL_RAD,
        upper=0.0 if dial else TRAVEL_RAD,
        confidence=0.6,
        evidence=("a switch in the middle of a plate",),
    )
