"""Errors of a predicted joint: the formulas of all protocols.

Both joints are :class:`PredictedJoint` in the frame ``o``. Lengths are in the units of the data
set, which for PartNet-Mobility are not metres: its objects have a diagonal of about two units, so
that "50 mm" means 0.05 units. ``docs/results/benchmark.md`` states where the published formulas
fail. This module has them as published, and corrected ones beside them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from articulate.benchmark.endpoint_error import Endpoints, endpoint_metrics
from articulate.reconstruct.actors.protocol import PredictedJoint
from articulate.transforms import Array, angle_between, apply, normalised

PARALLEL = 1e-3
"""Sine below which two axes count as parallel in the protocol ``paper``."""
FULL_TURN_RAD = 2.0 * np.pi - 0.25
"""A revolute joint with this range or more counts as continuous in ``strict``."""
MOTION_LENGTH = 0.05
"""Largest error of a corner at the limits [units], plus ``MOTION_ANGLE_RAD`` times its distance
from the axis."""
MOTION_ANGLE_RAD = 0.25
MOTION_SHARE = 0.25
"""Largest error of a corner as a share of the true travel of the part."""
_UNIT_BOX = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=float)


@dataclass(frozen=True, kw_only=True)
class JointErrors:
    """All errors of a predicted joint.

    Errors that do not apply are None; those that the formula leaves undefined are NaN.
    """

    kind_equal: bool
    """Both slide or both turn; continuous counts as revolute."""
    kind_same_word: bool
    """Both have the same joint type of URDF."""
    kind_strict: bool
    """Both slide, both turn without limits, or both turn between limits."""
    axis_rad: float
    """Angle between the axes without their signs, in [0, pi/2]."""
    origin_paper: float | None
    """The published origin error of turning joints; None for a true slide."""
    origin_literal: float
    """The published origin error; for slides the distance of the origins."""
    origin_released: float
    """Origin error of the released code."""
    origin_foot: float | None
    """Distance of the predicted line from the true one near the part; None unless both turn."""
    range_paper: float | None
    """Difference of the motions [rad or units]; None where the truth has no limits."""
    direction_paper: float | None
    """1 - cosine between the motions; None where the truth has no limits."""
    range_released: float
    direction_released: float
    motion: float | None
    """Largest error of a corner's position over the threshold; None without limits."""
    endpoints: Endpoints
    """Distances of ArticulateArena."""


def joint_errors(truth: PredictedJoint, predicted: PredictedJoint, box_o: Array) -> JointErrors:
    """Compute the errors of ``predicted``.

    Args:
        truth: The true joint.
        predicted: The predicted joint; not ``fixed``.
        box_o: Lowest and highest corner of the moving part (2, 3) in ``o`` at zero [units].
    """
    turns = truth.kind != "prismatic"
    both_turn = turns and predicted.kind not in {"prismatic", "fixed"}
    range_paper, direction_paper = paper_limit(truth, predicted)
    range_released, direction_released = released_limit(truth, predicted)
    literal = line_distance if turns else origin_distance
    return JointErrors(
        kind_equal=turns == (predicted.kind != "prismatic") and predicted.kind != "fixed",
        kind_same_word=truth.kind == predicted.kind,
        kind_strict=strict_kind(truth) == strict_kind(predicted),
        axis_rad=axis_error(truth.axis_o, predicted.axis_o),
        origin_paper=line_distance(truth, predicted) if turns else None,
        origin_literal=literal(truth, predicted),
        origin_released=released_origin(truth, predicted),
        origin_foot=foot_distance(truth, predicted, box_o.mean(axis=0)) if both_turn else None,
        range_paper=range_paper,
        direction_paper=direction_paper,
        range_released=range_released,
        direction_released=direction_released,
        motion=motion_excess(truth, predicted, box_o),
        endpoints=endpoint_metrics(truth, predicted, box_o),
    )


def strict_kind(joint: PredictedJoint) -> str:
    """Return the kind of a joint; a range of (nearly) a full turn counts as continuous."""
    if joint.kind == "revolute":
        if joint.lower is None or joint.upper is None:
            return "continuous"
        return "continuous" if joint.upper - joint.lower >= FULL_TURN_RAD else "revolute"
    return joint.kind


def axis_error(truth: ArrayLike, predicted: ArrayLike) -> float:
    """Return the angle between two axes (3,) [rad] in [0, pi/2]; NaN for zero or infinite ones."""
    a, b = np.asarray(truth, dtype=np.float64), np.asarray(predicted, dtype=np.float64)
    if not (np.isfinite(a).all() and np.isfinite(b).all() and a.any() and b.any()):
        return float("nan")
    return float(min(angle_between(a, b), angle_between(a, -b)))


def line_distance(truth: PredictedJoint, predicted: PredictedJoint) -> float:
    """Compute the published origin error |p . (a x b)| / |a x b|, or the distance if parallel."""
    p, a, b = _origins(truth, predicted)
    across = np.cross(b, a)
    sine = float(np.linalg.norm(across))
    if sine < PARALLEL:
        return float(np.linalg.norm(np.cross(p, a)))
    return float(abs(p @ across) / sine)


def origin_distance(truth: PredictedJoint, predicted: PredictedJoint) -> float:
    """Compute the distance of the two origins."""
    return float(np.linalg.norm(_origins(truth, predicted)[0]))


def foot_distance(truth: PredictedJoint, predicted: PredictedJoint, centre_o: Array) -> float:
    """Compute the distance of the predicted axis from the true one near the part.

    It is the distance from the point of the true axis that is nearest to the part.

    Args:
        truth: The true joint.
        predicted: The predicted joint.
        centre_o: Centre of the part (3,) [units].
    """
    _, a, b = _origins(truth, predicted)
    pivot = np.asarray(truth.pivot_o, dtype=np.float64)
    foot = pivot + ((centre_o - pivot) @ a) * a
    away = foot - np.asarray(predicted.pivot_o, dtype=np.float64)
    return float(np.linalg.norm(away - (away @ b) * b))


def released_origin(truth: PredictedJoint, predicted: PredictedJoint) -> float:
    """Compute the origin error of the released code with its fallback for parallel axes.

    The fallback measures along one direction only, and returns NaN for an axis (-1, 0, 0).
    """
    a = np.asarray(truth.axis_o, dtype=np.float64)
    b = np.asarray(predicted.axis_o, dtype=np.float64)
    p = np.asarray(truth.pivot_o, dtype=np.float64) - np.asarray(predicted.pivot_o, np.float64)
    if truth.kind != "revolute":
        return float(np.linalg.norm(p))
    w = np.cross(b, a)
    if np.allclose(w, 0.0):
        x, y = np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])
        w = np.cross(a, y) if np.allclose(b, x) else np.cross(b, x)
    with np.errstate(invalid="ignore", divide="ignore"):
        return float(np.abs(p @ w) / np.linalg.norm(w))


def paper_limit(
    truth: PredictedJoint, predicted: PredictedJoint
) -> tuple[float | None, float | None]:
    """Compute the published errors of range and direction, with the axis on the truth's side.

    A prediction without limits is infinitely far off; a motion of no length has no direction, and
    its error is NaN.
    """
    if truth.lower is None or truth.upper is None:
        return None, None
    if predicted.lower is None or predicted.upper is None:
        return float("inf"), float("nan")
    _, a, b = _origins(truth, predicted)
    sign = -1.0 if a @ b < 0.0 else 1.0
    # (axis, lower, upper) and (-axis, -upper, -lower) are the same joint; so is the length below.
    m, n = a * (truth.upper - truth.lower), sign * b * (predicted.upper - predicted.lower)
    lengths = float(np.linalg.norm(m) * np.linalg.norm(n))
    direction = 1.0 - float(m @ n) / lengths if lengths > 0.0 else float("nan")
    return float(np.linalg.norm(m - n)), direction


def released_limit(truth: PredictedJoint, predicted: PredictedJoint) -> tuple[float, float]:
    """Errors of range and direction in the released code: of two signs the one that agrees."""
    limits = (truth.lower, truth.upper, predicted.lower, predicted.upper)
    l1, u1, l2, u2 = (float("nan") if value is None else value for value in limits)
    a, b = np.asarray(truth.axis_o, np.float64), np.asarray(predicted.axis_o, np.float64)
    one = _released_motion(a, l1, u1, b, l2, u2)
    other = _released_motion(a, l1, u1, -b, -u2, -l2)
    return one if one[1] < other[1] else other


def _released_motion(
    a: Array, l1: float, u1: float, b: Array, l2: float, u2: float
) -> tuple[float, float]:
    m, n = a * (u1 - l1), b * (u2 - l2)
    length_m, length_n = np.linalg.norm(m), np.linalg.norm(n)
    unit_m = m / length_m if length_m != 0.0 else a
    unit_n = n / length_n if length_n != 0.0 else b
    return float(np.linalg.norm(n - m)), float(1.0 - unit_m @ unit_n)


def motion_excess(truth: PredictedJoint, predicted: PredictedJoint, box_o: Array) -> float | None:
    """Compute the largest error of a corner's position over its threshold.

    The corners of the part's box are compared at both limits, in either order, and in the middle,
    which distinguishes half turns to either side. The result is None if both joints turn without
    limits.

    Args:
        truth: The true joint.
        predicted: The predicted joint.
        box_o: Lowest and highest corner of the part (2, 3) [units].
    """
    if strict_kind(truth) == "continuous":
        return None if strict_kind(predicted) == "continuous" else float("inf")
    if truth.lower is None or truth.upper is None:
        return None
    if predicted.lower is None or predicted.upper is None:
        return float("inf")
    corners = box_o[0] + _UNIT_BOX * (box_o[1] - box_o[0])
    true_o = _positions(truth, truth.lower, truth.upper, corners)
    predicted_o = _positions(predicted, predicted.lower, predicted.upper, corners)
    allowed = _allowed(truth, corners)
    excess = [
        float((np.linalg.norm(true_o - positions, axis=-1) / allowed).max())
        for positions in (predicted_o, predicted_o[::-1])
    ]
    return float("nan") if np.isnan(excess).any() else min(excess)


def _positions(joint: PredictedJoint, lower: float, upper: float, corners: Array) -> Array:
    """Move the corners (8, 3) to the lower limit, the middle and the upper limit (3, 8, 3)."""
    q = np.array([lower, 0.5 * (lower + upper), upper])
    return apply(joint.T_o(q)[:, None], corners)


def _allowed(truth: PredictedJoint, corners: Array) -> Array:
    """Return the threshold of each corner (8,) [units]."""
    assert truth.lower is not None
    assert truth.upper is not None
    span = abs(truth.upper - truth.lower)
    axis = normalised(truth.axis_o)
    arm = corners - np.asarray(truth.pivot_o, dtype=np.float64)
    lever = np.linalg.norm(np.cross(arm, axis), axis=-1)
    if truth.kind == "prismatic":
        lever, travel = np.zeros(len(corners)), span
    else:
        travel = 2.0 * float(lever.max()) * np.sin(0.5 * min(span, np.pi))
    least = np.minimum(MOTION_LENGTH + MOTION_ANGLE_RAD * lever, MOTION_SHARE * travel)
    return np.asarray(np.maximum(least, 1e-9))


def _origins(truth: PredictedJoint, predicted: PredictedJoint) -> tuple[Array, Array, Array]:
    """Return the vector from the predicted to the true origin, and both unit axes."""
    p = np.asarray(truth.pivot_o, np.float64) - np.asarray(predicted.pivot_o, np.float64)
    return p, normalised(truth.axis_o), normalised(predicted.axis_o)


def ordered(joint: PredictedJoint) -> PredictedJoint:
    """Return the joint with its limits in order; predictions may have them swapped."""
    if joint.lower is None or joint.upper is None or joint.lower <= joint.upper:
        return joint
    return replace(joint, lower=joint.upper, upper=joint.lower)
