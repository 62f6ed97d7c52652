"""Engine and episodes of several scenes in one batch."""

import dataclasses

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from tests.scenes import DRAWS

from articulate.errors import EngineError
from articulate.task.observation import FORCE_UNIT_N, OBSERVATION, expert_action
from articulate.task.randomization import sample_episode_params
from articulate.task.scripted_expert import expert_params, write_expert_action
from articulate_envs.config import InitialStatesConfig
from articulate_envs.engine import Start
from articulate_envs.episodes import Episodes
from articulate_envs.initial_states import concatenate_starts, home_start
from articulate_envs.rewards import RewardConfig
from articulate_envs.threaded_engine import ThreadEngine

N = 2
"""Environments of each scene."""
ACTIONS = np.repeat(np.random.default_rng(0).uniform(-1.0, 1.0, (3, 2 * N, 8)), 4, axis=0)


def starts(scene, seed):
    return home_start(scene, sample_episode_params(DRAWS, np.random.default_rng(seed), N))


def both(drawer, door) -> Start:
    return concatenate_starts([starts(drawer, 1), starts(door, 2)], np.arange(2 * N))


def stepped(engine, start, actions):
    engine.reset(np.arange(engine.n_envs), start)
    states = [engine.step(action) for action in actions]
    engine.close()
    return states


def assert_rows_equal(state, rows, other):
    for name in ("q", "dq", "T_wt", "T_wh", "opened", "speed", "samples", "gripper_width"):
        assert_array_equal(getattr(state, name)[rows], getattr(other, name), err_msg=name)


@pytest.fixture(scope="module")
def states(drawer, door):
    return stepped(ThreadEngine([drawer, door], 2 * N), both(drawer, door), ACTIONS)


def test_each_environment_of_a_mixed_batch_moves_as_in_an_engine_of_its_scene(drawer, door, states):
    for scene, seed, rows in ((drawer, 1, slice(0, N)), (door, 2, slice(N, None))):
        other_states = stepped(ThreadEngine(scene, N), starts(scene, seed), ACTIONS[:, rows])
        for state, other in zip(states, other_states, strict=True):
            assert_rows_equal(state, rows, other)


def test_the_number_of_threads_changes_no_bit_of_a_mixed_batch(drawer, door, states):
    engine = ThreadEngine([drawer, door], 2 * N, threads=2)
    for state, other in zip(stepped(engine, both(drawer, door), ACTIONS), states, strict=True):
        assert_rows_equal(state, slice(None), other)


def test_a_mixed_batch_continues_from_a_snapshot_with_the_same_bits(drawer, door, states):
    engine, other = (ThreadEngine([drawer, door], 2 * N) for _ in range(2))
    engine.reset(np.arange(2 * N), both(drawer, door))
    for action in ACTIONS[:5]:
        engine.step(action)
    other.restore(engine.snapshot())
    for action, state in zip(ACTIONS[5:], states[5:], strict=True):
        assert_rows_equal(other.step(action), slice(None), state)


def test_scenes_that_cannot_share_an_engine_are_rejected(drawer, door):
    soft = dataclasses.replace(
        door, control=dataclasses.replace(door.control, move_m=0.5 * door.control.move_m)
    )
    with pytest.raises(EngineError, match="differ in control"):
        ThreadEngine([drawer, soft], 2 * N)
    with pytest.raises(EngineError, match="2 scenes for 1 environments"):
        ThreadEngine([drawer, door], 1)


def test_episodes_of_a_mixed_batch_sample_observe_and_reward_each_scene(drawer, door):
    engine = ThreadEngine([drawer, door], 2 * N)
    episodes = Episodes(
        engine,
        randomization=DRAWS,
        reward=RewardConfig(),
        initial_states=InitialStatesConfig(n_precomputed=8),
        seed=0,
    )
    seen = episodes.reset()
    params = episodes.params
    rotation = seen[:, OBSERVATION.slice("path_rotation")]
    assert_allclose(rotation[:N], 0.0)
    assert np.all(np.linalg.norm(rotation[N:], axis=1) > 0.1)
    left = seen[:, OBSERVATION.slice("path_left")][:, 0]
    travel = np.repeat(
        [s.task.target * s.asset.handle_travel(s.task.joint) for s in (drawer, door)], N
    )
    opened = episodes.state.opened / np.repeat([s.task.target for s in (drawer, door)], N)
    assert_allclose(left, travel * (1.0 - opened) / 0.2, atol=0.2)
    inputs, estimate = episodes._inputs(), episodes._estimator.estimate(params, episodes._noise)
    force = seen[:, OBSERVATION.slice("measured_force")]
    for i, scene in enumerate([drawer] * N + [door] * N):
        of_scene = expert_params(scene.control, scene.task, scene.asset, scene.placement)
        expected = np.empty(8)
        force_w = FORCE_UNIT_N * inputs.T_wt[i, :3, :3] @ force[i]
        at = estimate.T_wh[i], estimate.opened[i]
        write_expert_action(inputs, i, *at, force_w, of_scene, expected)
        assert_allclose(expert_action(seen)[i], expected, atol=1e-9)
    for action in ACTIONS:
        step = episodes.step(action)
    assert np.isfinite(step.reward).all()
    assert np.isfinite(step.observation).all()
    engine.close()
