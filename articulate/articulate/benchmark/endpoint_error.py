"""The metric E of ArticulateArena: a joint is the unordered pair of the twists at its ends.

From the formulas of "ArticulateArena: A Metric for Articulated Kinematics" (arXiv 2609.33931) and
of its reference implementation, ``articulatearena`` 0.1.0 on the package index (MIT); a test
compares both where it is installed. A twist is (omega, nu); the unit twist of a
turning joint is (a, p x a), that of a slide (0, a). ::

    E = min(|u1 - u2|^2 + |v1 - v2|^2, |u1 - v2|^2 + |v1 - u2|^2)^(1/2)
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from articulate.reconstruct.actors.protocol import PredictedJoint
from articulate.transforms import Array, normalised

KAPPA = np.pi
"""Scale of the compactification: half a turn about an axis through the origin."""


@dataclass(frozen=True, kw_only=True)
class Endpoints:
    """E between two joints under three norms; None if undefined for a joint without limits."""

    split: float | None
    """|omega|^2 + |nu|^2, with radians and units of length weighted alike, about the origin."""
    kinetic: float | None
    """Root mean square of the part's displacement, to first order [units of length]."""
    compact: float
    """``split`` after the radial compactification, which also covers joints without limits."""


def endpoint_metrics(
    truth: PredictedJoint, predicted: PredictedJoint | None, box_o: Array
) -> Endpoints:
    """Compute E between two joints.

    Args:
        truth: The true joint.
        predicted: The predicted joint; None or ``fixed`` for no motion, with zero twists. One
            with numbers that are not finite counts as none.
        box_o: Lowest and highest corner of the part (2, 3) [units], as a solid of uniform density.
    """
    if predicted is not None and not _is_finite(predicted):
        predicted = None
    one, two = unit_twist(truth), unit_twist(predicted)
    limits, others = _limits(truth), _limits(predicted)
    pairs = None if limits is None or others is None else (_pair(one, limits), _pair(two, others))
    euclidean = np.eye(6)
    compact = quotient_distance(
        _compact(one, limits, euclidean), _compact(two, others, euclidean), euclidean
    )
    return Endpoints(
        split=None if pairs is None else quotient_distance(*pairs, euclidean),
        kinetic=None if pairs is None else quotient_distance(*pairs, kinetic_norm(box_o)),
        compact=compact,
    )


def unit_twist(joint: PredictedJoint | None) -> Array:
    """Compute the unit twist (6,), omega first; zero for no joint."""
    if joint is None or joint.kind == "fixed":
        return np.zeros(6)
    axis = normalised(joint.axis_o)
    if joint.kind == "prismatic":
        return np.concatenate([np.zeros(3), axis])
    return np.concatenate([axis, np.cross(np.asarray(joint.pivot_o, np.float64), axis)])


def kinetic_norm(box_o: Array) -> Array:
    """Compute twice the kinetic energy per mass of a box (2, 3) [units] as a matrix (6, 6)."""
    x, y, z = (box_o[1] - box_o[0]) ** 2 / 12.0
    cx, cy, cz = box_o.mean(axis=0)
    cross = np.array([[0.0, -cz, cy], [cz, 0.0, -cx], [-cy, cx, 0.0]])
    velocity = np.concatenate([-cross, np.eye(3)], axis=1)  # of the centre: nu + omega x c
    out: Array = velocity.T @ velocity
    out[:3, :3] += np.diag([y + z, x + z, x + y])
    return out


def quotient_distance(one: Array, two: Array, norm: Array) -> float:
    """Compute E between two pairs of twists (2, 6), under the norm of a matrix (6, 6)."""

    def squared(a: Array, b: Array) -> float:
        return float(np.einsum("ij,jk,ik->", a - b, norm, a - b))

    least = min(squared(one, two), squared(one, two[::-1]))
    return float(np.sqrt(least if np.isnan(least) else max(0.0, least)))  # max would hide NaN


def _is_finite(joint: PredictedJoint) -> bool:
    """Return whether all numbers in the twists of a joint are finite."""
    pivot = () if joint.kind == "prismatic" else joint.pivot_o
    return bool(np.isfinite([*joint.axis_o, *pivot, *(_limits(joint) or ())]).all())


def _limits(joint: PredictedJoint | None) -> tuple[float, float] | None:
    """Return the limits of a joint, (0, 0) for no joint, None without limits."""
    if joint is None or joint.kind == "fixed":
        return 0.0, 0.0
    if joint.kind == "continuous" or joint.lower is None or joint.upper is None:
        return None
    return joint.lower, joint.upper


def _pair(twist: Array, limits: tuple[float, float]) -> Array:
    return np.stack([limits[0] * twist, limits[1] * twist])


def _compact(twist: Array, limits: tuple[float, float] | None, norm: Array) -> Array:
    """Map the pair (2, 6) into the unit ball of the norm; to antipodes on it without limits."""
    if limits is None:
        length = float(np.sqrt(twist @ norm @ twist))
        return np.stack([twist, -twist]) / (length or 1.0)
    pair = _pair(twist, limits)
    length = np.sqrt(np.einsum("ij,jk,ik->i", pair, norm, pair))[:, None]
    scale = np.tanh(length / KAPPA) / np.where(length > 0.0, length, 1.0)
    return np.asarray(pair * scale)
