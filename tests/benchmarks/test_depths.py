"""Hands are told apart by how deep they stand as they close, and by what they have then."""

import numpy as np
import pytest
from tests.assets import make_cabinet
from tests.runs import make_run

import depths
from articulate.draw import COLUMNS, draw
from articulate.settings import NO_DRAW
from articulate.transforms import pose

T = 60


def seen(*, depth_mm=(-8.0, 0.0, 4.0), width_m=(0.0, 0.02, 0.02), closes=(10, 20, 30)):
    """Three hands that close on 20 mm: each at its tick, at its depth, on its width."""
    n, tick = len(closes), np.arange(T)[:, None]
    closing = tick >= np.array(closes)
    return depths.Seen(
        depth_mm=np.where(tick >= np.array(closes) + depths.SOON, depth_mm, -99.0),
        closing=closing,
        width=np.where(tick >= np.array(closes) + depths.LATE, width_m, 0.08),
        force=np.broadcast_to(tick, (T, n)).astype(float),
        code=np.array([3, 0, 0]),
        thick=np.full(n, 0.02),
    )


def test_each_hand_is_in_the_range_of_its_depth_at_the_time_it_has_closed():
    short, at, deep = depths.rows(seen())
    assert (short.from_mm, short.to_mm) == (-np.inf, -6.0)
    assert (at.from_mm, at.to_mm) == (-1.0, 1.0)
    assert (deep.from_mm, deep.to_mm) == (3.0, 5.0)
    assert [row.on_nothing for row in (short, at, deep)] == [1, 0, 0]
    assert [row.successes for row in (short, at, deep)] == [0, 1, 1]
    assert [row.force_n for row in (short, at, deep)] == [30.0, 40.0, 50.0]


def test_a_range_without_a_bound_is_told_as_json_can():
    short, *_ = depths.result(seen())["rows"]
    assert (short["from_mm"], short["to_mm"]) == (None, -6.0)


def test_a_hand_that_never_closes_is_left_out():
    assert sum(row.episodes for row in depths.rows(seen(closes=(10, 20, T)))) == 2


def test_a_handle_is_told_deeper_along_its_approach_alone():
    drawn = draw(NO_DRAW, np.random.default_rng(0), 2)
    along_x = [[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]]
    T_wh = np.stack([np.eye(4), pose(np.zeros(3), along_x)])
    change = depths.told_deeper(drawn, T_wh, 0.01).values - drawn.values
    expected = np.zeros((2, len(COLUMNS)))
    expected[0, COLUMNS.index("bias_z_m")] = expected[1, COLUMNS.index("bias_x_m")] = 0.01
    np.testing.assert_allclose(change, expected, atol=1e-15)


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("depths")
    return make_run(folder / "run", make_cabinet(folder / "cabinet"), episode_s=1.0)


def test_where_the_handle_is_told_to_be_changes_what_a_policy_does(run):
    own, again, deeper = (depths.episodes(run, 0, 3, 5, deeper_m=d) for d in (0.0, 0.0, 0.05))
    assert np.array_equal(own.depth_mm, again.depth_mm)
    assert not np.array_equal(own.depth_mm, deeper.depth_mm)
    assert own.depth_mm.shape == (19, 3)
    assert depths.result(own)["episodes"] == 3


def test_depths_are_those_of_tools_that_have_not_come_to_the_handle(run):
    assert (depths.episodes(run, 0, 3, 5).depth_mm < 0.0).all()
