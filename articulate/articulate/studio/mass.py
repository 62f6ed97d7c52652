"""Mass properties of parts that are moved, scaled or split."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import trimesh
from scipy.spatial import QhullError

from articulate.formats.load_meshes import Piece
from articulate.geometry.inertia import Inertial, combined
from articulate.transforms import Array, apply


def moved_mass(inertial: Inertial, T: Array) -> Inertial:
    """Return mass properties after the rigid motion ``T`` (4, 4) [m]."""
    R = T[:3, :3]
    return replace(inertial, com_p=apply(T, inertial.com_p), inertia_p=R @ inertial.inertia_p @ R.T)


def scaled_mass(inertial: Inertial, factor: float) -> Inertial:
    """Return mass properties of a body of the same density, ``factor`` times as large."""
    return replace(
        inertial,
        mass_kg=factor**3 * inertial.mass_kg,
        com_p=factor * inertial.com_p,
        inertia_p=factor**5 * inertial.inertia_p,
    )


def divided_mass(inertial: Inertial, groups: Sequence[Sequence[Piece]]) -> list[Inertial] | None:
    """Return the share of each group of pieces in a part's mass, by the volume of their hulls.

    None if a group has no volume.
    """
    hulls = [[hull for piece in group if (hull := _hull(piece)) is not None] for group in groups]
    volumes = [sum(float(hull.volume) for hull in group) for group in hulls]
    if min(volumes) <= 1e-12:
        return None
    density = inertial.mass_kg / sum(volumes)
    out = []
    for group in hulls:
        bodies = [
            Inertial(
                mass_kg=density * float(hull.volume),
                com_p=np.asarray(hull.center_mass),
                inertia_p=density * np.asarray(hull.moment_inertia),
                from_source=True,
            )
            for hull in group
        ]
        out.append(combined(bodies))
    return out


def _hull(piece: Piece) -> trimesh.Trimesh | None:
    """Return the convex hull of a piece; None if it is flat."""
    try:
        hull = trimesh.convex.convex_hull(piece.mesh)
    except (QhullError, ValueError):
        return None
    return hull if hull.volume > 0.0 else None
