"""What every stand-in keeps of the protocol, whatever engine it runs on."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from articulate.errors import ConfigError, MissingError
from articulate.task.randomization import COLUMNS, nominal_params
from articulate_deploy.robots import ROBOTS, robot_named
from articulate_deploy.robots.robot import (
    ACTION_FEATURES,
    FORCE_KEYS,
    GRIPPER_KEY,
    OBSERVATION_FEATURES,
    NotConnectedError,
    action_dict,
    read_keys,
)


@pytest.fixture(scope="module", params=ROBOTS)
def connected(request, bundle):
    with robot_named(request.param, bundle) as robot:
        yield robot


@pytest.fixture
def robot(connected, bundle):
    """A stand-in at rest at the bundle's start, nothing drawn."""
    connected.set_episode_params(nominal_params())
    connected.reset_to(np.asarray(bundle.manifest.start.q), 0.08)
    return connected


@pytest.mark.parametrize("name", ROBOTS)
def test_features_are_readable_before_connecting(bundle, name):
    robot = robot_named(name, bundle)
    assert robot.name == name
    assert not robot.is_connected
    assert set(robot.observation_features) == set(OBSERVATION_FEATURES)
    assert set(robot.action_features) == set(ACTION_FEATURES)
    assert "joint_7.pos" in robot.action_features
    assert robot.observation_features["gripper.pos"] is float


@pytest.mark.parametrize("name", ROBOTS)
def test_a_robot_that_is_not_connected_says_so(bundle, name):
    robot = robot_named(name, bundle)
    with pytest.raises(ConnectionError):
        robot.get_observation()
    with robot as connected:
        assert connected.is_connected
        assert set(robot.get_observation()) == set(robot.observation_features)
    assert not robot.is_connected
    with pytest.raises(NotConnectedError, match="connect"):
        robot.send_action({})


def test_a_stopped_robot_refuses_actions_until_it_is_reset(robot, bundle):
    q = np.asarray(bundle.manifest.start.q)
    robot.stop()
    with pytest.raises(NotConnectedError, match="stopped"):
        robot.send_action(action_dict(q, 0.08))
    robot.reset_to(q, 0.08)
    robot.send_action(action_dict(q, 0.08))


def test_a_robot_at_rest_is_where_it_was_brought(robot, bundle):
    seen = robot.get_observation()
    assert_allclose(read_keys(seen), bundle.manifest.start.q, rtol=0, atol=1e-12)
    assert_allclose(seen[GRIPPER_KEY], 0.08, rtol=0, atol=1e-12)
    assert_allclose(robot.object_state().opened, 0.0, rtol=0, atol=1e-12)
    assert [seen[key] for key in FORCE_KEYS] == [0.0, 0.0, 0.0]


def test_a_stand_in_feels_with_the_errors_that_were_drawn(robot, bundle):
    drawn, q = nominal_params(), np.asarray(bundle.manifest.start.q)
    drawn["force_bias"][:] = (1.0, -2.0, 3.0)
    robot.set_episode_params(drawn)
    robot.reset_to(q, 0.08)
    assert [robot.get_observation()[key] for key in FORCE_KEYS] == [1.0, -2.0, 3.0]
    robot.set_episode_params(drawn, force_noise_n=0.5, noise=np.random.default_rng(0))
    robot.reset_to(q, 0.08)
    seen = np.array([read_keys(robot.get_observation(), FORCE_KEYS) for _ in range(400)])
    assert_allclose(seen.mean(axis=0), (1.0, -2.0, 3.0), rtol=0, atol=0.1)
    assert_allclose(seen.std(axis=0), 0.5, rtol=0.15)


def test_an_arm_that_is_told_nothing_new_stays_where_it_is(robot, bundle):
    q = np.asarray(bundle.manifest.start.q)
    for _ in range(10):
        robot.send_action(action_dict(q, 0.08))
    assert_allclose(read_keys(robot.get_observation()), q, rtol=0, atol=1e-4)
    samples = robot.take_samples()
    assert_allclose(sum(sample.dt for sample in samples), 0.5, rtol=0, atol=1e-9)
    assert not any(sample.touch or sample.wrench.any() for sample in samples)


def test_what_was_really_sent_comes_back(robot, bundle):
    manifest = bundle.manifest
    q = np.asarray(manifest.start.q) + 0.01
    sent = robot.send_action(action_dict(q, 0.05))
    assert_allclose(read_keys(sent), q, rtol=0, atol=1e-12)
    assert sent[GRIPPER_KEY] == manifest.robot.gripper.max_width_m


def test_the_hand_closes_after_its_latency_at_its_speed(robot, bundle):
    """A latency of 0.3 s, then both fingers at the hand's speed, less what they lag."""
    q, gripper = np.asarray(bundle.manifest.start.q), bundle.manifest.robot.gripper
    shut_s = gripper.max_width_m / 2.0 / gripper.finger_speed_m_s
    widths = []
    for _ in range(6 + round(shut_s / 0.05) + 6):
        robot.send_action(action_dict(q, 0.0))
        widths.append(robot.get_observation()[GRIPPER_KEY])
    assert_allclose(widths[5], 0.08, rtol=0, atol=1e-3)
    half = widths[6 + round(shut_s / 0.1) - 1]
    assert 0.04 - 0.01 < half < 0.04 + 0.015
    assert abs(widths[-1]) < 2e-3


def test_unknown_keys_of_an_action_are_refused(robot, bundle, error_line):
    action = action_dict(np.asarray(bundle.manifest.start.q), 0.08)
    action["joint_8.pos"] = 0.0
    error_line("send_action: joint_8", lambda: robot.send_action(action))


def test_another_size_of_the_object_is_refused(robot, error_line):
    drawn = nominal_params()
    drawn.values[:, COLUMNS.index("scale")] = 1.1
    error_line("set_episode_params: scale 1.1", lambda: robot.set_episode_params(drawn))


@pytest.mark.parametrize("name", ["panda", "fr3", "mujco", "kuka"])
def test_robots_that_are_not_there_are_named_in_one_line(bundle, name, error_line):
    error_line(f"robot_named({name})", lambda: robot_named(name, bundle))


def test_a_robot_without_a_name_is_refused(bundle):
    with pytest.raises(ConfigError):
        robot_named("", bundle)


def test_a_machine_without_pybullet_is_told_what_to_install(bundle, monkeypatch, error_line):
    monkeypatch.setitem(__import__("sys").modules, "articulate_deploy.robots.pybullet", None)

    def absent(name):
        raise ModuleNotFoundError("No module named 'pybullet'", name="pybullet")

    monkeypatch.setattr("articulate_deploy.robots.importlib.import_module", absent)
    error_line("robot_named(pybullet)  # not installed", lambda: robot_named("pybullet", bundle))
    with pytest.raises(MissingError):
        robot_named("pybullet", bundle)
