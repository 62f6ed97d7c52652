"""Front panels: flat, nearly rectangular surfaces that close the front of an object."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from articulate.reconstruct.scan.cells import Cells
from articulate.reconstruct.scan.front_view import FrontView
from articulate.reconstruct.scan.scan_mesh import ScanMesh
from articulate.transforms import Array, Ints

MIN_SIDE = 0.022
"""Shortest side of a panel, as a share of the diagonal of the front."""
MIN_AREA = 0.006
"""Smallest panel, as a share of the front."""
MIN_FILL = 0.72
"""Smallest share of its rectangle that a panel covers; an ellipse covers 0.785."""
THIN = 0.22
"""A panel thicker than this share of the depth of the object is not a board."""
RECESS = 0.03
"""Depth of a recess within a panel, as a share of the diagonal of the object."""
PROUD = 0.004
"""Least height of a handle above its panel, as a share of the diagonal of the object."""
MAX_OVERLAP = 0.2
"""Largest overlap of two panels, as a share of the smaller one."""
FRAME_QUANTILE = 0.85
"""Quantile of the depth of a panel above which handles are: its frame may be proud of it."""
EDGE_SHARE = 0.8
"""A protrusion at an edge of the panel that spans more of it belongs to the neighbour."""
BEYOND = 0.8
"""So does one whose mirror image beyond the edge protrudes by this share: a door over a rail."""
RIM, DEEP, ENTIRE = 0.5, 0.5, 0.85
"""A surface over the entire front that covers less of its rectangle, of a shell deeper than the
second share of the object, is the rim of the body around an opening."""
DEEPEST, RECESSED = 0.55, 0.06
"""Panels farther behind the front than this share of the depth are backs of shelves, unless they
are within the second share of the diagonal of the front: a door in its frame, behind a knob."""
HANDLE_SHARE = 0.45
"""Largest share of a panel that a handle covers."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Handle:
    """Protrusion of a panel."""

    rect: Array
    """``(y0, z0, y1, z1)`` (4,) [m]."""
    height: float
    """Height above the panel [m]."""

    @property
    def centre(self) -> Array:
        """Centre in y and z (2,) [m]."""
        return np.asarray(0.5 * (self.rect[:2] + self.rect[2:]))

    @property
    def size(self) -> Array:
        """Sides in y and z (2,) [m]."""
        return np.asarray(self.rect[2:] - self.rect[:2])


@dataclass(frozen=True, kw_only=True, eq=False)
class Panel:
    """A flat surface that faces the front."""

    rect: Array
    """``(y0, z0, y1, z1)`` (4,) [m]."""
    front: float
    """Coordinate x of its surface [m]."""
    back: float
    """Coordinate x of its back [m]."""
    own: Ints
    """Faces of the cell that was found (K,)."""
    fill: float
    """Share of the rectangle that is covered."""
    thin: bool
    """True if its cell is a board; False if it is a face of a deeper cell."""
    score: float
    solid: float = 1.0
    """Share of the rectangle that its own cell covers; 0.3 for a rim around an opening."""
    board: bool = True
    """True if its surface ends at its outline; False if it continues as the body."""
    handles: tuple[Handle, ...] = field(default=())

    @property
    def size(self) -> Array:
        """Sides in y and z (2,) [m]."""
        return np.asarray(self.rect[2:] - self.rect[:2])

    @property
    def area(self) -> float:
        """Area of the rectangle [m2]."""
        return float(np.prod(self.size))

    @property
    def centre(self) -> Array:
        """Centre in y and z (2,) [m]."""
        return np.asarray(0.5 * (self.rect[:2] + self.rect[2:]))


def find_panels(mesh: ScanMesh, levels: Sequence[Cells], view: FrontView) -> list[Panel]:
    """Return the front panels that do not overlap, the best first.

    Args:
        mesh: The object; its front is +x.
        levels: Partitions of its faces, the coarsest first.
        view: Its front view.
    """
    found: list[Panel] = []
    shells = levels[0]
    deep = np.ptp(shells.boxes[..., 0], axis=1) > DEEP * mesh.size[0]
    for cells in levels:
        found += [
            _ranked(mesh, panel, deep[shells.label[panel.own[0]]])
            for panel in _of_level(mesh, cells, view)
        ]
    # Of nearly equal panels the outer one counts: a door rather than its pane.
    found.sort(key=lambda panel: (-round(panel.score, 1), -panel.area))
    kept: list[Panel] = []
    for panel in found:
        if all(overlap(panel.rect, other.rect) < MAX_OVERLAP for other in kept):
            kept.append(panel)
    return kept


def _ranked(mesh: ScanMesh, panel: Panel, deep: bool) -> Panel:
    """Return the panel, with a lower score for the rim of the body around an opening."""
    entire = (panel.size > ENTIRE * mesh.size[1:]).all()
    return (
        replace(panel, score=0.5 * panel.score) if entire and deep and panel.solid < RIM else panel
    )


def overlap(one: Array, other: Array) -> float:
    """Return the overlap of two rectangles as a share of the smaller one."""
    sides = np.minimum(one[2:], other[2:]) - np.maximum(one[:2], other[:2])
    if (sides <= 0.0).any():
        return 0.0
    areas = [float(np.prod(rect[2:] - rect[:2])) for rect in (one, other)]
    return float(np.prod(sides)) / max(min(areas), 1e-12)


def _of_level(mesh: ScanMesh, cells: Cells, view: FrontView) -> list[Panel]:
    label = np.where(view.face >= 0, cells.label[np.maximum(view.face, 0)], -1)
    pixels = np.bincount(label[label >= 0].ravel(), minlength=cells.count)
    low, size = mesh.bounds[0], mesh.size
    front_area = max(float(size[1] * size[2]), 1e-12)
    across = float(np.hypot(size[1], size[2]))
    side, deepest = MIN_SIDE * across, max(DEEPEST * float(size[0]), RECESSED * across)
    boxes = cells.boxes
    sides = boxes[:, 1, 1:] - boxes[:, 0, 1:]
    likely = (sides.min(axis=1) > side) & (sides.prod(axis=1) > MIN_AREA * front_area)
    likely &= pixels * view.pixel**2 > 0.25 * sides.prod(axis=1)
    found = []
    for k in np.flatnonzero(likely):
        rect = boxes[k][:, 1:].ravel()
        panel = _panel(mesh, cells, view, int(k), rect, label == k)
        if panel is not None and panel.front > low[0] + size[0] - deepest:
            found.append(panel)
    return found


def _panel(
    mesh: ScanMesh, cells: Cells, view: FrontView, k: int, rect: Array, own: NDArray[np.bool_]
) -> Panel | None:
    """Return the panel of a cell, None if it does not fill its rectangle or faces elsewhere."""
    rows, columns = view.window(rect)
    depth, own = view.depth[rows, columns], own[rows, columns]
    if own.size < 12 or not own.any():
        return None
    facing = np.abs(mesh.normals[view.face[rows, columns][own], 0])
    if float((facing > 0.8).mean()) < 0.5:
        return None
    front = float(np.median(depth[own]))
    tolerance = RECESS * mesh.diagonal
    covered = own | (depth > front - tolerance)
    fill = float(covered.mean())
    if fill < MIN_FILL or float((depth > front + 4.0 * tolerance).mean()) > 0.5:
        return None
    box = cells.boxes[k]
    thickness = float(np.quantile(depth[own], 0.9) - box[0, 0])
    thin = thickness < THIN * mesh.size[0]
    share = float(np.prod(rect[2:] - rect[:2]) / max(float(np.prod(mesh.size[1:])), 1e-12))
    score = fill * (1.0 if thin else 0.3) * (0.6 + 0.4 * min(share / 0.2, 1.0))
    back = float(box[0, 0]) if thin else front - 0.02 * mesh.diagonal
    return Panel(
        rect=rect,
        front=front,
        back=back,
        own=cells.members[k],
        fill=fill,
        thin=thin,
        score=score,
        solid=float(own.mean()),
        handles=handles_of(mesh, view, rect, depth, float(np.quantile(depth[own], FRAME_QUANTILE))),
    )


def handles_of(
    mesh: ScanMesh, view: FrontView, rect: Array, depth: Array, front: float
) -> tuple[Handle, ...]:
    """Return the protrusions of a panel, the largest first."""
    rows, columns = view.window(rect)
    proud = (depth > front + PROUD * mesh.diagonal).astype(np.uint8)
    count, labels, stats, _ = cv2.connectedComponentsWithStats(proud, connectivity=8)
    found = []
    for k in range(1, count):
        if stats[k, cv2.CC_STAT_AREA] < 4:
            continue
        mask = labels == k
        around = view.rect_of(mask, rows, columns)
        if _is_edge(around, rect, 1.5 * view.pixel) or _is_beyond(view, around, rect, front):
            continue
        share = float(
            np.prod(around[2:] - around[:2]) / max(float(np.prod(rect[2:] - rect[:2])), 1e-12)
        )
        if share < HANDLE_SHARE:
            found.append(Handle(rect=around, height=float(depth[mask].max() - front)))
    return tuple(sorted(found, key=lambda handle: -float(np.prod(handle.size))))


def _is_beyond(view: FrontView, around: Array, rect: Array, front: float) -> bool:
    """Return whether a protrusion at an edge of a rectangle goes on as far beyond this edge."""
    for edge in np.flatnonzero(np.abs(around - rect) < 1.5 * view.pixel):
        mirrored, axis = around.copy(), edge % 2
        mirrored[[axis, axis + 2]] = 2.0 * rect[edge] - around[[axis + 2, axis]]
        rows, columns = view.window(mirrored)
        depth = view.depth[rows, columns]
        if depth.size and float((depth > front).mean()) > BEYOND:
            return True
    return False


def _is_edge(around: Array, rect: Array, near: float) -> bool:
    """Return whether a rectangle is along an edge of another one and spans it."""
    share = (around[2:] - around[:2]) / (rect[2:] - rect[:2])
    touches = np.asarray((np.abs(around - rect) < near).reshape(2, 2).any(axis=0))  # y, z
    return bool((touches[1] and share[0] > EDGE_SHARE) or (touches[0] and share[1] > EDGE_SHARE))
