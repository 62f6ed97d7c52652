import numpy as np
from numpy.testing import assert_allclose

from articulate.robot import kinematics
from articulate.robot.arm import PANDA
from articulate_envs.compiled.inverse_kinematics import solve_ik


def test_compiled_inverse_kinematics_is_the_plain_one():
    rng = np.random.default_rng(5)
    start = np.asarray(PANDA.home) + rng.uniform(-0.2, 0.2, (3, 7))
    goals = kinematics.tool_pose(PANDA, start + rng.uniform(-0.5, 0.5, (3, 7)))
    plain = kinematics.solve_ik(PANDA, goals, start, iterations=20)
    compiled = solve_ik(PANDA, goals, start, iterations=20)
    assert_allclose(compiled.q, plain.q, atol=1e-9)
    assert_allclose(compiled.rot_error, plain.rot_error, atol=1e-9)
