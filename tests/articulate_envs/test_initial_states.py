import dataclasses

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from tests.scenes import DRAWS, rows_of

from articulate.robot.kinematics import relative, tool_pose
from articulate.task.randomization import COLUMNS, nominal_params, sample_episode_params
from articulate.transforms import rotation_angle
from articulate_envs.config import InitialStatesConfig
from articulate_envs.initial_states import PLACED, home_start, mix_starts, precompute_states
from articulate_envs.threaded_engine import ThreadEngine

CONFIG = InitialStatesConfig(n_precomputed=60, closing_share=0.0)


@pytest.mark.parametrize("name", ["drawer", "door"])
def test_prepared_poses_hold_the_handle_of_their_own_object(name, request):
    """Where the hand is closed the tool is within 2 mm of the handle, turned like it."""
    scene = request.getfixturevalue(name)
    many = dataclasses.replace(CONFIG, n_precomputed=240)
    bank = precompute_states(scene, many, DRAWS, np.random.default_rng(0))
    n = len(bank.q)
    assert n > 0.5 * many.n_precomputed
    engine = ThreadEngine(scene, n)
    engine.reset(np.arange(n), bank)
    error = relative(tool_pose(scene.arm, bank.q), engine.state().T_wh)
    holds = (bank.closing > 0) & (bank.width > 0)
    assert 0.3 < holds.mean() < 0.95
    assert np.linalg.norm(error[holds, :3, 3], axis=1).max() < 2e-3
    assert rotation_angle(error[:, :3, :3]).max() < 0.021
    before = error[~holds, :3, 3]
    assert np.all((before[:, 2] > -2e-3) & (before[:, 2] < CONFIG.standoff_m + 2e-3))
    assert np.ptp(before[:, 2]) > 0.5 * CONFIG.standoff_m
    aside = np.abs(before[:, :2]).max(axis=1)
    assert aside.max() <= CONFIG.off_target_m[1] + 2e-3
    assert (aside > 2e-3).mean() == pytest.approx(CONFIG.off_target_share, abs=0.08)
    assert np.all(before[aside > 2e-3, 2] > CONFIG.off_target_m[0] - 2e-3)


def test_prepared_parts_are_short_of_the_target_and_hands_are_as_wide_as_the_handle(drawer):
    bank = precompute_states(drawer, CONFIG, DRAWS, np.random.default_rng(0))
    empty = bank.width == 0
    holds = (bank.closing > 0) & ~empty
    assert np.all(bank.opened[holds] <= drawer.task.target)
    assert np.all(bank.opened[~holds] == 0)
    assert_allclose(bank.width[holds], 0.012 * bank.params["scale"][holds])
    assert_allclose(bank.width[~holds & ~empty], drawer.arm.gripper.max_width_m)


def test_some_hands_before_the_handle_have_closed_on_nothing_and_stand_clear_of_it(drawer):
    config = dataclasses.replace(CONFIG, n_precomputed=300, empty_grasp_share=0.4)
    bank = precompute_states(drawer, config, DRAWS, np.random.default_rng(0))
    empty = bank.width == 0
    before = bank.opened == 0
    assert np.all(bank.closing[empty] == 1)
    assert np.all(before[empty])
    assert empty.sum() / before.sum() == pytest.approx(0.4, abs=0.1)
    engine = ThreadEngine(drawer, len(bank.q))
    engine.reset(np.arange(len(bank.q)), bank)
    error = relative(tool_pose(drawer.arm, bank.q), engine.state().T_wh)
    assert error[empty, 2, 3].min() > config.empty_grasp_m - 2e-3
    engine.close()
    none = dataclasses.replace(config, empty_grasp_share=0.0)
    assert np.all(precompute_states(drawer, none, DRAWS, np.random.default_rng(0)).width > 0)


def test_some_open_hands_at_the_handle_have_been_told_to_close_and_then_hold_it(drawer):
    """The commands of policies that want nothing else are zeros: the hand closes all the same."""
    config = dataclasses.replace(CONFIG, n_precomputed=300, closing_share=0.4)
    bank = precompute_states(drawer, config, DRAWS, np.random.default_rng(0))
    closing = (bank.closing > 0) & (bank.width == drawer.arm.gripper.max_width_m)
    others = (bank.opened == 0) & (bank.width > 0) & ~closing
    astray = 1.0 - config.off_target_share
    assert closing.sum() / (closing | others).sum() == pytest.approx(0.4 * astray, abs=0.1)
    n = 8
    some = rows_of(bank, np.flatnonzero(closing)[:n])
    engine = ThreadEngine(drawer, n)
    engine.reset(np.arange(n), some)
    error = relative(tool_pose(drawer.arm, some.q), engine.state().T_wh)
    assert np.linalg.norm(error[:, :3, 3], axis=1).max() < 2e-3
    for _ in range(40):
        state = engine.step(np.zeros((n, 8)))
    engine.close()
    assert np.all(state.gripper_width < 0.02)
    assert np.all(state.gripper_width > 0.005)


def test_held_handle_stays_in_the_hand(drawer):
    """Nobody moves: after half a second the handle is where it was, and the force is small."""
    config = dataclasses.replace(CONFIG, grip_share=1.0)
    bank = precompute_states(drawer, config, DRAWS, np.random.default_rng(1))
    bank = rows_of(bank, np.arange(8))
    engine = ThreadEngine(drawer, 8)
    engine.reset(np.arange(8), bank)
    still = np.zeros((8, 8))
    still[:, 7] = 1.0
    for _ in range(10):
        state = engine.step(still)
    error = relative(tool_pose(drawer.arm, state.q), state.T_wh)
    assert np.linalg.norm(error[:, :3, 3], axis=1).max() < 0.01
    assert np.abs(state.opened - bank.opened).max() < 0.05
    assert np.all(state.gripper.closing > 0)


def test_home_is_the_start_pose_with_the_drawn_offsets_hand_open_part_closed(drawer):
    drawn = sample_episode_params(DRAWS, np.random.default_rng(0), 50)
    start = home_start(drawer, drawn)
    assert_allclose(start.q - drawer.placement.start_q, drawn["start"], atol=1e-12)
    assert np.all(start.opened == 0)
    assert np.all(start.closing == -1)
    assert np.all(start.width == drawer.arm.gripper.max_width_m)


def test_home_never_leaves_the_limits_of_targets(drawer):
    drawn = nominal_params(2)
    drawn.values[:, COLUMNS.index("start_4")] = [5.0, -5.0]
    low, high = drawer.arm.bounds(drawer.control.margin_rad)
    assert_allclose(home_start(drawer, drawn).q[:, 3], [high[3], low[3]])


def test_share_falls_linearly_and_then_stays():
    config = InitialStatesConfig(share_first=0.8, share_last=0.2, until=0.5)
    shares = [config.share(p) for p in (-1.0, 0.0, 0.25, 0.5, 1.0)]
    assert_allclose(shares, [0.8, 0.8, 0.5, 0.2, 0.2])


def test_without_a_share_all_begin_at_home(drawer):
    rng = np.random.default_rng(0)
    bank, drawn = (
        precompute_states(drawer, CONFIG, DRAWS, rng),
        sample_episode_params(DRAWS, rng, 20),
    )
    start = mix_starts(drawer, bank, drawn, 0.0, rng)
    home = home_start(drawer, drawn)
    for name in ("q", "opened", "width", "closing", "home"):
        assert_array_equal(getattr(start, name), getattr(home, name))
    assert start.home.all()
    assert_array_equal(start.params.values, drawn.values)


def test_starts_along_the_task_take_their_objects_place_and_draw_the_rest_anew(drawer):
    rng = np.random.default_rng(0)
    bank, drawn = (
        precompute_states(drawer, CONFIG, DRAWS, rng),
        sample_episode_params(DRAWS, rng, 20),
    )
    kept = drawn.values.copy()
    start = mix_starts(drawer, bank, drawn, 1.0, rng)
    for k in range(20):
        source = np.flatnonzero((bank.q == start.q[k]).all(axis=1))
        assert len(source) >= 1
        for name in COLUMNS:
            expected = bank.params[name][source[0]] if name in PLACED else drawn[name][k]
            assert start.params[name][k] == expected
    assert_array_equal(drawn.values, kept)


def test_share_of_starts_along_the_task_is_as_asked(drawer):
    rng = np.random.default_rng(0)
    bank = precompute_states(drawer, CONFIG, DRAWS, rng)
    start = mix_starts(drawer, bank, sample_episode_params(DRAWS, rng, 2000), 0.3, rng)
    known = {row.tobytes() for row in bank.q}
    along = np.array([row.tobytes() in known for row in start.q])
    assert along.mean() == pytest.approx(0.3, abs=0.04)
    assert_array_equal(start.home, ~along)


def test_same_seed_prepares_the_same_starts(drawer):
    a, b = (precompute_states(drawer, CONFIG, DRAWS, np.random.default_rng(4)) for _ in range(2))
    assert_array_equal(a.q, b.q)
    assert_array_equal(a.params.values, b.params.values)
