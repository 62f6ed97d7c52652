"""Clause ``shown``: every link looks as it does in the input, and none is lost."""

from __future__ import annotations

import numpy as np

from articulate.proof import Clause
from articulate.prove.authored import surface_of
from articulate.prove.model import ObjectModel
from articulate.prove.origin import Origin
from articulate.prove.surface import is_near, sample
from articulate.transforms import Array

SAMPLES = 500
"""Points on a link's surface in the input, and as many in the asset."""
ALLOWED_SHARE = 0.99
"""Least share of them that must lie on the other surface."""
NEAR_M = 2e-4
"""Points this near lie on it [m]."""
NEAR_SHARE = 1e-3
"""So do points this share of the link's diagonal away."""


def shown(model: ObjectModel, origin: Origin) -> tuple[Clause, ...]:
    """Compare what each link shows with what it shows in the input, both ways."""
    clauses = []
    names = {origin.root: model.root}
    for part, triangles in origin.shown.items():
        link = names.get(part, part)
        if link in model.bodies:
            clauses.append(_alike(link, triangles, model))
        elif len(triangles):
            message = f"link {link} of the input is absent: make the asset anew"
            clauses.append(Clause(name="shown", outcome="failed", subject=link, message=message))
    return tuple(clauses)


def _alike(link: str, given: Array, model: ObjectModel) -> Clause:
    corners, faces = surface_of(model, link)
    own = corners[faces]
    if not len(given) and not len(own):
        message = f"{link} shows nothing, here and there"
        return Clause(name="shown", outcome="not_applicable", subject=link, message=message)
    kept, new = shares(given, own)
    measured = min(kept, new)
    message = (
        f"{kept:.1%} of what {link} shows in the input is there, and {new:.1%} of what it "
        "shows here was there"
    )
    passed = measured >= ALLOWED_SHARE
    if not passed:
        message += ": a mesh was lost, moved, scaled or mirrored"
    return Clause(
        name="shown",
        outcome="passed" if passed else "failed",
        subject=link,
        measured=measured,
        allowed=ALLOWED_SHARE,
        unit="1",
        message=message,
    )


def shares(one: Array, other: Array) -> tuple[float, float]:
    """Share of ``one`` (F, 3, 3) that lies on ``other`` (G, 3, 3), and the other way round."""
    if not len(one) or not len(other):
        return 0.0, 0.0
    points = np.concatenate([one.reshape(-1, 3), other.reshape(-1, 3)])
    near_m = max(NEAR_M, NEAR_SHARE * float(np.linalg.norm(np.ptp(points, axis=0))))
    on_other = is_near(sample(one, SAMPLES)[0], other, near_m)
    on_one = is_near(sample(other, SAMPLES)[0], one, near_m)
    return float(on_other.mean()), float(on_one.mean())
