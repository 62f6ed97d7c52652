"""Closed lids on top of a container, and doors that are ajar."""

from __future__ import annotations

import cv2
import numpy as np
import trimesh
from scipy.spatial import cKDTree

from articulate.reconstruct.scan.cells import components, edges_of
from articulate.reconstruct.scan.front_view import heights_above
from articulate.reconstruct.scan.part_proposal import QUARTER_RAD, PartProposal
from articulate.reconstruct.scan.scan_mesh import ScanMesh
from articulate.reconstruct.scan.segmentation import Segmentation
from articulate.transforms import Array, Ints

COVER = 0.8
"""Least share of the width and depth of the object that a lid covers."""
LID_HEIGHT = (0.015, 0.45)
"""Height of a lid, as a share of the height of the object."""
LID_BOTTOM = 0.5
"""Least height of the lower side of a lid, as a share of the height of the object."""
COVERED, GAP = "a cover on top of a container", "a level gap through a container"
LEAST_GAP = 0.002
"""Least height of a gap below a lid, as a share of the height of the object."""
WALL = 0.35
"""Least share of each side of a container that is closed."""
MARGIN = 0.15
"""Distance of a wall from the outline of the object, as a share of its width or depth."""
CLOSED_DEPTH, CLOSED_SHARE = 0.3, 0.75
"""Share of the front view of a container that is within this share of its depth."""
FLAP_AREA, MOST_FLAPS = 0.03, 4
"""Least area of an open flap, as a share of the object, and the largest number of them."""
ONLY_FLAPS = 0.8
"""Least area of the flaps, as a share of all that is above or outside the rim."""
LEAST_RIM = 0.2
"""Least height of the rim of an open container, as a share of the height of the object."""
INSIDE, OPEN_DEPTH = 0.8, 0.7
"""Share of each side of an open container that is inside, and of its height below which most of it
is seen from above."""
LOWER = 0.4
"""Share of the height of walls whose outline is that of a container."""
WALL_LEAN = 0.1
"""Largest vertical part of the normals of a wall."""
UPRIGHT = 0.25
"""Least reach of an open flap beyond the walls, as a share of its shorter side."""
LEAST_EDGE = 0.4
"""Least length of the lower edge of an open flap less its gap to the rim, as a share of its longest
side."""
WIDEST_RAD = 2.5 * QUARTER_RAD
"""Usual limit of a flap, from its closed pose."""
AJAR = (float(np.radians(7.0)), float(np.radians(83.0)))
"""Angles of a door that is ajar to the front and sides of the object."""
DOOR_HEIGHT = 0.4
"""Least height of a door that is ajar, as a share of the height of the object."""
SLIM = 0.2
"""Largest ratio of thickness to width of a door that is ajar."""
DOOR_AREA = 0.04
"""Least area of a shell of a door that is ajar, as a share of the object."""
FRAME_AREA = 0.02
"""Least area of a shell of a frame, as a share of the object; smaller ones touch a larger one, as
hinges do and latches of the door do not."""
SAMPLES, TOUCHING = 4000, 0.015
"""Points on the large shells of a frame, and the largest distance of a shell that touches them, as
a share of the diagonal."""
HANDLE_REACH = 0.12
"""Height of handles over a door that is ajar, as a share of its width."""


def closed_lid(parts: Segmentation) -> list[PartProposal]:
    """Propose the shells on top of a container as its lid, hinged at the back."""
    bottom = _cover_bottom(parts)
    return [] if bottom is None else _lid_above(parts, bottom, COVERED)


def lid_above_gap(parts: Segmentation) -> list[PartProposal]:
    """Propose all shells above a level gap through a closed container as its lid."""
    boxes, low, size = parts.shells.boxes, parts.mesh.bounds[0], parts.mesh.size
    order = np.argsort(boxes[:, 0, 2], kind="stable")
    bottoms, tops = boxes[order, 0, 2], np.maximum.accumulate(boxes[order, 1, 2])
    gaps = np.flatnonzero(bottoms[1:] - tops[:-1] > LEAST_GAP * size[2])
    for k in gaps:
        bottom, upper = float(bottoms[k + 1]), boxes[order[k + 1 :]]
        share = (low[2] + size[2] - bottom) / size[2]
        sides = upper[:, 1].max(axis=0) - upper[:, 0].min(axis=0)
        if LID_HEIGHT[0] < share < LID_HEIGHT[1] and (sides[:2] > COVER * size[:2]).all():
            found = _lid_above(parts, bottom, GAP)
            if found:
                return found
    return []


def _cover_bottom(parts: Segmentation) -> float | None:
    """Return the lower end of a shell that covers the object [m]; None without one."""
    mesh, boxes = parts.mesh, parts.shells.boxes
    size, low = mesh.size, mesh.bounds[0]
    sides = np.ptp(boxes, axis=1)
    likely = (sides[:, 0] > COVER * size[0]) & (sides[:, 1] > COVER * size[1])
    likely &= (sides[:, 2] > LID_HEIGHT[0] * size[2]) & (sides[:, 2] < LID_HEIGHT[1] * size[2])
    likely &= boxes[:, 0, 2] > low[2] + LID_BOTTOM * size[2]
    return float(boxes[likely, 0, 2].min()) if likely.any() else None


def _lid_above(parts: Segmentation, bottom: float, evidence: str) -> list[PartProposal]:
    """Propose the shells above a height as the lid of a closed container."""
    mesh, cells = parts.mesh, parts.shells
    above = np.flatnonzero(cells.boxes[:, 0, 2] > bottom - parts.near)
    faces = parts.faces_of(cells, above)
    rest = np.setdiff1d(np.arange(len(mesh.faces)), faces)
    if not len(rest) or not _is_container(parts, rest, bottom) or not _is_closed(parts, bottom):
        return []
    corners = mesh.triangles[faces].reshape(-1, 3)
    pivot = np.array([corners[:, 0].min(), corners[:, 1].mean(), bottom])
    return [
        PartProposal(
            kind="lid",
            faces=faces,
            joint="revolute",
            axis=np.array([0.0, -1.0, 0.0]),
            pivot=pivot,
            upper=QUARTER_RAD,
            confidence=0.55,
            evidence=(evidence,),
            hollow=True,
        )
    ]


def _is_container(parts: Segmentation, rest: Ints, top: float, box: Array | None = None) -> bool:
    """Return whether faces close all four sides of a box, by default the object, below ``top``."""
    mesh = parts.mesh
    low, high = mesh.bounds if box is None else box
    height = top - float(low[2])
    centres = mesh.triangles.mean(axis=1)[rest]
    for axis, other in ((0, 1), (1, 0)):
        outward = np.abs(mesh.normals[rest, axis])
        margin = MARGIN * (high - low)[axis]
        for near in (centres[:, axis] < low[axis] + margin, centres[:, axis] > high[axis] - margin):
            area = (mesh.areas[rest] * outward)[near].sum()
            if area < WALL * height * (high - low)[other]:
                return False
    return True


def _is_closed(parts: Segmentation, top: float) -> bool:
    """Return whether the front view shows a closed surface below ``top``."""
    view, (low, high) = parts.view, parts.mesh.bounds
    rows, columns = view.window(np.array([low[1], low[2], high[1], top]))
    depth = view.depth[rows, columns]
    near = depth > high[0] - CLOSED_DEPTH * (high[0] - low[0])
    return bool(near.size and near.mean() > CLOSED_SHARE)


def open_flaps(parts: Segmentation) -> list[PartProposal]:
    """Propose the plates above or outside the rim of a container as open flaps.

    The lowest possible rim counts: an upright flap looks like a part of its wall.
    """
    return next((found for box in _walls(parts) if (found := _flaps_at(parts, box))), [])


def _flaps_at(parts: Segmentation, box: Array) -> list[PartProposal]:
    """Return the open flaps of a container with its walls in a box (2, 3) [m]."""
    mesh, cells = parts.mesh, parts.facets
    rim, slack = float(box[1, 2]), 0.02 * float(mesh.size[2])
    sides = np.sort(np.ptp(cells.boxes, axis=1), axis=1)
    outer = np.maximum(box[0, :2] - cells.boxes[:, 0, :2], cells.boxes[:, 1, :2] - box[1, :2])
    outside = (outer.max(axis=1) > UPRIGHT * sides[:, 1]) & (cells.boxes[:, 1, 2] > rim - slack)
    upper = (mesh.triangles[..., 2] > rim - slack).all(axis=1) | outside[cells.label]
    found = [
        flap
        for faces in _plates(parts, np.flatnonzero(upper))
        if (flap := _open_flap(parts, faces, box)) is not None
    ]
    body = np.flatnonzero(~upper)
    covered = sum(float(mesh.areas[flap.faces].sum()) for flap in found)
    if not 0 < len(found) <= MOST_FLAPS or covered < ONLY_FLAPS * mesh.areas[upper].sum():
        return []
    if not _is_container(parts, body, rim, box):
        return []
    return found if _is_open_above(mesh.select(body), box) else []


def _is_open_above(body: ScanMesh, box: Array) -> bool:
    """Return whether most of the inside of a box of walls (2, 3) is lower than its rim."""
    height = heights_above(body, box, INSIDE)
    return bool(height.size and (height < box[0, 2] + OPEN_DEPTH * np.ptp(box[:, 2])).mean() > 0.5)


def _walls(parts: Segmentation) -> list[Array]:
    """Return boxes (2, 3) of the upright facets from the floor up to each possible rim [m]."""
    mesh, cells = parts.mesh, parts.facets
    floor, height = float(mesh.bounds[0, 2]), float(mesh.size[2])
    lean = np.bincount(cells.label, mesh.areas * np.abs(mesh.normals[:, 2]), cells.count)
    walls = (lean < WALL_LEAN * cells.area) & (cells.area > FLAP_AREA * cells.area.sum())
    reach, rims = floor + 0.1 * height, []
    for bottom, top in sorted(zip(*cells.boxes[walls, :, 2].T, strict=True)):  # one upon another
        if bottom < reach + parts.near:
            reach = max(reach, float(top))
            rims.append(float(top))
    found: list[Array] = []
    for rim in sorted(rims):
        if rim < floor + LEAST_RIM * height or (found and rim < found[-1][1, 2] + parts.near):
            continue
        lower = mesh.triangles[mesh.triangles[..., 2].mean(axis=1) < floor + LOWER * (rim - floor)]
        corners = lower.reshape(-1, 3)
        if len(corners):
            high = np.r_[corners[:, :2].max(axis=0), rim]
            found.append(np.stack([corners.min(axis=0), high]))
    return found


def _plates(parts: Segmentation, faces: Ints) -> list[Ints]:
    """Group faces that share an edge, and those of both sides of one plate."""
    if not len(faces):
        return []
    upper = parts.mesh.select(faces)
    cells = components(upper, edges_of(upper), colour=False)
    merged: list[tuple[Array, list[Ints]]] = []
    for box, members in zip(cells.boxes, cells.members, strict=True):
        same = [m for m in merged if (np.abs(m[0] - box) < 4.0 * parts.near).all()]
        if same:
            same[0][1].append(faces[members])
        else:
            merged.append((box, [faces[members]]))
    return [np.sort(np.concatenate(members)) for _, members in merged]


def _open_flap(parts: Segmentation, faces: Ints, walls: Array) -> PartProposal | None:
    """Return a plate at the rim of a container as a flap that turns about its edge at the rim.

    Args:
        parts: The object.
        faces: Faces of the plate.
        walls: Box of the walls of the container (2, 3) [m].
    """
    mesh = parts.mesh
    if mesh.areas[faces].sum() < FLAP_AREA * mesh.areas.sum():
        return None
    points = mesh.triangles[faces].reshape(-1, 3)
    _, _, axes = np.linalg.svd(points - points.mean(axis=0), full_matrices=False)
    thickness, width, length = np.sort(np.ptp(points @ axes.T, axis=0))
    outside = np.maximum(walls[0] - points, points - walls[1])
    if thickness > SLIM * length or width < SLIM * length or outside.max() < UPRIGHT * width:
        return None
    ends = [_foot(points, walls, axis, sign) for axis in (0, 1) for sign in (1.0, -1.0)]
    edge, inward, foot = max(ends, key=lambda end: end[0])
    if edge < LEAST_EDGE * length:
        return None
    middle = 0.5 * (foot.min(axis=0) + foot.max(axis=0))
    direction = points.mean(axis=0) - middle
    opened = float(np.arctan2(direction[2], direction @ inward)) % (2.0 * np.pi)
    return PartProposal(
        kind="flap",
        faces=faces,
        joint="revolute",
        axis=np.cross(inward, [0.0, 0.0, 1.0]),
        pivot=middle,
        lower=-opened,
        upper=max(WIDEST_RAD - opened, 0.1),
        confidence=0.6,
        evidence=("a plate above the rim of a container",),
    )


def _frame(parts: Segmentation, rest: Ints) -> Ints:
    """Return the faces of what carries a door that is ajar: large shells and those that touch them.

    Args:
        parts: The object.
        rest: Faces that are not of the door.
    """
    mesh, shells = parts.mesh, parts.shells
    label = shells.label[rest]
    large = shells.area > FRAME_AREA * mesh.areas.sum()
    if not large[label].any():
        return rest
    surface = trimesh.Trimesh(mesh.vertices, mesh.faces[rest[large[label]]], process=False)
    points, _ = trimesh.sample.sample_surface(surface, SAMPLES, seed=0)
    distance, _ = cKDTree(points).query(mesh.triangles[rest].mean(axis=1))
    gap = np.full(shells.count, np.inf)
    np.minimum.at(gap, label, distance)
    near = gap < TOUCHING * mesh.diagonal
    return np.asarray(rest[(large | near)[label]])


def _foot(points: Array, walls: Array, axis: int, sign: float) -> tuple[float, Array, Array]:
    """Return the edge of a plate at one side of a rim.

    Returns:
        The length of the edge less its gap to the rim [m], the inward direction of this side (3,),
        and the points of the edge (K, 3).
    """
    across = 1 - axis
    wall = walls[0 if sign > 0.0 else 1, across]
    gap = np.abs(points[:, 2] - walls[1, 2]) + np.abs(points[:, across] - wall)
    foot = points[gap <= gap.min() + 0.1 * np.ptp(gap)]
    length = float(np.ptp(foot[:, axis]) - gap.min())
    return length, sign * np.eye(3)[across], foot


def ajar_door(parts: Segmentation) -> list[PartProposal]:
    """Propose an upright slab that is turned against the object as an open door."""
    mesh, cells = parts.mesh, parts.shells
    boxes = cells.boxes
    tall = np.ptp(boxes[..., 2], axis=1) > DOOR_HEIGHT * mesh.size[2]
    for k in np.argsort(-cells.area, kind="stable")[:6]:
        if not tall[k] or cells.area[k] < DOOR_AREA * cells.area.sum():
            continue
        points = mesh.triangles[cells.members[k]].reshape(-1, 3)
        (cx, cy), (w, h), degrees = cv2.minAreaRect(points[:, :2].astype(np.float32))
        angle = float(np.radians(degrees))
        if w < h:
            w, h, angle = h, w, angle + QUARTER_RAD
        if h > SLIM * w or not AJAR[0] < angle % QUARTER_RAD < AJAR[1]:
            continue
        along = np.array([np.cos(angle), np.sin(angle)])
        return _ajar(parts, points, np.array([cx, cy]), along, (w, h))
    return []


def _ajar(
    parts: Segmentation, points: Array, centre: Array, along: Array, sides: tuple[float, float]
) -> list[PartProposal]:
    """Return the door of all cells within an upright slab, and with its handles."""
    mesh = parts.mesh
    across = np.array([-along[1], along[0]])
    flat = mesh.triangles[..., :2] - centre
    reach = 0.5 * sides[1] + HANDLE_REACH * sides[0]
    inside = (np.abs(flat @ along) < 0.5 * sides[0] + parts.near).all(axis=1)
    inside &= (np.abs(flat @ across) < reach).all(axis=1)
    low, high = float(points[:, 2].min()), float(points[:, 2].max())
    z = mesh.triangles[..., 2]
    inside &= ((z > low - parts.near) & (z < high + parts.near)).all(axis=1)
    cells = parts.facets
    share = np.bincount(cells.label, mesh.areas * inside, cells.count) / np.maximum(
        cells.area, 1e-300
    )
    faces = np.flatnonzero(share[cells.label] > 0.95)
    rest = np.setdiff1d(np.arange(len(mesh.faces)), faces)
    if not len(faces) or not len(rest):
        return []
    others = mesh.triangles[_frame(parts, rest)].reshape(-1, 3)
    ends = [centre + sign * 0.5 * sides[0] * along for sign in (-1.0, 1.0)]
    gaps = [float(np.linalg.norm(others[:, :2] - end, axis=1).min()) for end in ends]
    middle = others[:, :2].mean(axis=0)
    far = [float(np.linalg.norm(end - middle)) for end in ends]
    hinge = int(np.argmin([gap + 0.1 * d for gap, d in zip(gaps, far, strict=True)]))
    towards = ends[1 - hinge] - ends[hinge]
    # Closed, the door is along y; it opens to the front.
    side = 1.0 if towards[1] > 0.0 else -1.0
    opened = float(np.arctan2(towards[0], abs(towards[1])))
    return [
        PartProposal(
            kind="door",
            faces=faces,
            joint="revolute",
            axis=np.array([0.0, 0.0, -side]),
            pivot=np.array([*ends[hinge], 0.5 * (low + high)]),
            lower=-max(opened, 0.0),
            upper=max(QUARTER_RAD - opened, 0.1),
            confidence=0.7,
            evidence=("an upright slab turned against the object",),
        )
    ]
