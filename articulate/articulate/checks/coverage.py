"""Clause ``coverage``: what is seen can be touched, and what can be touched is seen."""

from __future__ import annotations

import numpy as np

from articulate.assets.check_report import Check
from articulate.checks.model import ObjectModel
from articulate.checks.solids import Solid, solids_of, union_surface, unknown_shape, within_any
from articulate.checks.surface import is_near, sample, winding_numbers
from articulate.checks.visual_collision import surface_of
from articulate.transforms import Array, Mask

SAMPLES = 1000
"""Points on the visual surface of a link, and as many on its collision shapes."""
ALLOWED_SHARE = 0.95
"""Least share of them that must lie near the other surface."""
NEAR_M = 0.003
"""Points this near are near for links of any size [m]."""
NEAR_SHARE = 0.01
"""Points this share of the link's diagonal away are near as well."""
INSIDE = 0.5
"""Points that the surface winds round more often than this lie inside the material."""


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
        f"{touchable:.1%} of what {link} shows lies within {1000 * near_m:.1f} mm of its "
        f"collision shapes, {seen:.1%} the other way round"
    )
    if not passed:
        message += (
            ": parts of it cannot be touched; give it collision geometry or raise --max-geoms"
            if touchable <= seen
            else ": collision shapes stand where nothing is seen; decompose it more finely"
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
    """Distance that counts as near [m] for a link that shows ``corners`` (V, 3) [m]."""
    return max(NEAR_M, NEAR_SHARE * float(np.linalg.norm(np.ptp(corners, axis=0))))


def shares(triangles: Array, solids: tuple[Solid, ...], near_m: float) -> tuple[float, float]:
    """Share of the surface within ``near_m`` of the solids, and of the solids' of the surface.

    Where shapes end inside the material, as they do where two of them lie against each other,
    there is nothing to be seen and nothing to be touched: such points are left out.

    Args:
        triangles: What is seen (F, 3, 3) [m].
        solids: What can be touched.
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
