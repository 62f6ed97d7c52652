"""What is compiled for speed sees what the functions that a robot runs see."""

import dataclasses
from unittest.mock import Mock

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from articulate.assets.asset import Joint
from articulate.robot.arm import PANDA
from articulate.robot.control import GripperState
from articulate.robot.kinematics import tool_pose
from articulate.task.episode_monitor import WIDTH
from articulate.task.object_placement import HandlePath
from articulate.task.observation import OBSERVATION, observation
from articulate.task.randomization import COLUMNS, EpisodeParams
from articulate.task.randomization_config import RandomizationConfig
from articulate.task.state_estimation import MAX_AGE, NoisyEstimator, felt
from articulate.transforms import axis_angle_to_matrix, pose
from articulate_envs.compiled.observe import (
    NOISES,
    Past,
    Scales,
    Seen,
    Shown,
    observations,
    part_of,
    push,
    write_parts,
)

N, TICK_S, TICKS, MOVE_M, GOAL = 60, 0.05, 200, 0.01, 0.8
CONFIG = RandomizationConfig()
JOINT = Joint(
    name="j",
    link="l",
    kind="slide",
    axis_o=(0.6, 0.0, 0.8),
    pivot_o=(0.1, -0.2, 0.3),
    lower=-0.1,
    upper=1.4,
    closed=0.2,
    open=1.3,
    parent="p",
    closed_rule="given",
)


def turned(rng, n):
    """Random poses (n, 4, 4) within a metre."""
    axis = rng.normal(size=(n, 3))
    axis /= np.linalg.norm(axis, axis=1, keepdims=True)
    return pose(rng.uniform(-1, 1, (n, 3)), axis_angle_to_matrix(axis, rng.uniform(-3, 3, n)))


@pytest.mark.parametrize("kind", ["slide", "hinge"])
def test_handles_are_where_the_python_function_puts_them(kind):
    rng = np.random.default_rng(0)
    way = HandlePath(dataclasses.replace(JOINT, kind=kind), turned(rng, 1)[0])
    T_wo, scale, opened = turned(rng, N), rng.uniform(0.8, 1.2, N), rng.uniform(-0.2, 1.2, N)
    size = scale if kind == "slide" else np.ones(N)
    rest = np.zeros((N, 4))
    rest[:, 1] = size * (JOINT.closed + opened * JOINT.span)
    seen, handles = np.full(N, np.nan), np.full((N, 4, 4), np.nan)
    write_parts(np.arange(N), rest, Shown(part_of(way), T_wo, scale, size, seen, handles))
    assert_allclose(seen, opened, rtol=0, atol=1e-14)
    want = way.in_world(T_wo=T_wo, scale=scale, opened=opened)
    assert_allclose(handles, want, rtol=0, atol=1e-14)


@pytest.fixture
def world():
    """All that observations are made of, by name."""
    rng = np.random.default_rng(1)
    estimator = NoisyEstimator(N, 0.3, "slide", CONFIG)
    for _ in range(MAX_AGE + 2):
        estimator.push(turned(rng, N), rng.uniform(0, 1, N), rng.normal(size=N))
    values = rng.uniform(-0.1, 0.1, (N, len(COLUMNS)))
    values[:, COLUMNS.index("estimate_delay_steps")] = rng.integers(0, MAX_AGE, N)
    q = rng.uniform(*PANDA.bounds(), (N, 7))
    one = rng.uniform(-1, 1, (5, N))
    return {
        "estimator": estimator,
        "drawn": EpisodeParams(values),
        "q": q,
        "dq": rng.normal(size=(N, 7)),
        "target": q + rng.uniform(-0.15, 0.15, (N, 7)),
        "width": rng.uniform(0.0, 0.08, N),
        "width_before": rng.uniform(0.0, 0.08, N),
        "hand": GripperState(one[0], one[1], 3.0 * np.abs(one[2]), one[3], one[4]),
        "last_action": rng.uniform(-1, 1, (N, 8)),
        "pending_actions": rng.uniform(-3, 3, (N, 7)),
        "samples": rng.normal(scale=60.0, size=(N, WIDTH)),
        "tick": rng.integers(0, TICKS + 1, N),
    }


def compiled(world, noise, *, closes=False):
    """Observations of ``world`` by the compiled function."""
    gripper, estimator = world["hand"], world["estimator"]
    seen = Seen(
        q=world["q"],
        dq=world["dq"],
        target=world["target"],
        width=world["width"],
        width_before=world["width_before"],
        smooth=gripper.smooth,
        wish=gripper.wish,
        since_s=gripper.since_s,
        samples=world["samples"],
        T_wt=tool_pose(PANDA, world["q"]),
        T_wt_target=tool_pose(PANDA, world["target"]),
        pending_actions=world["pending_actions"],
        last_action=world["last_action"],
        tick=world["tick"],
    )
    scales = Scales(
        TICK_S, TICKS, MOVE_M, GOAL, closes, CONFIG.estimate_noise_m, estimator.part_noise,
        CONFIG.force_noise_n,
    )  # fmt: skip
    past = Past(estimator.poses, estimator.opened, estimator.speed)
    return observations(seen, past, world["drawn"].values, noise, scales)


def by_numpy(world, noise, *, closes=False):
    """The same by the functions that a robot runs."""
    first, second = (Mock(normal=Mock(return_value=part)) for part in (noise[:, :4], noise[:, 4:]))
    estimate = world["estimator"].estimate(world["drawn"], first)
    force_w = world["samples"][:, :3]
    return observation(
        PANDA,
        q=world["q"],
        dq=world["dq"],
        target=world["target"],
        gripper_width=world["width"],
        gripper_speed=(world["width"] - world["width_before"]) / TICK_S,
        measured_force=felt(force_w, world["drawn"], CONFIG.force_noise_n, second),
        gripper=world["hand"],
        estimate=estimate,
        last_action=world["last_action"],
        pending_actions=world["pending_actions"],
        move_m=MOVE_M,
        time_left=1.0 - world["tick"] / TICKS,
        goal=GOAL,
        closes=closes,
    )


@pytest.mark.parametrize("closes", [False, True])
def test_policies_see_what_the_python_functions_say(world, closes):
    noise = np.random.default_rng(7).normal(size=(N, NOISES))
    want = by_numpy(world, noise, closes=closes)
    got = compiled(world, noise, closes=closes)
    for field in OBSERVATION.fields:
        where = OBSERVATION.slice(field.name)
        assert_allclose(got[:, where], want[:, where], rtol=0, atol=1e-12, err_msg=field.name)
    clipped = (got == OBSERVATION.low) | (got == OBSERVATION.high)
    assert clipped.any()
    assert not clipped.all(axis=0).any()


def test_estimators_take_in_what_the_python_one_does():
    rng = np.random.default_rng(3)
    theirs = NoisyEstimator(N, 0.3, "slide", CONFIG)
    ours = Past(theirs.poses.copy(), theirs.opened.copy(), theirs.speed.copy())
    for _ in range(MAX_AGE + 2):
        true = (turned(rng, N), rng.uniform(0, 1, N), rng.normal(size=N))
        theirs.push(*true)
        push(ours, *true)
        for name, array in zip(("poses", "opened", "speed"), ours, strict=True):
            assert_array_equal(array, getattr(theirs, name), err_msg=name)


def test_what_diverged_is_seen_as_nothing_and_the_others_as_they_are(world):
    noise = np.zeros((N, NOISES))
    before = compiled(world, noise)
    world["q"][3] = np.nan
    after = compiled(world, noise)
    assert_array_equal(np.delete(after, 3, axis=0), np.delete(before, 3, axis=0))
    assert_array_equal(after[3, OBSERVATION.slice("joint_pos")], 0.0)
    assert np.isfinite(after).all()
