"""The scripted expert moves the part within the limits and opens an empty gripper."""

from dataclasses import replace

import numpy as np
import pytest
from tests.scenes import DRAWS

from articulate.robot.kinematics import relative
from articulate.task.episode_monitor import REASONS, failure_reason
from articulate.task.observation import ACTION, expert_action
from articulate.transforms import rotation_angle
from articulate_envs.config import InitialStatesConfig
from articulate_envs.episodes import Episodes
from articulate_envs.initial_states import precompute_states
from articulate_envs.rewards import RewardConfig
from articulate_envs.threaded_engine import ThreadEngine

N = 24


def led(scene, steps=None):
    """Return episodes of ten seconds from home in which the expert acts, and its actions."""
    scene = replace(scene, task=replace(scene.task, episode_s=10.0))
    engine = ThreadEngine(scene, N)
    ranges = replace(DRAWS, gripper_latency_s=(0.1, 0.4))
    runs = Episodes(
        engine,
        randomization=ranges,
        reward=RewardConfig(),
        initial_states=None,
        seed=0,
        renew=False,
    )
    actions, seen = [], runs.reset()
    for _ in range(steps or scene.n_steps):
        actions.append(expert_action(seen))
        seen = runs.step(actions[-1]).observation
    engine.close()
    return runs, np.array(actions)


@pytest.mark.parametrize("name", ["drawer", "door", "closing_drawer"])
def test_led_parts_move_to_the_target_and_no_limit_is_exceeded(name, request):
    scene = request.getfixturevalue(name)
    runs, actions = led(scene)
    begin = runs.params["part_open"]
    made = (runs.state.opened - begin) / (scene.task.target - begin)
    assert np.quantile(made, 0.2) > 0.7
    assert set(failure_reason(runs.monitor, scene.task).tolist()) <= {0, *not_yet()}
    assert np.abs(actions).max() <= 1.0


def not_yet():
    """Codes of episodes in which no limit was broken."""
    return [REASONS.index(name) for name in ("goal_not_reached", "not_at_rest", "goal_not_reached")]


def test_open_gripper_comes_to_the_handle_with_its_orientation(drawer):
    runs, actions = led(drawer, steps=60)
    T_ht = relative(runs.state.T_wh, runs.state.T_wt)
    assert np.quantile(np.linalg.norm(T_ht[:, 1:3, 3], axis=1), 0.9) < 0.015
    assert rotation_angle(T_ht[:, :3, :3]).max() < 0.2
    assert (actions[:10, :, ACTION.slice("gripper")] < 0.0).all()


def test_gripper_that_has_closed_on_nothing_opens_and_goes_back(drawer):
    """Placed at the handle with its fingers shut, as starts of the training are."""
    config = InitialStatesConfig(
        n_precomputed=60, grip_share=0.0, empty_grasp_share=1.0, off_target_share=0.0
    )
    bank = precompute_states(drawer, config, DRAWS, np.random.default_rng(0))
    engine = ThreadEngine(drawer, len(bank.q))
    runs = Episodes(engine, randomization=DRAWS, reward=RewardConfig(), initial_states=None, seed=0)
    actions = expert_action(runs.reset(start=bank))
    engine.close()
    assert (actions[:, ACTION.slice("gripper")] == -1.0).all()
    close_by = np.linalg.norm(relative(runs.state.T_wh, runs.state.T_wt)[:, :3, 3], axis=1)
    assert (actions[close_by < 0.03, 2] < 0.0).all()
