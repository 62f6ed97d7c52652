"""The guide moves what it is asked to, within the limits, and opens a hand that is empty."""

from dataclasses import replace

import numpy as np
import pytest
from tests.scenes import DRAWS

from articulate.robot.kinematics import relative
from articulate.task.episode_monitor import REASONS, failure_reason
from articulate.task.observation import ACTION
from articulate.task.randomization import sample_episode_params
from articulate.transforms import rotation_angle
from articulate_envs.config import InitialStatesConfig
from articulate_envs.episodes import Episodes
from articulate_envs.initial_states import home_start, precompute_states
from articulate_envs.rewards import RewardConfig
from articulate_envs.scripted_expert import make_scripted_expert
from articulate_envs.threaded_engine import ThreadEngine

N = 24


def led(scene, ticks=None):
    """Episodes of ten seconds from home in which the guide acts, and all that it said."""
    scene = replace(scene, task=replace(scene.task, episode_s=10.0))
    engine = ThreadEngine(scene, N)
    draws = replace(DRAWS, gripper_latency_s=(0.1, 0.4))
    runs = Episodes(
        engine, randomization=draws, reward=RewardConfig(), initial_states=None, seed=0, renew=False
    )
    runs.reset()
    guide, said = make_scripted_expert(scene), []
    for _ in range(ticks or scene.n_steps):
        said.append(guide.act(runs.state, runs.params))
        runs.step(said[-1])
    engine.close()
    return runs, np.array(said)


@pytest.mark.parametrize("name", ["drawer", "door", "closing_drawer"])
def test_led_parts_make_their_way_and_no_limit_is_broken(name, request):
    scene = request.getfixturevalue(name)
    runs, said = led(scene)
    begin = runs.params["part_open"]
    made = (runs.state.opened - begin) / (scene.task.target - begin)
    assert np.quantile(made, 0.2) > 0.7
    assert set(failure_reason(runs.monitor, scene.task).tolist()) <= {0, *not_yet()}
    assert np.abs(said).max() <= 1.0


def not_yet():
    """Codes of episodes in which no limit was broken."""
    return [REASONS.index(name) for name in ("goal_not_reached", "not_at_rest", "goal_not_reached")]


def test_hand_comes_to_the_handle_open_and_turned_like_it(drawer):
    runs, said = led(drawer, ticks=60)
    T_ht = relative(runs.state.T_wh, runs.state.T_wt)
    assert np.quantile(np.linalg.norm(T_ht[:, 1:3, 3], axis=1), 0.9) < 0.015
    assert rotation_angle(T_ht[:, :3, :3]).max() < 0.2
    assert (said[:10, :, ACTION.slice("gripper")] < 0.0).all()


def test_hand_that_has_closed_on_nothing_opens_and_goes_back(drawer):
    """Placed at the handle with its fingers shut, as starts of the training are."""
    config = InitialStatesConfig(
        n_precomputed=60, grip_share=0.0, empty_grasp_share=1.0, off_target_share=0.0
    )
    bank = precompute_states(drawer, config, DRAWS, np.random.default_rng(0))
    engine = ThreadEngine(drawer, len(bank.q))
    engine.reset(np.arange(len(bank.q)), bank)
    said = make_scripted_expert(drawer).act(engine.state(), bank.params)
    engine.close()
    assert (said[:, ACTION.slice("gripper")] == -1.0).all()
    close_by = np.linalg.norm(relative(engine.state().T_wh, engine.state().T_wt)[:, :3, 3], axis=1)
    assert (said[close_by < 0.03, 2] < 0.0).all()


def test_guide_draws_nothing_at_random(drawer):
    drawn = sample_episode_params(DRAWS, np.random.default_rng(0), N, begin=drawer.task.begin)
    engine = ThreadEngine(drawer, N)
    engine.reset(np.arange(N), home_start(drawer, drawn))
    state = engine.state()
    engine.close()
    guide = make_scripted_expert(drawer)
    assert np.array_equal(guide.act(state, drawn), guide.act(state, drawn))
