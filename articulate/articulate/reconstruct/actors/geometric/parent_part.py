"""Holder: which of the parts that stand still holds the one that moves.

What holds a part touches it wherever it goes. What merely lies beside it at rest, or sits on it and
would have to move along, is left behind on the way.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import trimesh
from scipy.spatial import cKDTree

from articulate.geometry.shapes import sample_surface
from articulate.reconstruct.actors.geometric.candidates import Motion
from articulate.render.parts import PartMesh
from articulate.transforms import Array, apply

POINTS = 3000
"""Points of a part's surface that stand for it."""
STATES = 7
"""Positions along the way at which distances are taken."""
TOUCHING = 0.5
"""Per cent of a part's points that touch what it touches."""
AS_NEAR = 0.03
"""Parts whose distance differs by less than this share of the object's diagonal are as near."""


def holder_of(part: PartMesh, still: Sequence[PartMesh], motion: Motion, q: Array) -> str | None:
    """Name of the part that holds ``part``, None where nothing stands still.

    Of all that stays as near to it on its whole way as anything does, the part whose box is
    nearest to its middle.

    Args:
        part: What moves, at position 0.
        still: What stands still.
        motion: How it moves.
        q: Positions (N,) that it takes [m or rad].
    """
    if len(still) < 2:
        return still[0].name if still else None
    bounds = np.concatenate([other.bounds for other in (part, *still)])
    size_m = float(np.linalg.norm(np.ptp(bounds, axis=0)))
    own, T_o = spread(part), motion.T_o(np.linspace(q.min(), q.max(), STATES))
    places = [apply(T, own) for T in T_o]
    gaps = [max(gap_m(points, spread(other)) for points in places) for other in still]
    near = [k for k, gap in enumerate(gaps) if gap <= min(gaps) + AS_NEAR * size_m]
    return still[min(near, key=lambda k: _off(part, still[k]))].name


def gap_m(points: Array, others: Array) -> float:
    """Distance between two parts of which ``points`` (P, 3) and ``others`` (Q, 3) are known [m]."""
    return float(np.percentile(cKDTree(others).query(points)[0], TOUCHING))


def _off(part: PartMesh, other: PartMesh) -> float:
    """How far the middle of ``part`` is from the box of ``other``, and a little from its middle."""
    low, high = other.bounds
    middle = part.centre
    beside = float(np.linalg.norm(middle - np.clip(middle, low, high)))
    return beside + 1e-3 * float(np.linalg.norm(middle - other.centre))


def spread(part: PartMesh) -> Array:
    """Points (P, 3) all over the surface of ``part``; its corners where it has no area."""
    mesh = trimesh.Trimesh(part.vertices, part.faces, process=False)
    if mesh.area <= 0.0:
        return part.vertices
    return sample_surface(mesh, POINTS)[0]
