"""The stand-in in another engine: closed forms first, then the same motions as in MuJoCo."""

import dataclasses

import numpy as np
import pybullet
import pytest
from numpy.testing import assert_allclose
from tests.assets import make_box
from tests.runs import make_run

from articulate.errors import BundleError
from articulate.robot.arm import PANDA
from articulate.robot.kinematics import joint_poses, solve_ik, tool_jacobian, tool_pose
from articulate.task.object_placement import handle_in_world
from articulate.task.randomization import COLUMNS, EpisodeParams, nominal_params
from articulate_deploy.bundle import load_bundle
from articulate_deploy.robots.mujoco import MujocoRobot
from articulate_deploy.robots.pybullet import PybulletRobot, armature_on_links, contact_force
from articulate_deploy.robots.robot import GRIPPER_KEY, action_dict, read_keys
from articulate_train.export import export_policy


@pytest.fixture(scope="module")
def robot(bundle):
    with PybulletRobot(bundle) as robot:
        yield robot


@pytest.fixture(scope="module")
def smooth(bundle):
    """The same without dry friction in the arm's joints."""
    arm = dataclasses.replace(bundle.manifest.robot, friction=(0.0,) * 7)
    manifest = dataclasses.replace(bundle.manifest, robot=arm)
    with PybulletRobot(dataclasses.replace(bundle, manifest=manifest)) as robot:
        yield robot


def drawn(**values):
    row = nominal_params()
    for name, value in values.items():
        row.values[:, COLUMNS.index(name)] = value
    return row


def start_of(bundle):
    return np.asarray(bundle.manifest.start.q)


def grip_of(bundle):
    """Angles at which the open hand is around the closed handle."""
    manifest = bundle.manifest
    goal = handle_in_world(
        manifest.object,
        manifest.task.joint,
        T_wo=manifest.placement.T_wo()[None],
        scale=np.ones(1),
        opened=np.zeros(1),
        flip=manifest.placement.flip,
    )
    grip = solve_ik(manifest.robot, goal, start_of(bundle), iterations=80)
    assert grip.reached.all()
    return grip.q[0]


def test_its_panda_has_our_kinematics(robot):
    rng = np.random.default_rng(0)
    arm, joints = robot._bodies.arm, robot._bodies.arm_joints[:7]
    for _ in range(5):
        q = rng.uniform(PANDA.q_min, PANDA.q_max)
        for number, value in zip(joints, q, strict=True):
            robot._call("resetJointState", arm, number, value)
        poses = joint_poses(PANDA, q)
        for k, number in enumerate(joints):
            state = robot._call("getLinkState", arm, number, computeForwardKinematics=True)
            turn = np.array(pybullet.getMatrixFromQuaternion(state[5])).reshape(3, 3)
            assert_allclose(state[4], poses[k, :3, 3], rtol=0, atol=1e-6)
            assert_allclose(turn, poses[k, :3, :3], rtol=0, atol=1e-6)


def test_the_object_stands_where_training_has_it(robot, bundle):
    """Its URDF in PyBullet against our own kinematics, moved, turned and open."""
    row = drawn(x_m=0.02, y_m=-0.01, yaw_rad=0.1, part_open=0.5)
    robot.set_episode_params(row)
    robot.reset_to(start_of(bundle), 0.08)
    manifest = bundle.manifest
    joint = manifest.object.joint(manifest.task.joint)
    T_ol = manifest.object.T_ol(joint.name, joint.closed + 0.5 * joint.span)
    expected = robot._T_wo[0] @ T_ol
    number = robot._bodies.object_joints[joint.name]
    state = robot._call("getLinkState", robot._bodies.object, number, computeForwardKinematics=True)
    assert_allclose(state[4], expected[:3, 3], rtol=0, atol=1e-6)


@pytest.mark.parametrize("order", [(0, 1), (1, 0)])
def test_the_force_of_a_contact_is_the_weight_and_the_pull_on_top_of_it(order):
    """A box of 2 kg on another under sideways gravity: 2 N along, 19.62 N down on the lower."""
    world = pybullet.connect(pybullet.DIRECT)
    call = {"physicsClientId": world}
    pybullet.setGravity(1.0, 0.0, -9.81, **call)
    pybullet.setTimeStep(0.001, **call)
    shape = pybullet.createCollisionShape(pybullet.GEOM_BOX, halfExtents=[0.1] * 3, **call)
    made = {}
    for which in order:
        made[which] = pybullet.createMultiBody(
            2.0 * which, shape, basePosition=[0.0, 0.0, 0.2 * which], **call
        )
        pybullet.changeDynamics(made[which], -1, lateralFriction=1.0, **call)
    for _ in range(300):
        pybullet.stepSimulation(**call)
    total = np.zeros(3)
    for contact in pybullet.getContactPoints(**call):
        total += np.array(contact_force(contact)) * (1.0 if contact[1] == made[0] else -1.0)
    pybullet.disconnect(world)
    assert_allclose(total, [2.0, 0.0, -19.62], rtol=0, atol=0.02)


def test_armature_on_links_adds_up_to_that_of_the_joints():
    q = np.asarray(PANDA.home)
    more = armature_on_links(PANDA, q)
    axes = joint_poses(PANDA, q)[:, :3, 2]
    assert (more >= 0.0).all()
    assert more[6] == PANDA.armature[6]
    for i in range(7):
        seen = sum(more[j] * (axes[i] @ axes[j]) ** 2 for j in range(i, 7))
        assert_allclose(seen, PANDA.armature[i], rtol=0, atol=1e-12)


def test_a_slide_under_a_force_moves_as_the_closed_form_says(robot, bundle):
    """m x'' = F - c x' - f with the drawn mass, damping and dry friction."""
    mass, damping, friction, force, t = 2.5 * 1.2, 5.0 * 2.0, 2.0 * 0.5, 9.0, 0.2
    robot.set_episode_params(drawn(mass=1.2, joint_damping=2.0, joint_friction=0.5))
    robot.reset_to(start_of(bundle), 0.08)
    robot._push(np.array([-force, 0.0, 0.0]) @ robot._T_wo[0, :3, :3].T)
    for _ in range(round(t / robot.physics_step_s)):
        robot._step(start_of(bundle), 0.04)
    position, speed = robot._part()
    last, tau = (force - friction) / damping, mass / damping
    assert_allclose(speed, last * (1.0 - np.exp(-t / tau)), rtol=0.01)
    assert_allclose(position, last * (t - tau * (1.0 - np.exp(-t / tau))), rtol=0.02)


def test_dry_friction_holds_a_slide_below_its_force(robot, bundle):
    robot.set_episode_params(drawn(joint_friction=2.0))
    robot.reset_to(start_of(bundle), 0.08)
    robot._push(np.array([-3.9, 0.0, 0.0]) @ robot._T_wo[0, :3, :3].T)
    for _ in range(200):
        robot._step(start_of(bundle), 0.04)
    assert abs(robot._part()[0]) < 1e-5


def test_gravity_is_carried_without_the_help_of_friction(smooth, bundle):
    q = start_of(bundle) + 0.05
    smooth.set_episode_params(nominal_params())
    smooth.reset_to(q, 0.08)
    for _ in range(10):
        smooth.send_action(action_dict(q, 0.08))
    assert_allclose(read_keys(smooth.get_observation()), q, rtol=0, atol=1e-5)


def test_the_impedance_answers_a_step_as_in_mujoco(robot, bundle):
    """Another arm's inertias behind the same follower, stiffness and damping, nothing touched."""
    q, step = start_of(bundle), bundle.manifest.control.step_rad
    ways = []
    with MujocoRobot(bundle) as other:
        for one in (robot, other):
            one.set_episode_params(nominal_params())
            one.reset_to(q, 0.08)
            way = []
            for tick in range(40):
                target = q + min(tick + 1, 8) * step * np.array([1, -1, 1, 1, -1, 1, 1])
                one.send_action(action_dict(target, 0.08))
                way.append(read_keys(one.get_observation()))
            ways.append(np.array(way))
    assert np.abs(ways[0] - q).max() > 0.15
    assert np.abs(ways[0] - ways[1]).max() < 0.03
    assert np.abs(ways[0][-1] - ways[1][-1]).max() < 0.005


def test_forces_on_the_hand_are_those_that_the_joints_feel(smooth, bundle):
    """At rest J^T W = gravity - torque: the hand holds the handle and presses the drawer shut."""
    q = grip_of(bundle)
    smooth.set_episode_params(drawn(gripper_latency_s=0.1))
    smooth.reset_to(q, 0.08)
    for _ in range(16):
        smooth.send_action(action_dict(q, 0.0))
    held = [sample.wrench for sample in smooth.take_samples()]
    assert_allclose(np.mean(held[-50:], axis=0)[:3], 0.0, rtol=0, atol=1.0)  # the grip cancels
    jacobian = tool_jacobian(bundle.manifest.robot, q)
    approach = tool_pose(bundle.manifest.robot, q)[:3, 2]
    target = q + np.linalg.pinv(jacobian) @ np.append(0.01 * approach, np.zeros(3))
    for _ in range(30):
        smooth.send_action(action_dict(target, 0.0))
    samples = smooth.take_samples()[-100:]
    wrench = np.mean([sample.wrench for sample in samples], axis=0)
    torque = np.mean([sample.torque for sample in samples], axis=0)
    now, _, _ = smooth._read()
    missing = smooth._gravity(smooth._q)[:7] - torque
    assert wrench[:3] @ approach < -2.0  # the drawer pushes back
    felt = tool_jacobian(bundle.manifest.robot, now).T @ wrench
    assert_allclose(felt, missing, rtol=0, atol=0.1 * np.abs(missing).max() + 0.02)


def test_a_hand_that_pulls_opens_the_drawer_as_far_as_in_mujoco(robot, bundle):
    q = grip_of(bundle)
    jacobian = tool_jacobian(bundle.manifest.robot, q)
    approach = tool_pose(bundle.manifest.robot, q)[:3, 2]
    ends = []
    with MujocoRobot(bundle) as other:
        for one in (robot, other):
            one.set_episode_params(drawn(gripper_latency_s=0.1))
            one.reset_to(q, 0.08)
            for tick in range(50):
                way = -0.08 * np.clip((tick - 16) / 24, 0.0, 1.0) * approach
                target = q + np.linalg.pinv(jacobian) @ np.append(way, np.zeros(3))
                one.send_action(action_dict(target, 0.0))
            ends.append((one.object_state().opened[0], one.get_observation()[GRIPPER_KEY]))
    assert ends[1][0] > 0.1
    assert_allclose(ends[0][0], ends[1][0], rtol=0, atol=0.04)
    assert_allclose(ends[0][1], ends[1][1], rtol=0, atol=0.004)  # what it holds is as thick


def test_an_episode_depends_on_nothing_that_was_before_it(robot, bundle):
    def run(seed):
        rng = np.random.default_rng(seed)
        robot.set_episode_params(EpisodeParams(bundle.episode_params.values[seed : seed + 1]))
        q = start_of(bundle)
        robot.reset_to(q, 0.08)
        for _ in range(10):
            q = q + rng.uniform(-0.02, 0.02, 7)
            robot.send_action(action_dict(q, 0.0))
        return robot.get_observation()

    first = run(0)
    run(1)
    assert run(0) == first


def test_a_lid_whose_weight_is_carried_stays_where_it_was_drawn(tmp_path):
    asset = make_box(tmp_path / "object")
    path = make_run(tmp_path / "run", asset, joint="lid_hinge", task="close_lid", episode_s=2.0)
    bundle = load_bundle(export_policy(path, tmp_path / "bundle").path)
    assert bundle.manifest.scene.counterbalanced == ("lid",)
    row = drawn(part_open=bundle.manifest.task.begin[1], joint_friction=0.01)
    with PybulletRobot(bundle) as robot:
        robot.set_episode_params(row)
        robot.reset_to(start_of(bundle), 0.08)
        for _ in range(10):
            robot.send_action(action_dict(start_of(bundle), 0.08))
        assert_allclose(robot.object_state().opened, row["part_open"], rtol=0, atol=1e-3)


def test_what_bullet_prints_of_a_file_that_it_refuses_is_not_heard(bundle, capfd):
    name = bundle.manifest.scene.object_file
    other = dataclasses.replace(bundle, files={**bundle.files, name: b"<robot name='x'></robot>"})
    with pytest.raises(BundleError):
        PybulletRobot(other).connect()
    assert capfd.readouterr() == ("", "")


def test_an_object_that_lacks_a_joint_is_refused(bundle):
    name = bundle.manifest.scene.object_file
    text = bundle.files[name].replace(b"drawer_2_slide", b"drawer_9_slide")
    other = dataclasses.replace(bundle, files={**bundle.files, name: text})
    with pytest.raises(BundleError, match="drawer_2_slide"):
        PybulletRobot(other).connect()
