import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from articulate.errors import ConfigError
from articulate.task.randomization import BLOCKS, COLUMNS, nominal_params, sample_episode_params
from articulate.task.randomization_config import NO_RANDOMIZATION, RandomizationConfig

CONFIG = RandomizationConfig()
MANY = sample_episode_params(CONFIG, np.random.default_rng(0), 4000)


@pytest.mark.parametrize(
    "name",
    [
        "friction",
        "joint_damping",
        "joint_friction",
        "armature",
        "mass",
        "stiffness",
        "damping",
        "scale",
        "gripper_latency_s",
        "delay_steps",
        "estimate_delay_steps",
    ],
)
def test_factors_fill_their_range_and_stay_within_it(name):
    low, high = getattr(CONFIG, name)
    values = MANY[name]
    assert values.min() >= low - 1e-12
    assert values.max() <= high + 1e-12
    assert values.min() < low + 0.02 * (high - low) + 1e-12
    assert values.max() > high - 0.02 * (high - low) - 1e-12


@pytest.mark.parametrize("name", ["joint_damping", "joint_friction", "armature"])
def test_wide_factors_are_as_often_below_the_middle_of_their_logarithm_as_above(name):
    low, high = getattr(CONFIG, name)
    assert np.mean(MANY[name] < np.sqrt(low * high)) == pytest.approx(0.5, abs=0.04)


@pytest.mark.parametrize(
    ("name", "bound"),
    [
        ("x_m", CONFIG.position_m),
        ("y_m", CONFIG.position_m),
        ("yaw_rad", CONFIG.yaw_rad),
        ("start", CONFIG.start_rad),
    ],
)
def test_offsets_lie_on_both_sides_of_zero(name, bound):
    values = MANY[name]
    assert -bound <= values.min() < -0.95 * bound
    assert 0.95 * bound < values.max() <= bound


def test_sizes_are_those_that_are_prepared():
    assert set(MANY["scale"]) == set(CONFIG.scale_values)
    assert len(CONFIG.scale_values) == CONFIG.scales


def test_what_stands_open_is_pushed_when_a_hand_can_have_come_to_it():
    shut, ajar = (
        sample_episode_params(CONFIG, np.random.default_rng(0), 2000, begin=begin)["push_time"]
        for begin in ((0.0, 0.0), (0.4, 0.8))
    )
    assert shut.min() < 0.01
    assert ajar.min() >= 0.5
    assert max(shut.max(), ajar.max()) <= 0.9


def test_pushes_have_any_direction_and_their_range_of_force():
    force = np.linalg.norm(MANY["push"], axis=1)
    assert force.max() <= CONFIG.push_n[1] + 1e-12
    assert np.abs(MANY["push"].mean(axis=0)).max() < 0.1 * CONFIG.push_n[1]


def test_constant_errors_of_the_estimate_have_their_deviation():
    assert_allclose(MANY["bias"].std(axis=0), CONFIG.estimate_bias_m, rtol=0.05)
    assert_allclose(MANY["bias_yaw_rad"].std(), CONFIG.estimate_yaw_rad, rtol=0.05)


def test_constant_errors_of_the_force_have_their_deviation():
    assert_allclose(MANY["force_bias"].std(axis=0), CONFIG.force_bias_n, rtol=0.05)
    assert np.abs(np.corrcoef(MANY["force_bias"].T, MANY["bias"].T)[:3, 3:]).max() < 0.06


@pytest.mark.parametrize("name", BLOCKS)
def test_blocks_are_the_columns_of_their_name(name):
    units = {"start": "", "bias": "_m", "push": "_n", "force_bias": "_n"}
    parts = [f"start_{i}" for i in range(1, 8)] if name == "start" else None
    parts = parts or [f"{name}_{axis}{units[name]}" for axis in "xyz"]
    assert_array_equal(MANY[name], MANY.values[:, [COLUMNS.index(p) for p in parts]])


def test_same_seed_draws_the_same_bits():
    again = sample_episode_params(CONFIG, np.random.default_rng(0), 4000)
    assert_array_equal(again.values, MANY.values)


def test_nominal_draw_changes_nothing():
    row = nominal_params(3)
    for name in ("friction", "joint_damping", "armature", "mass", "stiffness", "scale"):
        assert_array_equal(row[name], 1.0)
    for name in ("x_m", "yaw_rad", "start", "bias", "push", "delay_steps", "force_bias"):
        assert_array_equal(row[name], 0.0)


def test_one_size_is_one_model():
    assert NO_RANDOMIZATION.scale_values == (1.0,)
    assert dataclasses.replace(CONFIG, scales=3, scale=(0.8, 1.2)).scale_values == (0.8, 1.0, 1.2)


def test_range_the_wrong_way_round_is_refused(error_line):
    error_line("DrawConfig(mass=(1.3, 0.7))", lambda: RandomizationConfig(mass=(1.3, 0.7)))


def test_factors_of_zero_and_delays_that_nobody_keeps_are_refused(error_line):
    error_line("DrawConfig(armature=(0, 1))", lambda: RandomizationConfig(armature=(0.0, 1.0)))
    error_line("DrawConfig(delay_steps=(0, 9))", lambda: RandomizationConfig(delay_steps=(0, 9)))
    error_line(
        "DrawConfig(estimate_delay_steps=(-1, 2))",
        lambda: RandomizationConfig(estimate_delay_steps=(-1, 2)),
    )


def test_ranges_are_widened_about_their_nominal_values():
    wide = CONFIG.widened(1.5)
    assert_allclose(wide.friction, (0.25, 1.75))
    assert_allclose(wide.joint_damping, (0.33**1.5, 3.0**1.5))
    assert_allclose(wide.scale, (0.85, 1.15))
    assert np.diff(wide.scale_values)[0] == pytest.approx(np.diff(CONFIG.scale_values)[0])
    assert wide.delay_steps == (0, 3)
    assert_allclose(wide.gripper_latency_s, (0.0, 0.65 + 1.5 * 0.55))
    assert_allclose(wide.push_n, (0.0, 7.5))
    assert wide.position_m == pytest.approx(1.5 * CONFIG.position_m)
    assert wide.part_noise == pytest.approx(1.5 * CONFIG.part_noise)


def test_ranges_that_are_once_as_wide_are_the_same_to_the_bit():
    assert CONFIG.widened(1.0) == CONFIG
    for name in (f.name for f in dataclasses.fields(RandomizationConfig)):
        nearly = getattr(CONFIG.widened(1.0 + 1e-9), name)
        assert_allclose(nearly, getattr(CONFIG, name), rtol=1e-8, atol=1e-8)


@given(st.floats(0.3, 1.6))
def test_each_widened_range_holds_the_narrower_one(factor):
    narrow, wide = CONFIG.widened(factor), CONFIG.widened(1.2 * factor)
    for name in (f.name for f in dataclasses.fields(RandomizationConfig)):
        small, large = getattr(narrow, name), getattr(wide, name)
        if isinstance(small, tuple):
            assert large[0] <= small[0] + 1e-12
            assert small[1] <= large[1] + 1e-12
        else:
            assert small <= large


def test_what_is_as_wide_as_it_was_is_the_same_and_what_is_not_drawn_stays_so():
    for name in (f.name for f in dataclasses.fields(RandomizationConfig)):
        assert_allclose(getattr(CONFIG.widened(1.0), name), getattr(CONFIG, name), rtol=1e-12)
    for name in (f.name for f in dataclasses.fields(RandomizationConfig)):
        if name != "scales":
            assert_allclose(
                getattr(NO_RANDOMIZATION.widened(2.0), name), getattr(NO_RANDOMIZATION, name)
            )


@pytest.mark.parametrize(
    ("factor", "what"),
    [
        (0.0, "above 0"),
        (float("nan"), "above 0"),
        (2.1, "range factor 2.1: .*friction"),
        (-1.0, "above 0"),
        (float("inf"), "at most 100"),
        (1e6, "at most 100"),
    ],
)
def test_ranges_that_cannot_be_are_refused(factor, what):
    with pytest.raises(ConfigError, match=what):
        CONFIG.widened(factor)
