import dataclasses

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from articulate.task.randomization import COLUMNS, EpisodeParams, nominal_params
from articulate.task.randomization_config import NO_RANDOMIZATION
from articulate.task.state_estimation import NoisyEstimator, measured_force
from articulate.transforms import axis_angle_to_matrix, pose

N = 3
NOISE = np.random.default_rng(0).normal(size=(N, 4))


def drawn(**values):
    """Nominal draws but for ``values``."""
    rows = nominal_params(N).values
    for name, value in values.items():
        rows[:, COLUMNS.index(name)] = value
    return EpisodeParams(rows)


def tick(k):
    """A true state that names its tick."""
    return pose(np.full((N, 3), float(k))), np.full(N, 0.1 * k), np.full(N, 0.01 * k)


def fed(ticks, config=NO_RANDOMIZATION):
    estimator = NoisyEstimator(N, 0.3, "slide", config)
    estimator.reset(np.arange(N), tick(0)[0], tick(0)[1])
    for k in range(1, ticks + 1):
        estimator.push(*tick(k))
    return estimator


def test_without_noise_and_age_the_truth_is_given():
    seen = fed(4).estimate(drawn(), NOISE)
    truth = tick(4)
    assert_allclose(seen.T_wh, truth[0], atol=1e-15)
    assert_array_equal(seen.opened, truth[1])
    assert_array_equal(seen.speed, truth[2])


def test_each_object_is_seen_as_it_was_its_own_age_ago():
    seen = fed(5).estimate(drawn(estimate_delay_steps=[0, 1, 2]), NOISE)
    assert_allclose(seen.T_wh[:, 0, 3], [5, 4, 3])
    assert_allclose(seen.opened, [0.5, 0.4, 0.3])
    assert_allclose(seen.speed, [0.05, 0.04, 0.03])


def test_before_the_first_tick_the_past_is_the_start():
    seen = fed(1).estimate(drawn(estimate_delay_steps=2), NOISE)
    assert_allclose(seen.opened, 0.0)


def test_a_new_episode_forgets_the_past_of_its_row_alone():
    estimator = fed(5)
    estimator.reset(np.array([1]), pose(np.full((1, 3), -1.0)), np.array([-1.0]))
    seen = estimator.estimate(drawn(estimate_delay_steps=2), NOISE)
    assert_allclose(seen.opened, [0.3, -1.0, 0.3])


def test_constant_errors_shift_and_turn_the_handle_in_the_world():
    values = drawn(bias_x_m=0.01, bias_z_m=-0.02, bias_yaw_rad=0.3)
    seen = fed(2).estimate(values, NOISE)
    assert_allclose(seen.T_wh[:, :3, 3] - 2.0, np.tile([0.01, 0, -0.02], (N, 1)), atol=1e-12)
    turn = axis_angle_to_matrix([0, 0, 1], 0.3)
    assert_allclose(seen.T_wh[:, :3, :3], np.tile(turn, (N, 1, 1)), atol=1e-12)


@pytest.mark.parametrize(("kind", "span", "length"), [("slide", 0.3, 0.3), ("hinge", -2.0, 1.0)])
def test_noise_has_its_deviation_in_metres_and_in_the_parts_own_measure(kind, span, length):
    config = dataclasses.replace(NO_RANDOMIZATION, estimate_noise_m=0.002, part_noise=0.005)
    estimator = NoisyEstimator(N, span, kind, config)
    estimator.reset(np.arange(N), *tick(0)[:2])
    rng = np.random.default_rng(0)
    seen = [estimator.estimate(drawn(), rng.normal(size=(N, 4))) for _ in range(3000)]
    assert_allclose(np.std([s.T_wh[:, :3, 3] for s in seen]), 0.002, rtol=0.05)
    assert_allclose(np.std([s.opened for s in seen]), 0.005 * length / abs(span), rtol=0.05)


def test_snapshot_restored_into_another_gives_the_same_bits():
    estimator = fed(5)
    other = NoisyEstimator(N, 0.3, "slide", NO_RANDOMIZATION)
    other.restore(estimator.snapshot())
    for e in (estimator, other):
        e.push(*tick(6))
    values = drawn(estimate_delay_steps=[0, 1, 2])
    a, b = (e.estimate(values, NOISE) for e in (estimator, other))
    assert_array_equal(a.T_wh, b.T_wh)
    assert_array_equal(a.opened, b.opened)


def measured(force, params, noise_n, rng):
    """Measured forces (N, 3)."""
    out = np.empty((N, 3))
    for i, row in enumerate(out):
        measured_force(force[i], params.values[i], rng.normal(size=3), noise_n, row)
    return out


def test_without_errors_the_force_is_felt_as_it_is():
    force = np.arange(9.0).reshape(N, 3)
    assert_array_equal(measured(force, drawn(), 0.0, np.random.default_rng(0)), force)


def test_the_felt_force_is_wrong_by_what_was_drawn_and_by_noise():
    errors = drawn(force_bias_x_n=[1.0, -2.0, 0.0], force_bias_z_n=3.0)
    rng = np.random.default_rng(0)
    seen = np.stack([measured(np.zeros((N, 3)), errors, 0.5, rng) for _ in range(4000)])
    assert_allclose(seen.mean(axis=0), [[1, 0, 3], [-2, 0, 3], [0, 0, 3]], atol=0.05)
    assert_allclose(seen.std(axis=0), 0.5, rtol=0.05)
