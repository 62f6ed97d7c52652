"""Hands are told apart by how deep they stand as they close, and by what they have then."""

from types import SimpleNamespace
from typing import Any

import numpy as np
from tests.assets import make_cabinet
from tests.runs import make_run

import depths
from watched import watch

T = 60


def hands(closes=(10, 20, 30)) -> Any:
    """Three hands that close on 20 mm: each at its tick, at its depth, on its width."""
    tick, at = np.arange(T)[:, None], np.array(closes)
    return SimpleNamespace(
        code=np.array([3, 0, 0]),
        least=np.full(3, 0.012),
        closing=tick >= at,
        depth=np.where(tick >= at + depths.SOON, (-0.008, 0.0, 0.004), -0.099),
        width=np.where(tick >= at + depths.LATE, (0.0, 0.02, 0.02), 0.08),
        force=np.broadcast_to(tick, (T, 3)).astype(float),
    )


def test_each_hand_is_in_the_range_of_its_depth_at_the_time_it_has_closed():
    short, at, deep = depths.rows(hands())
    assert (short.from_mm, short.to_mm) == (-np.inf, -6.0)
    assert (at.from_mm, at.to_mm) == (-1.0, 1.0)
    assert (deep.from_mm, deep.to_mm) == (3.0, 5.0)
    assert [row.on_nothing for row in (short, at, deep)] == [1, 0, 0]
    assert [row.successes for row in (short, at, deep)] == [0, 1, 1]
    assert [row.force_n for row in (short, at, deep)] == [30.0, 40.0, 50.0]


def test_a_range_without_a_bound_is_told_as_json_can():
    short, *_ = depths.result(hands())["rows"]
    assert (short["from_mm"], short["to_mm"]) == (None, -6.0)


def test_a_hand_that_never_closes_is_left_out():
    assert sum(row.episodes for row in depths.rows(hands(closes=(10, 20, T)))) == 2


def test_hands_of_a_policy_that_learned_nothing_are_told(tmp_path):
    run = make_run(tmp_path / "run", make_cabinet(tmp_path / "cabinet"), episode_s=1.0)
    told = depths.result(watch(run, 0, episodes=3, draws=5))
    assert (told["episodes"], told["successes"]) == (3, 0)
    assert sum(told["reasons"].values()) == 3
