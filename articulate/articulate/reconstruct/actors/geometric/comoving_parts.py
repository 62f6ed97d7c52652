"""Company: parts that go along with the one that moves, a handle or a knob on a door."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from articulate.reconstruct.actors.geometric.image_pyramid import (
    FINE_FRAMES,
    FINE_PX,
    Look,
    Scene,
    better_light,
)
from articulate.reconstruct.actors.geometric.parent_part import gap_m, spread
from articulate.reconstruct.actors.geometric.search import Fit
from articulate.transforms import Array

NEAR = 0.03
"""What goes along is nearer to what moves than this share of the object's diagonal."""
TELLS = 50.0
"""Where it costs so much less or more for each of its pixels, the pictures decide. Of 26 objects,
with joints as they are, what goes along saves 130 and more where it is in sight, and what does not
costs 850 and more."""
NEARER = 0.01
"""Else what is nearer to what moves than to all that stands still by this share goes along."""


def with_company(scene: Scene, fit: Fit) -> Fit:
    """``fit`` with the smaller parts that go along with what moves.

    Args:
        scene: The clip and the object.
        fit: What moves, its position in every frame of the clip.
    """
    longest = [float(np.ptp(part.bounds, axis=0).max()) for part in scene.parts]
    others = [k for k in range(len(scene.parts)) if k not in fit.parts]
    small = [k for k in others if longest[k] < longest[fit.parts[0]]]
    moving = _points(scene, fit.parts)
    gaps = {k: gap_m(spread(scene.parts[k]), moving) for k in small}
    near = [k for k in small if gaps[k] <= NEAR * scene.size_m]
    if not near:
        return fit
    rest = _points(scene, [k for k in others if k not in near])
    look = scene.look(FINE_PX, FINE_FRAMES)
    here = replace(fit, q=fit.q[look.shot.indices])
    look = replace(look, light=better_light(look, here, look.shot))
    stays = _cost(look, here)
    joined = []
    for k in near:
        goes = _cost(look, replace(here, parts=(*here.parts, k)))
        saved = (stays - goes) / max(look.layers([k]).own_px, 1)
        if abs(saved) < TELLS:
            away = gap_m(spread(scene.parts[k]), rest) if len(rest) else 0.0
            saved = away - gaps[k] - NEARER * scene.size_m
        if saved > 0.0:
            joined.append(k)
    return replace(fit, parts=(*fit.parts, *joined))


def _points(scene: Scene, parts: Sequence[int]) -> Array:
    """Points (P, 3) all over the surfaces of ``parts``."""
    return np.concatenate([np.zeros((0, 3)), *(spread(scene.parts[k]) for k in parts)])


def _cost(look: Look, fit: Fit) -> float:
    """What the pictures cost where its parts, and no others, move as ``fit`` says."""
    return float(look.layers(fit.parts).path_cost(fit.motion.T_o(fit.q)).sum())
