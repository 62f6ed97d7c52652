import dataclasses

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from stable_baselines3.common.vec_env import VecMonitor, VecNormalize
from tests.scenes import DRAWS

from articulate.task.episode_monitor import REASONS
from articulate.task.observation import ACTION, OBSERVATION
from articulate.task.randomization import nominal_params
from articulate_envs.config import InitialStatesConfig
from articulate_envs.episodes import Episodes
from articulate_envs.initial_states import home_start
from articulate_envs.privileged_observation import PRIVILEGED
from articulate_envs.rewards import RewardConfig
from articulate_envs.threaded_engine import ThreadEngine
from articulate_train.config import ActionScalingConfig
from articulate_train.vecenv import EpisodesVecEnv

N = 4
MOTIONS = ACTION.size - 1


@pytest.fixture
def env(drawer):
    runs = Episodes(
        ThreadEngine(drawer, N),
        randomization=DRAWS,
        reward=RewardConfig(),
        initial_states=InitialStatesConfig(n_precomputed=16),
        seed=0,
    )
    made = EpisodesVecEnv(runs, ActionScalingConfig())
    yield made
    made.close()


def test_spaces_are_those_of_the_layouts(env):
    assert env.observation_space.shape == (OBSERVATION.size + PRIVILEGED.size,)
    assert env.action_space.shape == (ACTION.size,)
    high = np.concatenate([OBSERVATION.high, PRIVILEGED.high])
    assert_array_equal(env.observation_space.high, high.astype(np.float32))
    assert_array_equal(env.action_space.low, -1.0)


def test_steps_give_what_the_spaces_state(env):
    observation = env.reset()
    rng = np.random.default_rng(0)
    for _ in range(30):
        assert observation.dtype == np.float32
        assert all(env.observation_space.contains(row) for row in observation)
        action = rng.uniform(-1, 1, (N, ACTION.size)).astype(np.float32)
        observation, reward, done, infos = env.step(action)
        assert (reward.dtype, reward.shape) == (np.float32, (N,))
        assert (done.dtype, done.shape, len(infos)) == (bool, (N,), N)


def test_end_of_an_episode_is_a_termination_with_its_last_observation_and_reason(env, drawer):
    env.reset()
    seen = []
    for _ in range(drawer.n_steps):
        observation, _, done, infos = env.step(np.zeros((N, 8), dtype=np.float32))
        for i in range(N):
            if done[i]:
                seen.append(i)
                last = infos[i]["terminal_observation"]
                assert env.observation_space.contains(last)
                assert last[OBSERVATION.slice("time_left")] == 0
                assert observation[i][OBSERVATION.slice("time_left")] == 1
                assert infos[i]["TimeLimit.truncated"] is False
                assert infos[i]["reason"] in REASONS
                assert infos[i]["is_success"] == (infos[i]["reason"] == "success")
            else:
                assert infos[i] == {}
    assert sorted(seen) == list(range(N))
    assert sum(len(e.code) for e in env.finished) == N


def test_episode_cut_at_rest_is_a_truncation_whose_last_observation_can_be_valued(env, drawer):
    runs = env.episodes
    runs.initial_states = dataclasses.replace(runs.initial_states, truncation_probability=1.0)
    env.reset()
    start = home_start(drawer, nominal_params(N))
    runs.reset(start=dataclasses.replace(start, opened=np.ones(N)))
    for _ in range(drawer.n_steps):
        _, _, done, infos = env.step(np.zeros((N, 8), dtype=np.float32))
        if done.any():
            break
    ended = [info for info in infos if info]
    assert len(ended) == round(runs.initial_states.truncation_env_share * N) > 0
    for info in ended:
        assert info["TimeLimit.truncated"] is True
        assert env.observation_space.contains(info["terminal_observation"])
        rest = info["terminal_observation"][OBSERVATION.size :][PRIVILEGED.slice("rest")]
        assert rest == pytest.approx(drawer.task.hold_s)


def test_wrappers_of_stable_baselines_go_around_it(env):
    wrapped = VecNormalize(VecMonitor(env), gamma=0.99)
    wrapped.reset()
    lengths = []
    for _ in range(45):
        observation, reward, _, infos = wrapped.step(np.zeros((N, 8), dtype=np.float32))
        lengths += [info["episode"]["l"] for info in infos if "episode" in info]
        assert np.isfinite(np.asarray(observation)).all()
        assert np.isfinite(reward).all()
    assert max(lengths) == 20


def test_attributes_and_methods_are_reached_through_it(env):
    assert env.get_attr("num_envs") == [N] * N
    assert env.get_attr("render_mode", indices=[0, 1]) == [None, None]
    env.set_attr("label", 3)
    assert env.label == 3
    assert env.env_is_wrapped(VecMonitor) == [False] * N
    assert env.seed(1) == [None] * N
    env.reset()
    assert set(env.env_method("snapshot")[0]) == set(env.episodes.snapshot())


def test_motions_are_finer_at_the_goal_and_the_grippers_command_is_not(env, monkeypatch):
    env.reset()
    near = np.zeros((N, OBSERVATION.size), dtype=np.float32)  # the part at its target
    env.restore(near, {})
    calls, step = [], env.episodes.step

    def stepped(action):
        calls.append(action)
        return step(action)

    monkeypatch.setattr(env.episodes, "step", stepped)
    env.step(np.full((N, ACTION.size), 2.0, dtype=np.float32))
    assert_allclose(calls[0][:, :MOTIONS], ActionScalingConfig().at_goal, rtol=1e-6)
    assert_allclose(calls[0][:, MOTIONS:], 1.0)
