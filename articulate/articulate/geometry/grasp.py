"""Grasp of a moving part by a parallel gripper, found on a height map.

The closed object is viewed from outside along a direction of approach (:mod:`height_map`). A
place can be held where two fingers fit beside something of at most the gripper's opening that
protrudes far enough between them. The opening direction is tried first, pieces named as handles
before all others; then the rims seen from the sides and from above.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import trimesh

from articulate.geometry.height_map import (
    FINGER_M,
    OPENING_M,
    HeightMap,
    distances_to_run_middle,
    height_map,
    holdable_cells,
    run_length,
)
from articulate.geometry.rays import Surface
from articulate.robot.arm import PAD_M
from articulate.transforms import Array, normalised

BITE_M = (0.012, 0.006)
"""Least depth of a finger tip behind the front of the handle: preferred, then accepted [m]."""
DEEP_M = 0.007
"""Least depth of the middle of the pads behind the front of the handle, however thin it is [m]: a
handle that slips while it is pulled slips out by the tips, and pads reach 8 mm to either side."""
DEEPEST_M = 0.010
"""Largest depth of the middle of the pads behind the front of the handle [m]."""
TIP_M = 0.0128
"""Length of the fingers beyond the middle of the pads, from franka's finger.stl [m]."""
CLEAR_M = 0.005
"""Distance of the tips to the surface behind the handle, if there is room [m]."""
LEAST_BITE_M = 0.010
"""Least depth of the tips behind the front of the handle, or as much as there is room [m]."""
LATERAL_M = 0.045
"""Distance from the middle of the handle up to which open fingers need room [m]."""
TOUCH_M = 0.001
"""Outlines of pieces at most this far apart belong to one thing [m]."""
MAX_GAP_M = 0.02
"""Largest distance between a map cell and the outline that belongs to it [m]."""
MAX_DEPTH_M = 0.05
"""Largest depth of a handle along the approach that is recorded [m]."""
INNER, INNER_COST = 0.6, 2.0
"""A rim of a part that turns is also held at this share of the largest radius, where its path is
shorter; the cost puts it last."""


@dataclass(frozen=True, kw_only=True)
class Grasp:
    """Place to hold, in the object frame."""

    pos_o: Array
    """Middle between the pads (3,) [m]."""
    normal_o: Array
    """Unit vector towards the gripper (3,)."""
    along_o: Array
    """Unit vector along the handle (3,)."""
    extent: tuple[float, float, float]
    """Size along ``along_o``, the closing axis and ``normal_o`` [m]."""
    kind: Literal["bar", "knob", "edge", "push", "hook", "none"]
    """``push``: a place that closed fingers push; ``hook``: one behind an edge that they pull;
    ``none``: an outermost point that fingers cannot hold."""
    named: bool
    """True on a piece named as a handle."""


def outline_bounds(
    surface: trimesh.Trimesh, pos: Array, normal: Array, closing: Array
) -> tuple[float, float, float, float] | None:
    """Exact bounds of the handle in the plane through ``pos`` across it.

    Args:
        surface: Triangles of the part [m].
        pos: A point near the front of the handle (3,) [m].
        normal: Unit vector towards the gripper (3,).
        closing: Unit vector along which the fingers close (3,).

    Returns:
        Lowest and highest coordinate along ``closing`` and along ``normal`` [m], or None.
    """
    along = np.cross(normal, closing)
    segments = trimesh.intersections.mesh_plane(surface, along, pos)
    if len(segments) == 0:
        return None
    points = segments.reshape(-1, 3)
    groups = _connected(segments)
    best: tuple[float, Array] | None = None
    for label in np.unique(groups):
        own = points.reshape(-1, 2, 3)[groups == label].reshape(-1, 3)
        c, n = (own - pos) @ closing, (own - pos) @ normal
        gap = float(max(c.min(), -c.max(), 0.0) + max(n.min(), -n.max(), 0.0))
        if best is None or gap < best[0] - 1e-6:
            best = (gap, own)
    if best is None or best[0] > MAX_GAP_M:
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
    """Merge ``box`` (2, 2) with those of ``boxes`` (N, 2, 2) that touch it, and so on.

    A part decomposed into convex pieces has as many outlines. If the merged box is wider than the
    gripper opens, the outlines continue into the panel, and the original box is returned.
    """
    out, left = box, boxes
    while len(left):
        touch = ((left[:, 0] <= out[1] + TOUCH_M) & (left[:, 1] >= out[0] - TOUCH_M)).all(axis=1)
        if not touch.any():
            break
        low, high = left[touch, 0].min(axis=0), left[touch, 1].max(axis=0)
        out, left = np.array([np.minimum(out[0], low), np.maximum(out[1], high)]), left[~touch]
    return out if out[1, 0] - out[0, 0] <= OPENING_M else box


def _connected(segments: Array) -> Array:
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
    """Return the best place to hold a part, or None; see :func:`grasp_candidates`."""
    return next(grasp_candidates(surface, owner, opening=opening, far_from=far_from), None)


def grasp_candidates(
    surface: trimesh.Trimesh,
    owner: Array,
    *,
    opening: Array,
    far_from: Array | None,
) -> Iterator[Grasp]:
    """Yield places to hold a part, the best first: pieces named as handles, the front, the rims.

    Args:
        surface: All triangles of the closed object, in the object frame [m].
        owner: Owner of each triangle, 0: another part, 1: the part, 2: its handle (F,).
        opening: Unit vector in which the part begins to open (3,).
        far_from: Point and axis (2, 3) of a hinge, from which the grasp should be far.
    """
    up = np.array([0.0, 0.0, 1.0])
    if abs(opening @ up) > 0.9:
        up = np.array([1.0, 0.0, 0.0])
    up = normalised(up - (up @ opening) * opening)
    side = np.cross(opening, up)
    normals = (opening, up, -up, side, -side)
    views: dict[int, HeightMap] = {}
    for named in (True, False) if (owner == 2).any() else (False,):
        for bite in BITE_M:
            for group in ((0,), (1, 2, 3, 4)):
                found: list[tuple[float, Grasp]] = []
                for k in group:
                    if k not in views:
                        u = up if k in {0, 3, 4} else side
                        views[k] = height_map(surface, owner, normals[k], u)
                    found += _rated(
                        views[k], surface, owner, opening, far_from, named=named, bite=bite
                    )
                yield from (grasp for _, grasp in sorted(found, key=lambda pair: -pair[0]))


def outermost_point(points: Array, opening: Array) -> Grasp:
    """Return the outermost point along the opening direction; fingers cannot hold it.

    Args:
        points: Vertices of the part in the object frame (N, 3) [m].
        opening: Unit vector in which the part begins to open (3,).
    """
    height = points @ opening
    top = points[height >= height.max() - 0.005].mean(axis=0)
    other = np.array([0.0, 0.0, 1.0]) if abs(opening[2]) < 0.9 else np.array([1.0, 0.0, 0.0])
    return Grasp(
        pos_o=top,
        normal_o=opening,
        along_o=normalised(np.cross(opening, other)),
        extent=(0.02, 0.02, 0.02),
        kind="none",
        named=False,
    )


def _rated(
    view: HeightMap,
    surface: trimesh.Trimesh,
    owner: Array,
    opening: Array,
    far_from: Array | None,
    *,
    named: bool,
    bite: float,
) -> list[tuple[float, Grasp]]:
    """Grasps in one view with a figure of merit, larger is better."""
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
        cells = holdable_cells(view, closing=axis, named=named, bite_m=bite)
        if not cells:
            continue
        index = np.array(cells)
        heights = view.height[index[:, 0], index[:, 1]]
        points = (
            (view.low[0] + view.cell_m * index[:, 0])[:, None] * view.u
            + (view.low[1] + view.cell_m * index[:, 1])[:, None] * view.v
            + heights[:, None] * view.normal
        )
        middle = distances_to_run_middle(index, axis, view.cell_m)
        merit = -np.linalg.norm(points - centre, axis=1) / size - 0.02 * index[:, 2] - middle
        if far_from is not None:
            offset = points - far_from[0]
            radius = np.linalg.norm(np.cross(offset, far_from[1]), axis=1)
            merit = radius / size - 0.02 * index[:, 2] - middle
        level = abs(np.cross(closing, view.normal)[2]) < 0.5  # prefer an upright gripper
        best = int(np.argmax(merit))
        picks = [(best, 0.0)]
        if edge and far_from is not None and (inner := radius <= INNER * radius[best]).any():
            picks.append((int(np.argmax(np.where(inner, merit, -np.inf))), INNER_COST))
        for k, cost in picks:
            length = run_length(index, k, axis, view.cell_m)
            bonus = 0.2 * min(length / 0.1, 1.0) + (0.05 if level else 0.0)
            grasp = _measured(
                handle,
                points[k],
                view.normal,
                closing,
                length,
                edge=edge,
                named=named,
                cell_m=view.cell_m,
            )
            grasp = between_pads(clear_of_surface(grasp, surface), handle)
            out.append((float(merit[k]) + bonus - cost, grasp))
    return out


def clear_of_surface(grasp: Grasp, surface: trimesh.Trimesh) -> Grasp:
    """Move a grasp back until the finger tips clear the surface behind the handle.

    Args:
        grasp: A place to hold.
        surface: All triangles of the closed object, in the object frame [m].
    """
    front = grasp.pos_o + held_depth(grasp.extent[2]) * grasp.normal_o
    free_m = room_behind(surface, front, grasp.normal_o, grasp.along_o, grasp.extent[1])
    free_m = max(free_m, BITE_M[1])  # the map has found as much beside it
    depth = held_depth(grasp.extent[2], free_m)
    return replace(grasp, pos_o=front - depth * grasp.normal_o)


def between_pads(grasp: Grasp, part: trimesh.Trimesh) -> Grasp:
    """Centre a grasp on the section that the pads reach, with its thickness.

    A slightly tilted lid is as thick as it rises over its depth, but fingers close on its rim.

    Args:
        grasp: A place to hold.
        part: Triangles of the part, in the object frame [m].
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
    """Part of a segment (2, 2) whose second coordinate is at most ``reach`` in magnitude."""
    (a, b), rise = segment, segment[1, 1] - segment[0, 1]
    if abs(rise) < 1e-12:
        return segment if abs(a[1]) <= reach else None
    first, last = sorted(((-reach - a[1]) / rise, (reach - a[1]) / rise))
    first, last = max(first, 0.0), min(last, 1.0)
    return None if first > last else np.array([a + first * (b - a), a + last * (b - a)])


def held_depth(thick_m: float, free_m: float = math.inf) -> float:
    """Depth of the middle of the pads behind the front of the handle [m].

    Args:
        thick_m: Depth of the handle along the approach [m].
        free_m: Room for finger tips behind its front [m].
    """
    preferred = min(max(thick_m / 2.0, DEEP_M), DEEPEST_M)
    return min(preferred, max(free_m - CLEAR_M, min(LEAST_BITE_M, free_m)) - TIP_M)


def room_behind(
    surface: trimesh.Trimesh, front: Array, normal: Array, along: Array, width_m: float
) -> float:
    """Distance that fingers beside a handle can move behind its front without contact [m].

    Args:
        surface: All triangles of the closed object [m].
        front: Middle of the front of the handle (3,) [m].
        normal: Unit vector towards the gripper (3,).
        along: Unit vector of the long axis of the handle (3,).
        width_m: Width between the fingers [m].
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


def _measured(
    surface: trimesh.Trimesh,
    point: Array,
    normal: Array,
    closing: Array,
    length: float,
    *,
    edge: bool,
    named: bool,
    cell_m: float,
) -> Grasp:
    """Grasp at ``point`` with exact position and extent from a section through the part."""
    along = normalised(np.cross(closing, normal))
    section = outline_bounds(surface, point - 0.002 * normal, normal, closing)
    front = float(point @ normal)
    if section is None:
        low, high = float(point @ closing) - 0.005, float(point @ closing) + 0.005
        back = front - 0.02
    else:
        low, high, back, front = section
        if high - low > OPENING_M:  # the section continues into the panel: use the map
            low, high = _width_at(surface, point, normal, closing)
    across = np.asarray(surface.vertices) @ along
    middle = float(across.min() + across.max()) / 2.0
    if abs(middle - float(point @ along)) > 2.0 * cell_m:
        middle = float(point @ along)
    depth = front - back
    hold = front - held_depth(depth)
    pos = middle * along + (low + high) / 2.0 * closing + hold * normal
    kind: Literal["bar", "knob", "edge"] = "knob"
    if edge:
        kind = "edge"
    elif length >= max(0.045, 1.3 * (high - low)):
        kind = "bar"
    extent = (length, high - low, min(depth, MAX_DEPTH_M))
    return Grasp(pos_o=pos, normal_o=normal, along_o=along, extent=extent, kind=kind, named=named)


def _width_at(
    surface: trimesh.Trimesh, point: Array, normal: Array, closing: Array
) -> tuple[float, float]:
    """Both sides of the protrusion at ``point``, found by rays from beside it [m]."""
    inside = point - 0.006 * normal
    out = []
    for sign in (-1.0, 1.0):
        origin = inside + sign * (OPENING_M / 2.0 + 0.005) * closing
        hits, _, _ = surface.ray.intersects_location(
            origin[None], -sign * closing[None], multiple_hits=False
        )
        out.append(float(hits[0] @ closing) if len(hits) else float(point @ closing))
    return min(out), max(out)
