"""The scripted expert: closed forms of its motions, and hysteresis of its grasp."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from articulate.assets.asset import Handle
from articulate.robot.arm import PANDA
from articulate.robot.control import new_gripper_state
from articulate.robot.kinematics import tool_pose
from articulate.task.object_placement import HandlePath
from articulate.task.observation import ACTION, ObservationInputs
from articulate.task.scripted_expert import (
    BACK_OFF_M,
    BLOCKED_S,
    DEEP_M,
    DEEPER_M,
    HOOKED_M,
    PRESS_N,
    RETREAT_M,
    SHALLOWER_M,
    SLOW,
    ExpertParams,
    _deep_m,
    _write_after_pending,
    _write_ahead,
    _write_before,
    write_expert_action,
)
from articulate.transforms import axis_angle_to_matrix, inverse, pose

HOME = np.asarray(PANDA.home)[None]
T_WT = tool_pose(PANDA, HOME)
MOVE_M, TURN_RAD = 0.008, 0.02
DRAWER = ExpertParams(
    move_m=MOVE_M, turn_rad=TURN_RAD,
    path=HandlePath(False, np.array([0.0, 0.0, -1.0]), np.zeros(3), np.eye(4), 0.0, 0.4),
    along_m=0.03, thick_m=0.01, deep_m=0.0, beside_m=0.0,
    shut=False, hooks=False, aim=0.8,
)  # fmt: skip
PIVOT = np.array([0.0, 0.3, 0.0])
DOOR = DRAWER._replace(path=HandlePath(True, np.array([1.0, 0.0, 0.0]), PIVOT, np.eye(4), 0.0, 1.5))


def act(
    params,
    *,
    T_th=None,
    width_m=0.08,
    command=-1.0,
    opened=0.0,
    pending=None,
    released_m=0.08,
    since_s=10.0,
    press_n=0.0,
    closed_m=0.0,
):
    """The action at home with the handle at ``T_th`` (4, 4) in the frame of the tool."""
    gripper = new_gripper_state(1)
    gripper.command[:], gripper.since_s[:], gripper.release_width[:] = command, since_s, released_m
    inputs = ObservationInputs(
        q=HOME, dq=np.zeros((1, 7)), target=HOME, T_wt=T_WT, T_wt_target=T_WT, gripper=gripper,
        gripper_width=np.array([width_m]), last_gripper_width=np.array([width_m + closed_m]),
        pending_actions=np.zeros((1, 7)) if pending is None else pending[None],
        last_action=np.zeros((1, 8)),
    )  # fmt: skip
    out = np.full(ACTION.size, np.nan)
    T_wh = T_WT[0] @ (np.eye(4) if T_th is None else T_th)
    write_expert_action(inputs, 0, T_wh, opened, -press_n * T_WT[0, :3, 2], params, out)
    return out


def ahead(*pos, turn=0.0):
    return pose(np.array(pos), axis_angle_to_matrix(np.array([0.0, 0.0, 1.0]), turn))


def test_far_from_the_handle_it_moves_there_with_its_largest_motion_and_an_open_gripper():
    action = act(DRAWER, T_th=ahead(0.0, 0.0, 0.3))
    assert_allclose(action, [0, 0, 1, 0, 0, 0, 0, -1], atol=1e-12)


def test_near_the_handle_it_is_slower():
    assert_allclose(act(DRAWER, T_th=ahead(0.0, 0.0, 0.025))[2], SLOW)


def test_motions_below_the_largest_are_in_its_unit_less_what_is_pending():
    action = act(DRAWER, T_th=ahead(0.0, 0.002, 0.0, turn=0.004))
    assert_allclose(action[:6], [0, 0.25, 0, 0, 0, 0.2], atol=2e-3)
    pending = np.array([0.0, 0.25, 0.0, 0.0, 0.0, 0.2, 0.0])
    rest = act(DRAWER, T_th=ahead(0.0, 0.002, 0.0, turn=0.004), pending=pending)
    assert_allclose(rest[:6], np.zeros(6), atol=2e-3)


def test_at_the_handle_it_closes_and_pulls_once_the_fingers_hold_it():
    assert act(DRAWER)[7] == 1.0
    assert_allclose(act(DRAWER, command=1.0)[:6], 0.0, atol=1e-12)  # the fingers are still open
    held = act(DRAWER, command=1.0, width_m=0.011)
    assert_allclose(held, [0, 0, -1, 0, 0, 0, 0, 1], atol=1e-12)


def test_fingers_that_closed_on_nothing_open_and_go_back_until_they_are_open():
    for command in (1.0, -1.0):  # the command to open takes time
        empty = act(DRAWER, command=command, width_m=0.002)
        assert empty[7] == -1.0
        assert_allclose(empty[2], -SLOW)


@pytest.mark.parametrize(
    ("released_m", "depth_m"),
    [(0.002, DEEPER_M), (0.011, 0.0), (0.04, -SHALLOWER_M), (0.08, 0.0)],
)
def test_it_repeats_a_grasp_deeper_that_slipped_off_and_less_deep_that_was_blocked(
    released_m, depth_m
):
    assert_allclose(act(DRAWER, released_m=released_m)[2], max(depth_m / MOVE_M, -SLOW), atol=1e-12)


def test_fingers_open_that_something_else_than_the_handle_has_stopped():
    """Fingers 4 cm apart cannot hold a handle of 1 cm."""
    blocked = {"command": 1.0, "width_m": 0.04}
    assert act(DRAWER, **blocked)[7] == -1.0
    assert act(DRAWER, **blocked, since_s=BLOCKED_S - 0.1)[7] == 1.0
    assert act(DRAWER, **blocked, closed_m=0.005)[7] == 1.0
    assert act(DRAWER._replace(thick_m=0.035), **blocked)[7] == 1.0


@pytest.mark.parametrize("size", [0.9, 1.0, 1.1])
def test_a_thick_handle_of_another_size_counts_as_held(size):
    """Fingers that hold it may be some millimetres farther apart than its thickness."""
    thick = DRAWER._replace(thick_m=0.045)
    held = act(thick, command=1.0, width_m=size * 0.045 + 0.009)
    assert_allclose(held, [0, 0, -1, 0, 0, 0, 0, 1], atol=1e-12)


def test_a_gripper_that_presses_on_the_object_backs_off():
    assert_allclose(act(DRAWER, press_n=PRESS_N - 1.0)[2], 0.0, atol=1e-12)
    back = act(DRAWER, press_n=PRESS_N + 1.0, command=1.0)
    assert back[7] == 1.0
    assert_allclose(back[2], -min(BACK_OFF_M / MOVE_M, SLOW))
    push = DRAWER._replace(shut=True, thick_m=0.0, aim=0.0)
    before = {"T_th": ahead(0.0, 0.0, 0.03), "width_m": 0.0}
    assert_allclose(act(push, **before, press_n=20.0), act(push, **before))


@pytest.mark.parametrize("closes", [False, True])
def test_it_brakes_before_the_target_and_stays_there(closes):
    params = DRAWER._replace(aim=0.04) if closes else DRAWER
    left = [act(params, command=1.0, width_m=0.01, opened=params.aim + e)[2] for e in (-0.01, 0.01)]
    assert left[0] < 0.0 < left[1]
    assert_allclose(np.abs(left), 0.01 * DRAWER.path.span / MOVE_M)


def test_a_door_is_led_on_its_arc_about_the_hinge():
    """The lead is 12 cm, and the pivot 30 cm beside the handle."""
    T_ht, T = pose(np.array([0.01, 0.002, 0.003])), np.empty((4, 4))
    _write_ahead(T_WT[0], T_ht, 0.1, DOOR, T)
    chord = 2.0 * np.linalg.norm(PIVOT) * np.sin(0.005 * DOOR.path.span)
    turn = axis_angle_to_matrix(np.array([1.0, 0.0, 0.0]), 0.12 / chord * 0.01 * DOOR.path.span)
    assert_allclose(T, T_WT[0] @ pose(PIVOT - turn @ PIVOT, turn) @ T_ht, atol=1e-12)


@given(st.lists(st.floats(-0.5, 0.5), min_size=6, max_size=6))
def test_pending_motions_move_the_target_to_first_order(motions):
    out, pending = np.empty((4, 4)), np.array([*motions, 0.0])
    _write_after_pending(T_WT[0], pending, DRAWER, out)
    got = inverse(T_WT[0]) @ out
    vector = TURN_RAD * np.array(motions[3:])
    angle = float(np.linalg.norm(vector))
    turn = axis_angle_to_matrix(vector / max(angle, 1e-12), angle)
    assert_allclose(got, pose(MOVE_M * np.array(motions[:3]), turn), atol=angle**2 + 1e-12)


def test_it_comes_to_the_handle_unless_a_finger_would_meet_its_front():
    """The error of an estimated position, some millimetres beside it, does not keep it back."""

    def stays_back(beside_m, thick_m):
        out, T_ha = np.empty((4, 4)), pose(np.array([0.0, beside_m, -0.05]))
        _write_before(np.eye(4), T_ha, False, 0.0, DRAWER._replace(thick_m=thick_m), out)
        return out[2, 3] < 0.0

    got = [[stays_back(b, t) for b in (0.004, 0.008, 0.03)] for t in (0.012, 0.07)]
    assert got == [[False, False, True], [False, True, True]]
    out = np.empty((4, 4))
    _write_before(np.eye(4), np.eye(4), True, 0.0, DRAWER, out)
    assert_allclose(out, pose(np.array([0.0, 0.0, -RETREAT_M])))


def test_closed_fingers_push_at_the_handle_and_hook_behind_an_edge():
    push = DRAWER._replace(shut=True, thick_m=0.0, aim=0.0)
    assert_allclose(act(push, T_th=ahead(0.0, 0.0, 0.1), width_m=0.0)[2], 1.0)
    pushed = act(push, width_m=0.0, opened=0.3)
    assert_allclose(pushed, [0, 0, 1, 0, 0, 0, 0, 1], atol=1e-12)
    path = DRAWER.path._replace(axis_o=np.array([1.0, 0.0, 0.0]))
    hook = push._replace(hooks=True, path=path, aim=0.8)
    hooked = act(hook, width_m=0.0)
    assert_allclose(hooked[0], 1.0)
    assert_allclose(float(hooked[2]) / float(hooked[0]), HOOKED_M / 0.12, rtol=1e-6)


def test_it_closes_behind_the_middle_of_a_knob_that_has_room_there():
    knob = Handle(
        name="h", joint="j", link="l", kind="knob", source="geometry", pos_l=(0.0, 0.0, 0.0),
        normal_l=(-1.0, 0.0, 0.0),
        along_l=(0.0, 1.0, 0.0), extent=(0.03, 0.03, 0.03),
    )  # fmt: skip
    flat, bar = replace(knob, extent=(0.03, 0.03, 0.01)), replace(knob, kind="bar")
    assert [_deep_m(one) for one in (None, bar, flat, knob)] == [0.0, 0.0, 0.0, DEEP_M]
