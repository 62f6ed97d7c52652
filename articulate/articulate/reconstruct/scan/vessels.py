"""Lids of bottles, jars and pots, and the bails of buckets."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from articulate.reconstruct.scan.part_proposal import QUARTER_RAD, PartProposal
from articulate.reconstruct.scan.segmentation import Segmentation, touching
from articulate.transforms import Array, Ints

ROUND = (0.88, 1.15)
"""Distances of the outline of a vessel from its axis, relative to an ellipse."""
SLENDER, BOTTLE = 1.5, (0.8, 1.25)
"""Limits of the outline of bodies that are this much higher than wide."""
OVAL = 0.55
"""Least ratio of the two horizontal sides of a vessel."""
BAND = (0.15, 0.6)
"""Heights between which a vessel is round, as shares of its height."""
SMALL = 0.025
"""Smaller shells do not decide the outline of a vessel, as a share of the area of the object."""
LEAST_WIDTH = 0.6
"""Least width of the round body, as a share of the object with its handles."""
LOW = 0.4
"""Shells of the body begin below this share of the height."""
FOOT, TALL = 0.15, 0.35
"""Staves begin below the first share of the height, and are as high as the second."""
CENTRED = 0.12
"""Largest offset of a lid from the axis, as a share of the width of the body."""
OFF_CENTRE = 0.3
"""Largest offset of a shell of a lid, as a share of the width of the body."""
LEDGE = 0.015
"""Least area of the lower side of a lid, as a share of the square of the width of the body."""
SHALLOW = 0.08
"""A cap that is lower than this share of the body continues to the ring below it."""
LEAST_LID = 0.004
"""Least area of a lid, as a share of the object."""
BEYOND, HINGE = (0.85, 1.25), 0.1
"""Distances of the shells of a hinge from the axis, as shares of the radius of the body; their
least height below the lid, as a share of the height of the body."""
BAIL_WIDTH = 0.8
"""Least width of a bail, as a share of the width of the body."""
BAIL_WIDEST = 1.6
"""Largest width of a bail, as a share of the width of the body."""
OUTER = 1.05
"""Least reach of a bail that is folded down, as a multiple of that of the body."""
GRIP = 0.05
"""Distance of the grip of a bail from its box, as a share of the width of the body."""
BAIL_SLIM = 0.8
"""Largest ratio of the horizontal sides of a bail; a rim has 1."""
BAIL_AREA = 0.3
"""Largest area of a bail, as a share of the object."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Vessel:
    """Round body about a vertical axis."""

    shells: Ints
    """Shells of its body."""
    slender: bool
    """True if the object is much higher than wide: a bottle, not a bucket or pot."""
    box: Array
    """Bounding box of the body (2, 3) [m]."""

    @property
    def centre(self) -> Array:
        """Centre of the body (3,) [m]."""
        return np.asarray(self.box.mean(axis=0))

    @property
    def height(self) -> float:
        """Height of the body [m]."""
        return float(np.ptp(self.box[:, 2]))

    @property
    def width(self) -> float:
        """Larger horizontal side [m]."""
        return float((self.box[1] - self.box[0])[:2].max())


def find_vessel(parts: Segmentation) -> Vessel | None:
    """Return the round body of a vessel; None if the object is no vessel."""
    cells, mesh = parts.shells, parts.mesh
    low, height = mesh.bounds[0, 2], mesh.size[2]
    corners = mesh.triangles.reshape(-1, 3)
    spans = np.ptp(mesh.triangles[..., 2], axis=1)
    middle = mesh.triangles.mean(axis=1)[:, 2]
    band = (middle > low + BAND[0] * height) & (middle < low + BAND[1] * height)
    band |= (spans > 0.3 * height) & (np.abs(mesh.normals[:, 2]) < 0.5)
    band &= (cells.area > SMALL * cells.area.sum())[cells.label]
    if not band.any():
        return None
    points = corners.reshape(-1, 3, 3)[band].reshape(-1, 3)
    slender = height > SLENDER * float(mesh.size[:2].max())
    if not _is_round(points[:, :2], BOTTLE if slender else ROUND):
        return None
    box = np.stack([points.min(axis=0), points.max(axis=0)])
    boxes = cells.boxes
    width = float(np.ptp(box[:, :2], axis=0).max())
    if width < LEAST_WIDTH * float(mesh.size[:2].max()):
        return None
    off = np.linalg.norm(boxes.mean(axis=1)[:, :2] - box.mean(axis=0)[:2], axis=1)
    bottom = boxes[:, 0, 2] < low + LOW * height
    stave = boxes[:, 0, 2] < low + FOOT * height
    stave &= np.ptp(boxes[..., 2], axis=1) > TALL * height
    body = np.flatnonzero(stave | (bottom & (off < CENTRED * width)))
    if not len(body):
        return None
    top = float(boxes[body, 1, 2].max())
    box[:, 2] = low, top
    return Vessel(shells=body, box=box, slender=slender)


def _is_round(points: Array, limits: tuple[float, float]) -> bool:
    """Return whether the outline of points (N, 2) is nearly an ellipse along the axes."""
    hull = cv2.convexHull(points.astype(np.float32)).reshape(-1, 2)
    sides = np.ptp(hull, axis=0)
    if len(hull) < 8 or sides.min() < OVAL * sides.max():
        return False
    unit = (hull - 0.5 * (hull.min(axis=0) + hull.max(axis=0))) / (0.5 * sides)
    middles = 0.5 * (unit + np.roll(unit, 1, axis=0))
    radii = np.linalg.norm(np.concatenate([unit, middles]), axis=1)
    return bool(radii.min() > limits[0] and radii.max() < limits[1])


def vessel_parts(parts: Segmentation) -> list[PartProposal]:
    """Propose the bail of a bucket, otherwise the lid of a bottle, jar or pot."""
    vessel = find_vessel(parts)
    if vessel is None:
        return []
    bail = None if vessel.slender else _bail(parts, vessel)
    if bail is not None:
        return [bail]
    lid = _lid(parts, vessel)
    return [] if lid is None else [lid]


def _bail(parts: Segmentation, vessel: Vessel) -> PartProposal | None:
    """Return the shells that form an arch over the body from one side to the other."""
    cells, mesh = parts.shells, parts.mesh
    boxes, area = cells.boxes, cells.area
    sides = np.ptp(boxes, axis=1)
    off = np.linalg.norm(boxes.mean(axis=1)[:, :2] - vessel.centre[:2], axis=1)
    ring = (off < CENTRED * vessel.width) & (
        sides[:, :2].min(axis=1) > BAIL_SLIM * sides[:, :2].max(axis=1)
    )
    likely = (
        (area < BAIL_AREA * area.sum())
        & ~ring
        & (boxes[:, 0, 2] > vessel.box[0, 2] + 0.1 * vessel.height)
    )
    likely[vessel.shells] = False
    which = np.flatnonzero(likely)
    singles = [np.array([k]) for k in which]
    best: tuple[float, Ints, int] | None = None
    for groups in (singles, touching(parts, which)):
        for group in groups:
            found = _arch(boxes[group], vessel)
            if found is not None and (best is None or found[0] < best[0]):
                best = (found[0], group, found[1])
        if best is not None:
            break
    if best is None:
        return None
    _, group, axis = best
    box = np.stack([boxes[group, 0].min(axis=0), boxes[group, 1].max(axis=0)])
    inside = parts.inside(cells, box[0] - GRIP * vessel.width, box[1] + GRIP * vessel.width)
    inside = inside[likely[inside]]
    faces = parts.faces_of(cells, np.union1d(group, inside))
    points = mesh.triangles[parts.faces_of(cells, group)].reshape(-1, 3)
    low, high = points[:, axis].min(), points[:, axis].max()
    margin = 0.04 * (high - low)
    ends = points[(points[:, axis] < low + margin) | (points[:, axis] > high - margin)]
    pivot = np.array([*vessel.centre[:2], float(np.median(ends[:, 2]))])
    pivot[1 - axis] = float(np.median(ends[:, 1 - axis]))
    middle = points.mean(axis=0) - pivot
    sign = 1.0 if np.cross(np.eye(3)[axis], middle)[2] >= 0.0 else -1.0  # up first
    return PartProposal(
        kind="handle",
        faces=faces,
        joint="revolute",
        axis=sign * np.eye(3)[axis],
        pivot=pivot,
        upper=float(np.pi / 2),
        confidence=0.75,
        evidence=("an arch from one side of a round body to the other",),
    )


def _arch(boxes: Array, vessel: Vessel) -> tuple[float, int] | None:
    """Return the rank and the axis of an arch over the body; None if shells form none."""
    box = np.stack([boxes[:, 0].min(axis=0), boxes[:, 1].max(axis=0)])
    sides, body = np.ptp(box, axis=0), np.ptp(vessel.box, axis=0)
    axis = int(np.argmax(sides[:2]))
    slim = float(sides[1 - axis] / max(float(sides[axis]), 1e-9))
    wide = BAIL_WIDTH * body[axis] < sides[axis] < BAIL_WIDEST * body[axis]
    if not wide or slim > BAIL_SLIM:
        return None
    flat = sides[2] < 0.08 * sides[axis]
    offsets = box[:, 1 - axis] - vessel.centre[1 - axis]
    folded = np.abs(offsets).min() < CENTRED * sides[axis]  # a rim is on both sides
    folded &= np.abs(offsets).max() > 0.5 * OUTER * body[1 - axis]
    if flat and not folded and box[1, 2] < vessel.box[1, 2] + 0.02 * vessel.height:
        return None
    return slim + flat, axis  # raised bails come first


def _lid(parts: Segmentation, vessel: Vessel) -> PartProposal | None:
    """Return the centred parts at the top: a group of shells, or the facets above a ledge."""
    mesh = parts.mesh
    order = [(_above_body, 0.45), (_top_shells, 0.35), (_above_ledge, 0.5)]
    for find, most in [*order[:2][:: -1 if vessel.slender else 1], order[2]]:
        faces = find(parts, vessel)
        share = float(mesh.areas[faces].sum() / mesh.areas.sum()) if len(faces) else 0.0
        if not LEAST_LID < share < most:
            continue
        hinge = _hinge(parts, vessel, faces)
        if hinge is not None:
            return hinge
        corners = mesh.triangles[faces].reshape(-1, 3)
        return PartProposal(
            kind="lid",
            faces=faces,
            joint="prismatic",
            axis=np.array([0.0, 0.0, 1.0]),
            pivot=corners.mean(axis=0),
            upper=float(np.ptp(corners[:, 2])),
            confidence=0.7,
            evidence=("a centred part above a round body",),
        )
    return None


def _hinge(parts: Segmentation, vessel: Vessel, lid: Ints) -> PartProposal | None:
    """Return the lid with a hinge: short shells of lid and body at the rim, one on the other.

    The ears of a pot are on two sides, and its handle is longer.
    """
    mesh, boxes = parts.mesh, parts.shells.boxes
    radius = 0.5 * np.ptp(vessel.box[:, :2], axis=0)
    offset = (boxes.mean(axis=1) - vessel.centre)[:, :2] / radius
    far = np.linalg.norm(offset, axis=1)
    top, near = float(mesh.triangles[lid][..., 2].min()), 2.0 * parts.near
    above = boxes[:, 0, 2] > top - near
    short = (far > BEYOND[0]) & (far < BEYOND[1])
    upper = np.flatnonzero(short & above)
    small = np.ptp(boxes[..., 2], axis=1) < LOW * vessel.height
    near_rim = boxes[:, 1, 2] > top - HINGE * vessel.height
    lower = np.flatnonzero(short & small & ~above & near_rim)
    pairs = [
        (offset[u], boxes[u])
        for u in upper
        for b in lower
        if (boxes[u, 0] < boxes[b, 1] + near).all() and (boxes[b, 0] < boxes[u, 1] + near).all()
    ]
    if not pairs:
        return None
    middle = np.mean([offset for offset, _ in pairs], axis=0)
    if np.linalg.norm(middle) < BEYOND[0]:  # on two sides
        return None
    axis = int(np.argmax(np.abs(middle)))
    outward = np.sign(middle[axis]) * np.eye(3)[axis]
    pivot = vessel.centre + outward * radius[axis]
    pivot[2] = top
    return PartProposal(
        kind="lid",
        faces=np.union1d(lid, parts.faces_of(parts.shells, np.flatnonzero(above))),
        joint="revolute",
        axis=np.cross([0.0, 0.0, 1.0], outward),
        pivot=pivot,
        upper=QUARTER_RAD,
        confidence=0.7,
        evidence=("a hinge at the rim of a round body",),
    )


def _above_body(parts: Segmentation, vessel: Vessel) -> Ints:
    """Return the faces of all centred shells that begin at the top of the body (K,)."""
    boxes, mesh = parts.shells.boxes, parts.mesh
    off = np.linalg.norm(boxes.mean(axis=1)[:, :2] - vessel.centre[:2], axis=1)
    above = boxes[:, 0, 2] > vessel.box[1, 2] - 0.05 * vessel.height
    above &= off < OFF_CENTRE * vessel.width
    above[vessel.shells] = False
    faces = parts.faces_of(parts.shells, np.flatnonzero(above))
    corners = mesh.triangles[faces].reshape(-1, 3)
    if not len(faces) or np.ptp(corners[:, 2]) < 0.02 * mesh.size[2]:
        return np.zeros(0, dtype=np.int64)
    return faces


def _top_shells(parts: Segmentation, vessel: Vessel) -> Ints:
    """Return the faces of the shells at the top, and of those at the same height (K,)."""
    boxes, height = parts.shells.boxes, vessel.height
    off = np.linalg.norm(boxes.mean(axis=1)[:, :2] - vessel.centre[:2], axis=1)
    high = boxes[:, 0, 2] > vessel.box[0, 2] + LOW * height
    likely = (off < OFF_CENTRE * vessel.width) & high
    likely[vessel.shells] = False
    if not likely.any():
        return np.zeros(0, dtype=np.int64)
    top = float(boxes[likely, 1, 2].max())
    if top < parts.mesh.bounds[1, 2] - 0.1 * height:
        return np.zeros(0, dtype=np.int64)
    group = likely & (boxes[:, 1, 2] > top - 0.005 * height)
    while True:
        bottom = float(boxes[group, 0, 2].min())
        overlap = boxes[:, 1, 2] - np.maximum(boxes[:, 0, 2], bottom)
        tall = np.ptp(boxes[..., 2], axis=1)
        more = likely & (overlap > np.maximum(0.25 * tall, -1e-9)) & (boxes[:, 1, 2] > bottom)
        if top - bottom < SHALLOW * height:  # the ring of a cap below its top
            wide = np.ptp(boxes[..., :2], axis=1).max(axis=1)
            same = np.abs(wide - wide[group].max()) < 0.25 * wide[group].max()
            more |= likely & same & (np.abs(boxes[:, 1, 2] - bottom) < 0.01 * height)
        if not (more & ~group).any():
            return parts.faces_of(parts.shells, np.flatnonzero(group))
        group |= more


def _above_ledge(parts: Segmentation, vessel: Vessel) -> Ints:
    """Return the facets above the largest horizontal surface that faces down (K,)."""
    mesh, height = parts.mesh, vessel.height
    middle = mesh.triangles.mean(axis=1)[:, 2]
    down = (mesh.normals[:, 2] < -0.7) & (middle > vessel.box[0, 2] + LOW * height)
    if not down.any():
        return np.zeros(0, dtype=np.int64)
    bins = np.floor((middle - vessel.box[0, 2]) / (0.02 * height)).astype(np.int64)
    area = np.bincount(np.maximum(bins[down], 0), mesh.areas[down])
    if area.max() < LEDGE * vessel.width**2:
        return np.zeros(0, dtype=np.int64)
    ledge = float(middle[down & (bins == int(np.argmax(area)))].min())
    above = np.flatnonzero(parts.facets.boxes[:, 0, 2] > ledge - parts.near)
    faces = parts.faces_of(parts.facets, above)
    level = np.flatnonzero(middle > ledge - 0.5 * parts.near)
    if mesh.areas[faces].sum() < 0.5 * mesh.areas[level].sum():  # smooth: no creases at the ledge
        return level
    return faces
