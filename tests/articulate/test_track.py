"""Means over estimates: closed forms of the gains, and no lag behind a part that moves."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from articulate.observe import Estimate
from articulate.track import LEAST_GAIN, MOVING, Tracker
from articulate.transforms import axis_angle_to_matrix, pose

TICK_S = 0.05
SPAN = 0.3


def estimate(places, *, opened=None, speed=None):
    """Of as many objects as there are ``places`` (N, 3)."""
    places = np.asarray(places, dtype=np.float64)
    zeros = np.zeros(len(places))
    return Estimate(pose(places), zeros if opened is None else opened, zeros + (speed or 0.0))


def track(kind="slide", n=1):
    return Tracker(n, SPAN, kind, TICK_S)


@given(st.integers(0, 10_000))
def test_of_a_part_at_rest_the_first_ten_estimates_have_their_plain_mean(seed):
    rng = np.random.default_rng(seed)
    places, openings = rng.normal(size=(10, 2, 3)), rng.normal(size=(10, 2))
    tracker = track(n=2)
    for k in range(10):
        known = tracker.update(estimate(places[k], opened=openings[k]))
        assert_allclose(known.T_wh[:, :3, 3], places[: k + 1].mean(axis=0), atol=1e-12)
        assert_allclose(known.opened, openings[: k + 1].mean(axis=0), atol=1e-12)


def test_noise_of_a_part_at_rest_ends_at_that_of_a_fading_mean():
    """Its variance is a / (2 - a) of what each estimate has (geometric series)."""
    rng = np.random.default_rng(0)
    tracker = track(n=20_000)
    for _ in range(80):
        known = tracker.update(estimate(rng.normal(size=(20_000, 3))))
    wanted = np.sqrt(LEAST_GAIN / (2.0 - LEAST_GAIN))
    assert_allclose(known.T_wh[:, :3, 3].std(axis=0), wanted, rtol=0.03)


@pytest.mark.parametrize("kind", ["slide", "hinge"])
def test_handle_of_a_part_that_moves_is_where_it_is_seen(kind):
    tracker = track(kind)
    tracker.update(estimate([[0.0, 0.0, 0.0]]))
    known = tracker.update(estimate([[1.0, 2.0, 3.0]], speed=-MOVING[kind]))
    assert_allclose(known.T_wh[0, :3, 3], [1.0, 2.0, 3.0], atol=1e-12)


@given(speed=st.floats(-0.3, 0.3))
def test_opening_of_a_part_with_a_known_speed_does_not_lag(speed):
    tracker = track()
    for k in range(60):
        opened = speed * k * TICK_S / SPAN
        known = tracker.update(estimate([[0.0] * 3], opened=np.array([opened]), speed=speed))
    assert_allclose(known.opened, opened, atol=1e-9)


@given(speed=st.floats(0.0, 0.5))
def test_handle_of_a_part_that_moves_lags_by_less_than_a_millimetre(speed):
    """Constant speed v: the lag is v dt (1 - a) / a."""
    tracker = track()
    for k in range(200):
        known = tracker.update(estimate([[speed * k * TICK_S, 0.0, 0.0]], speed=speed))
    assert abs(known.T_wh[0, 0, 3] - speed * 199 * TICK_S) < 0.001


def test_rows_that_are_not_new_stay_and_those_reset_begin_again():
    tracker = track(n=3)
    tracker.update(estimate(np.zeros((3, 3))))
    tracker.reset(np.array([2]))
    known = tracker.update(estimate(np.ones((3, 3))), np.array([1, 2]))
    assert_allclose(known.T_wh[:, 0, 3], [0.0, 0.5, 1.0])


def test_directions_and_speeds_are_taken_as_they_are():
    T_wh = pose(np.zeros((1, 3)), axis_angle_to_matrix([0, 0, 1], 0.3))
    tracker = track()
    tracker.update(estimate([[0.0] * 3]))
    known = tracker.update(Estimate(T_wh, np.zeros(1), np.array([0.01])))
    assert_array_equal(known.T_wh[:, :3, :3], T_wh[:, :3, :3])
    assert_array_equal(known.speed, [0.01])


def test_values_that_are_not_finite_are_forgotten_with_their_episode():
    tracker = track()
    tracker.update(estimate([[np.nan] * 3], opened=np.array([np.nan]), speed=np.nan))
    tracker.reset(np.array([0]))
    known = tracker.update(estimate([[1.0, 2.0, 3.0]], opened=np.array([0.5])))
    assert_allclose(known.T_wh[0, :3, 3], [1.0, 2.0, 3.0])
    assert_allclose(known.opened, 0.5)


def test_snapshot_goes_on_with_the_same_bits():
    rng = np.random.default_rng(1)
    one, other = track(n=4), track(n=4)
    for _ in range(5):
        one.update(estimate(rng.normal(size=(4, 3))))
    other.restore(one.snapshot())
    more = estimate(rng.normal(size=(4, 3)), opened=rng.normal(size=4), speed=0.004)
    a, b = one.update(more), other.update(more)
    assert_array_equal(a.T_wh, b.T_wh)
    assert_array_equal(a.opened, b.opened)
