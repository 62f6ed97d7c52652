"""Classifiers of candidate parts, learned from rendered videos (``joint_classifier.json``).

Each is the mean of the log-odds of gradient-boosted trees and of a logistic regression. The first
gives the probability that a candidate is the operated part, the second that it rotates. The second,
averaged over the candidates with the first as weight, is calibrated by a logistic curve. Linear
models give the probability that the first motion opens the part.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from articulate.transforms import Array, Ints

PATH = Path(__file__).with_name("joint_classifier.json")
USUAL = 2.5
"""Deviations from the mean to which the features of the linear model are clipped."""
LIMIT = 5.3
"""Largest log-odds of one model: a probability of 0.995."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Trees:
    """Gradient-boosted regression trees of the log-odds, as one array of nodes."""

    roots: Ints
    """First node of each tree."""
    feature: Ints
    """Feature of each node; -1 for a leaf."""
    threshold: Array
    """The left child follows if the feature is at most this; the value of a leaf."""
    right: Ints
    """Right child of each node; the left child is the next node."""
    bias: float

    def log_odds(self, row: Array) -> float:
        """Return the log-odds of one row of features (F,)."""
        total = self.bias
        for root in self.roots:
            node = int(root)
            while self.feature[node] >= 0:
                below = row[self.feature[node]] <= self.threshold[node]
                node = node + 1 if below else int(self.right[node])
            total += float(self.threshold[node])
        return total


@dataclass(frozen=True, kw_only=True, eq=False)
class Classifier:
    """Mean of the log-odds of trees and of a linear model."""

    trees: Trees
    mean: Array
    scale: Array
    weights: Array
    bias: float

    def log_odds(self, row: Array) -> float:
        """Return the log-odds of one row of features (F,)."""
        scaled = np.clip((row - self.mean) / self.scale, -USUAL, USUAL)
        linear = float(scaled @ self.weights) + self.bias
        both = (self.trees.log_odds(row), linear)
        return 0.5 * sum(float(np.clip(value, -LIMIT, LIMIT)) for value in both)


@dataclass(frozen=True, kw_only=True, eq=False)
class JointClassifier:
    """All learned models and the calibration."""

    names: tuple[str, ...]
    """Names of the features, in order."""
    role: Classifier
    """The candidate is the operated part."""
    rotates: Classifier
    """The candidate rotates."""
    power: float
    """Exponent of the first probability in the mean."""
    slope: float
    offset: float
    """Calibration: log-odds times ``slope`` plus ``offset``."""
    doubtful_below: float
    """Probability of the more likely type below which it is doubtful."""
    opening: Mapping[str, Any]
    """Names of the features of the sense of the motion, and a linear model for each joint type."""

    def rows(self, found: Sequence[Mapping[str, float]]) -> Array:
        """Return the features of the candidates (N, F)."""
        return np.array([[one[name] for name in self.names] for one in found])

    def p_opening(self, kind: str, found: Mapping[str, float]) -> float:
        """Return the probability that the first motion opens the part.

        Args:
            kind: Joint type.
            found: Features of the sense of the motion.
        """
        row = np.array([found[name] for name in self.opening["features"]])
        model = self.opening[kind]
        return _probability(float(row @ np.asarray(model["weights"])) + float(model["bias"]))

    def decide(self, found: Sequence[Mapping[str, float]]) -> tuple[float, Array, Array]:
        """Return the probability that the operated part rotates.

        Args:
            found: Features of each candidate.

        Returns:
            The calibrated probability; the probability of each candidate (N,) to be the operated
            part; and the log-odds of each (N,) that it rotates.
        """
        rows = self.rows(found)
        role = np.array([_probability(self.role.log_odds(row)) for row in rows])
        odds = np.array([self.rotates.log_odds(row) for row in rows])
        weight = role**self.power
        mean = float(weight @ odds / weight.sum())
        return _probability(self.slope * mean + self.offset), role, odds


def _probability(log_odds: float) -> float:
    return float(1.0 / (1.0 + np.exp(-log_odds)))


@cache
def joint_classifier() -> JointClassifier:
    """Return the learned classifiers."""
    content = json.loads(PATH.read_text(encoding="utf-8"))
    return JointClassifier(
        names=tuple(content["features"]),
        role=_classifier(content["role"]),
        rotates=_classifier(content["rotates"]),
        power=float(content["power"]),
        slope=float(content["slope"]),
        offset=float(content["offset"]),
        doubtful_below=float(content["doubtful_below"]),
        opening=content["opening"],
    )


def _classifier(content: Mapping[str, Any]) -> Classifier:
    trees = content["trees"]
    return Classifier(
        trees=Trees(
            roots=np.array(trees["roots"]),
            feature=np.array(trees["feature"]),
            threshold=np.array(trees["threshold"]),
            right=np.array(trees["right"]),
            bias=float(trees["bias"]),
        ),
        mean=np.array(content["mean"]),
        scale=np.array(content["scale"]),
        weights=np.array(content["weights"]),
        bias=float(content["bias"]),
    )
