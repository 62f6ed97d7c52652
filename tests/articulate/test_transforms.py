import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from articulate import transforms as tf

ANGLES = st.floats(-3.14, 3.14)
PITCHES = st.floats(-np.pi / 2, np.pi / 2)
UNITS = st.tuples(*[st.floats(-1.0, 1.0)] * 3).filter(lambda v: np.linalg.norm(v) > 1e-3)
QUATS = st.tuples(*[st.floats(-1.0, 1.0)] * 4).filter(lambda q: np.linalg.norm(q) > 1e-3)
POINTS = st.tuples(*[st.floats(-10.0, 10.0)] * 3)


@given(QUATS)
def test_matrix_of_quaternion_is_a_rotation_and_comes_back(quat):
    matrix = tf.quat_to_matrix(quat)
    assert_allclose(matrix @ matrix.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(matrix) == pytest.approx(1.0)
    back = tf.matrix_to_quat(matrix)
    unit = tf.normalised(quat)
    assert back[0] >= 0.0
    assert abs(back @ unit) == pytest.approx(1.0, abs=1e-12)


@given(ANGLES, PITCHES, ANGLES)
def test_rpy_of_matrix_gives_the_same_matrix(roll, pitch, yaw):
    matrix = tf.rpy_to_matrix([roll, pitch, yaw])
    assert_allclose(tf.rpy_to_matrix(tf.matrix_to_rpy(matrix)), matrix, atol=1e-11)


@given(ANGLES, st.floats(-1.5, 1.5), ANGLES)
def test_rpy_comes_back_away_from_gimbal_lock(roll, pitch, yaw):
    rpy = np.array([roll, pitch, yaw])
    assert_allclose(tf.matrix_to_rpy(tf.rpy_to_matrix(rpy)), rpy, atol=1e-9)


@pytest.mark.parametrize("sign", [-1.0, 1.0])
@pytest.mark.parametrize("off", [0.0, 1e-14, 1e-12, 1e-10, 1e-9, 1e-8, 1e-5])
def test_rpy_at_and_near_gimbal_lock_gives_the_same_matrix(sign, off):
    rng = np.random.default_rng(0)
    rpy = rng.uniform(-3, 3, (100, 3))
    rpy[:, 1] = sign * (np.pi / 2 - off)
    matrix = tf.rpy_to_matrix(rpy)
    assert_allclose(tf.rpy_to_matrix(tf.matrix_to_rpy(matrix)), matrix, atol=1e-11)


def test_yaw_is_zero_at_gimbal_lock():
    matrix = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
    assert_allclose(tf.matrix_to_rpy(matrix), [0.0, np.pi / 2, 0.0], atol=1e-15)


def test_yaw_pitch_and_roll_turn_about_fixed_axes_in_urdf_order():
    matrix = tf.rpy_to_matrix([np.pi / 2, 0.0, np.pi / 2])
    assert_allclose(matrix @ [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], atol=1e-15)
    assert_allclose(matrix @ [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], atol=1e-15)


@pytest.mark.parametrize("axis", np.eye(3))
def test_half_turns_have_stable_quaternions(axis):
    matrix = tf.axis_angle_to_matrix(axis, np.pi)
    quat = tf.matrix_to_quat(matrix)
    assert_allclose(np.abs(quat), [0.0, *axis], atol=1e-12)
    assert tf.rotation_angle(matrix) == pytest.approx(np.pi)


@given(UNITS, st.floats(0.0, np.pi))
def test_rotation_angle_is_the_angle_of_the_rotation(axis, angle):
    matrix = tf.axis_angle_to_matrix(tf.normalised(axis), angle)
    assert tf.rotation_angle(matrix) == pytest.approx(angle, abs=1e-7)


@given(POINTS, QUATS, POINTS)
def test_inverse_undoes_a_pose(pos, quat, point):
    T_ab = tf.pose(pos, tf.quat_to_matrix(quat))
    assert_allclose(tf.inverse(T_ab) @ T_ab, np.eye(4), atol=1e-12)
    assert_allclose(tf.apply(tf.inverse(T_ab), tf.apply(T_ab, point)), point, atol=1e-11)


def test_batches_of_poses_agree_with_single_ones():
    rng = np.random.default_rng(1)
    quats, positions, points = (
        rng.normal(size=(5, 4)),
        rng.normal(size=(5, 3)),
        rng.normal(size=(5, 3)),
    )
    T = tf.pose(positions, tf.quat_to_matrix(quats))
    moved = tf.apply(T, points)
    for i in range(5):
        single = tf.pose(positions[i], tf.quat_to_matrix(quats[i]))
        assert_allclose(moved[i], (single @ [*points[i], 1.0])[:3], atol=1e-14)
        assert_allclose(tf.inverse(T)[i], tf.inverse(single), atol=0)


def test_one_pose_moves_many_points():
    points = np.arange(12.0).reshape(4, 3)
    assert_allclose(tf.apply(tf.pose([1.0, 2.0, 3.0]), points), points + np.array([1.0, 2.0, 3.0]))


@pytest.mark.parametrize("angle", [0.0, 1e-12, 1e-8, 0.5, np.pi - 1e-8, np.pi])
def test_angle_between_is_exact_at_both_ends(angle):
    a, b = np.array([1.0, 0.0, 0.0]), np.array([np.cos(angle), np.sin(angle), 0.0])
    assert tf.angle_between(3.0 * a, 0.1 * b) == pytest.approx(angle, abs=1e-15)


def test_angle_between_is_finite_for_vectors_that_rounding_made_longer_than_one():
    a = np.array([0.5, 0.5, 0.5]) * 1.1547005383792517
    assert tf.angle_between(a, a * 1.0000000001) == pytest.approx(0.0, abs=1e-15)


def test_normalised_keeps_a_zero_vector():
    assert_allclose(
        tf.normalised([[0.0, 0.0, 0.0], [3.0, 0.0, 4.0]]), [[0.0, 0.0, 0.0], [0.6, 0.0, 0.8]]
    )
