import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_array_equal
from tests.scenes import DRAWS, rows_of

from articulate.errors import EngineError
from articulate.task.episode_monitor import COLUMN, WIDTH, EpisodeMonitor, FailureReason
from articulate.task.randomization import COLUMNS, sample_episode_params
from articulate_envs.config import InitialStatesConfig
from articulate_envs.initial_states import home_start, precompute_states
from articulate_envs.interface import apply_options, checked_action, episode_info, params_dict
from articulate_envs.single_engine import SingleEngine

FREE = [c for c in COLUMNS if not c.endswith("delay_steps") and c not in ("scale", "part_open")]
"""Columns that take any positive number."""


def begun(scene, n=3, seed=0):
    return home_start(scene, sample_episode_params(DRAWS, np.random.default_rng(seed), n))


@given(st.lists(st.floats(-1e6, 1e6), min_size=8, max_size=8))
def test_every_finite_action_of_the_right_size_is_taken_as_it_is(numbers):
    assert_array_equal(checked_action(numbers), np.asarray(numbers))
    assert_array_equal(checked_action([numbers] * 2, 2), np.asarray([numbers] * 2))


@given(st.integers(0, 7), st.sampled_from([np.nan, np.inf, -np.inf]))
def test_the_first_number_that_is_not_finite_is_named(index, bad):
    action = np.zeros(8)
    action[index] = bad
    with pytest.raises(EngineError, match=rf"^action\[{index}\] is {bad}; "):
        checked_action(action)


@given(st.dictionaries(st.sampled_from(FREE), st.floats(0.01, 2.0)))
def test_given_parameters_replace_the_sampled_ones(drawer, asked):
    before = begun(drawer)
    after = apply_options({"episode_params": asked}, before, drawer)
    for name in COLUMNS:
        expected = np.full(3, asked[name]) if name in asked else before.params[name]
        assert_array_equal(after.params[name], expected)
    if not any(name.startswith("start_") for name in asked):
        assert_array_equal(after.q, before.q)


@settings(max_examples=8)
@given(st.integers(0, 1000))
def test_options_of_an_episode_repeat_its_start(drawer, seed):
    rng = np.random.default_rng(seed)
    bank = precompute_states(drawer, InitialStatesConfig(n_precomputed=2), DRAWS, rng)
    first = rows_of(bank, np.array([0]))
    asked = {name: getattr(first, name)[0].tolist() for name in ("q", "opened", "width")}
    asked |= {"episode_params": params_dict(first.params), "closing": first.closing[0]}
    again = apply_options(asked, begun(drawer, 1, seed + 1), drawer)
    for name in ("q", "opened", "width", "closing"):
        assert_array_equal(getattr(again, name), getattr(first, name))
    assert_array_equal(again.params.values, first.params.values)


def test_no_options_change_nothing(drawer):
    start = begun(drawer)
    every: tuple[dict[str, dict[str, float]] | None, ...] = (None, {}, {"episode_params": {}})
    for options in every:
        after = apply_options(options, start, drawer)
        assert_array_equal(after.params.values, start.params.values)
        assert_array_equal(after.q, start.q)


def test_starts_along_the_task_keep_their_arm_under_given_parameters(drawer):
    bank = precompute_states(
        drawer, InitialStatesConfig(n_precomputed=4), DRAWS, np.random.default_rng(0)
    )
    after = apply_options({"episode_params": {"mass": 1.1, "start_1": 0.05}}, bank, drawer)
    assert_array_equal(after.q, bank.q)
    assert_array_equal(after.opened, bank.opened)


def test_info_agrees_with_the_episode_monitor(drawer):
    engine = SingleEngine(drawer)
    engine.reset(np.zeros(1, dtype=int), begun(drawer, 1))
    state = engine.state()

    def judged(rest_s, code=0, diverged=False):
        samples = np.zeros((1, WIDTH))
        samples[0, COLUMN["code"]] = code
        held = np.array([rest_s > 0.0])
        judgement = EpisodeMonitor(samples, np.array([rest_s]), held, np.array([diverged]))
        every = episode_info(judgement, drawer.task, state)
        return every["success"][0], every["reason"][0], every["opened"][0]

    assert judged(0.0) == (False, "goal_not_reached", False)
    assert judged(0.1) == (False, "not_at_rest", False)
    assert judged(1.0) == (True, "success", True)
    assert judged(1.0, FailureReason.FORCE) == (False, "force", True)
    assert judged(1.0, diverged=True) == (False, "diverged", False)
