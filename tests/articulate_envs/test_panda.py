import dataclasses
import importlib.util

import numpy as np
import pytest
from numpy.testing import assert_allclose

from articulate.robot.arm import PANDA
from articulate.robot.kinematics import tool_jacobian, tool_pose
from articulate.simulator import mujoco
from articulate_envs.panda import panda_spec
from articulate_envs.physics import PhysicsConfig
from articulate_envs.scene import apply_physics

LOOSE = dataclasses.replace(PANDA, friction=(0.0,) * 7)
HOME = np.asarray(PANDA.home)


def arm_alone(arm):
    spec = panda_spec(arm, visuals=False)
    apply_physics(spec, PhysicsConfig())
    return spec.compile()


@pytest.fixture(scope="module")
def loose():
    """The arm without dry friction, so that statics have closed forms."""
    return arm_alone(LOOSE)


def at(model, q):
    data = mujoco.MjData(model)
    data.qpos[:7] = data.ctrl[:7] = q
    return data


def test_forward_kinematics_and_jacobian_are_those_of_the_compiled_model(loose):
    rng = np.random.default_rng(0)
    data, site = mujoco.MjData(loose), loose.site("tool").id
    for q in rng.uniform(*PANDA.bounds(), (200, 7)):
        data.qpos[:7] = q
        mujoco.mj_forward(loose, data)
        T = tool_pose(PANDA, q)
        assert_allclose(data.site_xpos[site], T[:3, 3], atol=1e-9)
        assert_allclose(data.site_xmat[site].reshape(3, 3), T[:3, :3], atol=1e-9)
        jac = np.zeros((6, loose.nv))
        mujoco.mj_jacSite(loose, data, jac[:3], jac[3:], site)
        assert_allclose(jac[:, :7], tool_jacobian(PANDA, q), atol=1e-9)


def test_model_has_the_limits_gains_and_inertia_of_the_arm():
    model = arm_alone(PANDA)
    assert_allclose(model.jnt_range[:7], np.stack([PANDA.q_min, PANDA.q_max], axis=1))
    assert_allclose(model.jnt_actfrcrange[:7, 1], PANDA.tau_max)
    assert_allclose(model.actuator_gainprm[:7, 0], PANDA.stiffness)
    assert_allclose(model.actuator_biasprm[:7, 1:3], -np.stack([PANDA.stiffness, PANDA.damping], 1))
    assert_allclose(model.dof_armature[:7], PANDA.armature)
    assert_allclose(model.dof_frictionloss[:7], PANDA.friction)
    assert_allclose(model.dof_damping[:7], 0.0)


def test_gravity_compensation_holds_the_arm_still_in_any_pose(loose):
    rng = np.random.default_rng(1)
    for q in rng.uniform(*PANDA.bounds(0.3), (5, 7)):
        data = at(loose, q)
        for _ in range(200):
            mujoco.mj_step(loose, data)
        assert_allclose(data.qpos[:7], q, atol=1e-6)


def test_torques_that_are_judged_include_gravity(loose):
    data = at(loose, HOME)
    mujoco.mj_forward(loose, data)
    assert_allclose(data.qfrc_actuator[:7], data.qfrc_bias[:7], atol=1e-9)
    assert np.abs(data.qfrc_actuator[1]) > 1.0


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_torque_limit_holds_for_spring_and_gravity_together(loose, sign):
    """A set point far away asks for more than the table: the sum is cut, not the spring alone."""
    data = at(loose, HOME)
    data.ctrl[:7] = HOME + sign * 100.0
    mujoco.mj_forward(loose, data)
    assert_allclose(data.qfrc_actuator[:7], sign * np.asarray(PANDA.tau_max))


@pytest.mark.parametrize("joint", range(7))
def test_deflection_under_a_torque_is_torque_over_stiffness(loose, joint):
    torque = 0.05 * PANDA.stiffness[joint]
    data = at(loose, HOME)
    data.qfrc_applied[joint] = torque
    for _ in range(2000):
        mujoco.mj_step(loose, data)
    assert_allclose(data.qpos[:7] - HOME, 0.05 * np.eye(7)[joint], atol=2e-4)


def test_with_dry_friction_the_deflection_is_the_same_to_within_that_friction():
    model, joint = arm_alone(PANDA), 1
    torque = 0.1 * PANDA.stiffness[joint]
    data = at(model, HOME)
    data.qfrc_applied[joint] = torque
    for _ in range(600):
        mujoco.mj_step(model, data)
    error = data.qpos[joint] - HOME[joint] - 0.1
    assert abs(error) <= 1.2 * PANDA.friction[joint] / PANDA.stiffness[joint]


def test_fingers_hang_where_franka_mounts_them_and_the_tool_is_between_their_pads(loose):
    """hand.xacro of franka_description: joint at z = 0.0584 m, tips 0.0538 m beyond it."""
    data = at(loose, HOME)
    mujoco.mj_forward(loose, data)
    gripper, tool = loose.body("right_hand").id, loose.site("tool").id
    approach = data.xmat[gripper].reshape(3, 3)[:, 2]
    for name in ("leftfinger", "rightfinger"):
        way = data.xpos[loose.body(name).id] - data.xpos[gripper]
        assert_allclose(way @ approach, 0.0584, atol=1e-9)
    tips = []
    for name in ("finger1_pad_collision", "finger2_pad_collision"):
        geom = loose.geom(name).id
        middle = data.geom_xpos[geom] - data.site_xpos[tool]
        assert abs(middle @ approach) < 1e-3
    for name in ("finger1_collision", "finger2_collision"):
        mesh = int(loose.geom_dataid[loose.geom(name).id])
        first, count = int(loose.mesh_vertadr[mesh]), int(loose.mesh_vertnum[mesh])
        geom = loose.geom(name).id
        points = loose.mesh_vert[first : first + count] @ data.geom_xmat[geom].reshape(3, 3).T
        tips.append(((points + data.geom_xpos[geom] - data.xpos[gripper]) @ approach).max())
    assert_allclose(tips, 0.0584 + 0.0538, atol=2e-4)


def test_fingers_move_together_to_what_they_are_told(loose):
    data = at(loose, HOME)
    finger = loose.joint("finger_joint1").qposadr[0]
    act = loose.actuator("finger_joint1").id
    for width in (0.08, 0.03, 0.0):
        data.ctrl[act : act + 2] = width / 2, -width / 2
        for _ in range(300):
            mujoco.mj_step(loose, data)
        left, right = data.qpos[finger : finger + 2]
        assert left - right == pytest.approx(width, abs=2e-3)
        assert left == pytest.approx(-right, abs=1e-3)


@pytest.mark.parametrize("width", [0.0, 0.02, 0.041])
def test_closed_fingers_press_with_their_whole_force_whatever_they_hold(loose, width):
    """The fingers are held apart; a servo to the closed place alone would press with 0 to 41 N."""
    data = at(loose, HOME)
    finger = loose.joint("finger_joint1").qposadr[0]
    act = loose.actuator("finger_joint1").id
    closed, _ = PANDA.gripper.finger_m
    data.qpos[finger : finger + 2] = width / 2, -width / 2
    data.ctrl[act : act + 2] = closed, -closed
    mujoco.mj_forward(loose, data)
    assert np.abs(data.actuator_force[act : act + 2]) == pytest.approx(PANDA.gripper.force_n)


def test_arm_never_meets_itself(loose):
    rng = np.random.default_rng(2)
    data = mujoco.MjData(loose)
    for q in rng.uniform(*PANDA.bounds(), (100, 7)):
        data.qpos[:7] = q
        mujoco.mj_forward(loose, data)
        assert data.ncon == 0


def test_without_robosuite_one_line_says_how_to_install_it(monkeypatch, error_line):
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    error_line("panda_spec() without robosuite", lambda: panda_spec(PANDA, visuals=False))
