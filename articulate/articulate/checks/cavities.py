"""Check ``cavities``: collision shapes leave visible cavities open."""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from articulate.assets.check_report import Check
from articulate.checks.model import ObjectModel
from articulate.checks.solids import inside_any, solids_of, unknown_shape
from articulate.checks.surface import escapes, is_near, winding_numbers
from articulate.checks.visual_collision import surface_of
from articulate.transforms import Array, Ints, Mask

SAMPLES = 2000
"""Sample points in the convex hull of a link's visual geometry."""
HOLLOW = 0.5
"""Points with a smaller winding number are in the cavity."""
LEAST_WIDTH_M = 0.01
"""Links thinner than this have no cavity [m]."""
LEAST_CAVITY = 0.05
"""Links whose cavity is a smaller fraction of their hull count as solid."""
BALL_M = 0.01
"""Diameter of a ball that must fit into a cavity, unlike into gaps between keys [m]."""
LEAST_ROOM = 0.01
"""Least fraction of the hull in which the centre of such a ball fits."""
SURE = 2.0
"""Standard errors of the sample by which it must be exceeded: a keyboard of 0.8 % measured 0.8 and
1.3 % with 2,000 points, depending on its orientation."""
ALLOWED_OPEN = 0.85
"""Least fraction of the cavity outside the collision shapes."""

WALL_M = (0.001, 0.003)
"""Least and largest thickness that shapes may have beside visible surfaces [m] ..."""
WALL_SHARE = 0.015
"""... and between them this fraction of the diagonal of the link."""


def check_cavities(model: ObjectModel) -> tuple[Check, ...]:
    """Measure the free fraction of each link's cavity."""
    return tuple(_open(model, link.name) for link in model.asset.links)


def _open(model: ObjectModel, link: str) -> Check:
    unknown = unknown_shape(model, link)
    if unknown:
        return Check(name="cavities", outcome="failed", subject=link, message=unknown)
    corners, faces = surface_of(model, link)
    hull = _hull(corners)
    if hull is None:
        return _not_hollow(link, f"{link} has no volume")
    if width(hull) < LEAST_WIDTH_M:
        return _not_hollow(link, f"{link} is thinner than {1000 * LEAST_WIDTH_M:.0f} mm")
    points, inside = _cavity(_Surface(corners=corners, faces=faces))
    cavity = points[inside]
    share = len(cavity) / len(points)
    if share <= LEAST_CAVITY:
        return _not_hollow(link, f"{link} is solid: its cavity is {share:.1%} of its convex hull")
    room = float((~is_near(cavity, corners[faces], BALL_M / 2.0)).sum()) / len(points)
    if not has_room(room, len(points)):
        return _not_hollow(
            link,
            f"{link} has only gaps: a ball of {1000 * BALL_M:.0f} mm has room in {room:.1%} of its "
            f"convex hull, of which {share:.0%} is cavity",
        )
    free = ~inside_any(solids_of(model, link), cavity)
    measured = float(free.mean())
    passed = measured >= ALLOWED_OPEN
    message = f"{measured:.1%} of the cavity of {link} ({share:.0%} of its hull) is free"
    if not passed:
        message += ": its collision shapes seal it; decompose it more finely"
    return Check(
        name="cavities",
        outcome="passed" if passed else "failed",
        subject=link,
        measured=measured,
        allowed=ALLOWED_OPEN,
        unit="1",
        message=message,
    )


def has_room(share: float, count: int) -> bool:
    """Return whether a fraction of ``count`` points significantly exceeds ``LEAST_ROOM``."""
    return share - SURE * math.sqrt(share * (1.0 - share) / count) > LEAST_ROOM


def cavity_points(model: ObjectModel, link: str) -> Array:
    """Sample points (N, 3) [m] in the cavity of ``link``, except at its walls.

    They differ from the points of the check.
    """
    corners, faces = surface_of(model, link)
    hull = _hull(corners)
    if hull is None:
        return np.zeros((0, 3))
    points = hull_points(hull, SAMPLES, seed=1)
    points = points[is_cavity(points, corners[faces])]
    diagonal_m = float(np.linalg.norm(np.ptp(corners, axis=0)))
    wall_m = float(np.clip(WALL_SHARE * diagonal_m, *WALL_M))
    return np.asarray(points[~is_near(points, corners[faces], wall_m)])


@dataclass(frozen=True, kw_only=True, eq=False)
class _Surface:
    """Visual surface of a link, compared by content."""

    corners: Array
    faces: Ints

    def __hash__(self) -> int:
        return hash((self.corners.tobytes(), self.faces.tobytes()))

    def __eq__(self, other: object) -> bool:
        return (
            isinstance(other, _Surface)
            and np.array_equal(self.corners, other.corners)
            and np.array_equal(self.faces, other.faces)
        )


@functools.lru_cache(maxsize=64)
def _cavity(surface: _Surface) -> tuple[Array, Mask]:
    """Return points (N, 3) [m] in the hull of a surface, and a mask (N,) of those in a cavity.

    Cached, as shapes are computed several times for the same surface.
    """
    points = hull_points(ConvexHull(surface.corners), SAMPLES)
    return points, is_cavity(points, surface.corners[surface.faces])


def _not_hollow(link: str, message: str) -> Check:
    return Check(name="cavities", outcome="not_applicable", subject=link, message=message)


def is_cavity(points: Array, triangles: Array) -> Mask:
    """Return a mask (N,) of ``points`` (N, 3) [m] in an open cavity of ``triangles`` (F, 3, 3) [m].

    Points with a small winding number are outside the material. Where parts of a mesh are
    inverted this holds for solid parts as well; no ray escapes from those, so a point counts
    only if one does. A closed void is therefore no cavity.
    """
    hollow = np.abs(winding_numbers(points, triangles)) < HOLLOW
    found = np.flatnonzero(hollow)
    hollow[found] = escapes(points[found], triangles)
    return np.asarray(hollow)


def _hull(corners: Array) -> ConvexHull | None:
    if len(corners) < 4:
        return None
    try:
        return ConvexHull(corners)
    except (QhullError, ValueError):
        return None


def width(hull: ConvexHull) -> float:
    """Return the least distance of two parallel planes around ``hull``, one on a face [m]."""
    planes = np.unique(hull.equations.round(9), axis=0)
    corners = hull.points[hull.vertices]
    return float(-(corners @ planes[:, :3].T + planes[:, 3]).min(axis=0).max(initial=-np.inf))


def hull_points(hull: ConvexHull, count: int, *, seed: int = 0) -> Array:
    """Sample up to ``count`` points (N, 3) uniformly in ``hull`` [m], seeded by ``seed``."""
    planes = np.unique(hull.equations.round(9), axis=0)
    rng = np.random.default_rng(seed)
    low, high = hull.min_bound, hull.max_bound
    found = np.zeros((0, 3))
    for _ in range(50):
        points = rng.uniform(low, high, (2 * count, 3))
        inside = (points @ planes[:, :3].T + planes[:, 3] <= 0.0).all(axis=1)
        found = np.vstack([found, points[inside]])
        if len(found) >= count:
            break
    return found[:count]
