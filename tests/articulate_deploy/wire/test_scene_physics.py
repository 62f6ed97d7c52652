"""Scene of a bundle behind the simulated robot."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from tests.articulate_deploy.wire.fci import ArmClient, address, bump

from articulate.errors import ConfigError, UsageError
from articulate.robot.kinematics import tool_jacobian, tool_pose
from articulate.task.randomization import COLUMNS, EpisodeParams, sample_episode_params
from articulate_deploy.plan import one_size
from articulate_deploy.robots.mujoco import MujocoRobot
from articulate_deploy.robots.robot import action_dict, read_keys
from articulate_deploy.wire import SimulatedArm
from articulate_deploy.wire.physics import T_TOOL_FLANGE, Drive, FingerDrive, critical_damping
from articulate_deploy.wire.scene_physics import ScenePhysics

OPEN = FingerDrive(0.04, 30.0)


@pytest.fixture
def physics(bundle):
    return ScenePhysics(bundle)


def hold(q, torque=None):
    stiffness = np.full(7, 2000.0)
    return Drive(q, np.zeros(7), stiffness, critical_damping(stiffness), torque)


def test_an_arm_that_holds_its_start_stays_there(physics, bundle):
    q = np.array(bundle.manifest.start.q)
    physics.reset_to(q, 0.08)
    for _ in range(200):
        measured = physics.step(hold(q), OPEN, in_motion=False)
    assert_allclose(measured.q, q, atol=1e-6)
    assert_allclose(measured.drive_torque, 0.0, atol=1e-2)
    assert_allclose(measured.T_wt, tool_pose(bundle.manifest.robot, q), atol=1e-6)
    assert_allclose(physics.flange_pose(q), measured.T_wt @ T_TOOL_FLANGE, atol=1e-9)
    assert physics.take_samples() == []


def test_torques_of_the_trained_impedance_move_the_arm_like_the_simulated_robot(physics, bundle):
    robot = bundle.manifest.robot
    q = np.array(bundle.manifest.start.q)
    target = q + 0.02
    physics.reset_to(q, 0.08)
    measured = physics.measure()
    for _ in range(1000):
        torque = robot.stiffness * (target - measured.q) - np.array(robot.damping) * measured.dq
        measured = physics.step(hold(q, torque), OPEN, in_motion=True)
    with MujocoRobot(bundle) as other:
        other.reset_to(q, 0.08)
        for _ in range(40):
            other.send_action(action_dict(target, 0.08))
            other.send_action(action_dict(target, 0.08))
        expected = read_keys(other.get_observation())
    assert_allclose(measured.q, expected, atol=5e-3)
    assert len(physics.take_samples()) == 200


def test_an_external_torque_is_estimated_as_its_wrench(physics, bundle):
    q = np.array(bundle.manifest.start.q)
    physics.reset_to(q, 0.08)
    jacobian = tool_jacobian(bundle.manifest.robot, q)
    force = np.array([5.0, -3.0, 8.0, 0.0, 0.0, 0.0])
    physics.set_external_torque(jacobian.T @ force)  # on the arm
    for _ in range(300):
        measured = physics.step(hold(q), OPEN, in_motion=False)
    assert_allclose(measured.external_wrench[:3], -force[:3], atol=0.3)


def test_the_fingers_open_and_close(physics, bundle):
    q = np.array(bundle.manifest.start.q)
    physics.reset_to(q, 0.08)
    for _ in range(600):
        measured = physics.step(hold(q), FingerDrive(0.0, 30.0), in_motion=False)
    assert measured.width_m < 2e-3


def test_an_episode_is_served_with_its_parameters(exported, bundle):
    params = sample_episode_params(one_size(bundle.manifest), np.random.default_rng(5))
    q = np.array(bundle.manifest.start.q)
    with MujocoRobot(bundle) as robot:
        robot.set_episode_params(params)
        robot.reset_to(q, 0.08)
        expected = robot.object_state()
    with SimulatedArm(exported, address(131), in_process=True) as arm:
        arm.set_episode_params(params)
        arm.reset_to(q, 0.08)
        state = arm.object_state()
        assert_allclose(state.T_wh, expected.T_wh)
        assert_allclose(state.opened, expected.opened)
        with ArmClient(arm.address) as client:
            states, status = client.run(bump())
        assert status == "success"
        assert len(states) == 200
        samples = arm.take_samples()
        assert len(samples) == 39  # the last command ends the motion
        assert samples[0].dt == pytest.approx(bundle.manifest.scene.timestep_s)
        assert arm.take_samples() == []


def test_lockstep_with_a_scene_is_deterministic(exported, bundle):
    def trace():
        with (
            SimulatedArm(exported, address(131), in_process=True) as arm,
            ArmClient(arm.address) as client,
        ):
            states, _ = client.run(bump())
            return np.array([state["q"] for state in states])

    assert np.array_equal(trace(), trace())


def test_what_cannot_be_served_is_rejected(exported, tmp_path):
    with pytest.raises(UsageError, match="no such bundle"):
        SimulatedArm(tmp_path / "none", address(131), in_process=True).start()
    with pytest.raises(ConfigError, match="unknown; choose one of 5, 10"):
        SimulatedArm(None, protocol=7)
    with SimulatedArm(None, address(131), in_process=True) as arm:
        with pytest.raises(UsageError, match="has no object"):
            arm.object_state()
        with pytest.raises(UsageError, match="no episode parameters"):
            arm.set_episode_params(EpisodeParams(np.zeros((1, len(COLUMNS)))))
