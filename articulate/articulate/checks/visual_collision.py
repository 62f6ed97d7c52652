"""Detect crossings of the authored (visual) surfaces of two parts."""

from __future__ import annotations

import numpy as np

from articulate.checks.distances import Overlap, Shapes
from articulate.checks.model import Data, ObjectModel
from articulate.checks.triangles import triangles_of
from articulate.transforms import Array, Ints, Mask, apply, pose, quat_to_matrix

APART_M = 0.0002
"""Surfaces that cross by less than this only touch [m]."""
AROUND_M = 0.002
"""Margin of the search around shapes, which deviate from visual surfaces [m]."""
MOST = 4000
"""Largest number of triangles of one part in one search."""
CHUNK = 500
"""Number of triangles that are compared with those of the other part at once."""


class Surfaces:
    """Authored surfaces of the links of an object, for crossing queries.

    Args:
        model: Compiled object.
        shapes: Its collision shapes, which limit the search.
        known: Triangles (F, 3, 3) [m] of links in their own frames; those of others are added.
    """

    def __init__(
        self, model: ObjectModel, shapes: Shapes, known: dict[str, Array] | None = None
    ) -> None:
        self.model = model
        self.shapes = shapes
        self._built = {} if known is None else known

    def cross(self, data: Data, overlap: Overlap) -> bool:
        """Return whether the authored surfaces cross where two collision geoms overlap.

        Surfaces that only touch do not cross: the first part is moved out of the second by
        ``APART_M`` before.

        Args:
            data: State, with geoms in place.
            overlap: Where to look: around what the two geoms share.
        """
        apart_w = APART_M * np.asarray(overlap.separation_w)
        low, high = self.shapes.boxes(data, np.array([overlap.one, overlap.other]))
        low, high = low.max(axis=0) - AROUND_M, high.min(axis=0) + AROUND_M
        ones = _near(self._triangles_w(data, overlap.one) + apart_w, low, high)
        others = _near(self._triangles_w(data, overlap.other), low, high)
        for k in range(0, len(ones), CHUNK):
            some = ones[k : k + CHUNK]
            a, b = np.nonzero(_boxes_meet(some, others))
            if passes(cuts(some[a], others[b]), low, high).any():
                return True
        return False

    def _triangles_w(self, data: Data, geom: int) -> Array:
        """All triangles (F, 3, 3) [m] that the link of ``geom`` shows, in the world frame."""
        link = self.shapes.link_of[geom]
        if link not in self._built:
            corners, faces = surface_of(self.model, link)
            self._built[link] = corners[faces]
        triangles = self._built[link]
        body = int(self.model.model.geom_bodyid[geom])
        turn = data.xmat[body].reshape(3, 3)
        return np.asarray(triangles.reshape(-1, 3) @ turn.T + data.xpos[body]).reshape(-1, 3, 3)


def _near(triangles: Array, low: Array, high: Array) -> Array:
    """Return the triangles whose upright boxes meet the one from ``low`` to ``high``."""
    meets = (triangles.min(axis=1) <= high) & (triangles.max(axis=1) >= low)
    return np.asarray(triangles[meets.all(axis=1)][:MOST])


def _boxes_meet(ones: Array, others: Array) -> Mask:
    """Return a mask (A, B) of triangles whose axis-aligned boxes overlap."""
    apart = (ones.min(axis=1)[:, None] > others.max(axis=1)) | (
        ones.max(axis=1)[:, None] < others.min(axis=1)
    )
    return np.asarray(~apart.any(axis=-1))


def cuts(ones: Array, others: Array) -> Array:
    """Return the segments (N, 2, 3) in which triangles of ``ones`` and their partners cross [m].

    Those that do not, or lie in one plane, give NaN.

    Args:
        ones: Corners of triangles (N, 3, 3) [m].
        others: Corners of their partners (N, 3, 3) [m].
    """
    points = np.concatenate([_pierced(ones, others), _pierced(others, ones)], axis=1)
    line = np.cross(_normals(ones), _normals(others))
    along = np.einsum("nki,ni->nk", points, line)  # NaN where an edge pierces nothing
    first = np.where(np.isnan(along), np.inf, along).argmin(axis=1)
    last = np.where(np.isnan(along), -np.inf, along).argmax(axis=1)
    rows = np.arange(len(points))
    return np.stack([points[rows, first], points[rows, last]], axis=1)


def _normals(triangles: Array) -> Array:
    edges = triangles[:, 1:] - triangles[:, :1]
    return np.cross(edges[:, 0], edges[:, 1])


def _pierced(edges_of: Array, planes_of: Array) -> Array:
    """Return the points (N, 3, 3) where edges pierce the partner triangles [m], NaN without."""
    a, b, c = planes_of[:, 0], planes_of[:, 1], planes_of[:, 2]
    normal = _normals(planes_of)
    height = np.einsum("nki,ni->nk", edges_of - a[:, None], normal)
    start, end = edges_of, np.roll(edges_of, -1, axis=1)
    from_, to = height, np.roll(height, -1, axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        share = from_ / (from_ - to)
        points = start + share[..., None] * (end - start)
        inside = (share >= 0.0) & (share <= 1.0)
        for one, two in ((a, b), (b, c), (c, a)):
            side = np.cross((two - one)[:, None], points - one[:, None])
            inside &= np.einsum("nki,ni->nk", side, normal) >= 0.0
    return np.where(inside[..., None], points, np.nan)


def passes(lines: Array, low: Array, high: Array) -> Mask:
    """Return a mask (N,) of segments (N, 2, 3) through the box ``low`` to ``high`` (3,) [m]."""
    start, span = lines[:, 0], lines[:, 1] - lines[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        one, two = (low - start) / span, (high - start) / span
    level = np.abs(span) < 1e-15
    within = (start >= low) & (start <= high)
    enter = np.where(level, np.where(within, -np.inf, np.inf), np.minimum(one, two)).max(axis=1)
    leave = np.where(level, np.inf, np.maximum(one, two)).min(axis=1)
    return np.asarray(np.maximum(enter, 0.0) <= np.minimum(leave, 1.0))


def surface_of(model: ObjectModel, link: str) -> tuple[Array, Ints]:
    """Return corners (V, 3) [m] and triangles (F, 3) of the visual geometry of ``link``."""
    corners, faces, count = [np.zeros((0, 3))], [np.zeros((0, 3), dtype=np.int64)], 0
    for own in pieces_of(model, link):
        corners.append(own[0])
        faces.append(own[1] + count)
        count += len(own[0])
    return np.vstack(corners), np.vstack(faces)


def pieces_of(model: ObjectModel, link: str) -> list[tuple[Array, Ints]]:
    """Return corners (V, 3) [m] and triangles (F, 3) of each visual geom of ``link``."""
    m, found = model.model, []
    for geom in model.visual_geoms(link).tolist():
        own = triangles_of(m, geom, "visual")
        if own is not None:
            T_lg = pose(m.geom_pos[geom], quat_to_matrix(m.geom_quat[geom]))
            found.append((apply(T_lg, own[0]), own[1]))
    return found
