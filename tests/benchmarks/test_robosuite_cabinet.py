"""The robosuite environment of the training benchmark runs with the same cabinet."""

import importlib

import numpy as np
import pytest

from articulate.library.procedural.cabinet import embedded_cabinet
from articulate.simulator import mujoco

pytest.importorskip("robosuite", reason="robosuite is not installed; scripts/install does that")


robosuite_cabinet = importlib.import_module("robosuite_cabinet")


@pytest.fixture(scope="module")
def fixture(tmp_path_factory):
    return robosuite_cabinet.Fixture(
        model_path=embedded_cabinet(tmp_path_factory.mktemp("cabinet")),
        joint="drawer_0_slide",
        link="drawer_0",
        handle_pos_l=(-0.044, 0.0, 0.0),
        closed=0.0,
        open=0.282,
    )


@pytest.fixture(scope="module")
def env(fixture):
    env = robosuite_cabinet.make_env(fixture, horizon=15)
    yield env
    env.close()


def test_20_steps_cross_the_end_of_an_episode(env):
    rng = np.random.default_rng(0)
    obs, _ = env.reset(seed=0)
    ends = []
    for _ in range(20):
        obs, reward, terminated, truncated, _ = env.step(rng.uniform(-1, 1, env.action_space.shape))
        assert np.isfinite(obs).all()
        assert 0.0 <= reward <= 1.0
        assert not terminated
        ends.append(truncated)
        if truncated:
            obs, _ = env.reset()
    assert ends == [i == 14 for i in range(20)]
    assert obs.shape == env.observation_space.shape
    assert env.action_space.shape == (8,)


def test_the_environment_has_the_settings_of_the_comparison(env):
    raw = env.env
    assert raw.sim.model.opt.timestep == 0.002
    assert raw.control_freq == 20
    assert raw.hard_reset
    assert not raw.has_renderer
    assert not raw.has_offscreen_renderer
    controller = raw.robots[0].part_controllers["right"]
    assert type(controller).__name__ == "JointPositionController"


def test_the_cabinet_equals_that_of_the_file(env, fixture):
    ours = mujoco.MjModel.from_xml_path(str(fixture.model_path))
    theirs = env.env.sim.model._model
    for name in ("drawer_0_slide", "drawer_1_slide", "drawer_2_slide"):
        a, b = ours.joint(name), theirs.joint(f"cabinet_{name}")
        np.testing.assert_allclose(a.range, b.range)
        np.testing.assert_allclose(a.damping, b.damping)
        np.testing.assert_allclose(a.frictionloss, b.frictionloss)
    a, b = ours.body("drawer_0"), theirs.body("cabinet_drawer_0")
    np.testing.assert_allclose(a.mass, b.mass)
    np.testing.assert_allclose(a.inertia, b.inertia)
    touching = [g for g in range(theirs.ngeom) if theirs.geom(g).name.startswith("cabinet_")]
    assert len(touching) == ours.ngeom


def test_the_reward_grows_as_the_drawer_opens(env):
    raw = env.env
    env.reset()
    rewards = []
    for share in (0.0, 0.4, 0.9):
        raw.sim.data.qpos[raw.joint_qpos_addr] = share * 0.282
        raw.sim.forward()
        rewards.append(raw.reward())
    assert rewards == sorted(rewards)
    assert rewards[-1] == 1.0
