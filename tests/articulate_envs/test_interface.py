import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_array_equal
from tests.scenes import DRAWS, rows_of

from articulate.errors import EngineError
from articulate.task.episode_monitor import CODE, COLUMN, WIDTH, EpisodeMonitor
from articulate.task.randomization import COLUMNS, draw
from articulate_envs.config import StartConfig
from articulate_envs.initial_states import bank_of_starts, home_start
from articulate_envs.interface import checked_action, drawn_numbers, start_asked_for, told
from articulate_envs.single_engine import SingleEngine

FREE = [c for c in COLUMNS if not c.endswith("delay_ticks") and c not in ("scale", "part_open")]
"""Columns that take any positive number."""


def begun(scene, n=3, seed=0):
    return home_start(scene, draw(DRAWS, np.random.default_rng(seed), n))


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
def test_columns_that_are_asked_for_are_drawn_so_and_the_others_as_before(drawer, asked):
    before = begun(drawer)
    after = start_asked_for({"draw": asked}, before, drawer)
    for name in COLUMNS:
        expected = np.full(3, asked[name]) if name in asked else before.draw[name]
        assert_array_equal(after.draw[name], expected)
    if not any(name.startswith("start_") for name in asked):
        assert_array_equal(after.q, before.q)


@settings(max_examples=8)
@given(st.integers(0, 1000))
def test_what_an_episode_began_with_begins_another_one_like_it(drawer, seed):
    rng = np.random.default_rng(seed)
    bank = bank_of_starts(drawer, StartConfig(bank=2), DRAWS, rng)
    first = rows_of(bank, np.array([0]))
    asked = {name: getattr(first, name)[0].tolist() for name in ("q", "opened", "width")}
    asked |= {"draw": drawn_numbers(first.draw), "closing": first.closing[0]}
    again = start_asked_for(asked, begun(drawer, 1, seed + 1), drawer)
    for name in ("q", "opened", "width", "closing"):
        assert_array_equal(getattr(again, name), getattr(first, name))
    assert_array_equal(again.draw.values, first.draw.values)


def test_nothing_asked_for_changes_nothing(drawer):
    start = begun(drawer)
    every: tuple[dict[str, dict[str, float]] | None, ...] = (None, {}, {"draw": {}})
    for options in every:
        after = start_asked_for(options, start, drawer)
        assert_array_equal(after.draw.values, start.draw.values)
        assert_array_equal(after.q, start.q)


def test_starts_along_the_task_keep_their_arm_when_a_draw_is_asked_for(drawer):
    bank = bank_of_starts(drawer, StartConfig(bank=4), DRAWS, np.random.default_rng(0))
    after = start_asked_for({"draw": {"mass": 1.1, "start_1": 0.05}}, bank, drawer)
    assert_array_equal(after.q, bank.q)
    assert_array_equal(after.opened, bank.opened)


def test_users_are_told_what_the_judgement_says(drawer):
    engine = SingleEngine(drawer)
    engine.reset(np.zeros(1, dtype=int), begun(drawer, 1))
    state = engine.state()

    def judged(rest_s, code=0, diverged=False):
        samples = np.zeros((1, WIDTH))
        samples[0, COLUMN["code"]] = code
        held = np.array([rest_s > 0.0])
        judgement = EpisodeMonitor(samples, np.array([rest_s]), held, np.array([diverged]))
        every = told(judgement, drawer.task, state)
        return every["success"][0], every["reason"][0], every["opened"][0]

    assert judged(0.0) == (False, "not_open", False)
    assert judged(0.1) == (False, "moving", False)
    assert judged(1.0) == (True, "success", True)
    assert judged(1.0, CODE["force"]) == (False, "force", True)
    assert judged(1.0, diverged=True) == (False, "diverged", False)
