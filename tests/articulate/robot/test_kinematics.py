import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from articulate.robot.arm import PANDA
from articulate.robot.kinematics import (
    joint_poses,
    manipulability,
    relative,
    resolve_motion,
    small_twist,
    solve_ik,
    tool_jacobian,
    tool_pose,
    write_self_motion,
)
from articulate.transforms import axis_angle_to_matrix, pose, rotation_angle

LOW, HIGH = PANDA.bounds()


def tool_jacobian_t(q):
    """Jacobian in the axes of the tool."""
    return tool_jacobian(PANDA, q, in_tool=True)


def self_motion(jacobian):
    """Self-motions (N, 7) for Jacobians (N, 6, 7)."""
    out = np.empty((len(jacobian), 7))
    for row, matrix in zip(out, jacobian, strict=True):
        write_self_motion(matrix.copy(), np.zeros(7, dtype=np.int64), row)
    return out


def resolved(jacobian, twist, *, damping=0.02):
    """Joint motions (N, 7) for twists (N, 6)."""
    out = np.empty((len(jacobian), 7))
    for row, matrix, each in zip(out, jacobian, twist, strict=True):
        resolve_motion(matrix, each.copy(), damping, np.empty((6, 6)), row)
    return out


def angles(seed, n=1):
    return np.random.default_rng(seed).uniform(LOW, HIGH, (n, 7))


def test_tool_of_the_stretched_arm_stands_where_the_lengths_say():
    """All joints at 0: links stand upright, the hand points down from joint 7 beside the column."""
    T = tool_pose(PANDA, np.zeros(7))
    down = 0.107 + PANDA.gripper.tcp_z_m
    assert_allclose(T[:3, 3], [0.088, 0.0, 0.333 + 0.316 + 0.384 - down], atol=1e-12)
    assert_allclose(T[:3, 2], [0.0, 0.0, -1.0], atol=1e-12)


def test_home_points_forward_level():
    T = tool_pose(PANDA, PANDA.home)
    assert_allclose(T[:3, 2], [1.0, 0.0, 0.0], atol=0.1)
    assert_allclose(T[1, 3], 0.0, atol=1e-9)


@given(seed=st.integers(0, 2**32 - 1), turn=st.floats(-2, 2))
def test_first_joint_turns_everything_about_the_vertical(seed, turn):
    q = angles(seed)[0]
    moved = q + np.array([turn, 0, 0, 0, 0, 0, 0])
    c, s = np.cos(turn), np.sin(turn)
    T = pose(np.zeros(3), np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]))
    assert_allclose(tool_pose(PANDA, moved), T @ tool_pose(PANDA, q), atol=1e-12)


def test_batches_of_any_shape_give_what_single_poses_give():
    q = angles(1, 6)
    assert_allclose(
        joint_poses(PANDA, q.reshape(2, 3, 7)).reshape(6, 7, 4, 4), joint_poses(PANDA, q)
    )
    assert_allclose(tool_jacobian(PANDA, q)[4], tool_jacobian(PANDA, q[4]))


@given(seed=st.integers(0, 2**32 - 1))
def test_jacobian_is_the_finite_difference_of_the_tool_pose(seed):
    q, h = angles(seed)[0], 1e-6
    jac = tool_jacobian(PANDA, q)
    for j in range(7):
        ahead, back = (tool_pose(PANDA, q + s * h * np.eye(7)[j]) for s in (1, -1))
        linear = (ahead[:3, 3] - back[:3, 3]) / (2 * h)
        spin = (ahead[:3, :3] - back[:3, :3]) / (2 * h) @ tool_pose(PANDA, q)[:3, :3].T
        angular = np.array([spin[2, 1], spin[0, 2], spin[1, 0]])
        assert_allclose(jac[:, j], [*linear, *angular], atol=1e-8)


@settings(max_examples=4, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_inverse_kinematics_finds_poses_of_the_arms_neighbourhood(seed):
    """Goals that the arm has at angles up to 0.4 rad from home are reached, within the limits."""
    rng = np.random.default_rng(seed)
    goals = tool_pose(PANDA, np.asarray(PANDA.home) + rng.uniform(-0.4, 0.4, (4, 7)))
    found = solve_ik(PANDA, goals, PANDA.home, iterations=100)
    assert found.reached.all()
    assert np.all((found.q >= LOW) & (found.q <= HIGH))
    error = relative(tool_pose(PANDA, found.q), goals)
    assert_allclose(np.linalg.norm(error[:, :3, 3], axis=1), found.pos_error, atol=1e-9)
    assert_allclose(rotation_angle(error[:, :3, :3]), found.rot_error, atol=1e-6)


def test_goal_out_of_reach_is_flagged_with_its_distance():
    goals = np.repeat(tool_pose(PANDA, PANDA.home)[None], 2, axis=0)
    goals[1, :3, 3] = [2.0, 0.0, 0.5]
    found = solve_ik(PANDA, goals, PANDA.home)
    assert found.reached.tolist() == [True, False]
    assert found.pos_error[1] > 0.8


def test_goal_that_only_a_longer_arm_could_reach_from_behind_is_flagged():
    goal = tool_pose(PANDA, PANDA.home)
    goal[:3, :3] = goal[:3, :3] @ np.diag([-1.0, 1.0, -1.0])
    goal[0, 3] = 0.8
    found = solve_ik(PANDA, goal[None], PANDA.home)
    assert not found.reached[0]


def test_goal_turned_by_half_a_turn_is_not_reached_at_the_start():
    """There the rotation's antisymmetric part is 0, as where nothing is left to turn."""
    start = tool_pose(PANDA, PANDA.home)
    for axis in np.eye(3):
        goal = start.copy()
        goal[:3, :3] = start[:3, :3] @ axis_angle_to_matrix(axis, np.pi)
        found = solve_ik(PANDA, goal[None], PANDA.home, iterations=1)
        error = relative(tool_pose(PANDA, found.q), goal[None])
        assert found.rot_error[0] == pytest.approx(rotation_angle(error[0, :3, :3]), abs=1e-6)
        assert not found.reached[0]


def test_stretched_elbow_is_singular_and_home_is_not():
    q = np.asarray(PANDA.home)
    straight = np.array([0.0, 0.0, 0.0, 0.0, 0.0, np.pi / 2, 0.0])
    assert manipulability(PANDA, straight) < 0.02
    assert manipulability(PANDA, q) > 0.1


def test_relative_pose_carries_a_point_from_one_frame_to_the_other():
    T_wa, T_wb = tool_pose(PANDA, angles(3, 2))
    assert_allclose(T_wa @ relative(T_wa, T_wb), T_wb, atol=1e-12)


@given(seed=st.integers(0, 2**32 - 1))
def test_jacobian_in_the_tools_axes_is_the_worlds_turned(seed):
    q = angles(seed)
    turn = np.swapaxes(tool_pose(PANDA, q)[:, :3, :3], 1, 2)
    world, tool = tool_jacobian(PANDA, q), tool_jacobian_t(q)
    for rows in (slice(0, 3), slice(3, 6)):
        assert_allclose(tool[:, rows], turn @ world[:, rows], atol=1e-12)


@given(seed=st.integers(0, 2**32 - 1))
def test_self_motion_has_length_one_and_leaves_the_tool_where_it_is(seed):
    q = angles(seed, 4)
    jacobian = tool_jacobian_t(q)
    motion = self_motion(jacobian)
    assert_allclose(np.einsum("nij,nj->ni", jacobian, motion), 0, atol=1e-9)
    regular = manipulability(PANDA, q) > 0.05
    assert_allclose(np.linalg.norm(motion[regular], axis=1), 1.0)


def test_self_motion_keeps_its_sign_along_a_path():
    """From home to a reaching pose in a hundred steps; a sign that flips would give about -1."""
    way = np.array([0.4, 0.5, -0.3, 0.6, 0.3, 0.4, -0.5])
    path = np.asarray(PANDA.home) + np.linspace(0.0, 1.0, 100)[:, None] * way
    motion = self_motion(tool_jacobian_t(path))
    assert np.all(np.einsum("ni,ni->n", motion[1:], motion[:-1]) > 0.99)


@given(seed=st.integers(0, 2**32 - 1))
def test_resolved_motion_moves_the_tool_as_asked_and_has_no_part_that_does_not(seed):
    rng = np.random.default_rng(seed)
    q = np.asarray(PANDA.home) + rng.uniform(-0.3, 0.3, (4, 7))
    jacobian = tool_jacobian_t(q)
    twist = 1e-4 * rng.normal(size=(4, 6))
    step = resolved(jacobian, twist, damping=1e-6)
    assert_allclose(np.einsum("nij,nj->ni", jacobian, step), twist, atol=1e-10)
    seen = small_twist(tool_pose(PANDA, q), tool_pose(PANDA, q + step))
    # What is left over a straight step is of second order in it.
    assert np.all(np.abs(seen - twist).max(axis=1) <= np.square(step).sum(axis=1) + 1e-12)
    assert_allclose(np.einsum("ni,ni->n", step, self_motion(jacobian)), 0, atol=1e-12)


def test_resolved_motion_is_halved_where_the_singular_value_is_the_damping():
    jacobian = np.eye(6, 7)
    jacobian[0, 0] = 0.1
    step = resolved(jacobian[None], np.array([[1.0, 0, 0, 0, 0, 0]]), damping=0.1)
    assert_allclose(step[0, 0], 0.5 / 0.1)


@given(seed=st.integers(0, 2**32 - 1))
def test_small_twist_is_the_translation_and_the_rotation_vector(seed):
    rng = np.random.default_rng(seed)
    move, axis = rng.normal(size=3), rng.normal(size=3)
    turn = 0.01 * axis / np.linalg.norm(axis)
    T = pose(move, axis_angle_to_matrix(turn / 0.01, 0.01))
    assert_allclose(small_twist(np.eye(4), T), [*move, *turn], atol=1e-6)
