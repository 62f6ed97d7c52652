"""Clauses ``check_cavities`` and ``fingers``: what is hollow to the eye is hollow to the engine."""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from articulate.assets.asset import Handle, handle_frame
from articulate.assets.check_report import Check
from articulate.checks.model import Data, ObjectModel
from articulate.checks.solids import Solid, inside_any, solids_of, unknown_shape
from articulate.checks.surface import escapes, is_near, winding_numbers
from articulate.checks.visual_collision import surface_of
from articulate.transforms import Array, Ints, Mask, apply, inverse

SAMPLES = 2000
"""Points in the convex hull of what a link shows."""
HOLLOW = 0.5
"""Points with a smaller winding number lie in the cavity."""
LEAST_WIDTH_M = 0.01
"""Links thinner than this hold nothing, whatever their back looks like [m]."""
LEAST_CAVITY = 0.05
"""Links whose cavity is a smaller share of their hull count as solid."""
BALL_M = 0.01
"""A cavity in which no ball of this diameter has room holds nothing: gaps between keys [m]."""
LEAST_ROOM = 0.01
"""Least share of the hull in which the middle of such a ball can lie."""
SURE = 2.0
"""By so many standard errors of the sample it has to be more: a keyboard of 0.8 % had 0.8 and 1.3 %
of 2,000 points, as it was turned."""
ALLOWED_OPEN = 0.85
"""Least share of the cavity that must lie outside the collision shapes."""

WALL_M = (0.001, 0.003)
"""Shapes may take at least and at most this much room beside what is seen [m] ..."""
WALL_SHARE = 0.015
"""... and between them this share of a link's diagonal."""

FINGER_M = 0.008
"""Room that a finger needs beside a handle [m]."""
FINGER_WIDTH_M = 0.02
"""Width of a finger along the handle [m]."""
REACH_M = 0.1
"""Room beyond this is not measured [m]."""


Solids = Mapping[str, tuple[Solid, ...]]
"""The collision shapes of each link."""


def check_cavities(model: ObjectModel) -> tuple[Check, ...]:
    """How much of each link's cavity the engine leaves free, and room for fingers."""
    solids = {link.name: solids_of(model, link.name) for link in model.asset.links}
    hollow = [_open(model, name, own) for name, own in solids.items()]
    data = model.data()
    return (*hollow, *(_fingers(model, data, handle, solids) for handle in model.asset.handles))


def _open(model: ObjectModel, link: str, solids: tuple[Solid, ...]) -> Check:
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
    free = ~inside_any(solids, cavity)
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
    """Whether ``share`` of a sample of ``count`` points is surely more than ``LEAST_ROOM``."""
    return share - SURE * math.sqrt(share * (1.0 - share) / count) > LEAST_ROOM


def cavity_points(model: ObjectModel, link: str) -> Array:
    """Points (N, 3) [m] in the cavity of ``link``, not at its walls, which have some thickness.

    They are others than those that judge it.
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
    """What a link shows, told from another by its content."""

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
    """Points (N, 3) in the hull of a surface, and which of them lie in a cavity (N,).

    Kept, for shapes are made more than once for the same surface.
    """
    points = hull_points(ConvexHull(surface.corners), SAMPLES)
    return points, is_cavity(points, surface.corners[surface.faces])


def _not_hollow(link: str, message: str) -> Check:
    return Check(name="cavities", outcome="not_applicable", subject=link, message=message)


def is_cavity(points: Array, triangles: Array) -> Mask:
    """Whether ``points`` (N, 3) in the hull of ``triangles`` lie in a hollow that is open (N,).

    The winding number says what lies outside the material. Where a mesh is turned inside out in
    places it says so of solid parts, too; from inside those no ray gets out, so that a point
    counts only if one does. A void that is closed all round is no cavity, then.
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
    """Least distance of two parallel planes that hold ``hull`` between them, one along a face."""
    planes = np.unique(hull.equations.round(9), axis=0)
    corners = hull.points[hull.vertices]
    return float(-(corners @ planes[:, :3].T + planes[:, 3]).min(axis=0).max(initial=-np.inf))


def hull_points(hull: ConvexHull, count: int, *, seed: int = 0) -> Array:
    """Up to ``count`` points (N, 3) spread evenly in ``hull``, others for each ``seed``."""
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


def _fingers(model: ObjectModel, data: Data, handle: Handle, solids: Solids) -> Check:
    """Room on both sides of a handle, where the fingers of a gripper go, all joints closed."""
    T_oh = model.T_ol(data, handle.link) @ handle_frame(handle)
    room = min(_room(model, data, T_oh, handle, side, solids) for side in (-1.0, 1.0))
    passed = room >= FINGER_M
    most = " or more" if room >= REACH_M else ""
    message = (
        f"{handle.name}, a {handle.kind}: {1000 * room:.0f} mm{most} free beside it for fingers"
    )
    if not passed:
        message += f"; {1000 * FINGER_M:.0f} mm are needed to hold it with everything closed"
    return Check(
        name="finger_clearance",
        outcome="passed" if passed else "not_applicable",
        subject=handle.joint,
        measured=room,
        allowed=FINGER_M,
        unit="m",
        message=message,
    )


def _room(
    model: ObjectModel, data: Data, T_oh: Array, handle: Handle, side: float, solids: Solids
) -> float:
    """Free way [m] from the handle's flank along its closing axis, at most ``REACH_M``."""
    along = min(FINGER_WIDTH_M, handle.extent[0]) / 2.0
    steps = np.arange(0.0005, REACH_M, 0.001)
    least = REACH_M
    for x in (-along, 0.0, along):
        points_h = np.zeros((len(steps), 3))
        points_h[:, 0] = x
        points_h[:, 1] = side * (handle.extent[1] / 2.0 + steps)
        taken = np.zeros(len(steps), dtype=bool)
        for link in model.asset.links:
            T_lh = inverse(model.T_ol(data, link.name)) @ T_oh
            taken |= inside_any(solids[link.name], apply(T_lh, points_h))
        if taken.any():
            least = min(least, float(steps[int(taken.argmax())]))
    return least
