"""Intervals: Wilson's for shares, the bootstrap's over objects for means."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

Z95 = 1.959963984540054
"""Quantile of the normal distribution for 95 %."""
RESAMPLES = 2000


@dataclass(frozen=True, kw_only=True)
class Share:
    """A share of successes with its 95 % interval."""

    successes: int
    n: int
    share: float | None
    """None of nothing."""
    low: float | None
    high: float | None


@dataclass(frozen=True, kw_only=True)
class Mean:
    """A mean with its 95 % interval."""

    n: int
    mean: float | None
    """None of nothing."""
    low: float | None
    high: float | None
    median: float | None


def wilson(successes: int, n: int) -> Share:
    """Share of successes with Wilson's score interval (E. B. Wilson, JASA 22, 1927)."""
    if n == 0:
        return Share(successes=0, n=0, share=None, low=None, high=None)
    p, z2 = successes / n, Z95 * Z95
    middle = (p + z2 / (2 * n)) / (1 + z2 / n)
    half = Z95 * np.sqrt(p * (1 - p) / n + z2 / (4 * n * n)) / (1 + z2 / n)
    # Exact at the ends, where rounding would leave the share outside its interval.
    low = 0.0 if successes == 0 else float(middle - half)
    high = 1.0 if successes == n else float(middle + half)
    return Share(successes=successes, n=n, share=p, low=low, high=high)


def clustered_mean(
    values: Sequence[float], clusters: Sequence[str], rng: np.random.Generator
) -> Mean:
    """Mean of ``values`` with a bootstrap over ``clusters``: joints of one object hang together.

    Args:
        values: One for each joint.
        clusters: The object of each joint.
        rng: Decides the resamples.
    """
    if not len(values):
        return Mean(n=0, mean=None, low=None, high=None, median=None)
    names, index = np.unique(np.asarray(clusters), return_inverse=True)
    data = np.asarray(values, dtype=np.float64)
    sums, counts = np.bincount(index, data), np.bincount(index)
    drawn = rng.integers(len(names), size=(RESAMPLES, len(names)))
    means = sums[drawn].sum(axis=1) / counts[drawn].sum(axis=1)
    low, high = np.percentile(means, [2.5, 97.5])
    return Mean(
        n=len(data),
        mean=float(data.mean()),
        low=float(low),
        high=float(high),
        median=float(np.median(data)),
    )
