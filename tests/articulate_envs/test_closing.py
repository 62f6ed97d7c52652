"""Tasks that close a part: their starts, places, handles and judgement, for all kinds of parts."""

import dataclasses

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from tests.scenes import DRAWS, rows_of

from articulate.errors import ReachError
from articulate.robot.kinematics import relative, tool_pose
from articulate.task.episode_monitor import REASONS
from articulate.task.object_placement import handle_in_world, object_pose
from articulate.task.randomization import BLOCKS, COLUMNS, nominal_params, sample_episode_params
from articulate.task.randomization_config import NO_RANDOMIZATION
from articulate.transforms import axis_angle_to_matrix, rotation_angle
from articulate_envs.config import InitialStatesConfig
from articulate_envs.episodes import Episodes
from articulate_envs.grasp_clearance import check_grasp
from articulate_envs.initial_states import home_start, precompute_states
from articulate_envs.placement_search import (
    CLEAR_M,
    MIN_SAMPLED_SHARE,
    find_placement,
    start_clearance,
)
from articulate_envs.rewards import RewardConfig
from articulate_envs.threaded_engine import ThreadEngine

PARTS = ["closing_drawer", "closing_door", "closing_lid"]


@pytest.fixture(params=PARTS)
def scene(request):
    return request.getfixturevalue(request.param)


def test_place_is_reached_when_drawn_and_the_arm_starts_clear_of_the_open_part(scene):
    assert scene.placement.reachable_share >= MIN_SAMPLED_SHARE
    assert start_clearance(scene.asset, scene.task, scene.arm, scene.placement) > 0.8 * CLEAR_M
    assert check_grasp(scene) < 0.003


@pytest.mark.slow
def test_the_placement_is_that_of_all_stages(scene):
    found = find_placement(scene.asset, scene.task, scene.arm, DRAWS)
    assert found.pos_w == scene.placement.pos_w
    assert found.start_q == scene.placement.start_q


def test_of_several_sizes_and_places_the_nearest_tells_the_clearance(scene):
    """Ten metres off, a part of size s is nearer by s times what it stands out towards the arm."""
    parts = scene.asset, scene.task, scene.arm, scene.placement
    away = np.repeat(scene.placement.T_wo()[None], 3, axis=0)
    away[:, 0, 3] += (10.0, 10.0, 12.0)
    sizes = np.array([1.0, 1.3, 1.0])
    each = [start_clearance(*parts, scale=sizes[[i]], T_wo=away[[i]]) for i in range(len(sizes))]
    assert start_clearance(*parts, scale=sizes, T_wo=away) == min(each)
    assert each[2] - each[0] == pytest.approx(2.0, rel=0.01)
    assert 0.0 < each[0] - each[1] < 0.3
    assert start_clearance(*parts) == start_clearance(
        *parts, scale=sizes[:1], T_wo=scene.placement.T_wo()[None]
    )


def test_arm_that_starts_within_the_open_part_is_refused(closing_drawer):
    """As if the drawer were to be opened, closed handle before the hand."""
    placement = closing_drawer.placement
    x, y, z = placement.pos_w
    there = (x - 0.25, y, z)
    moved = dataclasses.replace(placement, pos_w=there)
    model = closing_drawer.nominal
    model.body_pos[closing_drawer.at.root_body] = there
    near = dataclasses.replace(closing_drawer, placement=moved)
    assert start_clearance(near.asset, near.task, near.arm, moved) == 0.0
    try:
        with pytest.raises(ReachError, match=r"the arm at its start collides|no room"):
            check_grasp(near)
    finally:
        model.body_pos[closing_drawer.at.root_body] = (x, y, z)


def test_episodes_begin_at_home_empty_with_the_part_uniformly_where_the_task_says(scene):
    n, (low, high) = 4000, scene.task.begin
    drawn = sample_episode_params(DRAWS, np.random.default_rng(0), n, begin=scene.task.begin)
    start = home_start(scene, drawn)
    assert_array_equal(start.opened, drawn["part_open"])
    assert low <= start.opened.min() < start.opened.max() <= high
    shares = (start.opened - low) / (high - low)
    assert_allclose(np.quantile(shares, [0.1, 0.5, 0.9]), [0.1, 0.5, 0.9], atol=0.03)
    assert np.all(start.closing == -1)
    assert np.all(start.width == scene.arm.gripper.max_width_m)
    engine = ThreadEngine(scene, 6)
    rows = np.arange(6)
    engine.reset(rows, rows_of(start, rows))
    assert_allclose(engine.state().opened, start.opened[:6], atol=1e-12)
    engine.close()


def test_part_stays_where_it_is_while_nobody_touches_it(scene):
    """The weight of a lid is carried, as springs and struts do."""
    n = 3
    start = home_start(scene, nominal_params(n, begin=scene.task.begin))
    start.opened[:] = [scene.task.begin[0], np.mean(scene.task.begin), scene.task.begin[1]]
    engine = ThreadEngine(scene, n)
    engine.reset(np.arange(n), start)
    for _ in range(20):
        state = engine.step(np.zeros((n, 8)))
    assert_allclose(state.opened, start.opened, atol=2e-3)
    assert np.abs(state.speed).max() < 1e-3
    engine.close()


def test_an_open_lid_that_is_to_be_opened_falls(lid):
    start = home_start(lid, nominal_params())
    start.opened[:] = 0.5
    engine = ThreadEngine(lid, 1)
    engine.reset(np.zeros(1, dtype=int), start)
    for _ in range(20):
        state = engine.step(np.zeros((1, 8)))
    assert state.opened[0] < 0.1
    engine.close()


def test_prepared_hands_hold_parts_on_their_way_and_wait_before_those_that_begin(scene):
    config = InitialStatesConfig(n_precomputed=80)
    bank = precompute_states(scene, config, DRAWS, np.random.default_rng(0))
    n = len(bank.q)
    assert n > 0.5 * config.n_precomputed
    engine = ThreadEngine(scene, n)
    engine.reset(np.arange(n), bank)
    error = relative(tool_pose(scene.arm, bank.q), engine.state().T_wh)
    engine.close()
    holds = (bank.closing > 0) & (bank.width > 0)
    low, high = scene.task.begin
    assert np.all((bank.opened[holds] >= scene.task.target) & (bank.opened[holds] <= high))
    assert bank.opened[holds].min() < low
    assert_array_equal(bank.opened[~holds], bank.params["part_open"][~holds])
    assert np.all((bank.params["part_open"] >= low) & (bank.params["part_open"] <= high))
    assert np.linalg.norm(error[holds, :3, 3], axis=1).max() < 2e-3
    assert rotation_angle(error[:, :3, :3]).max() < 0.021, "the corridor turns with the handle"
    assert error[~holds, 2, 3].min() > -2e-3


def test_handle_of_a_hinge_goes_on_a_circle_and_turns_with_it(closing_door):
    """Closed form: about the pivot, by the angle of the joint, at every size of the object."""
    scene, scale = closing_door, np.array([0.9, 1.0, 1.1])
    joint, opened = scene.asset.joint("door_hinge"), np.array([0.7, 0.35, 0.05])
    T_wo = object_pose(
        scene.asset,
        joint.name,
        scene.placement,
        scale=scale,
        shift=np.zeros((3, 2)),
        yaw=np.zeros(3),
    )
    shut, now = (
        np.linalg.inv(T_wo)
        @ handle_in_world(
            scene.asset, joint.name, T_wo=T_wo, scale=scale, opened=o, flip=scene.placement.flip
        )
        for o in (np.zeros(3), opened)
    )
    pivot = scale[:, None] * np.asarray(joint.pivot_o)
    turn = axis_angle_to_matrix(np.array([0.0, 0.0, -1.0]), opened * joint.span)
    arm = np.einsum("nij,nj->ni", turn, shut[:, :3, 3] - pivot)
    assert_allclose(now[:, :3, 3], pivot + arm, atol=1e-12)
    assert_allclose(now[:, :3, :3], turn @ shut[:, :3, :3], atol=1e-12)
    radius = np.hypot(0.40, 0.045) * scale
    assert_allclose(np.linalg.norm(arm[:, :2], axis=1), radius, atol=1e-12)


def test_part_that_rests_closed_is_a_success_and_one_that_stays_open_is_not_closed(scene):
    n = 4
    engine = ThreadEngine(scene, n)
    runs = Episodes(
        engine, randomization=NO_RANDOMIZATION, reward=RewardConfig(), initial_states=None, seed=0
    )
    start = home_start(scene, nominal_params(n, begin=scene.task.begin))
    start.opened[:] = [scene.task.begin[1], scene.task.target + 0.02, scene.task.target - 0.02, 0]
    start.q[2:, 0] += 1.5  # the arm is elsewhere
    runs.reset(start=start)
    for _ in range(scene.n_steps):
        tick = runs.step(np.zeros((n, 8)))
    assert tick.ended is not None
    codes = [REASONS[c] for c in tick.ended.code]
    assert codes == ["goal_not_reached", "goal_not_reached", "success", "success"]
    assert tick.ended.opened.tolist() == [False, False, True, True]
    assert_allclose(runs.params["part_open"], np.clip(runs.params["part_open"], *scene.task.begin))
    engine.close()


def test_episodes_of_closing_continue_from_a_snapshot_with_the_same_bits(closing_door):
    def made():
        engine = ThreadEngine(closing_door, 3)
        initial_states = InitialStatesConfig(n_precomputed=16)
        return Episodes(
            engine,
            randomization=DRAWS,
            reward=RewardConfig(),
            initial_states=initial_states,
            seed=3,
        )

    plan = np.random.default_rng(0).uniform(-1, 1, (30, 3, 8))
    runs, other = made(), made()
    runs.reset()
    for action in plan[:13]:
        runs.step(action)
    kept = runs.snapshot()
    ours = [runs.step(action) for action in plan[13:]]
    other.restore(kept)
    for a, action in zip(ours, plan[13:], strict=True):
        b = other.step(action)
        assert_array_equal(a.observation, b.observation)
        assert_array_equal(a.reward, b.reward)


def test_same_draws_as_for_opening_but_for_where_the_part_begins_and_when_it_is_pushed():
    """Opening tasks draw what they drew before tasks that close were added."""
    one = sample_episode_params(DRAWS, np.random.default_rng(0), 5)
    two = sample_episode_params(DRAWS, np.random.default_rng(0), 5, begin=(0.4, 0.8))
    before = COLUMNS.index("push_time")
    assert COLUMNS[before:] == ("push_time", "part_open", *COLUMNS[BLOCKS["force_bias"]])
    assert_array_equal(one.values[:, :before], two.values[:, :before])
    assert_allclose(two["push_time"], 0.5 + 0.4 / 0.9 * one["push_time"], rtol=1e-12)
    assert np.all(one["part_open"] == 0)
    rng, same = np.random.default_rng(0), np.random.default_rng(0)
    sample_episode_params(DRAWS, rng, 5)
    sample_episode_params(DRAWS, same, 5, begin=(0.3, 0.3))
    assert rng.bit_generator.state == same.bit_generator.state
