"""Statistics of evaluations: proportions and means with 95 % intervals, success by parameter."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.stats import binomtest, bootstrap

from articulate.transforms import Array, Mask

SEED_RESAMPLES = 10_000
"""Bootstrap samples of the mean over seeds."""
CLUSTER_RESAMPLES = 2_000
"""Bootstrap samples of a clustered mean."""


@dataclass(frozen=True, kw_only=True)
class Share:
    """Proportion of successes, or a mean of proportions, with its 95 % interval."""

    value: float
    """Proportion, in [0, 1]."""
    low: float
    """Lower end of the interval."""
    high: float
    """Upper end of the interval."""
    n: int
    """Number of trials."""


@dataclass(frozen=True, kw_only=True)
class Mean:
    """Mean with its 95 % interval; None without values."""

    n: int
    mean: float | None
    low: float | None
    high: float | None
    median: float | None


@dataclass(frozen=True, kw_only=True)
class Difference:
    """Difference of two proportions, with its 95 % interval."""

    value: float
    """First proportion minus the second."""
    low: float
    """Lower end of the interval."""
    high: float
    """Upper end of the interval."""


@dataclass(frozen=True, kw_only=True)
class Bin:
    """Success among the episodes whose parameter was sampled in one range."""

    begin: float
    """Smallest sampled value of the range."""
    end: float
    """Largest sampled value of the range."""
    centre: float
    """Median of the sampled values of the range."""
    success: Share
    """Success rate, with Wilson's interval."""


def percent(share: float) -> str:
    """Format a proportion in per cent; only exactly 1 gives 100.0 and only exactly 0 gives 0.0."""
    rounded = round(100.0 * share, 1)
    if 0.0 < share < 1.0:
        rounded = min(max(rounded, 0.1), 99.9)
    return f"{rounded:.1f}"


def wilson(successes: int, n: int) -> Share:
    """Proportion of ``successes`` among ``n`` trials with Wilson's score interval (Wilson 1927).

    Raises:
        ValueError: ``n`` is below 1, or ``successes`` is not in [0, ``n``].
    """
    if not 0 <= successes <= n or n < 1:
        raise ValueError(f"{successes} successes of {n} trials")
    interval = binomtest(successes, n).proportion_ci(0.95, method="wilson")
    # Rounding must not separate the bounds from the proportion at 0 and 1.
    low = 0.0 if successes == 0 else float(interval.low)
    high = 1.0 if successes == n else float(interval.high)
    return Share(value=successes / n, low=low, high=high, n=n)


def difference(one: Share, other: Share) -> Difference:
    """Difference of two independent proportions that have Wilson's intervals.

    The interval is Newcombe's hybrid score interval (Newcombe 1998, method 10). It stays within
    [-1, 1] and holds for proportions near 0 and 1.
    """
    gap = one.value - other.value
    low = gap - float(np.hypot(one.value - one.low, other.high - other.value))
    high = gap + float(np.hypot(one.high - one.value, other.value - other.low))
    return Difference(value=gap, low=low, high=high)


def clustered_mean(
    values: Sequence[float], clusters: Sequence[str], rng: np.random.Generator
) -> Mean:
    """Mean of ``values`` with a bootstrap over ``clusters``, whose values are not independent.

    Args:
        values: One value for each joint.
        clusters: Object of each joint.
        rng: Random generator of the resamples.
    """
    if not len(values):
        return Mean(n=0, mean=None, low=None, high=None, median=None)
    names, index = np.unique(np.asarray(clusters), return_inverse=True)
    data = np.asarray(values, dtype=np.float64)
    sums, counts = np.bincount(index, data), np.bincount(index)
    low = high = float(data.mean())
    if len(names) > 1:

        def mean(s: Any, c: Any, axis: int) -> Any:
            return s.sum(axis=axis) / c.sum(axis=axis)

        found = bootstrap(
            (sums, counts),
            mean,
            paired=True,
            vectorized=True,
            n_resamples=CLUSTER_RESAMPLES,
            method="percentile",
            rng=rng,
        ).confidence_interval
        low, high = float(found.low), float(found.high)
    median = float(np.median(data))
    return Mean(n=len(data), mean=float(data.mean()), low=low, high=high, median=median)


def iqm(scores: Array) -> Array:
    """Interquartile mean of scores (..., S) along the last axis, shape (...), in their unit.

    A value across a quartile counts with the fraction inside, so that the mean is defined for any
    number of scores: of three, the middle one weighs four times an outer one.
    """
    ordered = np.sort(np.asarray(scores, dtype=np.float64), axis=-1)
    edges = np.arange(ordered.shape[-1] + 1) / ordered.shape[-1]
    weights = np.diff(np.clip(edges, 0.25, 0.75)) / 0.5
    return np.asarray(ordered @ weights)


def iqm_over_seeds(
    hits: Sequence[Mask], rng: np.random.Generator, resamples: int = SEED_RESAMPLES
) -> Share:
    """Interquartile mean of the seeds' success rates, with a stratified bootstrap interval.

    Seeds are resampled, and the episodes within each seed, so that the interval covers other seeds
    and other episodes (percentiles 2.5 and 97.5).

    Args:
        hits: Success of the episodes of each seed (E,), boolean; seeds may differ in E.
        rng: Random generator of the resamples.
        resamples: Number of resamples.
    """
    count = np.array([len(h) for h in hits])
    share = np.array([np.mean(h) for h in hits])
    seeds = rng.integers(len(hits), size=(resamples, len(hits)))
    # The number of hits among E of E episodes sampled with replacement is binomial.
    again = rng.binomial(count[seeds], share[seeds]) / count[seeds]
    low, high = np.quantile(iqm(again), [0.025, 0.975])
    return Share(value=float(iqm(share)), low=float(low), high=float(high), n=int(count.sum()))


def success_by_range(values: Array, hits: Mask, bins: int = 6) -> tuple[Bin, ...]:
    """Success rates in ranges of a sampled parameter with equally many episodes.

    A parameter with few distinct values has one range for each; one that was not varied has none.

    Args:
        values: Sampled values (E,), in the unit of the parameter.
        hits: Success of the episodes (E,), boolean.
        bins: Number of ranges; up to twice as many distinct values are kept apart.
    """
    distinct = np.unique(values)
    if len(distinct) < 2:
        return ()
    if len(distinct) <= 2 * bins:
        label = np.searchsorted(distinct, values)
    else:
        inner = np.quantile(values, np.arange(1, bins) / bins)
        label = np.searchsorted(inner, values, side="right")
    out = []
    for k in np.unique(label):
        inside = values[label == k]
        out.append(
            Bin(
                begin=float(inside.min()),
                end=float(inside.max()),
                centre=float(np.median(inside)),
                success=wilson(int(hits[label == k].sum()), len(inside)),
            )
        )
    return tuple(out)


def dispersion(bins: Sequence[Bin]) -> float:
    """Dispersion of success between ranges: Pearson's chi-square over its degrees of freedom.

    About 1 by chance; 0 if all episodes ended alike.
    """
    n = np.array([b.success.n for b in bins], dtype=np.float64)
    p = np.array([b.success.value for b in bins])
    mean = float(np.sum(n * p) / np.sum(n)) if len(bins) else 0.0
    if len(bins) < 2 or mean * (1.0 - mean) < 1e-12:
        return 0.0
    return float(np.sum(n * (p - mean) ** 2) / (mean * (1.0 - mean)) / (len(bins) - 1))
