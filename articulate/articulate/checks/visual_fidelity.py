"""Check ``visual_fidelity``: every link has the visual geometry of the input."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from articulate.assets.check_report import Check
from articulate.checks.model import ObjectModel
from articulate.checks.source import Origin
from articulate.checks.surface import is_near, sample
from articulate.checks.visual_collision import pieces_of
from articulate.transforms import Array

SAMPLES = 500
"""Sample points on the surface of a link in the input, and as many in the asset."""
PIECE_SAMPLES = 40
"""Points on each of its meshes, where it has more than one."""
ALLOWED_SHARE = 0.99
"""Least fraction of either on the other surface."""
NEAR_M = 2e-4
"""Distance within which points are on a surface [m] ..."""
NEAR_SHARE = 1e-3
"""... or this fraction of the diagonal of the link."""


def check_visual_fidelity(model: ObjectModel, origin: Origin) -> tuple[Check, ...]:
    """Compare the visual surface of each link with that in the input, in both directions.

    Each mesh is compared separately as well: a link of hundreds of meshes can lose one without
    losing a hundredth of its surface.
    """
    checks = []
    names = {origin.root: model.root}
    for part, pieces in origin.visuals.items():
        link = names.get(part, part)
        if link in model.bodies:
            checks.append(_alike(link, pieces, model))
        elif pieces:
            message = f"link {link} of the input is missing: make the asset again"
            checks.append(
                Check(name="visual_fidelity", outcome="failed", subject=link, message=message)
            )
    return tuple(checks)


def _alike(link: str, reference: Sequence[Array], model: ObjectModel) -> Check:
    own = [corners[faces] for corners, faces in pieces_of(model, link)]
    if not reference and not own:
        message = f"{link} has no visual geometry, in the input and here"
        return Check(
            name="visual_fidelity", outcome="not_applicable", subject=link, message=message
        )
    kept, new = shares(reference, own)
    least_kept, least_new = (
        (kept, new) if len(reference) == len(own) == 1 else least_shares(reference, own)
    )
    measured = min(kept, new, least_kept, least_new)
    message = (
        f"{kept:.1%} of the surface of {link} in the input is in the asset, and {new:.1%} vice "
        f"versa; for single meshes at least {least_kept:.0%} and {least_new:.0%}"
    )
    passed = measured >= ALLOWED_SHARE
    if not passed:
        message += ": a mesh was lost, moved, scaled or mirrored"
    return Check(
        name="visual_fidelity",
        outcome="passed" if passed else "failed",
        subject=link,
        measured=measured,
        allowed=ALLOWED_SHARE,
        unit="1",
        message=message,
    )


def shares(ones: Sequence[Array], others: Sequence[Array]) -> tuple[float, float]:
    """Return the fraction of ``ones``, pieces (F, 3, 3) [m], on ``others``, and vice versa."""
    one, other = _joined(ones), _joined(others)
    if not len(one) or not len(other):
        return 0.0, 0.0
    near_m = _near_m(one, other)
    on_other = is_near(sample(one, SAMPLES)[0], other, near_m)
    on_one = is_near(sample(other, SAMPLES)[0], one, near_m)
    return float(on_other.mean()), float(on_one.mean())


def least_shares(ones: Sequence[Array], others: Sequence[Array]) -> tuple[float, float]:
    """Return the least fractions of single pieces (F, 3, 3) [m] on the other surface."""
    one, other = _joined(ones), _joined(others)
    if not len(one) or not len(other):
        return 0.0, 0.0
    near_m = _near_m(one, other)
    return _least(ones, other, near_m), _least(others, one, near_m)


def _least(pieces: Sequence[Array], other: Array, near_m: float) -> float:
    """Return the least fraction of one of ``pieces`` on ``other``."""
    points = [sample(piece, PIECE_SAMPLES)[0] for piece in pieces]
    found = is_near(np.concatenate(points), other, near_m)
    ends = np.cumsum([len(some) for some in points])
    return min((float(p.mean()) for p in np.split(found, ends[:-1]) if len(p)), default=0.0)


def _joined(pieces: Sequence[Array]) -> Array:
    return np.concatenate([np.zeros((0, 3, 3)), *pieces])


def _near_m(one: Array, other: Array) -> float:
    """Return the distance within which points are on a surface [m]."""
    points = np.concatenate([one.reshape(-1, 3), other.reshape(-1, 3)])
    return max(NEAR_M, NEAR_SHARE * float(np.linalg.norm(np.ptp(points, axis=0))))
