"""Probability that category and parts of a proposed object are right."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from articulate.transforms import Array

BIAS = -0.04
WEIGHTS = (0.76, 1.54)
"""Logistic regression on ``Evidence.features``, fitted by ``benchmarks/photo_confidence.py`` to the
development half of photos and renders."""
MIN_CONFIDENCE = 0.8
"""Confidence below which a result is doubtful; from the same command."""
MOST_LOGIT = 4.0
LEAST_PARTS = 0.02


@dataclass(frozen=True, kw_only=True)
class Evidence:
    """Evidence for a proposed object."""

    category: float
    """Probability of the category."""
    parts: float | None
    """Certainty of the parts of the front; None where the category determines them."""

    def features(self) -> Array:
        """Return the features of the regression (2,), at most ``MOST_LOGIT`` and 0."""
        p = float(np.clip(self.category, 1e-3, 1.0 - 1e-3))
        known = 1.0 if self.parts is None else max(self.parts, LEAST_PARTS)
        logit = float(np.clip(np.log(p / (1.0 - p)), -MOST_LOGIT, MOST_LOGIT))
        return np.array([logit, float(np.log(known))])

    def confidence(self) -> float:
        """Return the probability that category and parts are right."""
        return float(1.0 / (1.0 + np.exp(-BIAS - self.features() @ WEIGHTS)))

    def weakest(self) -> str:
        """Return the evidence that lowers the confidence most: category or parts."""
        losses = (self.features() - [MOST_LOGIT, 0.0]) * WEIGHTS
        return ("category", "parts")[int(np.argmin(losses))]
