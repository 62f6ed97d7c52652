import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode
from numpy.testing import assert_array_equal

from articulate.task.observation import OBSERVATION
from articulate.task.randomization import COLUMNS
from articulate_envs.vector_env import ArticulateVectorEnv

ID = "articulate_envs:Articulate/OpenDrawer-v0"
N = 3


@pytest.fixture
def envs(drawer):
    made = ArticulateVectorEnv(num_envs=N, scene=drawer)
    yield made
    made.close()


def test_make_vec_steps_the_batched_engine(named):
    envs = gymnasium.make_vec(ID, num_envs=N, threads=2, **named)
    assert isinstance(envs, ArticulateVectorEnv)
    assert envs.metadata["autoreset_mode"] is AutoresetMode.SAME_STEP
    assert (envs.engine.n_envs, envs.engine.threads) == (N, 2)
    observation, info = envs.reset(seed=0)
    assert envs.observation_space.contains(observation)
    assert set(info["draw"]) == set(COLUMNS)
    assert envs.spec is not None
    assert envs.spec.kwargs["num_envs"] == N
    envs.close()
    envs.close()


def test_make_vec_takes_single_environments_as_well(named):
    envs = gymnasium.make_vec(ID, num_envs=2, vectorization_mode="sync", **named)
    observation, info = envs.reset(seed=0)
    assert observation.shape == (2, OBSERVATION.size)
    observation, reward, _, _, info = envs.step(envs.action_space.sample())
    assert info["reason"].shape == reward.shape == (2,)
    envs.close()


def test_seed_decides_everything_and_threads_nothing(drawer, envs):
    def run(one):
        one.reset(seed=3)
        rng = np.random.default_rng(0)
        return [one.step(rng.uniform(-1, 1, (N, 8)))[:2] for _ in range(30)]

    first, again = run(envs), run(envs)
    threaded = run(ArticulateVectorEnv(num_envs=N, threads=2, scene=drawer))
    for other in (again, threaded):
        for ours, theirs in zip(other, first, strict=True):
            assert_array_equal(ours[0], theirs[0])
            assert_array_equal(ours[1], theirs[1])


def test_an_end_gives_the_last_observation_and_begins_anew(drawer, envs):
    envs.reset(seed=0)
    for tick in range(drawer.ticks):
        observation, _, terminated, truncated, info = envs.step(np.zeros((N, 8)))
        assert ("final_obs" in info) == (tick == drawer.ticks - 1)
    assert terminated.all()
    assert not truncated.any()
    left = OBSERVATION.slice("time_left")
    assert_array_equal(observation[:, left], np.ones((N, 1)))
    assert_array_equal(np.stack(info["final_obs"])[:, left], np.zeros((N, 1)))
    assert info["_final_obs"].all()
    assert set(info["final_info"]["reason"]) <= {"not_open", "touch", "force"}
    assert not info["final_info"]["success"].any()


def test_episodes_cut_in_training_are_truncations(envs, drawer):
    """What the curriculum of training cuts while the part rests at the target."""
    envs.reset(seed=0)
    held = envs.episodes.engine
    envs.episodes._cut = lambda: np.array([True, False, False])
    _, _, terminated, truncated, info = envs.step(np.zeros((N, 8)))
    assert_array_equal(truncated, [True, False, False])
    assert not terminated.any()
    assert_array_equal(info["_final_obs"], [True, False, False])
    assert info["final_obs"][1] is None
    assert held is envs.engine


def test_what_is_not_accepted_is_answered_in_one_line(drawer, envs, error_line):
    error_line("envs.step() before envs.reset()", lambda: envs.step(np.zeros((N, 8))))
    error_line("envs.reset(seed=[0, 1, 2])", lambda: envs.reset(seed=[0, 1, 2]))
    envs.reset(seed=0)
    error_line("envs.step(eight numbers)", lambda: envs.step(np.zeros(8)))
    bad = np.zeros((N, 8))
    bad[1, 2] = np.inf
    error_line("envs.step(inf)", lambda: envs.step(bad))
    error_line("make_vec(num_envs=0)", lambda: ArticulateVectorEnv(num_envs=0, scene=drawer))
    error_line(
        "make_vec(render_mode=human)",
        lambda: ArticulateVectorEnv(num_envs=1, scene=drawer, render_mode="human"),
    )
