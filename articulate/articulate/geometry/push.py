"""Place on the front of a part that closed fingers push to close it."""

from __future__ import annotations

import numpy as np
import trimesh
from scipy.ndimage import maximum_filter, minimum_filter

from articulate.geometry.grasp import TIP_M, Grasp
from articulate.geometry.height_map import PALM_M, height_map
from articulate.transforms import Array, normalised

PAD_M = 0.012
"""Half the side of the flat patch that closed fingers touch [m]."""
LEVEL_M = 0.002
"""Largest height difference on that patch [m]."""
RADIUS = 0.85
"""Share of the largest radius at which a part that turns is pushed."""


def push_place(
    surface: trimesh.Trimesh, owner: Array, *, opening: Array, far_from: Array | None
) -> Grasp | None:
    """Return a flat place on the front of the closed part, or None if there is none.

    A part that slides is pushed at its middle, one that turns far from its axis.

    Args:
        surface: All triangles of the closed object, in the object frame [m].
        owner: Owner of each triangle, 0: another part, else the part (F,).
        opening: Unit vector in which the part begins to open (3,).
        far_from: Point and axis (2, 3) of a hinge.
    """
    up = np.eye(3)[2 if abs(opening[2]) < 0.9 else 0]
    up = normalised(up - (up @ opening) * opening)
    view = height_map(surface, owner, opening, up)
    cell = view.cell_m
    height = np.where(np.isfinite(view.height), view.height, -10.0)
    patch = 2 * max(1, round(PAD_M / cell)) + 1
    palm = 2 * round(PALM_M[0] / cell) + 1
    flat = maximum_filter(height, size=patch) - minimum_filter(height, size=patch) <= LEVEL_M
    own = minimum_filter(view.is_part.astype(np.int8), size=patch, mode="constant") > 0
    free = maximum_filter(height, size=palm, mode="nearest") - height <= PALM_M[2]
    cells = np.argwhere(flat & own & free)
    if not len(cells):
        return None
    heights = height[cells[:, 0], cells[:, 1]]
    at = view.low + cell * cells
    points = at[:, :1] * view.u + at[:, 1:] * view.v + heights[:, None] * view.normal
    part = surface.vertices[np.unique(surface.faces[owner > 0])]
    middle = 0.5 * (part.min(axis=0) + part.max(axis=0))
    if far_from is None:
        cost = np.linalg.norm(points - middle, axis=1)
    else:
        pivot, axis = far_from
        radius = np.linalg.norm(np.cross(points - pivot, axis), axis=1)
        cost = np.abs(radius - RADIUS * radius.max()) + 0.3 * np.abs((points - middle) @ axis)
    point = points[int(np.argmin(cost))]
    return Grasp(
        pos_o=point + TIP_M * opening,
        normal_o=opening,
        along_o=up,
        extent=(0.02, 0.02, 0.02),
        kind="push",
        named=False,
    )
