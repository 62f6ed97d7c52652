"""Motions near the goal: closed forms, and the same in training, network and bundle."""

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from articulate.errors import ConfigError
from articulate.task.observation import ACTION, GOAL_ERROR_UNIT, OBSERVATION
from articulate_train.action_scaling import (
    GRIPPER_GAIN,
    action_scales,
    corrected_action,
    correction_to,
)
from articulate_train.config import ActionScalingConfig
from articulate_train.policy import Network, Policy

FINE = ActionScalingConfig(at_goal=0.2, goal_range=(-0.06, 0.02))
MOTIONS = ACTION.size - 1


def seen(beyond=-1.0):
    """One observation (1, size) with the part ``beyond`` its target, as a fraction."""
    fields = {f.name: np.zeros((1, f.size)) for f in OBSERVATION.fields}
    fields["goal_error_fine"] = np.array([[beyond / GOAL_ERROR_UNIT]])
    return OBSERVATION.pack(fields)


@pytest.mark.parametrize(
    ("beyond", "share"), [(-0.1, 1.0), (-0.06, 1.0), (-0.02, 0.6), (0.02, 0.2), (0.1, 0.2)]
)
def test_motions_are_finer_near_the_parts_target(beyond, share):
    assert_allclose(action_scales(FINE, seen(beyond)), [[share]], atol=1e-12)


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
    row = expert(np.concatenate([seen(), seen(0.1)]), action)
    assert_allclose(corrected_action(FINE, row, np.zeros((2, ACTION.size))), [action] * 2)


@given(
    start=st.lists(st.floats(-1.0, 1.0), min_size=8, max_size=8),
    target=st.lists(st.floats(-1.0, 1.0), min_size=8, max_size=8),
    beyond=st.floats(-0.3, 0.1),
)
def test_the_correction_to_an_action_results_in_it_within_its_bounds(start, target, beyond):
    row = expert(seen(beyond), start)
    correction = correction_to(FINE, row, np.array([target]))
    assert np.all(np.abs(correction) <= 1.0)
    inside = np.abs(correction[0]) < 1.0
    got = corrected_action(FINE, row, correction)[0]
    assert_allclose(got[inside], np.array(target)[inside], atol=1e-6)
    assert_allclose(got[-1], target[-1], atol=1e-6)  # the gripper can always be reversed


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
    rows = expert(np.concatenate([seen(), seen(-0.02)]), np.full(ACTION.size, -0.25))
    far, near = policy.act(rows)
    for got, scale in ((far, 1.0), (near, 0.6)):
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
        {"at_goal": 1.01},
        {"at_goal": float("nan")},
        {"at_goal": 0.0},
        {"goal_range_max_m": 0.0},
        {"goal_range": (0.0, 0.0)},
        {"goal_range": (-0.3, 0.0)},
    ],
)
def test_values_out_of_range_are_rejected(values):
    with pytest.raises(ConfigError, match="action_scaling"):
        ActionScalingConfig(**values)
