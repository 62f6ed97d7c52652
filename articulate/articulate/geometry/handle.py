"""Where a hand can hold a moving part.

The whole closed object is looked at from outside along a direction of approach, as a map of
heights. A place can be held where two fingers fit beside something of at most the hand's
opening that stands out far enough between them. The opening direction is tried first, pieces
whose names say handle before all others; then the rims seen from the sides and from above.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter, minimum_filter

from articulate.geometry.rays import Surface
from articulate.robot.arm import PAD_M
from articulate.transforms import Array, normalised

OPENING_M = 0.07
"""Widest thing held; the Panda hand opens to 0.08 m."""
FINGER_M = (0.020, 0.016)
"""Width of a finger along the handle and its thickness beside it [m]."""
HELD_M = 0.008
"""Least length along the handle of what is held [m]."""
BITE_M = (0.012, 0.006)
"""Least depth of a finger tip behind the front of what is held: wanted, then accepted [m]."""
DEEP_M = 0.007
"""At least so far behind the front of what is held the middle of the pads goes, however thin that
is [m]: what slips while it is pulled slips out by the tips, and pads reach 8 mm to either side."""
DEEPEST_M = 0.010
"""Farthest behind the front of what is held that the middle of the pads goes [m]."""
TIP_M = 0.0128
"""How far the fingers go beyond the middle of the pads in all, by franka's finger.stl [m]."""
CLEAR_M = 0.005
"""So much room the tips keep to what stands behind the handle, where there is as much [m]."""
LEAST_BITE_M = 0.010
"""They go at least so far behind the front of what is held, or as far as there is room [m]."""
LATERAL_M = 0.045
"""So far from the middle of what is held the room for open fingers is looked at [m]."""
TOUCH_M = 0.001
"""Outlines of pieces that come as near as this to each other are of one thing [m]."""
CELL_M = 0.004
"""Resolution of the map."""
PALM_M = (0.10, 0.035, 0.040)
"""Half length and half width of the palm, and how far behind the pads it stands [m]."""


@dataclass(frozen=True, kw_only=True)
class Grasp:
    """A place to hold, in the object frame."""

    pos_o: Array
    normal_o: Array
    along_o: Array
    extent: tuple[float, float, float]
    kind: Literal["bar", "knob", "edge"]
    named: bool


@dataclass(frozen=True, kw_only=True)
class View:
    """Heights seen along ``-normal``; rows run along ``u``, columns along ``v``."""

    normal: Array
    u: Array
    v: Array
    low: Array
    """Coordinates of cell (0, 0) along u and v (2,) [m]."""
    height: Array
    """Along the normal (U, V) [m]; -inf where nothing is hit."""
    mine: NDArray[np.bool_]
    """The part that is to be held is what is seen (U, V)."""
    named: NDArray[np.bool_]
    """It is a piece whose name says handle (U, V)."""

    def point(self, i: int, j: int, height: float) -> Array:
        """The point of cell (i, j) at ``height``."""
        u, v = self.low + CELL_M * np.array([i, j])
        return np.asarray(u * self.u + v * self.v + height * self.normal)


def look(
    surface: trimesh.Trimesh, owner: Array, normal: Array, u: Array, margin: float = 0.12
) -> View:
    """Height map of the object over the part that is to be held.

    Args:
        surface: All triangles of the closed object.
        owner: For each of them 0: another part, 1: the part, 2: its handle (F,).
        normal: Towards the viewer (3,).
        u: First axis of the map, perpendicular to it (3,).
        margin: How far the map goes beyond the part [m].
    """
    v = np.cross(normal, u)
    mine = surface.vertices[np.unique(surface.faces[owner > 0])]
    flat = np.stack([mine @ u, mine @ v], axis=-1)
    low, high = flat.min(axis=0) - margin, flat.max(axis=0) + margin
    count = np.ceil((high - low) / CELL_M).astype(int) + 1
    gu, gv = np.meshgrid(np.arange(count[0]), np.arange(count[1]), indexing="ij")
    top = float((surface.vertices @ normal).max()) + 0.05
    origins = (
        (low[0] + CELL_M * gu.ravel())[:, None] * u
        + (low[1] + CELL_M * gv.ravel())[:, None] * v
        + top * normal
    )
    hits, rays, faces = surface.ray.intersects_location(
        origins, np.broadcast_to(-normal, origins.shape), multiple_hits=False
    )
    height = np.full(gu.size, -np.inf)
    who = np.zeros(gu.size, dtype=int)
    height[rays] = hits @ normal
    who[rays] = owner[faces]
    shape = (int(count[0]), int(count[1]))
    return View(
        normal=normal,
        u=u,
        v=v,
        low=low,
        height=height.reshape(shape),
        mine=(who > 0).reshape(shape),
        named=(who == 2).reshape(shape),
    )


def places(
    view: View, *, closing: Literal["u", "v"], named: bool, bite: float
) -> list[tuple[int, int, int]]:
    """Cells that can be held between fingers closing along an axis, with the width in cells.

    A cell is the middle of what is held; of each run of cells the narrowest width counts.
    """
    height = np.where(np.isfinite(view.height), view.height, -10.0)
    wanted = view.named if named else view.mine
    if closing == "u":
        height, wanted = height.T, wanted.T
    across = max(1, round(FINGER_M[0] / 2.0 / CELL_M))
    thick = max(2, round(FINGER_M[1] / CELL_M))
    palm = (2 * round(PALM_M[1] / CELL_M) + 1, 2 * round(PALM_M[0] / CELL_M) + 1)
    around = maximum_filter(height, size=palm, mode="nearest")
    rows = 2 * max(1, round(HELD_M / 2.0 / CELL_M)) + 1
    ridge = minimum_filter(height, size=(rows, 1), mode="nearest")
    level = maximum_filter(height, size=(2 * across + 1, 1), mode="nearest")
    level = maximum_filter(level, size=(1, thick), mode="nearest")
    whole = minimum_filter(wanted.astype(np.int8), size=(rows, 1), mode="constant") > 0
    clear = around - ridge <= PALM_M[2] - bite
    found: dict[tuple[int, int], int] = {}
    for width in range(1, int(OPENING_M / CELL_M) + 1):
        half = width // 2
        odd = width % 2
        span = 2 * half + odd
        offset = half + 1
        left = _shifted(level, -(offset + thick // 2))
        right = _shifted(level, offset + thick // 2 - (1 - odd))
        deep = ridge - np.maximum(left, right) >= bite
        level_between = maximum_filter(height, size=(rows, span), mode="nearest") - ridge < 0.03
        for i, j in np.argwhere(deep & clear & whole & level_between):
            found.setdefault((int(i), int(j)), span)
    if closing == "u":
        return [(j, i, width) for (i, j), width in found.items()]
    return [(i, j, width) for (i, j), width in found.items()]


def _shifted(field: Array, by: int) -> Array:
    """``out[i, j] = field[i, j + by]``, edges repeated."""
    index = np.clip(np.arange(field.shape[1]) + by, 0, field.shape[1] - 1)
    return field[:, index]


def refined(
    surface: trimesh.Trimesh, pos: Array, normal: Array, closing: Array
) -> tuple[float, float, float, float] | None:
    """Exact bounds of what is held in the plane through ``pos`` across the handle.

    Args:
        surface: Triangles of the part.
        pos: Somewhere in the front of what is held (3,).
        normal: Towards the hand (3,).
        closing: Axis along which fingers close (3,).

    Returns:
        Lowest and highest coordinate along ``closing`` and along ``normal``, or None.
    """
    along = np.cross(normal, closing)
    segments = trimesh.intersections.mesh_plane(surface, along, pos)
    if len(segments) == 0:
        return None
    points = segments.reshape(-1, 3)
    groups = _linked(segments)
    best: tuple[float, Array] | None = None
    for label in np.unique(groups):
        own = points.reshape(-1, 2, 3)[groups == label].reshape(-1, 3)
        c, n = (own - pos) @ closing, (own - pos) @ normal
        gap = float(max(c.min(), -c.max(), 0.0) + max(n.min(), -n.max(), 0.0))
        if best is None or gap < best[0] - 1e-6:
            best = (gap, own)
    if best is None or best[0] > 0.02:
        return None
    flat = (points - pos) @ np.column_stack([closing, normal])
    corners = [flat.reshape(-1, 2, 2)[groups == g].reshape(-1, 2) for g in np.unique(groups)]
    boxes = np.array([[c.min(axis=0), c.max(axis=0)] for c in corners])
    own = (best[1] - pos) @ np.column_stack([closing, normal])
    low, high = _grown(np.array([own.min(axis=0), own.max(axis=0)]), boxes)
    at = pos @ closing, pos @ normal
    return (
        float(at[0] + low[0]),
        float(at[0] + high[0]),
        float(at[1] + low[1]),
        float(at[1] + high[1]),
    )


def _grown(box: Array, boxes: Array) -> Array:
    """``box`` (2, 2) with all of ``boxes`` (N, 2, 2) that touch it, or one that does, and so on.

    What was decomposed into convex pieces has as many outlines. Where they make more than a hand
    can hold, they run on into the panel, and the one box counts.
    """
    out, left = box, boxes
    while len(left):
        touch = ((left[:, 0] <= out[1] + TOUCH_M) & (left[:, 1] >= out[0] - TOUCH_M)).all(axis=1)
        if not touch.any():
            break
        low, high = left[touch, 0].min(axis=0), left[touch, 1].max(axis=0)
        out, left = np.array([np.minimum(out[0], low), np.maximum(out[1], high)]), left[~touch]
    return out if out[1, 0] - out[0, 0] <= OPENING_M else box


def _linked(segments: Array) -> Array:
    """Label of the connected outline of each segment (S,)."""
    keys = np.unique(segments.reshape(-1, 3).round(5), axis=0, return_inverse=True)[1]
    edges = np.asarray(keys).reshape(-1, 2)
    labels = trimesh.graph.connected_component_labels(edges, node_count=int(edges.max()) + 1)
    return np.asarray(labels[edges[:, 0]])


def best_grasp(
    surface: trimesh.Trimesh,
    owner: Array,
    *,
    opening: Array,
    far_from: Array | None,
) -> Grasp | None:
    """The best place to hold a part, or None if there is none.

    Args:
        surface: All triangles of the closed object, in the object frame.
        owner: For each of them 0: another part, 1: the part, 2: its handle (F,).
        opening: Direction in which the part begins to open (3,).
        far_from: A point and an axis (2, 3) that the place should be far from: a hinge's.
    """
    up = np.array([0.0, 0.0, 1.0])
    if abs(opening @ up) > 0.9:
        up = np.array([1.0, 0.0, 0.0])
    up = normalised(up - (up @ opening) * opening)
    side = np.cross(opening, up)
    views: dict[int, View] = {}
    for named in (True, False) if (owner == 2).any() else (False,):
        for bite in BITE_M:
            found: list[tuple[float, Grasp]] = []
            for k, normal in enumerate((opening, up, -up, side, -side)):
                if k not in views:
                    views[k] = look(surface, owner, normal, up if k in {0, 3, 4} else side)
                found += _rated(views[k], surface, owner, opening, far_from, named=named, bite=bite)
                if found and k == 0:
                    break
            if found:
                return max(found, key=lambda pair: pair[0])[1]
    return None


def _rated(
    view: View,
    surface: trimesh.Trimesh,
    owner: Array,
    opening: Array,
    far_from: Array | None,
    *,
    named: bool,
    bite: float,
) -> list[tuple[float, Grasp]]:
    """Places in one view with a figure of merit, larger is better."""
    part = surface.submesh([owner > 0], append=True, repair=False)
    handle = surface.submesh([owner == 2], append=True, repair=False) if named else part
    centre = part.bounds.mean(axis=0)
    size = float(np.linalg.norm(np.ptp(part.bounds, axis=0)))
    out: list[tuple[float, Grasp]] = []
    edge = bool(abs(view.normal @ opening) < 0.5)
    closings: tuple[Literal["u", "v"], ...] = ("u", "v")
    for axis in closings:
        closing = view.u if axis == "u" else view.v
        if edge and abs(closing @ opening) < 0.5:
            continue  # a rim is held across its thickness
        cells = places(view, closing=axis, named=named, bite=bite)
        if not cells:
            continue
        index = np.array(cells)
        heights = view.height[index[:, 0], index[:, 1]]
        points = (
            (view.low[0] + CELL_M * index[:, 0])[:, None] * view.u
            + (view.low[1] + CELL_M * index[:, 1])[:, None] * view.v
            + heights[:, None] * view.normal
        )
        middle = _middle_of_runs(index, axis)
        merit = -np.linalg.norm(points - centre, axis=1) / size - 0.02 * index[:, 2] - middle
        if far_from is not None:
            offset = points - far_from[0]
            radius = np.linalg.norm(np.cross(offset, far_from[1]), axis=1)
            merit = radius / size - 0.02 * index[:, 2] - middle
        k = int(np.argmax(merit))
        length = _run_length(index, k, axis)
        level = abs(np.cross(closing, view.normal)[2]) < 0.5  # of equals the hand stays upright
        bonus = 0.2 * min(length / 0.1, 1.0) + (0.05 if level else 0.0)
        grasp = _measured(handle, points[k], view.normal, closing, length, edge=edge, named=named)
        if grasp is not None:
            grasp = between_pads(held_shallow(grasp, surface), handle)
            out.append((float(merit[k]) + bonus, grasp))
    return out


def held_shallow(grasp: Grasp, surface: trimesh.Trimesh) -> Grasp:
    """The grasp drawn back as far as finger tips need to clear what stands behind the handle.

    Args:
        grasp: A place to hold.
        surface: All triangles of the closed object, in the object frame.
    """
    front = grasp.pos_o + held_depth(grasp.extent[2]) * grasp.normal_o
    free_m = room_behind(surface, front, grasp.normal_o, grasp.along_o, grasp.extent[1])
    free_m = max(free_m, BITE_M[1])  # the map has found as much beside it
    depth = held_depth(grasp.extent[2], free_m)
    return replace(grasp, pos_o=front - depth * grasp.normal_o)


def between_pads(grasp: Grasp, part: trimesh.Trimesh) -> Grasp:
    """The grasp with its middle and thickness those of what the pads reach.

    A lid that does not lie quite flat is as thick as it rises over all of its depth, and fingers
    close on its rim alone.

    Args:
        grasp: A place to hold.
        part: Triangles of the part, in the object frame.
    """
    closing = np.cross(grasp.normal_o, grasp.along_o)
    segments = trimesh.intersections.mesh_plane(part, grasp.along_o, grasp.pos_o)
    flat = (segments - grasp.pos_o) @ np.column_stack([closing, grasp.normal_o])
    ends = np.array([end for one in flat if (end := _clipped(one, PAD_M)) is not None])
    half = grasp.extent[1] / 2.0 + TOUCH_M
    across = ends[..., 0].ravel() if len(ends) else np.zeros(0)
    across = across[np.abs(across) <= half]
    if not len(across) or np.ptp(across) <= 0.0:
        return grasp
    low, high = float(across.min()), float(across.max())
    long, _, deep = grasp.extent
    middle = grasp.pos_o + 0.5 * (low + high) * closing
    return replace(grasp, pos_o=middle, extent=(long, high - low, deep))


def _clipped(segment: Array, reach: float) -> Array | None:
    """What of a segment (2, 2) has a second coordinate of at most ``reach``, either sign."""
    (a, b), rise = segment, segment[1, 1] - segment[0, 1]
    if abs(rise) < 1e-12:
        return segment if abs(a[1]) <= reach else None
    first, last = sorted(((-reach - a[1]) / rise, (reach - a[1]) / rise))
    first, last = max(first, 0.0), min(last, 1.0)
    return None if first > last else np.array([a + first * (b - a), a + last * (b - a)])


def held_depth(thick_m: float, free_m: float = math.inf) -> float:
    """How far behind the front of what is held the middle of the pads goes [m].

    Args:
        thick_m: Depth of what is held along the approach [m].
        free_m: Room for finger tips behind its front [m].
    """
    wanted = min(max(thick_m / 2.0, DEEP_M), DEEPEST_M)
    return min(wanted, max(free_m - CLEAR_M, min(LEAST_BITE_M, free_m)) - TIP_M)


def room_behind(
    surface: trimesh.Trimesh, front: Array, normal: Array, along: Array, width_m: float
) -> float:
    """How far fingers beside a handle can go behind its front before they meet anything [m].

    Args:
        surface: All triangles of the closed object.
        front: Middle of the front of what is held (3,).
        normal: Towards the hand (3,).
        along: Long axis of the handle (3,).
        width_m: What the fingers close on [m].
    """
    across = np.cross(normal, along)
    half = FINGER_M[0] / 2.0
    low = np.array([-half, -LATERAL_M, -(DEEPEST_M + TIP_M + CLEAR_M)])
    high = np.array([half, LATERAL_M, BITE_M[0]])
    placed = (np.asarray(surface.triangles) - front) @ np.column_stack([along, across, normal])
    near = ((placed.min(axis=1) <= high) & (placed.max(axis=1) >= low)).all(axis=1)
    if not near.any():
        return math.inf
    first = min(width_m / 2.0 + FINGER_M[1] / 4.0, LATERAL_M)
    beside = np.linspace(first, LATERAL_M, 8)
    grid = np.meshgrid(np.linspace(-half, half, 5), np.r_[-beside, beside], [0.0], indexing="ij")
    points = np.stack([g.ravel() for g in grid], axis=1)
    local = trimesh.Trimesh(**trimesh.triangles.to_kwargs(placed[near]), process=False)
    up = np.tile([0.0, 0.0, 1.0], (len(points), 1))
    depths = Surface(local).depths(points + BITE_M[0] * up, up) - BITE_M[0]
    return max(float(depths.min()), 0.0)


def _middle_of_runs(index: Array, axis: str) -> Array:
    """Distance [m, weighted] of each cell from the middle of its run along the handle (N,)."""
    row, column = (1, 0) if axis == "u" else (0, 1)
    out = np.zeros(len(index))
    for value in np.unique(index[:, column]):
        own = np.flatnonzero(index[:, column] == value)
        order = own[np.argsort(index[own, row])]
        for run in np.split(order, np.flatnonzero(np.diff(index[order, row]) > 1) + 1):
            middle = index[run, row].mean()
            out[run] = np.abs(index[run, row] - middle) * CELL_M * 5.0
    return out


def _run_length(index: Array, k: int, axis: str) -> float:
    row, column = (1, 0) if axis == "u" else (0, 1)
    rows = set(index[index[:, column] == index[k, column], row].tolist())
    low = high = int(index[k, row])
    while low - 1 in rows:
        low -= 1
    while high + 1 in rows:
        high += 1
    return (high - low + 1) * CELL_M + HELD_M


def _measured(
    surface: trimesh.Trimesh,
    point: Array,
    normal: Array,
    closing: Array,
    length: float,
    *,
    edge: bool,
    named: bool,
) -> Grasp | None:
    """The grasp at ``point`` with exact position and extent from a cut through the part."""
    along = normalised(np.cross(closing, normal))
    cut = refined(surface, point - 0.002 * normal, normal, closing)
    front = float(point @ normal)
    if cut is None:
        low, high, back = (
            float(point @ closing) - 0.005,
            float(point @ closing) + 0.005,
            front - 0.02,
        )
    else:
        low, high, back = cut[0], cut[1], cut[2]
        front = cut[3]
        if high - low > OPENING_M:  # the cut runs on into the panel: keep to the map
            low, high = _width_at(surface, point, normal, closing)
    across = np.asarray(surface.vertices) @ along
    middle = float(across.min() + across.max()) / 2.0
    if abs(middle - float(point @ along)) > 2.0 * CELL_M:
        middle = float(point @ along)
    depth = front - back
    hold = front - held_depth(depth)
    pos = middle * along + (low + high) / 2.0 * closing + hold * normal
    kind: Literal["bar", "knob", "edge"] = "knob"
    if edge:
        kind = "edge"
    elif length >= max(0.045, 1.3 * (high - low)):
        kind = "bar"
    extent = (length, high - low, min(depth, 0.05))
    return Grasp(pos_o=pos, normal_o=normal, along_o=along, extent=extent, kind=kind, named=named)


def _width_at(
    surface: trimesh.Trimesh, point: Array, normal: Array, closing: Array
) -> tuple[float, float]:
    """Both sides of what stands out at ``point``, found by rays from beside it."""
    inside = point - 0.006 * normal
    out = []
    for sign in (-1.0, 1.0):
        origin = inside + sign * (OPENING_M / 2.0 + 0.005) * closing
        hits, _, _ = surface.ray.intersects_location(
            origin[None], -sign * closing[None], multiple_hits=False
        )
        out.append(float(hits[0] @ closing) if len(hits) else float(point @ closing))
    return min(out), max(out)
