"""Raised slabs: the screen of a laptop, the open lid of a box."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from articulate.reconstruct.scan.part_proposal import PartProposal
from articulate.reconstruct.scan.scan_mesh import ScanMesh
from articulate.reconstruct.scan.segmentation import Segmentation
from articulate.transforms import Array, Ints

SPLITS = (0.1, 0.15, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7)
"""Heights above which all faces may be one slab, as shares of the height."""
THIN = 0.16
"""Largest thickness of a slab, as a share of its longer side."""
LEAST_WIDTH = 0.85
"""Least width of a slab, as a share of the width of the object."""
LEAST_LEAN = float(np.radians(8.0))
"""Least angle of a slab to the horizontal plane."""
UPPER_SHARE = 0.02
"""Area that may be outside a slab."""
BASE_HEIGHT = 0.35
"""Largest height of the base of a laptop, as a share of its depth."""
LEAST_BASE = 0.4
"""Least depth of the base, as a share of the length of the slab: less is a room door."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Slab:
    """Thin box above the rest of the object, hinged at its lower edge along y."""

    faces: Ints
    """Its faces (K,)."""
    normal: Array
    """Unit normal (3,)."""
    foot: Array
    """Middle of its lower edge (3,) [m]."""
    reach: float
    """Length from the foot to the far edge [m]."""
    base_height: float
    """Height of the rest of the object above its depth, a ratio."""


def find_slab(parts: Segmentation) -> Slab | None:
    """Return the slab of which all upper faces consist; None if they form none."""
    mesh = parts.mesh
    centres = mesh.triangles.mean(axis=1)
    low, size = mesh.bounds[0], mesh.size
    for split in SPLITS:
        upper = np.flatnonzero(centres[:, 2] > low[2] + split * size[2])
        if mesh.areas[upper].sum() < 0.05 * mesh.areas.sum():
            return None
        slab = _slab(parts, upper)
        if slab is not None:
            return slab
    return None


def _slab(parts: Segmentation, upper: Ints) -> Slab | None:
    """Fit a plane along y to the upper faces, and grow it to the facets near the plane."""
    mesh = parts.mesh
    points = mesh.triangles[upper].reshape(-1, 3)
    weights = np.repeat(mesh.areas[upper], 3)
    if np.ptp(points[:, 1]) < LEAST_WIDTH * mesh.size[1]:
        return None
    flat = points[:, [0, 2]]
    middle = np.average(flat, axis=0, weights=weights)
    cov = np.cov((flat - middle).T, aweights=weights)
    _, vectors = np.linalg.eigh(cov)
    along, across = vectors[:, 1], vectors[:, 0]
    if along[1] < 0.0:
        along = -along
    lean = np.arctan2(abs(along[1]), abs(along[0]))
    side = max(float(np.ptp(flat @ along)), float(mesh.size[1]))
    offset = (flat - middle) @ across
    low, high = _quantiles(offset, weights)
    if high - low > THIN * side or lean < LEAST_LEAN:
        return None
    normal = np.array([across[0], 0.0, across[1]])
    direction = np.array([along[0], 0.0, along[1]])
    margin = 0.25 * (high - low) + parts.near
    base = np.array([middle[0], 0.0, middle[1]])
    height = (mesh.triangles - base) @ normal
    inside = ((height > low - margin) & (height < high + margin)).all(axis=1)
    faces = _facets_within(parts, inside)
    if not len(faces):
        return None
    corners = mesh.triangles[faces].reshape(-1, 3)
    upper_along = float((points @ direction).min())
    # The plane of the slab also cuts the base: keep what is above the foot of the slab.
    foot = _foot(mesh, faces, direction, upper_along)
    faces = faces[(mesh.triangles[faces] @ direction).mean(axis=1) > foot]
    corners = mesh.triangles[faces].reshape(-1, 3)
    reach = float((corners @ direction).max() - foot)
    at = base + direction * (foot - float(base @ direction))
    at[1] = float(corners[:, 1].min() + corners[:, 1].max()) / 2.0
    rest = np.setdiff1d(np.arange(len(mesh.faces)), faces)
    if len(rest) < 1:
        return None
    other = mesh.triangles[rest].reshape(-1, 3)
    if np.ptp(other[:, 0]) < max(1.5 * (high - low), LEAST_BASE * reach):
        return None
    tall = float(np.ptp(other[:, 2])) / max(float(np.ptp(other[:, 0])), 1e-12)
    return Slab(faces=faces, normal=normal, foot=at, reach=reach, base_height=tall)


def _quantiles(values: Array, weights: Array) -> tuple[float, float]:
    order = np.argsort(values, kind="stable")
    share = np.cumsum(weights[order])
    share /= share[-1]
    first = int(np.searchsorted(share, UPPER_SHARE / 2.0))
    last = min(int(np.searchsorted(share, 1.0 - UPPER_SHARE / 2.0)), len(order) - 1)
    low, high = values[order[first]], values[order[last]]
    return float(low), float(high)


def _facets_within(parts: Segmentation, inside: Array) -> Ints:
    """Return the faces of the facets of which 95 % of the area are inside."""
    cells, areas = parts.facets, parts.mesh.areas
    share = np.bincount(cells.label, areas * inside, cells.count) / np.maximum(cells.area, 1e-300)
    return np.flatnonzero(share[cells.label] > 0.95)


def _foot(mesh: ScanMesh, faces: Ints, direction: Array, upper: float) -> float:
    """Return the lower end of the slab along its direction: that of its long faces."""
    along = mesh.triangles[faces] @ direction
    tall = np.ptp(along, axis=1) > 0.3 * np.ptp(along)
    return min(float(along[tall].min()), upper) if tall.any() else upper


def slab_parts(parts: Segmentation) -> list[PartProposal]:
    """Propose a screen or an open lid."""
    slab = find_slab(parts)
    if slab is None:
        return []
    mesh = parts.mesh
    area = float(mesh.areas[slab.faces].sum() / mesh.areas.sum())
    if not 0.1 < area < 0.75:
        return []
    laptop = slab.base_height < BASE_HEIGHT
    # Closing moves the slab over the rest: about y, towards the middle of the object.
    rest = mesh.bounds.mean(axis=0) - slab.foot
    closing = 1.0 if rest[0] > 0.0 else -1.0
    return [
        PartProposal(
            kind="screen" if laptop else "lid",
            faces=slab.faces,
            joint="revolute",
            axis=np.array([0.0, closing, 0.0]),
            pivot=slab.foot,
            upper=_closing_angle(slab, closing),
            confidence=0.85 if laptop else 0.7,
            evidence=("a thin slab above a flat base",),
        )
    ]


def _closing_angle(slab: Slab, closing: float) -> float:
    """Return the angle to the horizontal position over the base [rad]."""
    direction = np.cross([0.0, 1.0, 0.0], slab.normal)
    direction = direction if direction[2] > 0.0 else -direction
    return float(np.arctan2(direction[2], direction[0] * closing)) if closing else 0.0
