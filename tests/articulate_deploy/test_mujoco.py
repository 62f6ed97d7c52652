"""One plant: the stand-in does what the batched engine does."""

import dataclasses

import numpy as np
import pytest
from numpy.testing import assert_allclose

from articulate.errors import BundleError
from articulate.robot.kinematics import solve_ik, tool_pose
from articulate.task.episode_monitor import COLUMN, monitor_params, monitor_sample, new_monitor
from articulate.task.object_placement import handle_in_world
from articulate.task.randomization import COLUMNS, EpisodeParams, sample_episode_params
from articulate_deploy.plan import one_size
from articulate_deploy.policy_control import PolicyController
from articulate_deploy.robots.mujoco import MujocoRobot
from articulate_deploy.robots.robot import (
    FORCE_KEYS,
    GRIPPER_KEY,
    SPEED_KEYS,
    action_dict,
    read_keys,
)
from articulate_envs.engine import Start
from articulate_envs.initial_states import home_start
from articulate_envs.threaded_engine import ThreadEngine

TICKS = 100


@pytest.fixture
def robot(bundle):
    with MujocoRobot(bundle) as robot:
        yield robot


@pytest.fixture(scope="module")
def engine(run):
    engine = ThreadEngine(run.scene((1.0,)), 1)
    yield engine
    engine.close()


def compare(engine, robot, manifest, start, actions, atol):
    """Run both on the same start and actions and compare all that is observed and judged."""
    engine.reset(np.array([0]), start)
    robot.set_episode_params(start.params)
    robot.reset_to(start.q[0], float(start.width[0]))
    delay = int(start.params["delay_steps"][0])
    plant = PolicyController(manifest, start.q[0], delay_steps=delay)
    rows, torque, bias = new_monitor(1).samples, np.zeros(7), start.params["force_bias"][0]
    for tick, action in enumerate(actions):
        state = engine.step(action[None])
        seen = robot.get_observation()
        felt = read_keys(seen, FORCE_KEYS)
        wish, width = plant.step(action, q=read_keys(seen), width_m=seen[GRIPPER_KEY], force=felt)
        plant.set_sent(read_keys(robot.send_action(action_dict(wish, width))))
        for sample in robot.take_samples():
            monitor_sample(
                rows[0],
                sample.dq,
                sample.torque,
                torque,
                sample.wrench,
                sample.touch,
                monitor_params(manifest.robot, manifest.task.limits, sample.dt),
            )
        seen, truth = robot.get_observation(), robot.object_state()
        for name, ours, theirs in (
            ("q", read_keys(seen), state.q[0]),
            ("dq", read_keys(seen, SPEED_KEYS), state.dq[0]),
            ("target", plant.target, state.target[0]),
            ("width", seen[GRIPPER_KEY], state.gripper_width[0]),
            ("force", read_keys(seen, FORCE_KEYS) - bias, rows[0, :3]),
            ("handle", truth.T_wh, state.T_wh),
            ("opened", truth.opened, state.opened),
            ("speed", truth.speed, state.speed),
            ("smooth", plant.gripper.smooth, state.gripper.smooth),
            ("wish", plant.gripper.command, state.gripper.command),
            ("since", plant.gripper.since_s, state.gripper.since_s),
        ):
            assert_allclose(ours, theirs, rtol=0, atol=atol, err_msg=f"{name} at tick {tick}")
        force = slice(COLUMN["fx"], COLUMN["torque_rate"])
        assert_allclose(rows[:, force], state.samples[:, force], rtol=1e-4, atol=1e-3)
        assert rows[0, COLUMN["code"]] == state.samples[0, COLUMN["code"]]
    return state


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_the_stand_in_is_the_plant_of_training(engine, robot, bundle, seed):
    manifest = bundle.manifest
    rng = np.random.default_rng(seed)
    drawn = sample_episode_params(one_size(manifest), rng)
    actions = rng.uniform(-1.0, 1.0, (TICKS, 8))
    actions[:, 7] = np.sign(np.sin(np.arange(TICKS) / 8.0))  # the hand opens and closes
    compare(engine, robot, manifest, home_start(engine.scene, drawn), actions, atol=1e-6)


def test_the_stand_in_is_the_plant_of_training_while_it_pulls(engine, robot, bundle):
    """The hand closes on the handle and draws it back: contact, friction, force."""
    manifest = bundle.manifest
    values = sample_episode_params(one_size(manifest), np.random.default_rng(3)).values
    for name in ("x_m", "y_m", "yaw_rad"):
        values[:, COLUMNS.index(name)] = 0.0
    values[:, COLUMNS.index("gripper_latency_s")] = 0.1
    values[:, COLUMNS.index("delay_steps")] = 1.0
    goal = handle_in_world(
        manifest.object,
        manifest.task.joint,
        T_wo=manifest.placement.T_wo()[None],
        scale=np.ones(1),
        opened=np.zeros(1),
        flip=manifest.placement.flip,
    )
    grip = solve_ik(manifest.robot, goal, np.asarray(manifest.start.q), iterations=80)
    assert grip.reached.all()
    actions = np.zeros((60, 8))
    actions[:, 7] = 1.0
    actions[25:55, 2] = -0.12 / (30 * manifest.control.move_m)
    start = Start(
        params=EpisodeParams(values),
        q=grip.q,
        opened=np.zeros(1),
        width=np.full(1, 0.08),
        closing=-np.ones(1),
        home=np.zeros(1, dtype=bool),
    )
    state = compare(engine, robot, manifest, start, actions, atol=1e-6)
    assert state.opened[0] > 0.1  # it was pulled


def test_the_tool_of_the_scene_is_the_tool_of_the_kinematics(robot, bundle):
    q = np.asarray(bundle.manifest.start.q)
    robot.reset_to(q, 0.08)
    robot.send_action(action_dict(q, 0.08))
    seen = read_keys(robot.get_observation())
    site = robot._data.site_xpos[robot._at.tool]
    assert_allclose(site, tool_pose(bundle.manifest.robot, seen)[:3, 3], rtol=0, atol=1e-4)


def test_a_scene_without_what_the_manifest_names_is_refused(bundle):
    scene = dataclasses.replace(bundle.manifest.scene, tool_site="tip")
    manifest = dataclasses.replace(bundle.manifest, scene=scene)
    with pytest.raises(BundleError, match="tip"):
        MujocoRobot(dataclasses.replace(bundle, manifest=manifest)).connect()


@pytest.mark.parametrize(
    ("given", "other", "told"),
    [
        ('timestep="0.005"', 'timestep="0.001"', "time step"),
        ('iterations="30"', 'iterations="2000000000"', "iterations is 2000000000"),
    ],
)
def test_a_scene_that_is_stepped_otherwise_than_the_manifest_says_is_refused(
    bundle, given, other, told
):
    name = "scene/scene.xml"
    text = bundle.files[name].decode()
    assert f" {given}" in text
    changed = text.replace(f" {given}", f" {other}").encode()
    with pytest.raises(BundleError, match=told):
        MujocoRobot(dataclasses.replace(bundle, files={**bundle.files, name: changed})).connect()


@pytest.mark.parametrize("name", ["stiffness", "damping"])
def test_an_arm_of_other_gains_than_the_manifests_is_refused(bundle, name):
    robot = bundle.manifest.robot
    other = tuple(1.01 * value for value in getattr(robot, name))
    manifest = dataclasses.replace(
        bundle.manifest, robot=dataclasses.replace(robot, **{name: other})
    )
    with pytest.raises(BundleError, match=f"{name} of its arm"):
        MujocoRobot(dataclasses.replace(bundle, manifest=manifest)).connect()


def test_sensors_that_measure_something_else_are_refused(bundle):
    scene = dataclasses.replace(bundle.manifest.scene, sensors=bundle.manifest.scene.sensors[::-1])
    manifest = dataclasses.replace(bundle.manifest, scene=scene)
    with pytest.raises(BundleError, match="1 numbers, not 10"):
        MujocoRobot(dataclasses.replace(bundle, manifest=manifest)).connect()
