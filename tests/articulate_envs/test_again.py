import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_array_equal
from tests.scenes import DRAWS

from articulate.draw import COLUMNS, draw
from articulate_envs.again import Again
from articulate_envs.episodes import Episodes
from articulate_envs.settings import RewardConfig, StartConfig
from articulate_envs.threads import ThreadEngine

ALWAYS = StartConfig(again_from=0.0, again_times=2, again_share=1.0, again_most=5)


def rows(*values):
    return np.repeat(np.asarray(values, dtype=float)[:, None], len(COLUMNS), axis=1)


def test_draws_that_failed_come_again_in_their_order_as_often_as_is_said():
    again, values = Again(ALWAYS), rows(0, 0, 0)
    again.failed(rows(1, 2), 0.5)
    taken = again.take(values, np.array([True, False, True]), np.random.default_rng(0))
    assert taken.tolist() == [True, False, True]
    assert values[:, 0].tolist() == [1, 0, 1]
    assert again.waiting[:, 0].tolist() == [2, 2]


def test_nothing_comes_again_before_its_time_nor_where_nothing_failed():
    again, values = Again(StartConfig(again_from=0.5)), rows(7, 8)
    again.failed(rows(1), 0.49)
    again.failed(rows(), 0.9)
    generator = np.random.default_rng(3)
    before = generator.bit_generator.state
    assert not again.take(values, np.ones(2, dtype=bool), generator).any()
    assert values[:, 0].tolist() == [7, 8]
    assert generator.bit_generator.state == before


@given(failures=st.lists(st.integers(0, 100), max_size=9), n=st.integers(0, 9))
def test_what_waits_is_bounded_and_leaves_as_it_is_taken(failures, n):
    again = Again(ALWAYS)
    for k in failures:
        again.failed(rows(k), 1.0)
    expected = np.repeat(failures, 2)[-ALWAYS.again_most :]
    assert again.waiting[:, 0].tolist() == expected.tolist()
    values = rows(*range(-n, 0))
    taken = again.take(values, np.ones(n, dtype=bool), np.random.default_rng(1))
    assert taken.sum() == min(n, len(expected))
    assert values[taken, 0].tolist() == expected[: taken.sum()].tolist()
    assert again.waiting[:, 0].tolist() == expected[taken.sum() :].tolist()


def test_about_the_share_that_is_said_comes_again():
    again = Again(StartConfig(again_from=0.0, again_share=0.25, again_times=1, again_most=4000))
    again.failed(rows(*range(4000)), 0.0)
    taken = again.take(rows(*range(4000)), np.ones(4000, dtype=bool), np.random.default_rng(5))
    assert taken.mean() == pytest.approx(0.25, abs=0.03)


def made(scene, config, seed=0):
    engine = ThreadEngine(scene, 3, threads=1)
    return Episodes(engine, draws=DRAWS, reward=RewardConfig(), starts=config, seed=seed)


def test_an_episode_that_fails_from_home_begins_again_as_it_was_drawn(drawer):
    runs = made(drawer, StartConfig(share_first=0.0, bank=24, again_from=0.0, again_share=1.0))
    runs.reset()
    failed = runs.drawn.values
    for _ in range(drawer.ticks):
        tick = runs.step(np.zeros((3, 8)))
    assert tick.ended is not None
    assert (tick.ended.code != 0).all()
    assert_array_equal(runs.drawn.values, np.repeat(failed, 3, axis=0)[:3])
    start = np.asarray(drawer.place.start_q) + runs.drawn["start"]
    assert np.abs(runs.state.q - start).max() < 1e-9
    for _ in range(drawer.ticks):
        tick = runs.step(np.zeros((3, 8)))
    assert not tick.ended.from_home.any()  # the figures of training are of fresh draws
    assert_array_equal(runs.drawn.values[:, 0], np.repeat(failed[1:, 0], 3)[:3])


def test_a_draw_that_fails_again_does_not_come_back_for_ever(drawer):
    config = StartConfig(
        share_first=0.0, bank=24, again_from=0.0, again_share=1.0, again_times=1, cut_share=0.0
    )
    runs = made(drawer, config)
    runs.reset()
    first = runs.drawn.values[:, 0]
    seen = []
    for _ in range(3):
        for _ in range(drawer.ticks):
            runs.step(np.zeros((3, 8)))
        seen.append(runs.drawn.values[:, 0])
    assert_array_equal(seen[0], first)
    assert not np.isin(seen[1], first).any()
    assert_array_equal(seen[2], seen[1])


def test_what_waits_is_in_the_snapshot(drawer):
    config = StartConfig(share_first=0.0, bank=24, again_from=0.0, again_share=0.5)
    first = made(drawer, config)
    first.reset()
    for _ in range(drawer.ticks + 3):
        first.step(np.zeros((3, 8)))
    snapshot = first.snapshot()
    other = made(drawer, config, seed=9)
    other.reset()
    other.restore(snapshot)
    for _ in range(2 * drawer.ticks):
        a, b = (runs.step(np.zeros((3, 8))) for runs in (first, other))
        assert_array_equal(a.observation, b.observation)
    assert_array_equal(first.drawn.values, other.drawn.values)


def test_episodes_of_an_evaluation_are_all_fresh(drawer):
    runs = made(drawer, None)
    runs.reset()
    first = runs.drawn.values
    for _ in range(drawer.ticks):
        tick = runs.step(np.zeros((3, 8)))
    assert (tick.ended.code != 0).all()
    assert not (runs.drawn.values == first).all(axis=1).any()
    assert len(draw(DRAWS, np.random.default_rng(0), 3).values) == 3
