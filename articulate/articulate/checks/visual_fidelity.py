"""Clause ``shown``: every link looks as it does in the input, and none is lost."""

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
"""Points on a link's surface in the input, and as many in the asset."""
PIECE_SAMPLES = 40
"""Points on each of its meshes, where it has more than one."""
ALLOWED_SHARE = 0.99
"""Least share of either that must lie on the other surface."""
NEAR_M = 2e-4
"""Points this near lie on it [m]."""
NEAR_SHARE = 1e-3
"""So do points this share of the link's diagonal away."""


def check_visual_fidelity(model: ObjectModel, origin: Origin) -> tuple[Check, ...]:
    """Compare what each link shows with what it shows in the input, both ways.

    Each mesh counts by itself, too: links of hundreds of meshes lose one without losing a
    hundredth of their surface.
    """
    checks = []
    names = {origin.root: model.root}
    for part, pieces in origin.shown.items():
        link = names.get(part, part)
        if link in model.bodies:
            checks.append(_alike(link, pieces, model))
        elif pieces:
            message = f"link {link} of the input is absent: make the asset anew"
            checks.append(
                Check(name="visual_fidelity", outcome="failed", subject=link, message=message)
            )
    return tuple(checks)


def _alike(link: str, given: Sequence[Array], model: ObjectModel) -> Check:
    own = [corners[faces] for corners, faces in pieces_of(model, link)]
    if not given and not own:
        message = f"{link} shows nothing, here and there"
        return Check(
            name="visual_fidelity", outcome="not_applicable", subject=link, message=message
        )
    kept, new = shares(given, own)
    least_kept, least_new = (kept, new) if len(given) == len(own) == 1 else least_shares(given, own)
    measured = min(kept, new, least_kept, least_new)
    message = (
        f"{kept:.1%} of what {link} shows in the input is there, and {new:.1%} of what it "
        f"shows here was there; mesh by mesh at least {least_kept:.0%} and {least_new:.0%}"
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
    """Share of ``ones``, pieces (F, 3, 3), that lies on ``others``, and the other way round."""
    one, other = _joined(ones), _joined(others)
    if not len(one) or not len(other):
        return 0.0, 0.0
    near_m = _near_m(one, other)
    on_other = is_near(sample(one, SAMPLES)[0], other, near_m)
    on_one = is_near(sample(other, SAMPLES)[0], one, near_m)
    return float(on_other.mean()), float(on_one.mean())


def least_shares(ones: Sequence[Array], others: Sequence[Array]) -> tuple[float, float]:
    """The same of that piece of ``ones`` of which least lies on ``others``, and of ``others``."""
    one, other = _joined(ones), _joined(others)
    if not len(one) or not len(other):
        return 0.0, 0.0
    near_m = _near_m(one, other)
    return _least(ones, other, near_m), _least(others, one, near_m)


def _least(pieces: Sequence[Array], other: Array, near_m: float) -> float:
    """Least share of one of ``pieces`` that lies on ``other``."""
    points = [sample(piece, PIECE_SAMPLES)[0] for piece in pieces]
    found = is_near(np.concatenate(points), other, near_m)
    ends = np.cumsum([len(some) for some in points])
    return min((float(p.mean()) for p in np.split(found, ends[:-1]) if len(p)), default=0.0)


def _joined(pieces: Sequence[Array]) -> Array:
    return np.concatenate([np.zeros((0, 3, 3)), *pieces])


def _near_m(one: Array, other: Array) -> float:
    """Distance within which points lie on a surface [m]."""
    points = np.concatenate([one.reshape(-1, 3), other.reshape(-1, 3)])
    return max(NEAR_M, NEAR_SHARE * float(np.linalg.norm(np.ptp(points, axis=0))))
