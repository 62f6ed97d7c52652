import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from articulate.statistics import (
    clustered_mean,
    difference,
    dispersion,
    iqm,
    iqm_over_seeds,
    percent,
    success_by_range,
    wilson,
)

Z_95 = 1.959963984540054


@pytest.mark.parametrize(
    ("hits", "episodes", "low", "high"),
    [
        # Newcombe 1998, Statistics in Medicine 17, table I, method 3 (score).
        (81, 263, 0.2553, 0.3662),
        (15, 148, 0.0624, 0.1605),
        (0, 20, 0.0, 0.1611),
        (1, 29, 0.0061, 0.1718),
        (5, 10, 0.2366, 0.7634),
        (10, 10, 0.7225, 1.0),
    ],
)
def test_wilson_gives_the_published_intervals(hits, episodes, low, high):
    share = wilson(hits, episodes)
    assert share.value == hits / episodes
    assert share.n == episodes
    assert (share.low, share.high) == pytest.approx((low, high), abs=5e-5)


def test_wilson_bounds_solve_the_score_equation():
    share = wilson(37, 50)
    for bound in (share.low, share.high):
        score = (share.value - bound) / np.sqrt(bound * (1.0 - bound) / 50)
        assert abs(score) == pytest.approx(Z_95)


def test_wilson_of_all_and_of_none_are_mirror_images_within_zero_and_one():
    none, every = wilson(0, 200), wilson(200, 200)
    assert none.low == 0.0
    assert every.high == 1.0
    assert none.high == pytest.approx(1.0 - every.low)
    assert none.high == pytest.approx(Z_95**2 / (200 + Z_95**2))


@pytest.mark.parametrize(("hits", "episodes"), [(3, 2), (-1, 2), (0, 0)])
def test_wilson_rejects_impossible_counts(hits, episodes):
    with pytest.raises(ValueError, match="trials"):
        wilson(hits, episodes)


def test_iqm_of_known_arrays():
    assert iqm(np.arange(8.0)) == 3.5
    assert iqm(np.array([0.0, 1.0, 3.0, 100.0])) == 2.0
    assert iqm(np.array([0.7])) == pytest.approx(0.7)
    # Of three, the outer ones are inside the quartiles with a quarter each.
    assert iqm(np.array([0.9, 0.3, 0.6])) == pytest.approx((0.25 * 0.3 + 0.6 + 0.25 * 0.9) / 1.5)
    # Five at 1, 3, 5, 7, 9: an outer one is out, the next is in by three quarters.
    assert iqm(np.array([1.0, 3.0, 5.0, 7.0, 9.0])) == pytest.approx(5.0)


def test_iqm_runs_along_the_last_axis():
    scores = np.random.default_rng(0).random((4, 5, 12))
    assert iqm(scores).shape == (4, 5)
    assert iqm(scores)[2, 3] == pytest.approx(np.sort(scores[2, 3])[3:9].mean())


def _hits(*counts, episodes=200):
    return [np.arange(episodes) < n for n in counts]


def test_interval_over_seeds_is_decided_by_its_generator():
    hits = _hits(180, 190, 197)
    first, again, other = (iqm_over_seeds(hits, np.random.default_rng(s), 500) for s in (1, 1, 2))
    assert first == again
    assert first != other


def test_interval_over_seeds_holds_the_value_and_grows_with_the_spread_of_seeds():
    close = iqm_over_seeds(_hits(186, 188, 190), np.random.default_rng(0))
    apart = iqm_over_seeds(_hits(150, 188, 199), np.random.default_rng(0))
    for share in (close, apart):
        assert share.low < share.value < share.high
        assert share.n == 600
    assert apart.high - apart.low > 2.0 * (close.high - close.low)


def test_interval_of_one_seed_is_that_of_its_episodes():
    share = iqm_over_seeds(_hits(80, episodes=100), np.random.default_rng(0))
    assert share.value == pytest.approx(0.8)
    spread = Z_95 * np.sqrt(0.8 * 0.2 / 100)
    assert share.low == pytest.approx(0.8 - spread, abs=0.015)
    assert share.high == pytest.approx(0.8 + spread, abs=0.015)


def test_seeds_may_have_different_numbers_of_episodes():
    hits = [np.ones(10, dtype=bool), np.ones(20, dtype=bool)]
    share = iqm_over_seeds(hits, np.random.default_rng(0), 50)
    assert (share.value, share.low, share.high, share.n) == (1.0, 1.0, 1.0, 30)


def test_ranges_hold_equally_many_episodes_and_all_of_them():
    values = np.random.default_rng(0).permutation(120).astype(float)
    bins = success_by_range(values, values < 30, bins=4)
    assert [b.success.n for b in bins] == [30] * 4
    assert [b.success.value for b in bins] == [1.0, 0.0, 0.0, 0.0]
    assert [(b.begin, b.end) for b in bins] == [(0, 29), (30, 59), (60, 89), (90, 119)]
    assert bins[0].centre == 14.5


def test_integers_have_a_range_each():
    values = np.repeat([0.0, 1.0, 2.0], [10, 20, 30])
    bins = success_by_range(values, np.ones(60, dtype=bool))
    assert [(b.begin, b.end, b.success.n) for b in bins] == [
        (0.0, 0.0, 10),
        (1.0, 1.0, 20),
        (2.0, 2.0, 30),
    ]


def test_a_constant_parameter_has_no_ranges():
    assert success_by_range(np.ones(50), np.ones(50, dtype=bool)) == ()


def test_dispersion_is_about_one_by_chance_and_large_for_a_cause():
    rng = np.random.default_rng(0)
    values = rng.random((200, 600))
    chance = [dispersion(success_by_range(v, rng.random(600) < 0.8)) for v in values]
    assert np.mean(chance) == pytest.approx(1.0, abs=0.15)
    assert dispersion(success_by_range(values[0], values[0] > 0.2)) > 50.0


def test_dispersion_is_zero_where_all_episodes_ended_alike():
    values = np.linspace(0.0, 1.0, 60)
    assert dispersion(success_by_range(values, np.ones(60, dtype=bool))) == 0.0
    assert dispersion(()) == 0.0


def test_a_difference_has_newcombes_interval():
    # 56 of 70 against 48 of 80: the example of Newcombe (1998), method 10.
    gap = difference(wilson(56, 70), wilson(48, 80))
    assert gap.value == pytest.approx(0.2)
    assert (gap.low, gap.high) == pytest.approx((0.0524, 0.3339), abs=5e-5)


def test_a_difference_of_the_same_shares_holds_zero_and_stays_within_one():
    for hits in (0, 7, 20):
        gap = difference(wilson(hits, 20), wilson(hits, 20))
        assert gap.value == 0.0
        assert gap.low == pytest.approx(-gap.high)
        assert -1.0 <= gap.low < 0.0 < gap.high <= 1.0
    assert difference(wilson(20, 20), wilson(0, 20)).high == 1.0


@pytest.mark.parametrize(
    ("hits", "episodes", "text"),
    [
        (3000, 3000, "100.0"),
        (2999, 3000, "99.9"),
        (2919, 3000, "97.3"),
        (1, 3000, "0.1"),
        (0, 3000, "0.0"),
    ],
)
def test_a_hundred_per_cent_is_all_of_them_and_nothing_is_none(hits, episodes, text):
    assert percent(hits / episodes) == text


@given(st.integers(1, 500).flatmap(lambda n: st.tuples(st.integers(0, n), st.just(n))))
def test_a_proportion_is_inside_its_interval(counts):
    share = wilson(*counts)
    assert 0.0 <= share.low <= share.value <= share.high <= 1.0


def test_no_values_have_no_mean_and_one_cluster_has_no_width():
    assert clustered_mean([], [], np.random.default_rng(0)).mean is None
    one = clustered_mean([1.0, 3.0], ["a", "a"], np.random.default_rng(0))
    assert (one.mean, one.low, one.high, one.median) == (2.0, 2.0, 2.0, 2.0)


def test_joints_of_one_object_are_not_independent():
    """Ten joints of each of eight objects count like eight values, not like eighty."""
    rng = np.random.default_rng(0)
    effects = rng.normal(size=8)
    values = np.repeat(effects, 10).tolist()
    together = clustered_mean(values, [str(k) for k in np.repeat(np.arange(8), 10)], rng)
    apart = clustered_mean(values, [str(k) for k in range(80)], rng)
    assert together.mean == pytest.approx(effects.mean())
    wide, narrow = ((m.high or 0.0) - (m.low or 0.0) for m in (together, apart))
    assert wide > 2.0 * narrow
    assert wide == pytest.approx(2 * 1.96 * effects.std() / np.sqrt(8), rel=0.2)


def test_a_clustered_mean_has_the_percentiles_of_resampled_clusters():
    values, clusters = [0.0, 1.0, 5.0, 2.0], ["a", "a", "b", "c"]
    index = np.random.default_rng(7).integers(3, size=(2000, 3))
    sums, counts = np.array([1.0, 5.0, 2.0]), np.array([2, 1, 1])
    means = sums[index].sum(axis=1) / counts[index].sum(axis=1)
    low, high = np.percentile(means, [2.5, 97.5])
    mean = clustered_mean(values, clusters, np.random.default_rng(7))
    assert (mean.low, mean.high) == pytest.approx((low, high))
