"""Levers and handles of faucets: the upper parts of columns on a vertical axis."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from articulate.reconstruct.scan.front_view import front_view
from articulate.reconstruct.scan.part_proposal import QUARTER_RAD, PartProposal
from articulate.reconstruct.scan.segmentation import Segmentation, touching
from articulate.transforms import Ints

OPEN_VIEW, SIDE_PX = 0.52, 120
"""Largest share of the side view that a faucet covers, and pixels of the view."""
BASE_HEIGHT, BASE, OVERHANG = 0.06, 0.6, 0.25
"""Height of the base as a share of the object; its largest depth, and least depth of the spout in
front of it, as shares of the depth of the object."""
FAR = 0.2
"""Least distance of a lateral handle from the spout, as a share of the width of the object."""
BESIDE = 0.2
"""Least distance of a single lever from the middle of the base, as a share of the base."""
MIRROR = 0.1
"""Largest difference of the sides of two mirrored handles, as a share."""
SMALLEST, LARGEST = 0.03, 0.4
"""Area of a handle, as a share of the object."""
TOP = 0.4
"""Handles end above this share of the height of their column or object."""


def faucet_parts(parts: Segmentation) -> list[PartProposal]:
    """Propose the handles of a faucet: a mirrored pair beside the spout, or one on top."""
    if not _is_faucet(parts):
        return []
    pair = _lateral(parts)
    lever = None if pair else _side_lever(parts)
    if lever is not None:
        return [lever]
    return [_handle(parts, group) for group in pair or _upper(parts) if len(group)]


def _is_faucet(parts: Segmentation) -> bool:
    """Return whether an object is slender, and overhangs a small base to the front."""
    mesh = parts.mesh
    if parts.shells.count < 2:
        return False
    corners = mesh.triangles.reshape(-1, 3)
    base = corners[corners[:, 2] < mesh.bounds[0, 2] + BASE_HEIGHT * mesh.size[2], 0]
    overhang = float(mesh.bounds[1, 0] - base.max())
    if float(np.ptp(base)) > BASE * mesh.size[0] or overhang < OVERHANG * mesh.size[0]:
        return False
    quarter = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    side = front_view(mesh.transformed(quarter, 1.0, np.zeros(3)), SIDE_PX)
    return float((side.face >= 0).mean()) < OPEN_VIEW


def _lateral(parts: Segmentation) -> list[Ints]:
    """Return the faces of the upper shells of two equal columns at both sides."""
    mesh, cells = parts.mesh, parts.shells
    boxes = cells.boxes
    middle, width = float(mesh.bounds[:, 1].mean()), float(mesh.size[1])
    sides = []
    for sign in (-1.0, 1.0):
        offset = sign * (boxes[..., 1] - middle)
        groups = touching(parts, np.flatnonzero(offset.min(axis=1) > 0.5 * FAR * width))
        if not groups:
            return []
        sides.append(max(groups, key=lambda group: float(cells.area[group].sum())))
    spans = [np.ptp(boxes[group].reshape(-1, 3), axis=0) for group in sides]
    if (np.abs(spans[0] - spans[1]) > MIRROR * np.maximum(*spans)).any():
        return []
    return [parts.faces_of(cells, _top(parts, group)) for group in sides]


def _side_lever(parts: Segmentation) -> PartProposal | None:
    """Propose the shells at one side of the column as a lever about y; None if there are none."""
    mesh, cells = parts.mesh, parts.shells
    corners = mesh.triangles.reshape(-1, 3)
    base = corners[corners[:, 2] < mesh.bounds[0, 2] + BASE_HEIGHT * mesh.size[2], 1]
    middle, margin = 0.5 * float(base.min() + base.max()), BESIDE * float(np.ptp(base))
    found = []
    for sign in (-1.0, 1.0):
        beside = (sign * (cells.boxes[..., 1] - middle)).min(axis=1) > margin
        for group in touching(parts, np.flatnonzero(beside)):
            area = float(cells.area[group].sum())
            if SMALLEST * cells.area.sum() < area < LARGEST * cells.area.sum():
                found.append((sign, parts.faces_of(cells, group)))
    if len(found) != 1:
        return None
    sign, faces = found[0]
    points = mesh.triangles[faces].reshape(-1, 3)
    outward = sign * points[:, 1]
    hub = points[outward < outward.min() + 0.1 * np.ptp(outward)]
    return replace(
        _handle(parts, faces),
        axis=np.array([0.0, sign, 0.0]),
        pivot=0.5 * (hub.min(axis=0) + hub.max(axis=0)),
        evidence=("a lever at one side of a column",),
    )


def _top(parts: Segmentation, group: Ints) -> Ints:
    """Return the shells of a column without those that carry it: the lowest ones."""
    boxes = parts.shells.boxes[group]
    low, high = float(boxes[:, 0, 2].min()), float(boxes[:, 1, 2].max())
    above = boxes[:, 0, 2] > low + TOP * (high - low)
    return group[above] if above.any() else group


def _upper(parts: Segmentation) -> list[Ints]:
    """Return the faces of the shells at the top of the column that carries the spout."""
    mesh, cells = parts.mesh, parts.shells
    boxes, total = cells.boxes, float(cells.area.sum())
    low, height = float(mesh.bounds[0, 2]), float(mesh.size[2])
    above = boxes[:, 0, 2] > low + TOP * height
    above &= cells.area < LARGEST * total
    groups = [
        group
        for group in touching(parts, np.flatnonzero(above))
        if SMALLEST * total < cells.area[group].sum() < LARGEST * total
    ]
    if not groups:
        return []
    best = max(groups, key=lambda group: float(boxes[group, 1, 2].max()))
    return [parts.faces_of(cells, best)]


def _handle(parts: Segmentation, faces: Ints) -> PartProposal:
    corners = parts.mesh.triangles[faces].reshape(-1, 3)
    # The lowest points of the handle touch its column.
    foot = corners[corners[:, 2] <= corners[:, 2].min() + 0.1 * np.ptp(corners[:, 2])]
    pivot = 0.5 * (foot.min(axis=0) + foot.max(axis=0))
    return PartProposal(
        kind="switch",
        faces=faces,
        joint="revolute",
        axis=np.array([0.0, 0.0, 1.0]),
        pivot=pivot,
        lower=-QUARTER_RAD / 2.0,
        upper=QUARTER_RAD / 2.0,
        confidence=0.7,
        evidence=("the upper part of a column",),
    )
