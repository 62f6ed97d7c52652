"""Check ``collision_coverage``: visual surfaces and collision shapes agree."""

from __future__ import annotations

import numpy as np

from articulate.assets.check_report import Check
from articulate.checks.model import ObjectModel
from articulate.checks.solids import Solid, solids_of, union_surface, unknown_shape, within_any
from articulate.checks.surface import is_near, sample, winding_numbers
from articulate.checks.visual_collision import surface_of
from articulate.transforms import Array, Mask

SAMPLES = 1000
"""Sample points on the visual surface of a link, and as many on its collision shapes."""
ALLOWED_SHARE = 0.95
"""Least fraction of them near the other surface."""
NEAR_M = 0.003
"""Distance that counts as near for links of any size [m] ..."""
NEAR_SHARE = 0.01
"""... or this fraction of the diagonal of the link."""
INSIDE = 0.5
"""Points with a larger winding number are inside the material."""


def check_coverage(model: ObjectModel) -> tuple[Check, ...]:
    """Compare the visual surface of each link with its collision shapes, both ways."""
    return tuple(_covered(model, link.name) for link in model.asset.links)


def _covered(model: ObjectModel, link: str) -> Check:
    unknown = unknown_shape(model, link)
    if unknown:
        return Check(name="collision_coverage", outcome="failed", subject=link, message=unknown)
    corners, faces = surface_of(model, link)
    solids = solids_of(model, link)
    if not len(faces) and not solids:
        message = f"{link} has no geometry"
        return Check(
            name="collision_coverage", outcome="not_applicable", subject=link, message=message
        )
    near_m = near_of(corners) if len(corners) else NEAR_M
    touchable, seen = shares(corners[faces], solids, near_m)
    measured = min(touchable, seen)
    passed = measured >= ALLOWED_SHARE
    message = (
        f"{touchable:.1%} of the visual surface of {link} is within {1000 * near_m:.1f} mm of its "
        f"collision shapes, {seen:.1%} the other way round"
    )
    if not passed:
        message += (
            ": parts of it have no collision shape; add collision geometry or raise --max-geoms"
            if touchable <= seen
            else ": collision shapes fill empty space; decompose it more finely"
        )
    return Check(
        name="collision_coverage",
        outcome="passed" if passed else "failed",
        subject=link,
        measured=measured,
        allowed=ALLOWED_SHARE,
        unit="1",
        message=message,
    )


def near_of(corners: Array) -> float:
    """Return the distance that counts as near for visual ``corners`` (V, 3) [m]."""
    return max(NEAR_M, NEAR_SHARE * float(np.linalg.norm(np.ptp(corners, axis=0))))


def shares(triangles: Array, solids: tuple[Solid, ...], near_m: float) -> tuple[float, float]:
    """Return the fraction of the surface near the solids, and of the solids near the surface.

    Points of shapes inside the material, for example where two shapes touch, are ignored: there
    is no surface to compare.

    Args:
        triangles: Visual surface (F, 3, 3) [m].
        solids: Collision shapes.
        near_m: Distance that counts as near [m].
    """
    seen_points, _ = sample(triangles, SAMPLES) if len(triangles) else (np.zeros((0, 3)), None)
    touch_points = union_surface(solids, SAMPLES)
    touchable = within_any(solids, seen_points, near_m)
    seen = is_near(touch_points, triangles, near_m)
    doubtful = np.flatnonzero(~seen)
    inside = winding_numbers(touch_points[doubtful], triangles) > INSIDE
    seen = np.delete(seen, doubtful[inside])
    return _share(touchable), _share(seen)


def _share(mask: Mask) -> float:
    return float(mask.mean()) if len(mask) else 0.0
