"""Height map of an object seen along one direction, and the cells that fingers can hold."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter, minimum_filter

from articulate.transforms import Array

CELL_M = 0.004
"""Side of a cell of the map [m]."""
MAX_CELLS = 600_000
"""Most cells of a map; cells of larger parts are coarser. A ray takes about 400 bytes."""
RAYS_AT_ONCE = 100_000
"""Rays that are cast at once, which bounds the memory."""
OPENING_M = 0.07
"""Largest width that is held [m]; the Panda gripper opens to 0.08 m."""
FINGER_M = (0.020, 0.016)
"""Width of a finger along the handle and its thickness beside it [m]."""
HELD_M = 0.008
"""Least length along the handle that fingers hold [m]."""
PALM_M = (0.10, 0.035, 0.040)
"""Half length and half width of the palm, and its distance behind the pads [m]."""
MAX_BUMP_M = 0.03
"""Largest height between the fingers above the held ridge [m]."""


@dataclass(frozen=True, kw_only=True)
class HeightMap:
    """Heights seen along ``-normal``; rows run along ``u``, columns along ``v``."""

    normal: Array
    u: Array
    v: Array
    low: Array
    """Coordinates of cell (0, 0) along u and v (2,) [m]."""
    height: Array
    """Height along the normal (U, V) [m]; -inf where nothing is hit."""
    is_part: NDArray[np.bool_]
    """Cells that show the part to be held (U, V)."""
    is_named: NDArray[np.bool_]
    """Cells that show a piece named as a handle (U, V)."""
    cell_m: float = CELL_M
    """Side of a cell [m]."""


def height_map(
    surface: trimesh.Trimesh, owner: Array, normal: Array, u: Array, margin: float = 0.12
) -> HeightMap:
    """Cast rays at the object from above the part that is to be held.

    Args:
        surface: All triangles of the closed object [m].
        owner: Owner of each triangle, 0: another part, 1: the part, 2: its handle (F,).
        normal: Unit vector towards the viewer (3,).
        u: Unit vector of the first axis of the map, perpendicular to it (3,).
        margin: Border of the map around the part [m].
    """
    v = np.cross(normal, u)
    part = surface.vertices[np.unique(surface.faces[owner > 0])]
    flat = np.stack([part @ u, part @ v], axis=-1)
    low, high = flat.min(axis=0) - margin, flat.max(axis=0) + margin
    cell_m = max(CELL_M, math.sqrt(float(np.prod(high - low)) / MAX_CELLS))
    count = np.ceil((high - low) / cell_m).astype(int) + 1
    gu, gv = (g.ravel() for g in np.meshgrid(*map(np.arange, count), indexing="ij"))
    top = float((surface.vertices @ normal).max()) + 0.05
    height = np.full(gu.size, -np.inf)
    seen = np.zeros(gu.size, dtype=int)
    for first in range(0, gu.size, RAYS_AT_ONCE):
        some = slice(first, first + RAYS_AT_ONCE)
        origins = (
            (low[0] + cell_m * gu[some])[:, None] * u
            + (low[1] + cell_m * gv[some])[:, None] * v
            + top * normal
        )
        hits, rays, faces = surface.ray.intersects_location(
            origins, np.broadcast_to(-normal, origins.shape), multiple_hits=False
        )
        height[first + rays] = hits @ normal
        seen[first + rays] = owner[faces]
    shape = (int(count[0]), int(count[1]))
    return HeightMap(
        normal=normal,
        u=u,
        v=v,
        low=low,
        height=height.reshape(shape),
        is_part=(seen > 0).reshape(shape),
        is_named=(seen == 2).reshape(shape),
        cell_m=cell_m,
    )


def holdable_cells(
    view: HeightMap, *, closing: Literal["u", "v"], named: bool, bite_m: float
) -> list[tuple[int, int, int]]:
    """List cells that fit between fingers closing along an axis, with their width in cells.

    A cell is the middle of the held width; of each cell the narrowest width is listed.

    Args:
        view: Height map.
        closing: Axis along which the fingers close.
        named: Only cells of a piece named as a handle.
        bite_m: Least depth of the finger tips behind the front of the cell [m].
    """
    height = np.where(np.isfinite(view.height), view.height, -10.0)
    wanted = view.is_named if named else view.is_part
    if closing == "u":
        height, wanted = height.T, wanted.T
    cell = view.cell_m
    across = max(1, round(FINGER_M[0] / 2.0 / cell))
    thick = max(2, round(FINGER_M[1] / cell))
    palm = (2 * round(PALM_M[1] / cell) + 1, 2 * round(PALM_M[0] / cell) + 1)
    around = maximum_filter(height, size=palm, mode="nearest")
    rows = 2 * max(1, round(HELD_M / 2.0 / cell)) + 1
    ridge = minimum_filter(height, size=(rows, 1), mode="nearest")
    level = maximum_filter(height, size=(2 * across + 1, 1), mode="nearest")
    level = maximum_filter(level, size=(1, thick), mode="nearest")
    all_wanted = minimum_filter(wanted.astype(np.int8), size=(rows, 1), mode="constant") > 0
    clear = around - ridge <= PALM_M[2] - bite_m
    found: dict[tuple[int, int], int] = {}
    for width in range(1, int(OPENING_M / cell) + 1):
        half = width // 2
        odd = width % 2
        span = 2 * half + odd
        offset = half + 1
        left = _shifted(level, -(offset + thick // 2))
        right = _shifted(level, offset + thick // 2 - (1 - odd))
        deep = ridge - np.maximum(left, right) >= bite_m
        bump = maximum_filter(height, size=(rows, span), mode="nearest") - ridge
        for i, j in np.argwhere(deep & clear & all_wanted & (bump < MAX_BUMP_M)):
            found.setdefault((int(i), int(j)), span)
    if closing == "u":
        return [(j, i, width) for (i, j), width in found.items()]
    return [(i, j, width) for (i, j), width in found.items()]


def _shifted(field: Array, by: int) -> Array:
    """Return ``out[i, j] = field[i, j + by]``, edges repeated."""
    index = np.clip(np.arange(field.shape[1]) + by, 0, field.shape[1] - 1)
    return field[:, index]


def distances_to_run_middle(index: Array, axis: str, cell_m: float) -> Array:
    """Distance of each cell (N, 3) to the middle of its run along the handle (N,) [m], times 5."""
    row, column = (1, 0) if axis == "u" else (0, 1)
    out = np.zeros(len(index))
    for value in np.unique(index[:, column]):
        own = np.flatnonzero(index[:, column] == value)
        order = own[np.argsort(index[own, row])]
        for run in np.split(order, np.flatnonzero(np.diff(index[order, row]) > 1) + 1):
            middle = index[run, row].mean()
            out[run] = np.abs(index[run, row] - middle) * cell_m * 5.0
    return out


def run_length(index: Array, k: int, axis: str, cell_m: float) -> float:
    """Length along the handle of the run of cells (N, 3) that contains cell ``k`` [m]."""
    row, column = (1, 0) if axis == "u" else (0, 1)
    rows = set(index[index[:, column] == index[k, column], row].tolist())
    low = high = int(index[k, row])
    while low - 1 in rows:
        low -= 1
    while high + 1 in rows:
        high += 1
    return (high - low + 1) * cell_m + HELD_M
