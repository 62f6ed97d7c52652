import copy

import numpy as np
import pytest
from numpy.testing import assert_allclose
from tests.scenes import DRAWS, rows_of

from articulate.robot.arm import PANDA
from articulate.robot.contact import contact_wrench
from articulate.robot.kinematics import solve_ik
from articulate.simulator import mujoco
from articulate.transforms import pose
from articulate_envs.config import InitialStatesConfig
from articulate_envs.initial_states import precompute_states
from articulate_envs.panda import GRIPPER_BODY
from articulate_envs.scene import PREFIX
from articulate_envs.threaded_engine import ThreadEngine


def in_hand(model, body):
    """Whether ``body`` is the hand or hangs below it."""
    while body:
        if model.body(body).name == GRIPPER_BODY:
            return True
        body = model.body_parentid[body]
    return False


def in_object(model, body):
    return model.body(body).name.startswith(PREFIX)


def contacts(model, data):
    """Per contact: robot's body, other body, force and moment about the tool on the robot."""
    tool = data.site("tool").xpos
    for k in range(data.ncon):
        contact, raw = data.contact[k], np.zeros(6)
        mujoco.mj_contactForce(model, data, k, raw)
        first, second = (int(model.geom_bodyid[g]) for g in contact.geom)
        sign = 1.0
        if in_object(model, first) or first == 0:
            first, second, sign = second, first, -1.0
        # The frame points from the first geom to the second; the force acts on the second.
        frame = contact.frame.reshape(3, 3)
        force, torque = -sign * frame.T @ raw[:3], -sign * frame.T @ raw[3:]
        yield first, second, force, torque + np.cross(contact.pos - tool, force)


def summed(model, data):
    """The hand's net wrench and whether the arm touches the object, from MuJoCo's contacts."""
    wrench, touch = np.zeros(6), False
    for robot, other, force, moment in contacts(model, data):
        if in_hand(model, robot):
            wrench += [*force, *moment]
        elif in_object(model, other) and not in_object(model, robot) and robot != 0:
            touch = True
    return wrench, touch


def reported(scene, data):
    wrench = np.empty((1, 6))
    gripper, floor, robot = scene.at.sensors
    tool_w = data.site("tool").xpos
    contact = contact_wrench(data.sensordata, gripper, floor, robot, tool_w, wrench[0])
    touch = np.array([contact])
    return wrench[0], bool(touch[0])


@pytest.mark.parametrize("name", ["drawer", "door"])
def test_sensors_report_the_sum_of_mujocos_contact_forces(name, request):
    """Hands closed on handles, pulled about at random: the net wrench of all contacts."""
    scene = request.getfixturevalue(name)
    rng, n = np.random.default_rng(0), 6
    config = InitialStatesConfig(n_precomputed=40, grip_share=1.0)
    bank = precompute_states(scene, config, DRAWS, rng)
    engine = ThreadEngine(scene, n)
    engine.reset(np.arange(n), rows_of(bank, np.arange(n)))
    largest = 0.0
    pull = rng.choice([-1.0, 1.0], (n, 8))
    pull[:, 7] = 1.0  # hands stay closed
    for _ in range(10):
        engine.step(pull)
        for i in range(n):
            model, data = engine.physics_state(i)
            data = copy.copy(data)
            mujoco.mj_forward(model, data)
            expected, touch = summed(model, data)
            wrench, says = reported(scene, data)
            assert_allclose(wrench, expected, atol=1e-9 * (1 + np.abs(expected).max()))
            assert says == touch
            largest = max(largest, float(np.linalg.norm(expected[:3])))
    assert largest > 5.0


def test_force_on_the_hand_from_a_part_that_leans_on_it_is_what_pushes_the_part(drawer):
    """Closed form: a drawer pushed along its slide by 10 N against a blocked hand.

    The hand is held by a rigid arm; at rest it feels 10 N along -x, dry friction aside.
    """
    model = copy.copy(drawer.nominal)
    model.dof_frictionloss[list(drawer.at.object_v)] = 0.0
    model.dof_damping[:7] = 1e5
    data = mujoco.MjData(model)
    T_wh = drawer.placement.T_wo() @ drawer.asset.T_oh(drawer.task.joint, 0.10)
    before = pose(np.array([-0.025, 0.0, 0.0])) @ T_wh
    found = solve_ik(PANDA, before[None], np.asarray(drawer.placement.start_q))
    data.qpos[:7] = data.ctrl[:7] = found.q[0]
    data.qpos[drawer.at.part_q] = 0.06
    data.qfrc_applied[drawer.at.part_v] = 10.0
    for _ in range(600):
        mujoco.mj_step(model, data)
    wrench, touch = reported(drawer, data)
    assert abs(data.qvel[drawer.at.part_v]) < 1e-4
    assert wrench[0] == pytest.approx(-10.0, abs=0.1)
    assert not touch


def test_hand_that_rests_on_the_floor_feels_it_and_touches_no_object(drawer):
    model = drawer.nominal
    data = mujoco.MjData(model)
    down = pose(np.array([0.45, -0.3, -0.003]), np.diag([1.0, -1.0, -1.0]))
    start = np.array([-0.6, 0.3, 0.0, -2.4, 0.0, 2.7, 0.8])
    found = solve_ik(PANDA, down[None], start, iterations=200)
    assert found.pos_error[0] < 2e-3
    data.qpos[:7] = data.ctrl[:7] = found.q[0]
    data.qpos[drawer.at.finger_q : drawer.at.finger_q + 2] = 0.04, -0.04
    mujoco.mj_forward(model, data)
    wrench, touch = reported(drawer, data)
    assert wrench[2] > 1.0
    assert_allclose(wrench, summed(model, data)[0], atol=1e-6)
    assert not touch


def test_arm_that_touches_the_object_is_told_from_a_hand_that_does(drawer):
    model, rng = drawer.nominal, np.random.default_rng(3)
    data = mujoco.MjData(model)
    seen = set()
    for q in rng.uniform(*PANDA.bounds(), (400, 7)):
        mujoco.mj_resetData(model, data)
        data.qpos[:7] = q
        mujoco.mj_forward(model, data)
        expected = summed(model, data)[1]
        gripper = any(
            in_hand(model, c[0]) and in_object(model, c[1]) for c in contacts(model, data)
        )
        assert reported(drawer, data)[1] == expected
        seen.add((expected, gripper))
    assert seen == {(False, False), (False, True), (True, False), (True, True)}


def test_ticks_and_steps_fill_the_episode(drawer):
    assert drawer.n_steps * drawer.control.step_s == pytest.approx(drawer.task.episode_s)
    assert drawer.substeps * drawer.physics.timestep_s == pytest.approx(drawer.control.step_s)


def test_addresses_name_what_they_point_to(drawer):
    model, at = drawer.nominal, drawer.at
    assert model.joint(PREFIX + drawer.task.joint).qposadr[0] == at.part_q
    assert model.body(at.part_body).name == PREFIX + "drawer_2"
    assert {model.body(b).name for b in at.moving_bodies} == {
        f"{PREFIX}drawer_{k}" for k in range(3)
    }
    assert [model.dof_jntid[v] for v in at.object_v] == [
        model.joint(f"{PREFIX}drawer_{k}_slide").id for k in range(3)
    ]
    assert len(at.finger_geoms) >= 2
    assert all(in_hand(model, model.geom_bodyid[g]) for g in at.finger_geoms)


def test_each_size_has_its_lengths_masses_and_ranges(drawer):
    nominal = drawer.nominal
    part = drawer.at.part_body
    for scale, model in zip(drawer.scales, drawer.models, strict=True):
        assert_allclose(model.body_pos[part], scale * nominal.body_pos[part])
        assert_allclose(model.body_mass[part], scale**3 * nominal.body_mass[part])
        assert_allclose(model.body_inertia[part], scale**5 * nominal.body_inertia[part])
        own = [g for g in range(model.ngeom) if model.geom_bodyid[g] == part]
        assert_allclose(model.geom_size[own], scale * nominal.geom_size[own])
        slide = model.joint(PREFIX + drawer.task.joint).id
        assert_allclose(model.jnt_range[slide], scale * nominal.jnt_range[slide])


def test_range_of_a_hinge_does_not_change_with_size(door):
    hinge = door.nominal.joint(PREFIX + door.task.joint).id
    for model in door.models:
        assert_allclose(model.jnt_range[hinge], door.nominal.jnt_range[hinge])


def test_nominal_model_is_the_one_of_size_one(drawer):
    assert drawer.nominal is drawer.models[drawer.scales.index(1.0)]


def test_closed_object_touches_nothing(drawer, door):
    for scene in (drawer, door):
        data = mujoco.MjData(scene.nominal)
        data.qpos[:7] = scene.placement.start_q
        mujoco.mj_forward(scene.nominal, data)
        assert data.ncon == 0
