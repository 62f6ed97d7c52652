import json
import sys

import numpy as np
import pytest
import robosuite
from numpy.testing import assert_array_equal
from robosuite.wrappers import DataCollectionWrapper, GymWrapper

from articulate.task.observation import ACTION, OBSERVATION
from articulate.task.randomization import COLUMNS
from articulate_envs import robosuite_sim, viewer
from articulate_envs.robosuite_env import ArticulatedObject
from articulate_envs.video import SceneRenderer

STILL = np.zeros(8)


@pytest.fixture
def env(drawer):
    made = ArticulatedObject("Panda", scene=drawer, seed=0)
    yield made
    made.close()


def test_robosuite_makes_it_by_its_name(named):
    env = robosuite.make(
        "ArticulatedObject",
        robots=["Panda"],
        task="open_drawer",
        has_renderer=False,
        has_offscreen_renderer=False,
        use_camera_obs=False,
        reward_shaping=True,
        control_freq=20,
        hard_reset=False,
        **named,
    )
    assert isinstance(env, robosuite.environments.base.MujocoEnv)
    assert (env.control_freq, env.horizon, env.model_timestep) == (20, 200, 0.005)
    told, reward, done, info = env.step(STILL)
    assert (done, info["success"], np.isfinite(reward)) == (False, False, True)
    assert told["policy-state"].shape == (OBSERVATION.size,)
    env.close()
    env.close()


def test_observations_are_the_fields_of_the_layout_by_name(env):
    told = env.reset()
    whole = told["policy-state"]
    for field in OBSERVATION.fields:
        assert_array_equal(np.ravel(told[field.name]), whole[OBSERVATION.slice(field.name)])
    assert told["object-state"].size + told["robot0_proprio-state"].size == OBSERVATION.size
    spec = env.observation_spec()
    assert spec.keys() == told.keys()
    assert all(np.shape(spec[k]) == np.shape(told[k]) for k in told)


def test_actions_are_specified_as_robosuite_does_it(env):
    low, high = env.action_spec
    assert_array_equal(low, ACTION.low)
    assert_array_equal(high, ACTION.high)
    assert env.action_dim == env.robots[0].action_dim == ACTION.size


def test_simulation_is_the_engines_own(env, drawer):
    env.reset()
    env.step(0.5 * np.ones(8))
    assert_array_equal(env.sim.data.qpos, env.engine.data.qpos)
    assert_array_equal(env.robots[0]._joint_positions, env.episodes.state.q[0])
    assert_array_equal(env.robots[0]._joint_velocities, env.episodes.state.dq[0])
    joint = env.sim.model.get_joint_qpos_addr(f"object/{drawer.task.joint}")
    assert joint == drawer.at.part_q
    state = env.sim.get_state().flatten()
    env.sim.data.qpos[:] = 0.0
    env.sim.set_state_from_flattened(state)
    env.sim.forward()
    assert_array_equal(env.engine.data.qpos, state[1 : 1 + env.sim.model.nq])
    assert env.sim.model.opt.timestep == env.model_timestep


def test_parts_are_looked_up_by_their_names(env, drawer):
    env.reset()
    data, model = env.sim.data, env.sim.model
    assert_array_equal(data.get_site_xpos("tool"), env.engine.data.site("tool").xpos)
    part = f"object/{drawer.task.joint}"
    assert data.get_joint_qpos(part) == env.engine.data.qpos[drawer.at.part_q]
    assert model.body_id2name(model.body_name2id("right_hand")) == "right_hand"
    fingers = [model.geom_id2name(g) for g in drawer.at.finger_geoms]
    assert not env.check_contact(fingers)


def test_observables_can_be_spoilt_and_hidden_and_policies_see_the_truth(env):
    env.modify_observable("joint_pos", "corrupter", lambda value: value + 1.0)
    env.modify_observable("joint_vel", "active", False)
    told = env.reset()
    where = OBSERVATION.slice("joint_pos")
    np.testing.assert_allclose(told["joint_pos"], told["policy-state"][where] + 1.0)
    assert "joint_vel" not in told
    assert env.observation_names >= {f.name for f in OBSERVATION.fields}
    assert env.observation_modalities == {"object", "robot0_proprio", "policy"}


def test_episodes_are_done_at_their_end_and_not_before(env, drawer):
    env.reset()
    done = [env.step(STILL)[2] for _ in range(drawer.n_steps)]
    assert done == [False] * (drawer.n_steps - 1) + [True]
    assert env.cur_time == pytest.approx(drawer.task.episode_s)


def test_horizon_and_ignore_done_are_what_they_are_in_robosuite(drawer):
    short = ArticulatedObject("Panda", scene=drawer, horizon=3)
    assert [short.step(STILL)[2] for _ in range(3)] == [False, False, True]
    endless = ArticulatedObject("Panda", scene=drawer, ignore_done=True)
    assert not any(endless.step(STILL)[2] for _ in range(drawer.n_steps + 3))


def test_success_is_paid_once_though_the_episode_goes_on(drawer):
    endless = ArticulatedObject("Panda", scene=drawer, ignore_done=True)
    aside = [1.6, *drawer.placement.start_q[1:]]
    still = {"push_x_n": 0, "push_y_n": 0, "push_z_n": 0}
    endless.set_ep_meta({"q": aside, "opened": 0.9, "episode_params": still})
    endless.reset()
    rewards = [endless.step(STILL)[1] for _ in range(drawer.n_steps + 3)]
    paid = np.flatnonzero(np.array(rewards) > 30.0)
    assert paid.tolist() == [drawer.n_steps - 1]


def test_success_is_what_the_judgement_says(drawer, env):
    aside = [1.6, *drawer.placement.start_q[1:]]
    still = {"push_x_n": 0, "push_y_n": 0, "push_z_n": 0}
    env.set_ep_meta({"q": aside, "opened": 0.9, "episode_params": still})
    env.reset()
    assert not env._check_success()
    for _ in range(drawer.n_steps):
        *_, done, info = env.step(STILL)
    assert done
    assert env._check_success()
    assert (info["success"], info["reason"]) == (True, "success")


def test_rewards_are_scaled(drawer):
    rewards = []
    for scale in (1.0, 0.5):
        env = ArticulatedObject("Panda", scene=drawer, seed=1, reward_scale=scale)
        rewards.append(env.step(np.ones(8))[1])
        assert env.reward() == rewards[-1]
    assert rewards[1] == 0.5 * rewards[0] != 0.0


def drawn(env):
    env.reset()
    return env.get_ep_meta()["episode_params"]


def test_seed_decides_everything(drawer):
    one, two, three = (ArticulatedObject("Panda", scene=drawer, seed=s) for s in (4, 4, 5))
    first = drawn(one)
    assert drawn(two) == first
    assert drawn(three) != first
    assert drawn(one) != first
    assert first.keys() == set(COLUMNS)
    one.rng = np.random.default_rng(9)
    two.rng = np.random.default_rng(9)
    assert drawn(one) == drawn(two)


def test_an_episodes_meta_data_begin_it_anew(env):
    first = env.reset()
    meta = json.loads(json.dumps(env.get_ep_meta()))
    env.step(np.ones(8))
    assert np.any(env.reset()["joint_pos"] != first["joint_pos"])
    env.set_ep_meta(meta)
    assert_array_equal(env.reset()["joint_pos"], first["joint_pos"])
    assert env.get_ep_meta() == meta
    env.unset_ep_meta()
    assert np.any(env.reset()["joint_pos"] != first["joint_pos"])


@pytest.mark.parametrize(
    ("noise", "spread"),
    [(None, 0.0), ("default", 0.1), ({"type": "uniform", "magnitude": 0.02}, 0.02)],
)
def test_noise_of_the_start_is_robosuites_to_set(drawer, noise, spread):
    env = ArticulatedObject("Panda", scene=drawer, initialization_noise=noise)
    away = env.engine.state().q[0] - np.asarray(drawer.placement.start_q)
    assert np.abs(away).max() <= spread
    assert np.abs(away).max() > 0.2 * spread or spread == 0.0


@pytest.mark.parametrize(
    ("call", "changes"),
    [
        ("robots=Sawyer", {"robots": "Sawyer"}),
        ("controller_configs=BASIC", {"controller_configs": "BASIC"}),
        ("controller_configs=OSC_POSE", {"controller_configs": {"type": "OSC_POSE"}}),
        ("gripper_types=Robotiq85Gripper", {"gripper_types": "Robotiq85Gripper"}),
        ("renderer=mujoco", {"renderer": "mujoco"}),
        ("camera_depths=True", {"camera_depths": True}),
        ("camera_depths=[False, True]", {"camera_depths": [False, True]}),
        ("camera_heights=[48, 48]", {"camera_heights": [48, 48]}),
        ("camera_widths=0", {"camera_widths": 0}),
        ("camera_widths=text", {"camera_widths": "64"}),
        ("camera_names=frontview", {"camera_names": "frontview"}),
        ("initialization_noise=gaussian", {"initialization_noise": {"type": "gaussian"}}),
        (
            "initialization_noise magnitude=x",
            {"initialization_noise": {"type": "uniform", "magnitude": "x"}},
        ),
        (
            "initialization_noise magnitude=-1",
            {"initialization_noise": {"type": "uniform", "magnitude": -1.0}},
        ),
        ("horizn=3", {"horizn": 3}),
        ("horizon=-1", {"horizon": -1}),
        ("scene=20 Hz, control_freq=10", {"control_freq": 10}),
    ],
)
def test_arguments_that_are_not_accepted_are_answered_in_one_line(
    drawer, call, changes, error_line
):
    plain = {"robots": "Panda", "scene": drawer}
    error_line(f"ArticulatedObject({call})", lambda: ArticulatedObject(**{**plain, **changes}))


def test_use_that_is_not_possible_is_answered_in_one_line(drawer, env, monkeypatch, error_line):
    error_line("ArticulatedObject.step(seven numbers)", lambda: env.step(np.zeros(7)))
    error_line("ArticulatedObject.render() without a viewer", env.render)
    error_line("sim.render(depth=True)", lambda: env.sim.render(depth=True))
    error_line("sim.render(camera_name=side)", lambda: env.sim.render(camera_name="side"))
    error_line("reset_from_xml_string(another model)", lambda: env.reset_from_xml_string("<x/>"))
    error_line("set_xml_processor()", lambda: env.set_xml_processor(str))
    for _ in range(drawer.n_steps):
        env.step(STILL)
    error_line("ArticulatedObject.step() after the end", lambda: env.step(STILL))
    for name in viewer.DISPLAYS:
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(sys, "platform", "linux")
    error_line(
        "ArticulatedObject(has_renderer=True)",
        lambda: ArticulatedObject("Panda", scene=drawer, has_renderer=True),
    )


@pytest.mark.filterwarnings("ignore:.*Box (low|high)'s precision:UserWarning")
def test_robosuites_gym_wrapper_takes_it(env):
    """It casts its float64 bounds and warns of that."""
    wrapped = GymWrapper(env)
    observation, _ = wrapped.reset()
    assert observation.shape == (OBSERVATION.size,)
    observation, _, terminated, truncated, _ = wrapped.step(wrapped.action_space.sample())
    assert np.isfinite(observation).all()
    assert (terminated, truncated) == (False, False)
    assert wrapped.name == "Panda_ArticulatedObject"


def test_robosuites_recorder_keeps_an_episode_that_can_be_begun_again(drawer, env, tmp_path):
    recorder = DataCollectionWrapper(env, str(tmp_path))
    recorder.reset()
    for _ in range(3):
        recorder.step(0.3 * np.ones(8))
    recorder.close()
    (folder,) = tmp_path.iterdir()
    states = np.load(next(folder.glob("*.npz")), allow_pickle=True)["states"]
    other = ArticulatedObject("Panda", scene=drawer)
    other.set_ep_meta(json.loads((folder / "ep_meta.json").read_text()))
    other.reset()
    other.reset_from_xml_string((folder / "model.xml").read_text())
    assert_array_equal(other.sim.get_state().flatten(), states[0])
    for _ in range(3):
        other.step(0.3 * np.ones(8))
    np.testing.assert_allclose(other.sim.get_state().flatten(), states[-1], atol=1e-12)


def test_continued_from_a_snapshot_it_gives_the_same_bits(drawer, env):
    env.reset()
    env.step(np.ones(8))
    kept = env.snapshot()
    first = [env.step(np.ones(8))[0]["policy-state"] for _ in range(4)]
    other = ArticulatedObject("Panda", scene=drawer, seed=8)
    other.restore(kept)
    assert other.timestep == 1
    assert_array_equal([other.step(np.ones(8))[0]["policy-state"] for _ in range(4)], first)
    assert drawn(other) == drawn(env)


def test_closed_twice_and_begun_again(drawer):
    env = ArticulatedObject("Panda", scene=drawer)
    env.close()
    env.close()
    assert env.sim is None
    assert env.reset()["joint_pos"].shape == (7,)
    env.close()


@pytest.mark.render
def test_each_camera_may_have_its_size(drawer):
    env = ArticulatedObject(
        "Panda",
        scene=drawer,
        use_camera_obs=True,
        camera_names=["agentview", "sideview"],
        camera_heights=[48, 48],
        camera_widths=[64, 80],
        camera_depths=[False, False],
        camera_segmentations=[None, None],
    )
    observations = env.reset()
    assert observations["agentview_image"].shape == (48, 64, 3)
    assert observations["sideview_image"].shape == (48, 80, 3)
    env.close()


@pytest.mark.render
def test_cameras_give_pictures_the_way_round_that_robosuite_has_them(drawer):
    names = list(robosuite_sim.CAMERAS)
    env = ArticulatedObject(
        "Panda",
        scene=drawer,
        use_camera_obs=True,
        camera_names=names,
        camera_widths=160,
        camera_heights=120,
    )
    told = env.reset()
    pictures = [told[f"{name}_image"] for name in names]
    assert all(p.shape == (120, 160, 3) for p in pictures)
    assert np.any(pictures[0] != pictures[1])
    scale, T_wo = env.engine.object_pose(0)
    with SceneRenderer(drawer, scale=scale, T_wo=T_wo, size=(160, 120)) as film:
        upright = film.frame(env.sim.data.qpos.copy())
    assert_array_equal(pictures[0], upright[::-1])
    assert_array_equal(env.sim.render(width=160, height=120, camera_name=names[0]), pictures[0])
    env.close()


def test_viewer_opens_with_the_first_step_and_follows(drawer, opened):
    env = ArticulatedObject("Panda", scene=drawer, has_renderer=True)
    assert opened == []
    env.step(np.ones(8))
    env.render()
    (viewer,) = opened
    assert_array_equal(viewer.seen[-1], env.sim.data.qpos)
    env.close()
    assert not viewer.open
