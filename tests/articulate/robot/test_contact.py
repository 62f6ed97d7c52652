import numpy as np
from numpy.testing import assert_allclose, assert_array_equal

from articulate.robot.contact import contact_wrench

STARTS = (0, 10, 20)


def wrenches(sensors, tool_w):
    """Return the wrenches (N, 6) and the forbidden contacts (N,) of rows of sensor data."""
    out = np.empty((len(sensors), 6))
    rows = zip(sensors, tool_w, out, strict=True)
    return out, np.array([contact_wrench(row, *STARTS, tool, wrench) for row, tool, wrench in rows])


def row(*, force=(0, 0, 0), torque=(0, 0, 0), pos=(0, 0, 0), at=0, gripper=0, robot=0):
    """One row of sensor data with one contact in the block that begins at ``at``."""
    out = np.zeros(21)
    out[at + 1 : at + 10] = [*force, *torque, *pos]
    out[0] += gripper
    out[20] = robot
    return out


def test_the_hand_feels_the_opposite_of_what_it_does_to_the_object():
    sensors = row(force=(1, 2, 3), pos=(0.1, 0.2, 0.3))[None]
    wrench, _ = wrenches(sensors, np.array([[0.1, 0.2, 0.3]]))
    assert_allclose(wrench, [[-1, -2, -3, 0, 0, 0]], rtol=0, atol=1e-15)


def test_the_moment_of_a_force_is_that_of_its_lever():
    sensors = row(force=(0, 0, 10), pos=(0.2, 0, 0))[None]
    wrench, _ = wrenches(sensors, np.zeros((1, 3)))
    assert_allclose(wrench, [[0, 0, -10, 0, 2, 0]], rtol=0, atol=1e-15)


def test_object_and_floor_add_up():
    rng = np.random.default_rng(0)
    a, b, tool = rng.normal(size=(3, 3)), rng.normal(size=(3, 3)), rng.normal(size=(1, 3))
    sensors = row(force=a[0], torque=a[1], pos=a[2]) + row(force=b[0], torque=b[1], pos=b[2], at=10)
    wrench, _ = wrenches(sensors[None], tool)
    moment = a[1] + b[1] + np.cross(a[2] - tool[0], a[0]) + np.cross(b[2] - tool[0], b[0])
    assert_allclose(-wrench[0], [*(a[0] + b[0]), *moment], rtol=0, atol=1e-12)


def test_the_arm_touches_where_it_has_more_contacts_than_the_hand():
    sensors = np.stack([row(), row(gripper=2, robot=2), row(gripper=2, robot=3), row(robot=1)])
    _, touch = wrenches(sensors, np.zeros((4, 3)))
    assert_array_equal(touch, [False, False, True, True])
