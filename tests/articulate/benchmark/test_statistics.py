from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from articulate.benchmark.statistics import clustered_mean, wilson


@pytest.mark.parametrize(
    ("successes", "n", "low", "high"),
    [(5, 10, 0.23659, 0.76341), (0, 10, 0.0, 0.27753), (10, 10, 0.72247, 1.0)],
)
def test_wilsons_interval_has_its_known_values(successes, n, low, high):
    share = wilson(successes, n)
    assert (share.low, share.high) == pytest.approx((low, high), abs=1e-5)


@given(st.integers(1, 500).flatmap(lambda n: st.tuples(st.integers(0, n), st.just(n))))
def test_the_share_lies_in_its_interval(counts):
    share = wilson(*counts)
    assert None not in (share.share, share.low, share.high)
    ends = [0.0, share.low, share.share, share.high, 1.0]
    assert ends == sorted(float(value or 0.0) for value in ends)


def test_nothing_has_no_share_and_no_mean():
    assert wilson(0, 0).share is None
    assert clustered_mean([], [], np.random.default_rng(0)).mean is None


def test_joints_of_one_object_hang_together():
    """Ten joints of each of eight objects tell as much of the objects as eight, not as eighty."""
    rng = np.random.default_rng(0)
    effects = rng.normal(size=8)
    values = np.repeat(effects, 10).tolist()
    together = clustered_mean(values, [str(k) for k in np.repeat(np.arange(8), 10)], rng)
    apart = clustered_mean(values, [str(k) for k in range(80)], rng)
    assert together.mean == pytest.approx(effects.mean())
    wide, narrow = ((m.high or 0.0) - (m.low or 0.0) for m in (together, apart))
    assert wide > 2.0 * narrow
    assert wide == pytest.approx(2 * 1.96 * effects.std() / np.sqrt(8), rel=0.2)
