import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode
from gymnasium.wrappers.vector import (
    NormalizeObservation,
    NormalizeReward,
    RecordEpisodeStatistics,
)
from numpy.testing import assert_array_equal

from articulate.task.observation import OBSERVATION
from articulate.task.randomization import COLUMNS
from articulate_envs.gym_env import ArticulateEnv
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
    assert set(info["episode_params"]) == set(COLUMNS)
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
    for tick in range(drawer.n_steps):
        observation, _, terminated, truncated, info = envs.step(np.zeros((N, 8)))
        assert ("final_obs" in info) == (tick == drawer.n_steps - 1)
    assert terminated.all()
    assert not truncated.any()
    left = OBSERVATION.slice("time_left")
    assert_array_equal(observation[:, left], np.ones((N, 1)))
    assert_array_equal(np.stack(info["final_obs"])[:, left], np.zeros((N, 1)))
    assert info["_final_obs"].all()
    assert set(info["final_info"]["reason"]) <= {"goal_not_reached", "forbidden_contact", "force"}
    assert not info["final_info"]["success"].any()


def test_episodes_cut_in_training_are_truncations(envs, drawer):
    """Truncations of the training curriculum while the part is at rest at the target."""
    envs.reset(seed=0)
    envs.episodes._truncated = lambda: np.array([True, False, False])
    _, _, terminated, truncated, info = envs.step(np.zeros((N, 8)))
    assert_array_equal(truncated, [True, False, False])
    assert not terminated.any()
    assert_array_equal(info["_final_obs"], [True, False, False])
    assert info["final_obs"][1] is None


@pytest.fixture
def vectors(drawer):
    """``vectors(**arguments)``: environments that are closed after the test."""
    made = []

    def make(**arguments):
        made.append(ArticulateVectorEnv(num_envs=N, scene=drawer, **arguments))
        return made[-1]

    yield make
    for one in made:
        one.close()


STILL = np.zeros((N, 8))


def test_next_step_autoreset_begins_episodes_in_the_step_after_the_end(vectors):
    envs = vectors(autoreset_mode="next_step", max_episode_steps=4)
    assert envs.metadata["autoreset_mode"] is AutoresetMode.NEXT_STEP
    envs.reset(seed=0)
    steps = [envs.step(STILL) for _ in range(6)]
    assert [bool(step[3].all()) for step in steps] == [False, False, False, True, False, False]
    assert not any(step[2].any() for step in steps)
    assert not any("final_obs" in step[4] for step in steps)
    assert_array_equal(steps[4][1], np.zeros(N))
    left = OBSERVATION.slice("time_left")
    assert_array_equal(steps[4][0][:, left], np.ones((N, 1)))
    assert (steps[5][0][:, left] < 1.0).all()


def test_disabled_autoreset_leaves_the_reset_to_a_mask(vectors, error_line):
    envs = vectors(autoreset_mode=AutoresetMode.DISABLED, max_episode_steps=2)
    envs.reset(seed=0)
    envs.step(STILL)
    last = envs.step(STILL)[0]
    error_line("envs.step() after the end", lambda: envs.step(STILL))
    mask = np.array([False, True, False])
    observation, info = envs.reset(options={"reset_mask": mask})
    assert_array_equal(observation[~mask], last[~mask])
    assert np.any(observation[mask] != last[mask])
    assert info["reason"].shape == (N,)
    envs.reset(options={"reset_mask": ~mask, "opened": 0.0})
    assert not envs.step(STILL)[3].any()


def test_max_episode_steps_truncate_and_same_step_begins_the_next_episode(vectors):
    envs = vectors(max_episode_steps=2)
    envs.reset(seed=0)
    envs.step(STILL)
    observation, _, terminated, truncated, info = envs.step(STILL)
    assert (terminated.any(), truncated.all()) == (False, True)
    left = OBSERVATION.slice("time_left")
    assert_array_equal(observation[:, left], np.ones((N, 1)))
    assert (np.stack(info["final_obs"])[:, left] < 1.0).all()


@pytest.mark.parametrize("mode", ["SAME_STEP", "NEXT_STEP"])
def test_each_environment_follows_its_seed(drawer, vectors, mode):
    """Environment i repeats a single environment with its seed, over a truncation."""
    seeds, steps = [5, 9, 5], 3
    envs = vectors(autoreset_mode=mode, max_episode_steps=steps)
    first, _ = envs.reset(seed=seeds)
    found = [first] + [envs.step(np.full((N, 8), 0.3))[0] for _ in range(steps + 3)]
    assert_array_equal([step[0] for step in found], [step[2] for step in found])
    observations = np.array(found)
    for row, seed in enumerate(seeds[:2]):
        env = ArticulateEnv(scene=drawer)
        expected = [env.reset(seed=seed)[0]]
        expected += [env.step(np.full(8, 0.3))[0] for _ in range(steps)]
        if mode == "SAME_STEP":  # the last observation is in `final_obs`
            expected.pop()
        expected.append(env.reset()[0])
        expected += [env.step(np.full(8, 0.3))[0] for _ in range(2)]
        env.close()
        np.testing.assert_allclose(observations[: len(expected), row], expected, atol=1e-5)


def test_seeds_of_some_environments_change_no_other(vectors):
    one, two = vectors(), vectors()
    one.reset(seed=[1, 2, 3])
    two.reset(seed=[1, 7, 3])
    a, b = (envs.step(STILL)[0] for envs in (one, two))
    assert_array_equal(a[[0, 2]], b[[0, 2]])
    assert np.any(a[1] != b[1])


def test_gymnasium_normalizes_observations_and_rewards(named):
    envs = gymnasium.make_vec(
        ID, num_envs=N, autoreset_mode="NEXT_STEP", max_episode_steps=20, **named
    )
    envs = NormalizeReward(NormalizeObservation(envs))
    envs.reset(seed=[1, 2, 3])  # type: ignore[arg-type]  # vector environments take lists
    for _ in range(5):
        observation, reward, *_ = envs.step(envs.action_space.sample())
    assert np.isfinite(observation).all()
    assert np.isfinite(reward).all()
    envs.close()


@pytest.mark.parametrize("mode", ["SAME_STEP", "NEXT_STEP"])
def test_gymnasium_counts_returns_and_lengths_of_episodes(vectors, mode):
    envs = RecordEpisodeStatistics(vectors(autoreset_mode=mode, max_episode_steps=3))
    envs.reset(seed=0)
    for _ in range(3):
        info = envs.step(STILL)[-1]
    assert_array_equal(info["episode"]["l"], np.full(N, 3))
    envs.close()


def test_what_is_not_accepted_is_answered_in_one_line(drawer, envs, error_line):
    error_line("envs.step() before envs.reset()", lambda: envs.step(np.zeros((N, 8))))
    error_line("envs.reset(seed=[0, 1])", lambda: envs.reset(seed=[0, 1]))
    some = np.array([True, False, False])
    error_line("envs.reset(reset_mask) first", lambda: envs.reset(options={"reset_mask": some}))
    envs.reset(seed=0)
    error_line(
        "envs.reset(reset_mask=[1])", lambda: envs.reset(options={"reset_mask": np.array([1])})
    )
    error_line("envs.step(eight numbers)", lambda: envs.step(np.zeros(8)))
    bad = np.zeros((N, 8))
    bad[1, 2] = np.inf
    error_line("envs.step(inf)", lambda: envs.step(bad))
    error_line("make_vec(num_envs=0)", lambda: ArticulateVectorEnv(num_envs=0, scene=drawer))
    error_line(
        "make_vec(autoreset_mode=never)",
        lambda: ArticulateVectorEnv(num_envs=1, scene=drawer, autoreset_mode="never"),
    )
    error_line(
        "make_vec(max_episode_steps=0)",
        lambda: ArticulateVectorEnv(num_envs=1, scene=drawer, max_episode_steps=0),
    )
    error_line(
        "make_vec(render_mode=human)",
        lambda: ArticulateVectorEnv(num_envs=1, scene=drawer, render_mode="human"),
    )
