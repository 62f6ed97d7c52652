import numpy as np
import pytest
from numpy.testing import assert_array_equal

from articulate.robot.arm import ARMS, PANDA, arm_named


@pytest.mark.parametrize("arm", ARMS.values(), ids=ARMS)
def test_tables_have_seven_entries_that_make_sense(arm):
    assert len(arm.joint_names) == 7
    tables = ("dq_max", "ddq_max", "dddq_max", "tau_max", "stiffness", "damping", "armature")
    for name in tables:
        assert len(getattr(arm, name)) == 7
        assert min(getattr(arm, name)) > 0, name
    assert all(
        low < home < high for low, home, high in zip(arm.q_min, arm.home, arm.q_max, strict=True)
    )


def test_panda_has_the_speeds_and_torques_of_its_documentation():
    """A deployable episode is judged by these; they are not ours to change."""
    assert PANDA.dq_max == (2.175,) * 4 + (2.61,) * 3
    assert PANDA.tau_max == (87.0,) * 4 + (12.0,) * 3
    assert PANDA.ddq_max == (15.0, 7.5, 10.0, 12.5, 15.0, 20.0, 20.0)
    assert PANDA.dtau_max == 1000.0


def test_bounds_are_drawn_in_from_both_sides():
    low, high = PANDA.bounds(0.1)
    assert_array_equal(low, np.asarray(PANDA.q_min) + 0.1)
    assert_array_equal(high, np.asarray(PANDA.q_max) - 0.1)


def test_unknown_arm_is_refused_with_those_that_exist(error_line):
    error_line('arm_named("pandas")', lambda: arm_named("pandas"))
    assert arm_named("panda") is PANDA
