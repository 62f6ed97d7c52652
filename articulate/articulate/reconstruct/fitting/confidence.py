"""Probability that category and parts of a proposed object are right."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

CATEGORY = (0.323, 1.215)
PARTS = (-0.134, 0.615)
"""Bias and weight of logistic regressions on the logit of the score, fitted by
``benchmarks/photo_confidence.py`` to the development half of photos and renders."""
FIXED_PARTS = 0.873
"""Share of right parts where the category determines them; from the same command."""
MIN_CONFIDENCE = 0.8
"""Confidence below which a result is doubtful; from the same command."""
MOST_LOGIT = 4.0
MOTION = (0.320, 0.927)
"""Bias and weight of the logit of the category's score in a video, fitted by
``benchmarks/videos.py confidence`` to 39 videos of the development half."""
MIN_MOTION, MIN_JOINT = 0.7, 0.5
"""Confidence, and probability of the joint, below which the result of a video is doubtful. With the
first, 9 of 10 of these videos are right (leave-one-out)."""


@dataclass(frozen=True, kw_only=True)
class Evidence:
    """Scores of a proposed object."""

    category: float
    """Score of the category, in [0, 1]."""
    parts: float | None
    """Score of the parts of the front; None where the category determines them."""

    def confidence(self) -> float:
        """Return the probability that category and parts are right."""
        return self.p_category() * self.p_parts()

    def p_category(self) -> float:
        """Return the probability of the category."""
        return _regression(logit(self.category), CATEGORY)

    def p_parts(self) -> float:
        """Return the probability of the number and kinds of the parts, given the category."""
        return FIXED_PARTS if self.parts is None else _regression(logit(self.parts), PARTS)

    def weakest(self) -> str:
        """Return the less probable: category or parts."""
        return "category" if self.p_category() <= self.p_parts() else "parts"


@dataclass(frozen=True, kw_only=True)
class MotionEvidence:
    """Scores of an object from a video."""

    category: float
    """Probability of the category among all."""
    joint: float
    """Probability of joint type and axis among those of the category."""

    def confidence(self) -> float:
        """Return the probability that category, part, joint type and axis are right."""
        return _regression(logit(self.category), MOTION)


def logit(score: float) -> float:
    """Return the logit of a score in [0, 1], within ``MOST_LOGIT``."""
    p = float(np.clip(score, 1e-3, 1.0 - 1e-3))
    return float(np.clip(np.log(p / (1.0 - p)), -MOST_LOGIT, MOST_LOGIT))


def _regression(x: float, bias_and_weight: tuple[float, float]) -> float:
    bias, weight = bias_and_weight
    return float(1.0 / (1.0 + np.exp(-bias - weight * x)))
