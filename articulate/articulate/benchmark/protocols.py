"""The three protocols: from errors to the first failure."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from articulate.benchmark.metrics import JointErrors, joint_errors, ordered
from articulate.reconstruct.actors.protocol import Failure, PredictedJoint
from articulate.transforms import Array

Protocol = Literal["paper", "released_code", "strict"]
PROTOCOLS: tuple[Protocol, ...] = ("paper", "released_code", "strict")
ANGLE_RAD = 0.25
LENGTH = 0.05
"""The publication's thresholds: 0.25 rad, and 50 mm, which are 0.05 units of PartNet-Mobility."""
DIRECTION = 1.0 - float(np.cos(ANGLE_RAD))
"""Largest difference of motion directions, 1 - cosine of the same angle."""
RELEASED_RANGE_RAD = 1.6057
"""Threshold of the range in the released code [rad]: 92 degrees."""
RELEASED_DIRECTION = 1.0
RELEASED_SCORE: dict[Failure, int] = {
    "success": 10,
    "joint_type": 0,
    "joint_axis": 1,
    "joint_origin": 2,
    "joint_limit": 3,
}
"""Rank of attempts in the released code, which compares them with the truth."""


@dataclass(frozen=True, kw_only=True)
class JointScore:
    """Errors and failures of a predicted joint."""

    errors: JointErrors | None
    """None if no joint was predicted for the part."""
    failures: dict[Protocol, Failure]
    """First failure by protocol."""
    literal_origin: Failure
    """First failure in ``paper`` with the published origin error applied to slides as well."""


def score(truth: PredictedJoint, predicted: PredictedJoint | None, box_o: Array) -> JointScore:
    """Score a predicted joint by each protocol.

    Args:
        truth: The true joint.
        predicted: The predicted joint of its part; None or ``fixed`` without motion.
        box_o: Lowest and highest corner of the part (2, 3) in ``o`` at zero [units].
    """
    if predicted is None or predicted.kind == "fixed":
        return JointScore(
            errors=None,
            failures=dict.fromkeys(PROTOCOLS, "joint_type"),
            literal_origin="joint_type",
        )
    truth = ordered(truth)
    errors = joint_errors(truth, ordered(predicted), box_o)
    return JointScore(
        errors=errors,
        failures={
            "paper": paper_failure(errors, slides=truth.kind == "prismatic"),
            "released_code": released_failure(errors, slides=truth.kind == "prismatic"),
            "strict": strict_failure(errors),
        },
        literal_origin=paper_failure(errors, slides=truth.kind == "prismatic", literal_origin=True),
    )


def paper_failure(errors: JointErrors, *, slides: bool, literal_origin: bool = False) -> Failure:
    """Return the first failure by the publication's text; undefined errors fail.

    Args:
        errors: Errors of the joint.
        slides: The true joint is a slide: its range is a length, and it has no origin.
        literal_origin: Also check the origin of slides.
    """
    if not errors.kind_equal:
        return "joint_type"
    if not errors.axis_rad <= ANGLE_RAD:
        return "joint_axis"
    origin = errors.origin_literal if literal_origin else errors.origin_paper
    if origin is not None and not origin <= LENGTH:
        return "joint_origin"
    if errors.range_paper is None or errors.direction_paper is None:
        return "success"
    if not errors.range_paper <= (LENGTH if slides else ANGLE_RAD):
        return "joint_limit"
    return "success" if errors.direction_paper <= DIRECTION else "joint_limit"


def released_failure(errors: JointErrors, *, slides: bool, frame_angle_rad: float = 0.0) -> Failure:
    """Return the first failure in the released code, in which NaN and some slides pass.

    Args:
        errors: Errors of the joint.
        slides: The true joint is a slide.
        frame_angle_rad: Angle between the frames of the two joints; predictions here are in the
            frame ``o`` of the truth.
    """
    if not errors.kind_same_word:
        return "joint_type"
    if errors.axis_rad > ANGLE_RAD:
        return "joint_axis"
    if (errors.origin_released + frame_angle_rad) / 2.0 > LENGTH:
        return "success" if slides else "joint_origin"
    if errors.direction_released > RELEASED_DIRECTION or errors.range_released > RELEASED_RANGE_RAD:
        return "success" if slides else "joint_limit"
    return "success"


def strict_failure(errors: JointErrors) -> Failure:
    """Return the first failure if the part must move as in truth; NaN fails."""
    if not errors.kind_strict:
        return "joint_type"
    if not errors.axis_rad <= ANGLE_RAD:
        return "joint_axis"
    if errors.origin_foot is not None and not errors.origin_foot <= LENGTH:
        return "joint_origin"
    if errors.motion is not None and not errors.motion <= 1.0:
        return "joint_limit"
    return "success"


def counts_in_released(truth: PredictedJoint) -> bool:
    """Return whether the released code scores the joint; it omits continuous ones."""
    return truth.kind in {"revolute", "prismatic"}


def best_by_truth(scored: Sequence[JointScore]) -> int:
    """Return the attempt that the released code keeps: the last of the best by the truth."""
    ranks = [RELEASED_SCORE[s.failures["released_code"]] for s in scored]
    best = max(ranks)
    return max(i for i, rank in enumerate(ranks) if rank == best)


def best_by_critic(ratings: Sequence[float | None]) -> int:
    """Return the first attempt with the highest rating; the last one without ratings."""
    rated = [(r, -i) for i, r in enumerate(ratings) if r is not None and np.isfinite(r)]
    return -max(rated)[1] if rated else len(ratings) - 1
