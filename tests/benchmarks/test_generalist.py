"""The mirrored scene of the generalist's training is what the simulated robot would observe."""

import numpy as np
import torch
from numpy.testing import assert_allclose

from articulate.robot.arm import PANDA
from articulate.robot.control import new_gripper_state
from articulate.robot.kinematics import tool_pose
from articulate.task.object_placement import HandlePath
from articulate.task.observation import (
    Estimate,
    ObservationInputs,
    ObservationParams,
    observation,
)
from articulate.task.scripted_expert import ExpertParams
from generalist import mirrored

N = 16
EXPERT = ExpertParams(
    move_m=0.008, turn_rad=0.02,
    path=HandlePath(False, np.array([0.0, 0.0, -1.0]), np.zeros(3), np.eye(4), 0.0, 0.4),
    along_m=0.03, thick_m=0.01, deep_m=0.0, beside_m=0.0,
    shut=False, hooks=False, aim=0.86,
)  # fmt: skip
ANGLES = np.array([-1, 1, -1, 1, -1, 1, -1])
OFFSET = np.array([0, 0, 0, 0, 0, 0, np.pi / 2])
ACROSS, TWIST = np.array([1, -1, 1]), np.array([1, -1, 1, -1, 1, -1])
MOTION = np.array([*TWIST, -1])


def observed(q, dq, target, T_wh, force, pending, action, direction, rotation):
    inputs = ObservationInputs(
        q=q,
        dq=dq,
        target=target,
        T_wt=tool_pose(PANDA, q),
        T_wt_target=tool_pose(PANDA, target),
        gripper=new_gripper_state(N),
        gripper_width=np.full(N, 0.06),
        last_gripper_width=np.full(N, 0.07),
        pending_actions=pending,
        last_action=action,
    )
    estimate = Estimate(T_wh, np.full(N, 0.3), np.full(N, 0.1))
    size = np.array([0.1, 0.01, 0.02])
    params = ObservationParams(0.05, 0.008, 0.8, False, direction, rotation, 0.4, size, EXPERT)
    return observation(inputs, estimate, force, 0.5, params)


def test_the_mirrored_observation_is_that_of_the_mirrored_robot_and_object():
    rng = np.random.default_rng(0)
    q = np.asarray(PANDA.home) + rng.uniform(-0.3, 0.3, (N, 7))
    dq, target = rng.normal(size=(N, 7)), q + rng.uniform(-0.05, 0.05, (N, 7))
    T_wh = tool_pose(PANDA, q + rng.uniform(-0.1, 0.1, (N, 7)))
    force, pending = rng.normal(size=(N, 3)), rng.normal(size=(N, 7))
    action = rng.uniform(-1, 1, (N, 8))
    direction, rotation = rng.normal(size=(2, 3))
    seen = observed(q, dq, target, T_wh, force, pending, action, direction, rotation)
    mirror = np.diag([1.0, -1.0, 1.0, 1.0])
    expected = observed(
        q * ANGLES + OFFSET,
        dq * ANGLES,
        target * ANGLES + OFFSET,
        mirror @ T_wh @ mirror,  # the closing axis keeps the frame right-handed
        force * ACROSS,
        pending * MOTION,
        action * np.array([*MOTION, 1]),
        direction * ACROSS,
        rotation * -ACROSS,
    )
    out, actions = mirrored(torch.from_numpy(seen), torch.from_numpy(action))
    assert_allclose(out.numpy(), expected, atol=1e-5)
    assert_allclose(actions.numpy(), action * np.array([*MOTION, 1]))
    twice = mirrored(out, actions)
    assert_allclose(twice[0].numpy() - seen, np.zeros_like(seen), atol=1e-12)
