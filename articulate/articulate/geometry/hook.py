"""Place at which closed fingers hook a part: behind an edge, from which they pull it open."""

from __future__ import annotations

import numpy as np
import trimesh
from scipy.ndimage import maximum_filter, minimum_filter

from articulate.geometry.grasp import TIP_M, Grasp
from articulate.geometry.height_map import PALM_M, HeightMap, height_map
from articulate.transforms import Array, normalised

TIP_SIZE_M = (0.021, 0.036)
"""Size of closed finger tips along the pads and across them, from franka's finger.stl [m]."""
SLACK_M = 0.004
"""Room on each side of the fingers: the position of a handle is estimated to 4 mm [m]."""
ABOVE_M = 0.010
"""Distance of the tips to the surface behind the edge [m]."""
DEPTH_M = (0.010, 0.025)
"""Least depth of the tips behind the edge, and the depth that suffices [m]."""
NEAR_CELLS = 2
"""Cells between the room for the fingers and the edge, at most and one more."""


def hook_places(
    surface: trimesh.Trimesh, owner: Array, *, opening: Array, far_from: Array | None
) -> list[Grasp]:
    """Return places behind edges of the closed part, the best of each side, the best first.

    Fingers enter across the opening direction, from above, below or beside. A part that slides is
    pulled near its middle, one that turns far from its axis.

    Args:
        surface: All triangles of the closed object, in the object frame [m].
        owner: Owner of each triangle, 0: another part, else the part (F,).
        opening: Unit vector in which the part begins to open (3,).
        far_from: Point and axis (2, 3) of a hinge.
    """
    up = np.eye(3)[2 if abs(opening[2]) < 0.9 else 0]
    up = normalised(up - (up @ opening) * opening)
    side = np.cross(opening, up)
    part = surface.vertices[np.unique(surface.faces[owner > 0])]
    middle, size = 0.5 * (part.min(axis=0) + part.max(axis=0)), np.linalg.norm(np.ptp(part, axis=0))
    found: list[tuple[float, Grasp]] = []
    for normal in (up, -up, side, -side):
        view = height_map(surface, owner, normal, np.cross(opening, normal))
        depth, tip = _edges(view)
        cells = np.argwhere(depth >= DEPTH_M[0])
        if not len(cells):
            continue
        at = view.low + view.cell_m * cells
        heights = tip[cells[:, 0], cells[:, 1]]
        points = at[:, :1] * view.u + at[:, 1:] * view.v + heights[:, None] * normal
        if far_from is None:
            merit = -np.linalg.norm(points - middle, axis=1)
        else:
            radius = np.linalg.norm(np.cross(points - far_from[0], far_from[1]), axis=1)
            merit = radius - 0.3 * np.abs((points - middle) @ far_from[1])
        k = int(np.argmax(merit))
        deep = min(float(depth[cells[k, 0], cells[k, 1]]), DEPTH_M[1])
        grasp = Grasp(
            pos_o=points[k] + TIP_M * normal,
            normal_o=normal,
            along_o=opening,
            extent=(TIP_SIZE_M[0], 0.0, deep),
            kind="hook",
            named=False,
        )
        found.append((float(merit[k] / size), grasp))
    return [grasp for _, grasp in sorted(found, key=lambda pair: -pair[0])]


def _edges(view: HeightMap) -> tuple[Array, Array]:
    """Return the depth of tips behind an edge of the part and their height, for each cell [m].

    The opening direction is the second axis of the map. Cells without room have depth ``-inf``.
    """
    cell = view.cell_m
    height = np.where(np.isfinite(view.height), view.height, -10.0)
    across, along = (_cells(size + 2.0 * SLACK_M, cell) for size in TIP_SIZE_M[::-1])
    floor = maximum_filter(height, size=(across, along), mode="nearest")
    wall = np.where(view.is_part, height, -10.0)
    wall = minimum_filter(wall, size=(_cells(TIP_SIZE_M[0], cell), 1), mode="nearest")
    front = np.full_like(wall, -10.0)
    for shift in range(along // 2 + 1, along // 2 + 1 + NEAR_CELLS):
        front[:, :-shift] = np.maximum(front[:, :-shift], wall[:, shift:])
    tip = np.maximum(floor + ABOVE_M, front - DEPTH_M[1])
    palm = maximum_filter(
        height, size=tuple(2 * round(half / cell) + 1 for half in PALM_M[:2]), mode="nearest"
    )
    free = palm - tip <= TIP_M + PALM_M[2] - ABOVE_M
    return np.where(free & (front > -9.0), front - tip, -np.inf), tip


def _cells(length_m: float, cell_m: float) -> int:
    """Return the least odd number of cells that cover a length."""
    return 2 * int(np.ceil((length_m / cell_m - 1.0) / 2.0)) + 1
