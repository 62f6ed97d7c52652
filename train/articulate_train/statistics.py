"""Statistics of evaluations: shares with intervals, means over seeds, success by parameter."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from articulate.transforms import Array, Mask

Z_95 = 1.959963984540054
"""Two-sided 95 % quantile of the standard normal distribution."""
RESAMPLES = 10_000
"""Bootstrap samples."""


@dataclass(frozen=True, kw_only=True)
class Share:
    """A share of episodes, or a mean of such shares, with its 95 % interval."""

    value: float
    """The share, in [0, 1]."""
    low: float
    """Lower end of the interval."""
    high: float
    """Upper end of the interval."""
    episodes: int
    """Number of episodes that it rests on."""


def percent(share: float) -> str:
    """``share`` in per cent with one decimal: 100.0 is all of them and 0.0 none, nothing less."""
    rounded = round(100.0 * share, 1)
    if 0.0 < share < 1.0:
        rounded = min(max(rounded, 0.1), 99.9)
    return f"{rounded:.1f}"


@dataclass(frozen=True, kw_only=True)
class Bin:
    """Success among the episodes whose parameter was drawn in one range."""

    begin: float
    """Smallest value drawn in the range."""
    end: float
    """Largest value drawn in the range."""
    centre: float
    """Median of the values drawn in the range."""
    success: Share
    """Share of successes, with Wilson's interval."""


def wilson(hits: int, episodes: int, z: float = Z_95) -> Share:
    """Share of hits with Wilson's score interval (Wilson 1927), which stays within [0, 1].

    Args:
        hits: Number of successes.
        episodes: Number of episodes, at least 1.
        z: Quantile of the normal distribution.
    """
    if not 0 <= hits <= episodes or episodes < 1:
        raise ValueError(f"{hits} hits of {episodes} episodes")
    p = hits / episodes
    spread = z * np.sqrt(p * (1.0 - p) / episodes + (z / (2.0 * episodes)) ** 2)
    middle, norm = p + z**2 / (2.0 * episodes), 1.0 + z**2 / episodes
    # Rounding must not part the bounds from the share at 0 and 1.
    low = 0.0 if hits == 0 else float((middle - spread) / norm)
    high = 1.0 if hits == episodes else float((middle + spread) / norm)
    return Share(value=p, low=low, high=high, episodes=episodes)


@dataclass(frozen=True, kw_only=True)
class Difference:
    """Difference of two shares, with its 95 % interval."""

    value: float
    """First share less the second."""
    low: float
    """Lower end of the interval."""
    high: float
    """Upper end of the interval."""


def difference(one: Share, other: Share) -> Difference:
    """``one`` less ``other``, two independent shares with Wilson's intervals.

    The interval is Newcombe's hybrid score interval (Newcombe 1998, method 10), which stays
    within [-1, 1] and is sound for shares near 0 and 1.
    """
    gap = one.value - other.value
    low = gap - float(np.hypot(one.value - one.low, other.high - other.value))
    high = gap + float(np.hypot(one.high - one.value, other.value - other.low))
    return Difference(value=gap, low=low, high=high)


def iqm(scores: Array) -> Array:
    """Interquartile mean along the last axis: the mean of the middle half, shape (...).

    A value that lies across a quartile counts with the share of it that is inside, so that it
    is defined for any number of scores: of three, the middle one weighs four times an outer one.

    Args:
        scores: Scores (..., S).
    """
    ordered = np.sort(np.asarray(scores, dtype=np.float64), axis=-1)
    edges = np.arange(ordered.shape[-1] + 1) / ordered.shape[-1]
    weights = np.diff(np.clip(edges, 0.25, 0.75)) / 0.5
    return np.asarray(ordered @ weights)


def iqm_over_seeds(
    hits: Sequence[Mask], rng: np.random.Generator, resamples: int = RESAMPLES
) -> Share:
    """Interquartile mean of the seeds' shares, with a stratified bootstrap interval.

    Seeds are drawn with replacement, and within each the episodes, so that the interval holds
    both what other seeds and what other episodes might have shown (percentiles 2.5 and 97.5).

    Args:
        hits: For each seed, which of its episodes succeeded (E,); seeds may differ in E.
        rng: Decides the resamples.
        resamples: Number of them.
    """
    count = np.array([len(h) for h in hits])
    share = np.array([np.mean(h) for h in hits])
    seeds = rng.integers(len(hits), size=(resamples, len(hits)))
    # Drawing E of E episodes with replacement and counting the hits among them is binomial.
    again = rng.binomial(count[seeds], share[seeds]) / count[seeds]
    low, high = np.quantile(iqm(again), [0.025, 0.975])
    return Share(
        value=float(iqm(share)), low=float(low), high=float(high), episodes=int(count.sum())
    )


def success_against(values: Array, hits: Mask, bins: int = 6) -> tuple[Bin, ...]:
    """Success in ranges of a drawn parameter that hold equally many episodes.

    A parameter that takes few distinct values has one range for each; one that was not varied
    has none.

    Args:
        values: What was drawn (E,).
        hits: Which episodes succeeded (E,).
        bins: Number of ranges; twice as many distinct values are kept apart.
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


def unevenness(bins: Sequence[Bin]) -> float:
    """How much success differs between ranges, against what chance alone gives (about 1).

    Pearson's statistic over its degrees of freedom; 0 where every episode ended alike.
    """
    n = np.array([b.success.episodes for b in bins], dtype=np.float64)
    p = np.array([b.success.value for b in bins])
    mean = float(np.sum(n * p) / np.sum(n)) if len(bins) else 0.0
    if len(bins) < 2 or mean * (1.0 - mean) < 1e-12:
        return 0.0
    return float(np.sum(n * (p - mean) ** 2) / (mean * (1.0 - mean)) / (len(bins) - 1))
