"""Motions near the handle: closed forms, and the same in training, network and bundle."""

import dataclasses

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from articulate.errors import ConfigError
from articulate.task.observation import (
    ACTION,
    GOAL_ERROR_UNIT,
    GRIPPER_SPEED_UNIT_M_S,
    HANDLE_UNIT_M,
    OBSERVATION,
    WIDTH_UNIT_M,
)
from articulate_train.action_scaling import (
    GRIPPER_GAIN,
    MIN_SCALE,
    action_scales,
    corrected_action,
    correction_to,
)
from articulate_train.config import ActionScalingConfig
from articulate_train.policy import Network, Policy

FINE = ActionScalingConfig(
    near_handle=0.4,
    while_closing=0.2,
    near_m=0.03,
    far_m=0.10,
    at_goal=0.2,
    goal_range=(-0.06, 0.02),
)
OPEN_M = 0.08
MOTIONS = ACTION.size - 1


def seen(
    distance_m,
    *,
    command=-1.0,
    width_m=OPEN_M,
    speed_m_s=0.0,
    beyond=-1.0,
):
    """One observation (1, size) with the handle ahead of the tool."""
    fields = {f.name: np.zeros((1, f.size)) for f in OBSERVATION.fields}
    fields["handle_pos_predicted"] = np.array([[0.0, 0.6, 0.8]]) * distance_m / HANDLE_UNIT_M
    fields["gripper_command"] = np.array([[command, command, 1.0]])
    fields["gripper_width"] = np.array([[width_m / WIDTH_UNIT_M]])
    fields["gripper_speed"] = np.array([[speed_m_s / GRIPPER_SPEED_UNIT_M_S]])
    fields["goal_error_fine"] = np.array([[beyond / GOAL_ERROR_UNIT]])
    return OBSERVATION.pack(fields)


@pytest.mark.parametrize(
    ("distance_m", "share"),
    [(0.0, 0.4), (0.03, 0.4), (0.065, 0.7), (0.10, 1.0), (0.5, 1.0)],
)
def test_motions_of_an_open_gripper_are_finer_near_the_handle(distance_m, share):
    assert_allclose(action_scales(FINE, seen(distance_m)), [[share]], atol=1e-12)


@pytest.mark.parametrize(
    ("width_m", "speed_m_s", "share"),
    [
        (0.08, 0.0, 0.2),  # commanded, and nothing has moved yet
        (0.06, -0.2, 0.2),  # closing
        (0.04, 0.0, 1.0),  # closed on something
        (0.0, 0.0, 1.0),  # closed on nothing
        (0.04, 0.025, 0.6),  # coming to rest
        (0.075, 0.0, 0.6),
    ],
)
def test_motions_are_finest_from_commanding_the_gripper_to_close_until_it_has(
    width_m, speed_m_s, share
):
    got = action_scales(FINE, seen(0.01, command=1.0, width_m=width_m, speed_m_s=speed_m_s))
    assert_allclose(got, [[share]], atol=1e-12)


def test_fingers_that_open_are_those_of_an_open_gripper():
    got = action_scales(FINE, seen(0.01, command=-1.0, width_m=0.04, speed_m_s=0.2))
    assert_allclose(got, [[0.4]], atol=1e-12)


@pytest.mark.parametrize("distance_m", [0.0, 0.3])
@pytest.mark.parametrize(
    ("beyond", "share"), [(-0.1, 1.0), (-0.06, 1.0), (-0.02, 0.6), (0.02, 0.2), (0.1, 0.2)]
)
def test_motions_are_finer_near_the_parts_target(distance_m, beyond, share):
    short = action_scales(FINE, seen(distance_m))
    assert_allclose(action_scales(FINE, seen(distance_m, beyond=beyond)), short * share, atol=1e-12)


@pytest.mark.parametrize("command", [-1.0, 1.0])
def test_far_from_the_handle_nothing_is_finer(command):
    assert_allclose(action_scales(FINE, seen(0.2, command=command)), [[1.0]], atol=1e-12)


@given(
    distance_m=st.floats(0.0, 2.0),
    command=st.sampled_from([-1.0, 1.0]),
    width_m=st.floats(0.0, 0.08),
    speed_m_s=st.floats(-0.3, 0.3),
    share=st.floats(0.05, 1.0),
    closing=st.floats(0.05, 1.0),
)
def test_shares_lie_between_the_least_and_one(
    distance_m, command, width_m, speed_m_s, share, closing
):
    row = seen(distance_m, command=command, width_m=width_m, speed_m_s=speed_m_s)
    got = action_scales(ActionScalingConfig(near_handle=share, while_closing=closing), row)[0, 0]
    assert min(share, closing) - 1e-12 <= got <= 1.0


def one_network(action_scaling):
    """A policy with one network that normalises nothing."""
    zeros, ones = torch.zeros(OBSERVATION.size), torch.ones(OBSERVATION.size)
    return Policy([Network(zeros, ones, (4,))], action_scaling)


def expert(row, action):
    """The observations ``row`` (N, size) with an action of the scripted expert."""
    row = row.copy()
    row[:, OBSERVATION.slice("expert_action")] = action
    return row


def test_without_a_correction_the_action_is_that_of_the_expert():
    action = np.linspace(-1.0, 1.0, ACTION.size)
    row = expert(np.concatenate([seen(0.02), seen(0.5, beyond=0.1)]), action)
    assert_allclose(corrected_action(FINE, row, np.zeros((2, ACTION.size))), [action] * 2)


@given(
    start=st.lists(st.floats(-1.0, 1.0), min_size=8, max_size=8),
    target=st.lists(st.floats(-1.0, 1.0), min_size=8, max_size=8),
    beyond=st.floats(-0.3, 0.1),
    distance_m=st.floats(0.0, 0.3),
)
def test_the_correction_to_an_action_results_in_it_within_its_bounds(
    start, target, beyond, distance_m
):
    row = expert(seen(distance_m, beyond=beyond), start)
    config = dataclasses.replace(FINE, at_goal=1.0)
    correction = correction_to(config, row, np.array([target]))
    assert np.all(np.abs(correction) <= 1.0)
    inside = np.abs(correction[0]) < 1.0
    got = corrected_action(config, row, correction)[0]
    assert_allclose(got[inside], np.array(target)[inside], atol=1e-6)
    assert_allclose(got[-1], target[-1], atol=1e-6)  # the gripper can always be reversed


def test_a_correction_at_the_goal_is_bounded_though_its_scale_is_small():
    row = expert(seen(0.5, beyond=0.1), np.zeros(ACTION.size))
    target = np.full((1, ACTION.size), 0.15)
    assert_allclose(correction_to(FINE, row, target)[0, :MOTIONS], 0.15 / MIN_SCALE)
    assert_allclose(correction_to(FINE, row, target)[0, MOTIONS:], 0.15 / GRIPPER_GAIN)


def test_arrays_and_tensors_give_the_same():
    rng = np.random.default_rng(0)
    rows = rng.uniform(-1.0, 1.0, (64, OBSERVATION.size)).astype(np.float32)
    other = rng.uniform(-1.0, 1.0, (64, ACTION.size)).astype(np.float32)
    tensors = torch.as_tensor(rows), torch.as_tensor(other)
    assert_allclose(action_scales(FINE, tensors[0]).numpy(), action_scales(FINE, rows), rtol=1e-5)
    for of in (corrected_action, correction_to):
        assert_allclose(of(FINE, *tensors).numpy(), of(FINE, rows, other), rtol=1e-5, atol=1e-6)


def test_policy_scales_its_corrections_but_not_that_of_the_gripper():
    policy = one_network(FINE)
    with torch.no_grad():
        policy.networks[0].head.weight.zero_()
        policy.networks[0].head.bias.copy_(torch.linspace(-2.0, 0.5, ACTION.size))
    correction = np.clip(np.linspace(-2.0, 0.5, ACTION.size), -1.0, 1.0)
    rows = expert(np.concatenate([seen(0.5), seen(0.02)]), np.full(ACTION.size, -0.25))
    far, near = policy.act(rows)
    for got, scale in ((far, 1.0), (near, 0.4)):
        want = np.clip(-0.25 + scale * correction[:MOTIONS], -1.0, 1.0)
        assert_allclose(got[:MOTIONS], want, rtol=1e-5)
        assert_allclose(got[MOTIONS:], -0.25 + GRIPPER_GAIN * correction[MOTIONS:], rtol=1e-5)


@pytest.mark.parametrize(
    ("path_m", "begin"), [(0.2, -0.2), (0.5, -0.1), (1.0, -0.05), (None, -0.2)]
)
def test_motions_are_finer_over_at_most_a_bounded_length_of_the_handle(path_m, begin):
    action_scaling = ActionScalingConfig(goal_range=(-0.2, 0.0), goal_range_max_m=0.05)
    assert_allclose(action_scaling.for_path(path_m).goal_range, (begin, 0.0), rtol=1e-12)


@pytest.mark.parametrize(
    "values",
    [
        {"near_handle": 0.0},
        {"near_handle": 1.5},
        {"near_m": 0.2},
        {"near_m": -0.1},
        {"while_closing": 0.0},
        {"while_closing": 1.01},
        {"closed_width_m": (0.08, 0.07)},
        {"closed_speed_m_s": 0.0},
        {"near_handle": float("nan")},
        {"at_goal": 0.0},
        {"goal_range_max_m": 0.0},
        {"goal_range": (0.0, 0.0)},
        {"goal_range": (-0.3, 0.0)},
    ],
)
def test_values_out_of_range_are_rejected(values):
    with pytest.raises(ConfigError, match="action_scaling"):
        ActionScalingConfig(**values)
