"""What is compiled for speed gives the numbers of the functions that a robot runs."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from articulate.robot.arm import PANDA
from articulate.robot.config import ControlConfig
from articulate.robot.control import joint_steps, next_target
from articulate.robot.kinematics import tool_pose
from articulate_envs.compiled.motion import aim, chain_of, room_of, write_tool

CONFIG = ControlConfig()
N = 200


def poses(seed):
    """Targets anywhere between the limits and joints near them (N, 7)."""
    rng = np.random.default_rng(seed)
    target = rng.uniform(*PANDA.bounds(CONFIG.margin_rad), (N, 7))
    return target, target + rng.uniform(-0.2, 0.2, (N, 7)), rng.uniform(-1.3, 1.3, (N, 7))


def aimed(target, motion, q, yields):
    """Each row of ``target`` moved by the compiled function."""
    out, room = target.copy(), room_of()
    chain = chain_of(PANDA, CONFIG)
    for i in range(len(out)):
        aim(out[i], motion[i], q[i], yields[i], chain, room)
    return out


def test_targets_move_as_the_python_function_moves_them():
    target, q, motion = poses(0)
    yields = np.arange(N) % 3 == 0
    want = next_target(target, motion, q, CONFIG, PANDA, yields)
    assert_allclose(aimed(target, motion, q, yields), want, rtol=0, atol=1e-12)
    share = np.abs(want - target) / joint_steps(CONFIG, PANDA)
    assert share.max() == pytest.approx(1.0)


def test_targets_move_alike_at_a_stretched_arm():
    target = np.zeros((4, 7))
    target[:, 3] = np.array([-0.08, -0.1, -0.2, -0.5])
    motion = np.random.default_rng(1).uniform(-1.0, 1.0, (4, 7))
    free = np.zeros(4, dtype=bool)
    want = next_target(target, motion, target, CONFIG, PANDA, free)
    assert_allclose(aimed(target, motion, target, free), want, rtol=0, atol=1e-11)


def test_the_tool_is_where_the_python_function_puts_it():
    _, q, _ = poses(2)
    out, frames = np.full((N, 4, 4), np.nan), np.zeros((7, 6))
    for i in range(N):
        write_tool(q[i], chain_of(PANDA, CONFIG), frames, out[i])
    assert_allclose(out, tool_pose(PANDA, q), rtol=0, atol=1e-14)
