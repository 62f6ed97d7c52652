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
MOTION = (-0.37, 0.56, 0.29, -1.63)
"""Bias and weights of the logit of the category's score, of the logit of the joint's score and of a
motion that is not explained, fitted by ``benchmarks/videos.py confidence`` to 66 videos of the
development half, each without and with its category as text."""
UNEXPLAINED = 0.995
"""Error of the motion in a video from which no joint explains it."""
MIN_MOTION = 0.75
"""Confidence below which the result of a video is doubtful. Of 40 other videos of the development
half, 8 of 8 above it are right without a text, and 30 of 33 with one."""


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
    error: float
    """Error of the motion over that of a resting object, in [0, 1]."""

    def confidence(self) -> float:
        """Return the probability that category, part, joint type and axis are right."""
        x = MOTION[0] + sum(w * v for w, v in zip(MOTION[1:], self.terms(), strict=True))
        return float(1.0 / (1.0 + np.exp(-x)))

    def terms(self) -> tuple[float, float, float]:
        """Return the values that the weights multiply: category, joint and motion."""
        return logit(self.category), logit(self.joint), float(self.error >= UNEXPLAINED)

    def weakest(self) -> str:
        """Return the score that reduces the confidence most: category, joint or motion."""
        best = (MOST_LOGIT, MOST_LOGIT, 0.0)
        names = ("category", "joint", "motion")
        loss = [w * (b - v) for w, b, v in zip(MOTION[1:], best, self.terms(), strict=True)]
        return names[int(np.argmax(loss))]


def logit(score: float) -> float:
    """Return the logit of a score in [0, 1], within ``MOST_LOGIT``."""
    p = float(np.clip(score, 1e-3, 1.0 - 1e-3))
    return float(np.clip(np.log(p / (1.0 - p)), -MOST_LOGIT, MOST_LOGIT))


def _regression(x: float, bias_and_weight: tuple[float, float]) -> float:
    bias, weight = bias_and_weight
    return float(1.0 / (1.0 + np.exp(-bias - weight * x)))
