import copy
import pickle  # noqa: TID251  # what Gymnasium itself does with an environment
import sys

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from numpy.testing import assert_array_equal

from articulate.task.episode_monitor import REASONS
from articulate.task.observation import ACTION, OBSERVATION
from articulate.task.randomization import COLUMNS
from articulate_envs import gym_env, viewer
from articulate_envs.gym_env import ArticulateEnv

STILL = np.zeros(8, dtype=np.float32)


@pytest.fixture
def env(drawer):
    made = ArticulateEnv(scene=drawer)
    yield made
    made.close()


@pytest.mark.render
def test_gymnasiums_checker_has_nothing_to_say(made, monkeypatch):
    """Warnings are errors here; on a screen it would open a window, too."""
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    check_env(made(render_mode="rgb_array").unwrapped)


def test_spaces_are_those_of_the_layouts(env):
    for space, layout in (
        (env.observation_space, env.observation_layout),
        (env.action_space, env.action_layout),
    ):
        assert (space.dtype, space.shape) == (np.float32, (layout.size,))
        assert_array_equal(space.low, layout.low.astype(np.float32))
        assert_array_equal(space.high, layout.high.astype(np.float32))
    assert (env.observation_layout, env.action_layout) == (OBSERVATION, ACTION)


def run(env, seed, ticks=12):
    observation, info = env.reset(seed=seed)
    rng = np.random.default_rng(0)
    out = [observation]
    for _ in range(ticks):
        observation, reward, *_ = env.step(rng.uniform(-1, 1, 8).astype(np.float32))
        out.append(np.append(observation, reward))
    return np.concatenate(out), info["episode_params"]


def test_seed_decides_everything_whatever_came_before(drawer, env):
    first, drawn = run(env, 5)
    other, other_drawn = run(env, 6)
    again, again_drawn = run(env, 5)
    elsewhere, _ = run(ArticulateEnv(scene=drawer), 5)
    assert_array_equal(again, first)
    assert_array_equal(elsewhere, first)
    assert again_drawn == drawn
    assert other_drawn != drawn
    assert np.abs(other - first).max() > 1e-3


def test_a_reset_without_a_seed_goes_on_with_the_same_generator(drawer, env):
    env.reset(seed=1)
    _, one = env.reset()
    other = ArticulateEnv(scene=drawer)
    other.reset(seed=1)
    assert other.reset()[1]["episode_params"] == one["episode_params"]
    assert env.reset(seed=1)[1]["episode_params"] != one["episode_params"]


def test_end_of_an_episode_is_a_termination_and_says_why(drawer, env):
    env.reset(seed=0)
    for tick in range(drawer.n_steps):
        observation, _, terminated, truncated, info = env.step(STILL)
        assert terminated == (tick == drawer.n_steps - 1)
        assert not truncated
        assert info["reason"] in REASONS
        assert info["success"] == (info["reason"] == "success")
        assert isinstance(info["opened"], bool)
    assert observation[OBSERVATION.slice("time_left")] == 0
    assert (info["reason"], info["success"], info["opened"]) == ("goal_not_reached", False, False)
    assert abs(info["open_fraction"]) < 0.1  # a push may have moved it


def test_a_limit_of_others_is_a_truncation(made, named):
    env = made(max_episode_steps=3)
    env.reset(seed=0)
    ends = [env.step(STILL)[2:4] for _ in range(3)]
    assert ends == [(False, False), (False, False), (False, True)]


def test_success_is_told(drawer, env):
    """A part that begins at its target and is left alone rests there to the end."""
    aside = [1.6, *drawer.placement.start_q[1:]]
    still = {"push_x_n": 0, "push_y_n": 0, "push_z_n": 0}
    env.reset(seed=0, options={"q": aside, "opened": 0.9, "episode_params": still})
    for _ in range(drawer.n_steps):
        *_, terminated, _, info = env.step(STILL)
    assert terminated
    assert (info["success"], info["reason"], info["opened"]) == (True, "success", True)
    assert info["open_fraction"] == pytest.approx(0.9, abs=0.01)


def test_what_starts_cut_off_is_truncated_and_not_terminated(drawer):
    """Its part rests at the target from the first tick on."""
    env = ArticulateEnv(
        scene=drawer,
        initial_states={
            "truncation_probability": 1.0,
            "truncation_env_share": 0.9,
            "n_precomputed": 8,
        },
    )
    aside = [1.6, *drawer.placement.start_q[1:]]
    still = {"push_x_n": 0, "push_y_n": 0, "push_z_n": 0}
    env.reset(seed=0, options={"q": aside, "opened": 0.9, "episode_params": still})
    ends: list[tuple[bool, bool]] = []
    while not any(any(e) for e in ends):
        ends.append(env.step(STILL)[2:4])
    env.close()
    assert ends[-1] == (False, True)
    assert len(ends) < drawer.n_steps


def test_options_replace_what_was_drawn(drawer, env):
    q = (np.asarray(drawer.placement.start_q) + 0.05).tolist()
    asked = {"episode_params": {"scale": 0.9, "mass": 1.2}, "q": q, "opened": 0.5, "width": 0.02}
    _, info = env.reset(seed=3, options={**asked, "closing": 1})
    state = env.episodes.state
    assert (info["episode_params"]["scale"], info["episode_params"]["mass"]) == (0.9, 1.2)
    np.testing.assert_allclose(state.q[0], q)
    assert state.opened[0] == pytest.approx(0.5)
    assert state.gripper_width[0] == pytest.approx(0.02)
    assert state.gripper.closing[0] == 1.0
    _, plain = env.reset(seed=3)
    assert info["episode_params"]["part_open"] == 0.5
    other = ("scale", "mass", "part_open")
    kept = {k: v for k, v in plain["episode_params"].items() if k not in other}
    assert kept.items() <= info["episode_params"].items()
    _, again = env.reset(options={"episode_params": info["episode_params"]})
    assert again["episode_params"] == info["episode_params"]
    assert env.episodes.state.opened[0] == pytest.approx(0.5)


def test_drawn_offsets_of_the_start_move_the_arm(drawer, env):
    env.reset(seed=3, options={"episode_params": {f"start_{i + 1}": 0.0 for i in range(7)}})
    np.testing.assert_allclose(env.episodes.state.q[0], drawer.placement.start_q)


@pytest.mark.parametrize(
    ("call", "options"),
    [
        ("params", {"params": {}}),
        ("episode_params=3", {"episode_params": 3}),
        ("episode_params.scales", {"episode_params": {"scales": 1.0}}),
        ("episode_params.scale=0.93", {"episode_params": {"scale": 0.93}}),
        ("episode_params.mass=-1", {"episode_params": {"mass": -1.0}}),
        ("episode_params.part_open=2", {"episode_params": {"part_open": 2.0}}),
        ("episode_params.delay_steps=0.5", {"episode_params": {"delay_steps": 0.5}}),
        ("opened=1.5", {"opened": 1.5}),
        ("q=six numbers", {"q": [0.0] * 6}),
        ("q=out of reach", {"q": [9.0] * 7}),
        ("width=nan", {"width": float("nan")}),
    ],
)
def test_options_that_are_not_accepted_are_answered_in_one_line(env, call, options, error_line):
    error_line(f"env.reset({call})", lambda: env.reset(options=options))


def test_actions_that_are_not_accepted_are_answered_in_one_line(env, error_line):
    env.reset(seed=0)
    before = env.snapshot()["engine_physics"]
    error_line("env.step(seven numbers)", lambda: env.step(np.zeros(7)))
    error_line("env.step(NaN)", lambda: env.step(np.array([0, 0, np.nan, 0, 0, 0, 0, 0])))
    error_line("env.step(text)", lambda: env.step("open"))
    assert_array_equal(env.snapshot()["engine_physics"], before)


def test_steps_outside_an_episode_are_answered_in_one_line(drawer, env, error_line):
    line = error_line("env.step() before env.reset()", lambda: env.step(STILL))
    env.reset(seed=0)
    for _ in range(drawer.n_steps):
        env.step(STILL)
    assert error_line("env.step() after the end", lambda: env.step(STILL)) == line


@pytest.mark.parametrize(
    ("call", "change"),
    [
        ("no asset", {"asset": None}),
        ("assets", {"assets": "x"}),
        ("task=open_drawers", {"task": "open_drawers"}),
        ("randomization.fricton", {"randomization": {"fricton": [1, 1]}}),
        ("render_mode=rgb", {"render_mode": "rgb"}),
        ("joint=lid", {"joint": "lid"}),
        ("width=0", {"width": 0}),
    ],
)
def test_arguments_that_are_not_accepted_are_answered_in_one_line(named, call, change, error_line):
    error_line(f"ArticulateEnv({call})", lambda: ArticulateEnv(**{**named, **change}))


def test_sizes_that_a_given_scene_has_not_are_refused(drawer, error_line):
    error_line(
        "ArticulateEnv(scene=three sizes, draw.scales=4)",
        lambda: ArticulateEnv(scene=drawer, randomization={"scales": 4}),
    )


def test_continued_from_a_snapshot_it_gives_the_same_bits(drawer, env):
    env.reset(seed=4)
    for _ in range(5):
        env.step(STILL)
    kept = env.snapshot()
    ends = []
    for one in (env, ArticulateEnv(scene=drawer)):
        one.restore(kept)
        ends.append([one.step(STILL)[0] for _ in range(5)])
    assert_array_equal(ends[0], ends[1])
    assert env.reset()[1]["episode_params"] == one.reset()[1]["episode_params"]


def test_spec_can_be_copied_kept_as_text_and_made_again(made):
    env = made()
    first = run(env, 2)[0]
    for spec in (
        copy.deepcopy(env.spec),
        pickle.loads(pickle.dumps(env.spec)),
        gymnasium.envs.registration.EnvSpec.from_json(env.spec.to_json()),
    ):
        again = gymnasium.make(spec)
        assert_array_equal(run(again, 2)[0], first)
        again.close()


def test_closing_twice_is_no_harm(made):
    env = made()
    env.reset(seed=0)
    env.close()
    env.close()


def test_starts_along_the_task_are_those_of_training(made):
    env = made(initial_states={"share_first": 1.0, "grip_share": 1.0, "n_precomputed": 8}).unwrapped
    opened = {round(env.reset(seed=k)[1]["open_fraction"], 6) for k in range(4)}
    assert len(opened) > 1
    assert made(initial_states={}).unwrapped.config.initial_states is not None


def test_without_randomisation_every_episode_is_the_same(named):
    env = ArticulateEnv(**{**named, "randomise": False})
    one, two = (env.reset(seed=k) for k in (1, 2))
    assert_array_equal(one[0], two[0])
    assert one[1]["episode_params"].keys() == set(COLUMNS)


@pytest.mark.render
def test_pictures_are_of_the_size_asked_for_and_show_what_moves(drawer):
    env = ArticulateEnv(scene=drawer, render_mode="rgb_array", width=160, height=120)
    env.reset(seed=0)
    first = env.render()
    assert first is not None
    assert first.shape == (120, 160, 3)
    assert first.dtype == np.dtype(np.uint8)
    assert_array_equal(env.render(), first)
    for _ in range(10):
        env.step(np.ones(8, dtype=np.float32))
    assert np.any(env.render() != first)
    env.reset(seed=1)  # another size and place
    assert np.any(env.render() != first)
    env.close()
    env.close()


def test_rendering_that_cannot_be_is_answered_in_one_line(drawer, env, monkeypatch, error_line):
    error_line("env.render() without a mode", env.render)
    with_mode = ArticulateEnv(scene=drawer, render_mode="rgb_array")
    error_line("env.render() before env.reset()", with_mode.render)
    for name in viewer.DISPLAYS:
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(sys, "platform", "linux")
    error_line(
        "ArticulateEnv(render_mode=human)",
        lambda: ArticulateEnv(scene=drawer, render_mode="human"),
    )
    assert ArticulateEnv(scene=drawer).metadata["render_modes"] == ["rgb_array"]


def test_a_window_follows_by_itself_and_closes(drawer, opened):
    env = gym_env.ArticulateEnv(scene=drawer, render_mode="human")
    assert "human" in env.metadata["render_modes"]
    env.reset(seed=0)
    for _ in range(3):
        env.step(np.ones(8, dtype=np.float32))
    assert env.render() is None
    (viewer,) = opened
    assert len(viewer.seen) == 4
    assert_array_equal(viewer.seen[-1], env.engine.data.qpos)
    viewer.open = False  # its user closed it
    env.step(STILL)
    assert len(viewer.seen) == 4
    env.reset(seed=1)
    assert len(opened) == 2
    env.close()
    assert not opened[1].open
