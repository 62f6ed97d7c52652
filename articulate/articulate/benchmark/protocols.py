"""The three protocols: from errors to what failed first."""

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
"""Directions of motion may differ by the same angle."""
RELEASED_RANGE_RAD = 1.6057
"""Threshold of the range in the released code: 92 degrees."""
RELEASED_DIRECTION = 1.0
RELEASED_SCORE: dict[Failure, int] = {
    "success": 10,
    "joint_type": 0,
    "joint_axis": 1,
    "joint_origin": 2,
    "joint_limit": 3,
}
"""What the released code ranks attempts by, with the truth at hand."""


@dataclass(frozen=True, kw_only=True)
class Scored:
    """A predicted joint against the true one."""

    errors: JointErrors | None
    """None where nothing was predicted for the part."""
    failures: dict[Protocol, Failure]
    """What failed first, by protocol."""
    literal_origin: Failure
    """Protocol ``paper`` with the published origin error of slides read literally."""


def score(truth: PredictedJoint, predicted: PredictedJoint | None, box_o: Array) -> Scored:
    """What each protocol says.

    Args:
        truth: The true joint.
        predicted: What was said of its part; None or ``fixed`` if it should not move.
        box_o: Lowest and highest corner of the part (2, 3), in ``o`` at zero.
    """
    if predicted is None or predicted.kind == "fixed":
        return Scored(
            errors=None,
            failures=dict.fromkeys(PROTOCOLS, "joint_type"),
            literal_origin="joint_type",
        )
    truth = ordered(truth)
    errors = joint_errors(truth, ordered(predicted), box_o)
    return Scored(
        errors=errors,
        failures={
            "paper": paper_failure(errors, slides=truth.kind == "prismatic"),
            "released_code": released_failure(errors, slides=truth.kind == "prismatic"),
            "strict": strict_failure(errors),
        },
        literal_origin=paper_failure(errors, slides=truth.kind == "prismatic", literal_origin=True),
    )


def paper_failure(errors: JointErrors, *, slides: bool, literal_origin: bool = False) -> Failure:
    """What fails first by the publication's words; what is undefined fails.

    Args:
        errors: Errors of the joint.
        slides: The true joint is a slide: its range is a length, and it has no origin.
        literal_origin: Judge the origin of slides all the same.
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
    """What fails first in the released code, where NaN passes and slides are excused.

    Args:
        errors: Errors of the joint.
        slides: The true joint is a slide.
        frame_angle_rad: Angle between the frames of the two joints. Predictions here have no
            frame but ``o``, which is the truth's.
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
    """What fails first when the part must move as it does in truth; NaN fails."""
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
    """Whether the released code scores the joint at all: continuous ones are left out."""
    return truth.kind in {"revolute", "prismatic"}


def best_by_truth(scored: Sequence[Scored]) -> int:
    """Index of the attempt that the released code would keep: best by the truth, then latest."""
    ranks = [RELEASED_SCORE[s.failures["released_code"]] for s in scored]
    best = max(ranks)
    return max(i for i, rank in enumerate(ranks) if rank == best)


def best_by_critic(ratings: Sequence[float | None]) -> int:
    """Index of the attempt with the highest rating, the earlier of equals; the last unrated one."""
    rated = [(r, -i) for i, r in enumerate(ratings) if r is not None and np.isfinite(r)]
    return -max(rated)[1] if rated else len(ratings) - 1
