"""Likelihood of how a part opens in the frame of its object, from the joints fitted to tracks.

A fitted hinge or slide is known in the frame of the camera only. The front of the object faces the
camera roughly and the camera is upright, so that the likelihood of an axis of the object is a mean
over azimuths and elevations. It needs neither the outline of the object nor a fitted box.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from articulate.transforms import Array, normalised
from articulate.video.candidate_parts import CandidatePart
from articulate.video.joint_classifier import joint_classifier
from articulate.video.joint_fit import JointFit
from articulate.video.motion_features import opening_features, points_at

FORWARD, ACROSS, UP = np.eye(3)
SLIDES = ((FORWARD,), (UP,), (ACROSS, -ACROSS))
"""Directions of each sliding opening: forward, upward, to either side."""
TURNS = (
    (FORWARD, (ACROSS, -ACROSS, -UP)),
    (-FORWARD, (ACROSS, -ACROSS, -UP)),
    (ACROSS, (UP, -FORWARD)),
    (-ACROSS, (FORWARD, -UP)),
    (UP, (-ACROSS,)),
    (-UP, (ACROSS,)),
)
"""Axis of each turning opening, and the directions in which the closed part can be from it."""
OPENINGS = len(SLIDES) + len(TURNS)
"""Number of openings: the slides, then the turns."""
AZIMUTH_DEG, AZIMUTH_SPREAD_DEG = 65.0, 40.0
"""Largest angle between the front and the camera, and its deviation."""
ELEVATION_DEG = 55.0
"""Largest elevation of the camera."""
AXIS_SHARPNESS, SIDE_SHARPNESS = 8.0, 3.0
"""Concentrations of von Mises-Fisher distributions of axes and of the side of a hinge."""
OUTLIERS = 0.15
"""Share of fitted directions that are wrong."""
UNCERTAIN = 0.05
"""Least probability that the first motion opens or closes the part."""
LEAST = 0.003
"""Added to each likelihood, relative to the others of the same joint type."""


def opening_index(kind: str, axis: Array) -> int:
    """Return the index of a joint among the openings.

    Args:
        kind: Joint type; all but prismatic joints turn.
        axis: Axis (3,) along or about which the part opens, in the frame of the object: its front
            is at +x, z up.
    """
    k = int(np.argmax(np.abs(axis)))
    if kind == "prismatic":
        return {0: 0, 2: 1}.get(k, 2) if axis[k] > 0.0 else 2
    return len(SLIDES) + 2 * k + int(axis[k] < 0.0)


def opening_logs(candidates: Sequence[CandidatePart], role: Array, log_odds: Array) -> Array:
    """Return the logarithm of the likelihood of each opening (``OPENINGS``,).

    Those of the same joint type add up to about one: the joint type is left to its classifier.

    Args:
        candidates: Candidates for the operated part.
        role: Probability that each is the operated part (N,).
        log_odds: Logarithm of the odds that each rotates (N,).
    """
    features = [opening_features(part) for part in candidates]
    p_opening = joint_classifier().p_opening
    rows = np.array(
        [
            [
                *_slides(part.slide, p_opening("prismatic", seen)),
                *_turns(part.hinge, p_opening("revolute", seen)),
            ]
            for part, seen in zip(candidates, features, strict=True)
        ]
    )
    rotates = 1.0 / (1.0 + np.exp(-log_odds))
    n = len(SLIDES)
    both = (role**2 * (1.0 - rotates)) @ rows[:, :n], (role**2 * rotates) @ rows[:, n:]
    return np.log(np.concatenate([one / max(float(one.sum()), 1e-300) for one in both]) + LEAST)


def _slides(fit: JointFit, p_opening: float) -> list[float]:
    """Return the likelihoods of the slides (3,)."""
    rotations, weights = _cameras()
    first = fit.axis * _first_sign(fit)
    out = []
    for directions in SLIDES:
        seen = [
            p * _density(sense * first, rotations @ direction, AXIS_SHARPNESS)
            for sense, p in _senses(p_opening)
            for direction in directions
        ]
        out.append(float(weights @ np.sum(seen, axis=0)) / len(directions))
    return out


def _turns(fit: JointFit, p_opening: float) -> list[float]:
    """Return the likelihoods of the turns (6,)."""
    rotations, weights = _cameras()
    first = fit.axis * _first_sign(fit)
    out = []
    for axis, sides in TURNS:
        total = 0.0
        for sense, p in _senses(p_opening):
            closed = 0 if sense > 0.0 else _peak(fit)
            centre = points_at(fit, closed).mean(axis=0)
            foot = fit.pivot + fit.axis * float((centre - fit.pivot) @ fit.axis)
            side = normalised(centre - foot)
            turned = _density(sense * first, rotations @ axis, AXIS_SHARPNESS)
            beside = [_density(side, rotations @ one, SIDE_SHARPNESS) for one in sides]
            total += p * float(weights @ (turned * np.mean(beside, axis=0)))
        out.append(total)
    return out


def _senses(p_opening: float) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return the senses of the first motion, +1 for opening, with their probabilities."""
    p = float(np.clip(p_opening, UNCERTAIN, 1.0 - UNCERTAIN))
    return (1.0, p), (-1.0, 1.0 - p)


def _peak(fit: JointFit) -> int:
    """Return the frame at which the joint is farthest from its first position."""
    return int(np.argmax(np.abs(fit.positions - fit.positions[0])))


def _first_sign(fit: JointFit) -> float:
    """Return the sign of the first motion of a joint."""
    return 1.0 if fit.positions[_peak(fit)] >= fit.positions[0] else -1.0


def _density(seen: Array, expected: Array, sharpness: float) -> Array:
    """Return the density of a direction (3,), over that of random ones, at each camera (G,)."""
    scale = 2.0 * sharpness / -np.expm1(-2.0 * sharpness)
    return np.asarray(
        OUTLIERS + (1.0 - OUTLIERS) * scale * np.exp(sharpness * (expected @ seen - 1.0))
    )


@lru_cache(maxsize=1)
def _cameras() -> tuple[Array, Array]:
    """Return rotations from the object to cameras (G, 3, 3) and their probabilities (G,)."""
    azimuth = np.radians(np.linspace(-AZIMUTH_DEG, AZIMUTH_DEG, 13))
    elevation = np.radians(np.linspace(0.0, ELEVATION_DEG, 6))
    a, e = (x.ravel() for x in np.meshgrid(azimuth, elevation, indexing="ij"))
    ahead = -np.stack([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)], axis=1)
    right = np.stack([-np.sin(a), np.cos(a), np.zeros_like(a)], axis=1)
    rotations = np.stack([right, np.cross(ahead, right), ahead], axis=1)
    weights = np.exp(-0.5 * (a / np.radians(AZIMUTH_SPREAD_DEG)) ** 2)
    return rotations, weights / weights.sum()
