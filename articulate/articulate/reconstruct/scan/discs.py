"""Round parts: knobs on the front, wheels at the bottom."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from articulate.reconstruct.scan.part_proposal import QUARTER_RAD, PartProposal
from articulate.reconstruct.scan.segmentation import Segmentation
from articulate.transforms import Array, Ints

ROUND_FILL = (0.735, 0.84)
"""Area of the outline of a disc over that of its square: 0.785, and 0.83 for an octagon."""
PORTHOLE, CLOSED = (0.18, 0.5), 0.85
"""Diameters of a round door, as shares of the diagonal; least share of the front that is closed."""
SQUARE = 0.88
"""Least ratio of the two sides of the outline."""
SIZES = (0.012, 0.3)
"""Diameters, as shares of the diagonal of the object."""
THICKEST = 1.5
"""Largest length along the axis, in diameters."""
CONCENTRIC = 0.3
"""Largest distance of the centres of concentric discs, in radii of the larger one."""
LEAST_HEIGHT = 0.006
"""Least height of a knob over the surface, as a share of the diagonal."""
DIAL = 0.14
"""A round protrusion on a door that is wider than this share of it is a dial, not a handle."""
SMALL_DIAL = 0.05
"""The same for the single door of an object, beside another protrusion: a safe."""
WHEEL_BOTTOM = 0.04
"""Largest height of the lowest point of a wheel, as a share of the height of the object."""
WHEEL_SIZE = 0.35
"""Largest diameter of a wheel, as a share of the height of the object."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Disc:
    """Round cluster of surfaces."""

    faces: Ints
    """Its faces (K,)."""
    box: Array
    """Its bounding box (2, 3) [m]."""

    @property
    def centre(self) -> Array:
        """Centre of its box (3,) [m]."""
        return np.asarray(self.box.mean(axis=0))

    @property
    def size(self) -> Array:
        """Sides of its box (3,) [m]."""
        return np.asarray(self.box[1] - self.box[0])


def find_discs(parts: Segmentation, axis: int, sizes: tuple[float, float] = SIZES) -> list[Disc]:
    """Return the round clusters about the axis x, y or z, largest first, each with its interior."""
    across = [k for k in range(3) if k != axis]
    boxes, diagonal = parts.shells.boxes, parts.mesh.diagonal
    sides = boxes[:, 1] - boxes[:, 0]
    wide, high = sides[:, across[0]], sides[:, across[1]]
    larger = np.maximum(wide, high)
    likely = np.minimum(wide, high) > SQUARE * larger
    likely &= (larger > sizes[0] * diagonal) & (larger < sizes[1] * diagonal)
    likely &= sides[:, axis] < THICKEST * larger
    found: list[Disc] = []
    for k in sorted(np.flatnonzero(likely), key=lambda k: (-larger[k], k)):
        points = parts.mesh.triangles[parts.shells.members[k]].reshape(-1, 3)[:, across]
        if not is_round(points):
            continue
        centre = boxes[k].mean(axis=0)
        if any(_is_concentric(centre, disc, across) for disc in found):
            continue
        low, high_corner = boxes[k].copy()
        reach = np.zeros(3)
        reach[axis] = larger[k]
        inside = parts.inside(parts.shells, low - reach, high_corner + reach)
        faces = parts.faces_of(parts.shells, inside)
        corners = parts.mesh.triangles[faces].reshape(-1, 3)
        found.append(Disc(faces=faces, box=np.stack([corners.min(axis=0), corners.max(axis=0)])))
    return found


def is_round(points: Array) -> bool:
    """Return whether the outline of points (N, 2) is that of a disc."""
    hull = cv2.convexHull(points.astype(np.float32)).reshape(-1, 2)
    if len(hull) < 6:
        return False
    square = float(np.prod(np.ptp(hull, axis=0)))
    fill = float(cv2.contourArea(hull)) / max(square, 1e-12)
    return ROUND_FILL[0] < fill < ROUND_FILL[1]


def _is_concentric(centre: Array, disc: Disc, across: Sequence[int]) -> bool:
    offset = (centre - disc.centre)[list(across)]
    radius = 0.5 * float(disc.size[list(across)].max())
    return bool(np.linalg.norm(offset) < radius + CONCENTRIC * radius)


def knobs(
    parts: Segmentation, covered: NDArray[np.bool_], fronts: Sequence[PartProposal]
) -> list[PartProposal]:
    """Propose knobs that are visible from the front: beside the doors, and dials on doors."""
    view, mesh = parts.view, parts.mesh
    found = []
    for disc in find_discs(parts, 0):
        y, z = disc.centre[1:]
        rows, columns = view.window(
            np.array([disc.box[0, 1], disc.box[0, 2], disc.box[1, 1], disc.box[1, 2]])
        )
        seen = view.face[rows, columns]
        own = np.zeros(len(mesh.faces), dtype=bool)
        own[disc.faces] = True
        visible = own[np.maximum(seen, 0)] & (seen >= 0)
        if not seen.size or float(visible.mean()) < 0.5:
            continue
        carrier = None
        for k, front in enumerate(fronts):
            if front.panel is not None and _contains(front.panel, y, z):
                carrier = k
        if carrier is None and covered[disc.faces].mean() > 0.5:
            continue
        if carrier is not None and not _is_dial(fronts, carrier, disc):
            continue
        if _height(parts, disc) < LEAST_HEIGHT * mesh.diagonal:
            continue
        found.append(
            PartProposal(
                kind="knob",
                faces=disc.faces,
                joint="continuous",
                axis=np.array([1.0, 0.0, 0.0]),
                pivot=disc.centre,
                upper=0.0,
                confidence=0.6 if carrier is None else 0.5,
                evidence=("a round protrusion of the front",),
                on=carrier,
            )
        )
    return found


def round_door(parts: Segmentation) -> list[PartProposal]:
    """Propose a large disc in the middle of a closed front as a door, hinged at the left."""
    mesh, view = parts.mesh, parts.view
    if float((view.face >= 0).mean()) < CLOSED:
        return []
    middle, width = mesh.bounds[:, 1].mean(), float(mesh.size[1])
    for disc in find_discs(parts, 0, PORTHOLE):
        seen = np.isin(view.face, disc.faces).sum() * view.pixel**2
        own = float(np.prod(disc.size[1:]))
        offset = abs(float(disc.centre[1] - middle))
        if offset > 0.15 * width or seen < 0.4 * own or disc.size[1] < 0.4 * width:
            continue
        return [
            PartProposal(
                kind="door",
                faces=disc.faces,
                joint="revolute",
                axis=np.array([0.0, 0.0, -1.0]),
                pivot=np.array([disc.centre[0], disc.box[0, 1], disc.centre[2]]),
                upper=QUARTER_RAD,
                confidence=0.55,
                evidence=("a large disc in the front",),
            )
        ]
    return []


def _height(parts: Segmentation, disc: Disc) -> float:
    """Return the height of a disc over the surface around it [m]."""
    view = parts.view
    grow = 0.25 * disc.size[1:]
    low, high = disc.box[0, 1:] - grow, disc.box[1, 1:] + grow
    rows, columns = view.window(np.concatenate([low, high]))
    depth, face = view.depth[rows, columns], view.face[rows, columns]
    own = np.isin(face, disc.faces)
    around = depth[~own & (face >= 0)]
    if not len(around):
        return float(disc.size[0])
    return float(disc.box[1, 0] - np.median(around))


def _contains(rect: Array, y: float, z: float) -> bool:
    return bool(rect[0] < y < rect[2] and rect[1] < z < rect[3])


def _is_dial(fronts: Sequence[PartProposal], carrier: int, disc: Disc) -> bool:
    """Return whether a disc on a door is a dial: large, or beside the handle of a single door."""
    front = fronts[carrier]
    if front.kind == "drawer" or front.panel is None:
        return False
    sides = front.panel[2:] - front.panel[:2]
    share = float(disc.size[1:].max() / sides.min())
    least = SMALL_DIAL if len(fronts) == 1 and len(front.handles) > 1 else DIAL
    return least < share < 0.6


def wheels(parts: Segmentation) -> list[PartProposal]:
    """Propose two or more equal wheels at the bottom, whose axes may differ: casters."""
    mesh, cells = parts.mesh, parts.shells
    bottom, height = float(mesh.bounds[0, 2]), float(mesh.size[2])
    boxes = cells.boxes
    likely = boxes[:, 0, 2] < bottom + WHEEL_BOTTOM * height
    likely &= np.ptp(boxes[..., 2], axis=1) < WHEEL_SIZE * height
    likely &= np.ptp(boxes[..., 2], axis=1) > SIZES[0] * mesh.diagonal
    found: list[tuple[Array, Disc]] = []
    for k in sorted(np.flatnonzero(likely), key=lambda k: (-cells.area[k], k)):
        axis = _wheel_axis(mesh.triangles[cells.members[k]].reshape(-1, 3))
        centre = boxes[k].mean(axis=0)
        if axis is None or any(_inside(centre, disc.box, parts.near) for _, disc in found):
            continue
        inside = parts.inside(cells, boxes[k, 0], boxes[k, 1])
        found.append((axis, Disc(faces=parts.faces_of(cells, inside), box=boxes[k])))
    if not found:
        return []
    tallest = max(float(disc.size[2]) for _, disc in found)
    found = [(axis, disc) for axis, disc in found if disc.size[2] > 0.5 * tallest]
    if not 2 <= len(found) <= 8:
        return []
    return [
        PartProposal(
            kind="wheel",
            faces=disc.faces,
            joint="continuous",
            axis=axis,
            pivot=disc.centre,
            upper=0.0,
            confidence=0.7,
            evidence=("equal discs at the bottom",),
        )
        for axis, disc in found
    ]


def _wheel_axis(points: Array) -> Array | None:
    """Return the horizontal axis of an upright disc (3,); None if points form none."""
    flat = points[:, :2]
    _, vectors = np.linalg.eigh(np.cov((flat - flat.mean(axis=0)).T))
    for column in (0, 1):
        across, along = vectors[:, column], vectors[:, 1 - column]
        outline = np.stack([flat @ along, points[:, 2]], axis=1)
        sides = np.ptp(outline, axis=0)
        thick = float(np.ptp(flat @ across))
        square = sides.min() > SQUARE * sides.max()
        if square and thick < 0.8 * sides.max() and is_round(outline):
            return np.array([across[0], across[1], 0.0])
    return None


def _inside(point: Array, box: Array, near: float) -> bool:
    return bool((point > box[0] - near).all() and (point < box[1] + near).all())
