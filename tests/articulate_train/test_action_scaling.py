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
    JOINT_TRACKING_UNIT_RAD,
    OBSERVATION,
    TRACKING_UNIT_M,
    TRACKING_UNIT_RAD,
    WIDTH_UNIT_M,
)
from articulate.task.task import Task
from articulate_train.action_scaling import ELBOW, MOTIONS, action_scales, lead_compensation
from articulate_train.config import ActionScalingConfig
from articulate_train.imitation import unscale_action
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
NO_LEAD, NO_BEND = np.zeros(6), np.zeros(7)


def seen(
    distance_m,
    *,
    command=-1.0,
    width_m=OPEN_M,
    speed_m_s=0.0,
    beyond=-1.0,
    lead=NO_LEAD,
    bent=NO_BEND,
):
    """One observation (1, size) with the handle ahead of the tool."""
    fields = {f.name: np.zeros((1, f.size)) for f in OBSERVATION.fields}
    fields["handle_pos_predicted"] = np.array([[0.0, 0.6, 0.8]]) * distance_m / HANDLE_UNIT_M
    fields["gripper_command"] = np.array([[command, command, 1.0]])
    fields["gripper_width"] = np.array([[width_m / WIDTH_UNIT_M]])
    fields["gripper_speed"] = np.array([[speed_m_s / GRIPPER_SPEED_UNIT_M_S]])
    fields["goal_error_fine"] = np.array([[beyond / GOAL_ERROR_UNIT]])
    fields["joint_tracking_error"] = bent[None] / JOINT_TRACKING_UNIT_RAD
    fields["tracking_error"] = lead[None] / np.repeat([TRACKING_UNIT_M, TRACKING_UNIT_RAD], 3)
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


AHEAD = np.array([0.0, 0.06, 0.08, 0.1, 0.0, 0.0])
"""The target of the tool is 10 cm and 0.1 rad ahead."""
LEADS = ActionScalingConfig(
    lead_gain=0.5,
    max_lead_m=(0.08, 0.02),
    max_lead_rad=(0.3, 0.05),
    goal_range=(-0.2, 0.0),
    stop_range=(0.0, 0.1),
)


@pytest.mark.parametrize(
    ("beyond", "allowed_m"),
    [
        (-0.25, 1.0),  # far from the target it may be ahead as it likes
        (-0.2, 1.0),
        (-0.18, 0.074),
        (-0.1, 0.05),
        (0.0, 0.02),
        (0.05, 0.01),
        (0.1, 0.0),  # shut
    ],
)
def test_what_the_target_is_ahead_by_too_much_is_compensated(beyond, allowed_m):
    got = lead_compensation(LEADS, seen(0.3, beyond=beyond, lead=AHEAD))
    much = max(0.0, 1.0 - allowed_m / 0.1)
    units = AHEAD / np.repeat([TRACKING_UNIT_M, TRACKING_UNIT_RAD], 3)
    assert_allclose(got, [0.5 * much * units], atol=1e-4)


@pytest.mark.parametrize(("beyond", "allowed_rad"), [(-0.1, 0.175), (0.0, 0.05), (0.05, 0.025)])
def test_the_joint_that_is_farthest_ahead_counts_as_well(beyond, allowed_rad):
    """Of two bounds the one that takes back more."""
    bent = np.array([0.0, 0.1, -0.25, 0.05, 0.0, 0.2, -0.1])
    lead = 0.1 * AHEAD
    got = lead_compensation(LEADS, seen(0.3, beyond=beyond, lead=lead, bent=bent))
    units = lead / np.repeat([TRACKING_UNIT_M, TRACKING_UNIT_RAD], 3)
    assert_allclose(got, [0.5 * (1.0 - allowed_rad / 0.25) * units], atol=1e-4)


def test_nothing_is_compensated_of_a_lead_that_is_allowed():
    got = lead_compensation(LEADS, seen(0.3, beyond=0.0, lead=0.19 * AHEAD))
    assert_allclose(got, np.zeros((1, 6)), atol=1e-12)


def one_network(action_scaling):
    """A policy with one network that normalises nothing."""
    zeros, ones = torch.zeros(OBSERVATION.size), torch.ones(OBSERVATION.size)
    return Policy([Network(zeros, ones, (4,))], action_scaling)


def test_policy_compensates_on_top_of_what_it_reports_within_what_a_step_may_do():
    policy = one_network(LEADS)
    with torch.no_grad():
        policy.networks[0].head.weight.zero_()
        policy.networks[0].head.bias.fill_(0.5)
    row = seen(0.5, beyond=0.1, lead=AHEAD)
    want = 0.5 * LEADS.at_goal - lead_compensation(LEADS, row)[0]
    got = policy.act(row)[0]
    assert_allclose(got[:ELBOW], np.clip(want, -1.0, 1.0), rtol=1e-5)
    assert_allclose(got[ELBOW], 0.5 * LEADS.at_goal, rtol=1e-6)
    assert_allclose(policy.act(seen(0.5, beyond=0.1, lead=9 * AHEAD))[0, 2], -1.0)


@given(
    calls=st.lists(st.floats(-1.0, 1.0), min_size=8, max_size=8),
    beyond=st.floats(-0.3, 0.1),
    ahead=st.floats(0.0, 0.05),
)
def test_what_the_expert_requests_comes_of_what_a_policy_would_state(calls, beyond, ahead):
    row = seen(0.5, beyond=beyond, lead=ahead * AHEAD / 0.1)
    action_scaling = dataclasses.replace(LEADS, at_goal=0.5)
    left, back = action_scales(action_scaling, row), lead_compensation(action_scaling, row)
    words = unscale_action(np.array([calls]), left, back)
    done = words[:, :MOTIONS] * left
    done[:, :ELBOW] -= back
    full = np.all(np.abs(words[:, :MOTIONS]) < 1.0, axis=0)
    assert_allclose(done[0][full], np.array(calls)[:MOTIONS][full], atol=1e-6)
    assert np.all(np.abs(words) <= 1.0)


def test_arrays_and_tensors_give_the_same():
    rng = np.random.default_rng(0)
    rows = rng.uniform(-1.0, 1.0, (64, OBSERVATION.size)).astype(np.float32)
    for of in (action_scales, lead_compensation):
        assert_allclose(of(FINE, torch.as_tensor(rows)).numpy(), of(FINE, rows), rtol=1e-5)


def test_policy_scales_motions_and_leaves_the_grippers_command():
    policy = one_network(FINE)
    with torch.no_grad():
        policy.networks[0].head.weight.zero_()
        policy.networks[0].head.bias.copy_(torch.linspace(-2.0, 0.5, ACTION.size))
    text = np.clip(np.linspace(-2.0, 0.5, ACTION.size), -1.0, 1.0)
    far, near = policy.act(np.concatenate([seen(0.5), seen(0.02)]))
    assert_allclose(far, text, rtol=1e-6)
    assert_allclose(near[:MOTIONS], 0.4 * text[:MOTIONS], rtol=1e-6)
    assert_allclose(near[MOTIONS:], text[MOTIONS:], rtol=1e-6)


@pytest.mark.parametrize(
    ("target", "stop", "heard"),
    [(0.05, 0.0, True), (0.95, 1.0, True), (0.41, 1.0, False), (0.8, None, False)],
)
def test_leads_are_compensated_where_the_stop_is_near_the_target(target, stop, heard):
    task = Task(name="open_drawer", joint="j", kind="slide", span=0.3, target=target, stop=stop)
    want = LEADS if heard else dataclasses.replace(LEADS, lead_gain=0.0)
    assert LEADS.for_task(task, None) == want


@pytest.mark.parametrize(
    ("path_m", "begin"), [(0.2, -0.2), (0.5, -0.1), (1.0, -0.05), (None, -0.2)]
)
def test_motions_are_finer_over_at_most_a_bounded_length_of_the_handle(path_m, begin):
    action_scaling = ActionScalingConfig(goal_range=(-0.2, 0.0), goal_range_max_m=0.05)
    task = Task(name="open_door", joint="j", kind="hinge", span=1.5, target=0.8)
    assert_allclose(action_scaling.for_task(task, path_m).goal_range, (begin, 0.0), rtol=1e-12)


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
        {"max_lead_m": (0.02, 0.03)},
        {"max_lead_m": (0.08, -0.01)},
        {"max_lead_rad": (0.05, 0.06)},
        {"stop_range": (0.05, 0.03)},
        {"lead_gain": -0.1},
        {"lead_gain": float("nan")},
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
