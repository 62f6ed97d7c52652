"""Lids and seats of toilets: plates on a bowl, hinged at the tank behind them."""

from __future__ import annotations

import cv2
import numpy as np

from articulate.reconstruct.scan.part_proposal import QUARTER_RAD, PartProposal
from articulate.reconstruct.scan.segmentation import Segmentation
from articulate.transforms import Array, Ints

LENGTH, WIDTH = 0.35, 0.5
"""Least depth and width of a plate, as shares of those of the object."""
THICK = 0.15
"""Largest thickness of a plate, as a share of its depth."""
HEIGHTS = (0.3, 0.8)
"""Heights of the plates, as shares of the height of the object."""
ROUNDED = (0.7, 0.95)
"""Area of the outline of a plate, as a share of the rectangle around it."""
TANK, BEHIND = 0.15, 0.25
"""Least height of the tank above the plates, as a share of the height of the object, and the
largest part of it above them, as a share of their depth."""
ALIKE = 0.2
"""Largest distance of the edges of seat and lid, as a share of their depth."""


def toilet_parts(parts: Segmentation) -> list[PartProposal]:
    """Propose lid and seat, the highest first; the front is +x."""
    mesh, boxes = parts.mesh, parts.shells.boxes
    sides, low = np.ptp(boxes, axis=1), float(mesh.bounds[0, 2])
    likely = (sides[:, 0] > LENGTH * mesh.size[0]) & (sides[:, 1] > WIDTH * mesh.size[1])
    likely &= sides[:, 2] < THICK * sides[:, 0]
    height = (boxes[:, 0, 2] - low) / mesh.size[2]
    likely &= (height > HEIGHTS[0]) & (height < HEIGHTS[1])
    plates = [k for k in np.flatnonzero(likely) if _is_rounded(parts, int(k))]
    plates.sort(key=lambda k: -float(boxes[k, 1, 2]))
    if not plates or not _has_tank(parts, boxes[plates[0]]):
        return []
    top = boxes[plates[0]]
    alike = [k for k in plates if (np.abs(boxes[k] - top)[:, :2] < ALIKE * np.ptp(top[:, 0])).all()]
    found: list[PartProposal] = []
    for k in alike[:2]:
        faces = _plate(parts, boxes[k], found)
        pivot = np.array([boxes[k, 0, 0], boxes[k, :, 1].mean(), boxes[alike[-1], 0, 2]])
        found.append(
            PartProposal(
                kind="lid" if not found else "part",
                faces=faces,
                joint="revolute",
                axis=np.array([0.0, -1.0, 0.0]),
                pivot=pivot,
                upper=QUARTER_RAD,
                confidence=0.7,
                evidence=("a rounded plate in front of a tank",),
            )
        )
    return found


def _is_rounded(parts: Segmentation, shell: int) -> bool:
    points = parts.mesh.triangles[parts.shells.members[shell]].reshape(-1, 3)[:, :2]
    hull = cv2.convexHull(points.astype(np.float32))
    fill = float(cv2.contourArea(hull)) / max(float(np.prod(np.ptp(points, axis=0))), 1e-12)
    return ROUNDED[0] < fill < ROUNDED[1]


def _has_tank(parts: Segmentation, plate: Array) -> bool:
    """Return whether all that is much higher than a plate is behind it."""
    mesh = parts.mesh
    corners = mesh.triangles.reshape(-1, 3)
    above = corners[corners[:, 2] > plate[1, 2] + 0.5 * TANK * mesh.size[2]]
    if mesh.bounds[1, 2] < plate[1, 2] + TANK * mesh.size[2] or not len(above):
        return False
    return bool(above[:, 0].max() < plate[0, 0] + BEHIND * np.ptp(plate[:, 0]))


def _plate(parts: Segmentation, box: Array, others: list[PartProposal]) -> Ints:
    """Return the faces of all shells in the box of a plate, without those of other plates."""
    faces = parts.faces_of(parts.shells, parts.inside(parts.shells, box[0], box[1]))
    for other in others:
        faces = np.setdiff1d(faces, other.faces)
    return faces
