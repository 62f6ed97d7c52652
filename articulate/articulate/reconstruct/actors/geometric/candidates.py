"""Candidates: the slides and hinges that the shape of a part and of what is next to it suggests."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.spatial import ConvexHull, QhullError, cKDTree

from articulate.reconstruct.actors.geometric.surface import Surface
from articulate.transforms import Array, axis_angle_to_matrix, normalised, pose

SAME_AXIS_RAD = np.radians(4.0)
"""Axes nearer to each other than this are one candidate."""
CONTACT = 0.02
"""Points nearer to another part than this share of the object's size touch it."""
ENDS = 3.0
"""Per cent of a part's surface that are one of its ends."""
SAMPLES = 4000


@dataclass(frozen=True)
class Motion:
    """One way in which a part may move."""

    kind: Literal["slide", "turn"]
    axis_o: Array
    """Unit vector (3,)."""
    pivot_o: Array
    """A point on the axis (3,) [m]; for a slide the middle of the part."""
    source: str
    """Where the candidate comes from."""

    def T_o(self, q: Array) -> Array:
        """Poses (..., 4, 4) at positions ``q`` (...) [m or rad]."""
        q = np.asarray(q, dtype=np.float64)
        if self.kind == "slide":
            return pose(q[..., None] * self.axis_o)
        rot = axis_angle_to_matrix(np.broadcast_to(self.axis_o, (*q.shape, 3)), q)
        return pose(self.pivot_o - np.einsum("...ij,j->...i", rot, self.pivot_o), rot)


def axes_of(part: Surface) -> list[tuple[str, Array]]:
    """Directions (unit, with their source) along or about which a part may move."""
    found: list[tuple[str, Array]] = [(f"frame {n}", np.eye(3)[k]) for k, n in enumerate("xyz")]
    boxes = _box_axes(part)
    _add(found, (("box", axis) for axis in boxes))
    _add(found, (("box, across", axis) for axis in _across(boxes)))
    _add(found, (("face", axis) for axis in _face_axes(part, 3)))
    return found


def motions_of(part: Surface, rest: Surface, axes: list[tuple[str, Array]]) -> list[Motion]:
    """All candidates for the given axes."""
    scale = float(np.linalg.norm(np.ptp(part.points_o, axis=0)))
    middle = 0.5 * (part.points_o.min(axis=0) + part.points_o.max(axis=0))
    slides = [Motion("slide", axis, middle, name) for name, axis in axes]
    samples = sample(part)
    touching = contact_points(samples, rest, part)
    turns = []
    for name, axis in axes:
        for where, pivot in pivots_of(samples, touching, axis, 0.04 * scale):
            turns.append(Motion("turn", axis, pivot, f"{name}, {where}"))
    return slides + turns


def pivots_of(
    points: Array, touching: Array, axis: Array, same_m: float
) -> list[tuple[str, Array]]:
    """Points through which an axis may pass: corners, edges and middle of boxes around things."""
    across = plane_of(axis)
    found: list[tuple[str, Array]] = []
    flat: list[Array] = []
    groups = [("part", points)]
    if len(touching) >= 3:
        groups.append(("contact", touching))
    groups.append(("weight", points.mean(axis=0)[None]))
    groups.append(("ends", _ends(points @ axis, points)[None]))
    for name, group in groups:
        low, high = _flat_box(group @ across.T)
        for i, wi in enumerate(("low", "mid", "high")):
            for j, wj in enumerate(("low", "mid", "high")):
                spot2 = (
                    np.array([low[0], 0.5 * (low[0] + high[0]), high[0]])[i],
                    np.array([low[1], 0.5 * (low[1] + high[1]), high[1]])[j],
                )
                spot = np.array(spot2)
                if any(np.linalg.norm(spot - other) < same_m for other in flat):
                    continue
                flat.append(spot)
                along = axis * float(np.mean(points @ axis))
                found.append((f"{name} {wi} {wj}", across.T @ spot + along))
    return found


def _ends(along: Array, points: Array) -> Array:
    """Middle between the two ends of a part along an axis (3,): a handle of wire hangs there."""
    low, high = np.percentile(along, (ENDS, 100.0 - ENDS))
    return np.asarray(
        0.5 * (points[along <= low].mean(axis=0) + points[along >= high].mean(axis=0))
    )


def plane_of(axis: Array) -> Array:
    """Two unit vectors (2, 3) across ``axis`` and each other, along the frame's if they can be."""
    order = np.argsort(np.abs(axis))
    first = np.eye(3)[order[0]]
    first = normalised(first - axis * float(first @ axis))
    return np.stack([first, np.cross(axis, first)])


def sample(surface: Surface, n: int = SAMPLES, seed: int = 0) -> Array:
    """Points (n, 3) spread over a surface, each area alike."""
    rng = np.random.default_rng(seed)
    areas = surface.areas
    if areas.sum() <= 0.0:
        return surface.points_o
    chosen = rng.choice(len(areas), size=n, p=areas / areas.sum())
    a, b = rng.random((2, n, 1))
    flip = a + b > 1.0
    a, b = np.where(flip, 1.0 - a, a), np.where(flip, 1.0 - b, b)
    corners = surface.points_o[surface.faces[chosen]]
    return np.asarray(
        corners[:, 0] + a * (corners[:, 1] - corners[:, 0]) + b * (corners[:, 2] - corners[:, 0])
    )


def contact_points(samples: Array, rest: Surface, part: Surface) -> Array:
    """Those of the part's points that lie next to something else (K, 3)."""
    if not len(rest.faces):
        return np.empty((0, 3))
    everything = np.concatenate([part.points_o, rest.points_o])
    reach = CONTACT * float(np.linalg.norm(np.ptp(everything, axis=0)))
    distance, _ = cKDTree(sample(rest, 4 * SAMPLES)).query(samples, distance_upper_bound=reach)
    return np.asarray(samples[np.isfinite(distance)])


def _flat_box(points: Array) -> tuple[Array, Array]:
    return points.min(axis=0), points.max(axis=0)


def _add(found: list[tuple[str, Array]], more: Iterable[tuple[str, Array]]) -> None:
    for name, axis in more:
        if all(abs(float(axis @ other)) < np.cos(SAME_AXIS_RAD) for _, other in found):
            found.append((name, axis))


def _box_axes(part: Surface) -> list[Array]:
    """Axes of the smallest box: of the principal axes, and of the hull's smallest rectangle."""
    points = sample(part)
    centred = points - points.mean(axis=0)
    values, vectors = np.linalg.eigh(centred.T @ centred / len(points))
    axes = []
    # Where two principal moments are alike only the third axis means anything.
    for k in range(3):
        others = [values[j] for j in range(3) if j != k]
        if min(abs(values[k] - other) for other in others) > 0.08 * values[2]:
            axes.append(vectors[:, k])
    return axes


def _across(axes: list[Array]) -> list[Array]:
    """Directions across one of ``axes`` and one of the frame's that is square to it.

    A lever that leans is as wide as it is high, so that its box has one direction alone; it is
    as a rule symmetrical about a plane of the frame.
    """
    return [
        normalised(np.cross(axis, frame))
        for axis in axes
        for frame in np.eye(3)
        if abs(float(axis @ frame)) < np.sin(SAME_AXIS_RAD)
    ]


def _face_axes(part: Surface, n: int) -> list[Array]:
    """The directions in which most of the area looks, sign aside."""
    normals, areas = part.normals_o, part.areas.copy()
    axes = []
    for _ in range(n):
        if areas.sum() <= 0.0:
            break
        order = np.argsort(-areas)[:60]
        near = np.abs(normals @ normals[order].T) > np.cos(SAME_AXIS_RAD)
        score = areas @ near
        best = int(score.argmax())
        if score[best] < 0.12 * part.areas.sum():
            break
        mine = near[:, best]
        sign = np.sign(normals[mine] @ normals[order[best]])
        axes.append(normalised((normals[mine] * (sign * areas[mine])[:, None]).sum(axis=0)))
        areas[mine] = 0.0
    return axes


def hull_of(points: Array) -> Array:
    """Corners of the convex hull (K, 3); all points where they have none."""
    try:
        return np.asarray(points[ConvexHull(points).vertices])
    except QhullError:
        return points
