import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from articulate.robot.arm import PANDA
from articulate.robot.control import new_gripper_state
from articulate.robot.kinematics import resolve_motion, tool_jacobian, tool_pose
from articulate.task.object_placement import HandlePath
from articulate.task.observation import (
    ACTION,
    COMMAND_TIME_S,
    OBSERVATION,
    Estimate,
    ObservationInputs,
    ObservationParams,
    observation,
)
from articulate.task.scripted_expert import ExpertParams
from articulate.transforms import axis_angle_to_matrix, pose

HOME = np.asarray(PANDA.home)[None]


STEP_S = 0.05
EXPERT = ExpertParams(
    move_m=0.008, turn_rad=0.02,
    path=HandlePath(False, np.array([0.0, 0.0, -1.0]), np.zeros(3), np.eye(4), 0.0, 0.4),
    along_m=0.03, thick_m=0.01, deep_m=0.0, beside_m=0.0,
    shut=False, hooks=False, aim=0.86,
)  # fmt: skip


def observe(*, T_wh=None, q=HOME, **values):
    """Observation of one robot at rest, except for ``values``."""
    given = {
        "dq": np.zeros((1, 7)),
        "target": q,
        "gripper_width": np.array([0.08]),
        "gripper_speed": np.zeros(1),
        "measured_force": np.zeros((1, 3)),
        "gripper": new_gripper_state(1),
        "estimate": Estimate(tool_pose(PANDA, q) if T_wh is None else T_wh, *np.zeros((2, 1))),
        "last_action": np.zeros((1, 8)),
        "pending_actions": np.zeros((1, 7)),
        "time_left": 1.0,
        "goal": 0.8,
        "closes": False,
    } | values
    width = given["gripper_width"]
    inputs = ObservationInputs(
        q=q,
        dq=given["dq"],
        target=given["target"],
        T_wt=tool_pose(PANDA, q),
        T_wt_target=tool_pose(PANDA, given["target"]),
        gripper=given["gripper"],
        gripper_width=width,
        last_gripper_width=width - STEP_S * given["gripper_speed"],
        pending_actions=given["pending_actions"],
        last_action=given["last_action"],
    )
    params = ObservationParams(
        STEP_S,
        0.008,
        given["goal"],
        given["closes"],
        direction_h=np.array([0.0, 0.0, -1.0]),
        rotation_h=np.zeros(3),
        travel_m=0.4,
        handle_size=np.array([0.1, 0.01, 0.02]),
        expert=EXPERT,
    )
    force, left = given["measured_force"], given["time_left"]
    return observation(inputs, given["estimate"], force, left, params)[0]


def resolved(twist):
    """Joint motion (1, 7) at home for a small motion of the tool (1, 6)."""
    out = np.empty(7)
    jacobian = tool_jacobian(PANDA, HOME[0], in_tool=True)
    resolve_motion(jacobian, twist[0].copy(), 0.02, np.empty((6, 6)), out)
    return out[None]


def field(vector, name):
    return vector[OBSERVATION.slice(name)]


def test_handle_in_the_hand_is_the_origin_with_the_tools_axes():
    seen = observe()
    assert_allclose(field(seen, "handle_pos"), 0, atol=1e-12)
    assert_allclose(field(seen, "handle_axes"), [0, 0, 1, 1, 0, 0], atol=1e-12)


def test_handle_ten_centimetres_before_the_hand_is_half_a_unit_along_z():
    T_wh = tool_pose(PANDA, HOME) @ pose(np.array([0.0, 0.0, 0.1]))
    assert_allclose(field(observe(T_wh=T_wh), "handle_pos"), [0, 0, 0.5], atol=1e-12)


@pytest.mark.parametrize(("ahead_m", "seen"), [(0.01, 0.5), (-0.03, -1.5), (0.1, 1.5)])
def test_near_field_is_fine_and_ends_three_centimetres_from_the_handle(ahead_m, seen):
    T_wh = tool_pose(PANDA, HOME) @ pose(np.array([0.0, 0.0, ahead_m]))
    assert_allclose(field(observe(T_wh=T_wh), "handle_pos_fine"), [0, 0, seen], atol=1e-12)


def test_handle_is_aimed_at_from_the_target_and_less_what_is_due():
    """Ten centimetres ahead, of which the target has made one and two late motions take 16 mm."""
    T_wh = tool_pose(PANDA, HOME) @ pose(np.array([0.0, 0.0, 0.1]))
    twist = np.array([[0, 0, 0.01, 0, 0, 0]])
    target = HOME + resolved(twist)
    due = np.array([[0.0, 0.0, 2.0, 0.5, 0.0, 0.0, 1.0]])
    seen = observe(T_wh=T_wh, target=target, pending_actions=due)
    assert_allclose(field(seen, "handle_pos_predicted"), [0, 0, 0.074 / 0.2], atol=5e-3)
    assert_allclose(field(seen, "handle_pos"), [0, 0, 0.5], atol=1e-12)
    seen = observe(
        T_wh=tool_pose(PANDA, HOME) @ pose(np.array([0.01, 0.0, 0.0])), pending_actions=due
    )
    assert_allclose(field(seen, "handle_pos_predicted_fine"), [0.5, 0, -0.8], atol=1e-12)


def test_handle_aimed_at_from_a_target_that_is_reached_is_where_it_is():
    T_wh = tool_pose(PANDA, HOME) @ pose(np.array([0.02, -0.01, 0.3]))
    seen = observe(T_wh=T_wh)
    assert_allclose(field(seen, "handle_pos_predicted"), field(seen, "handle_pos"), atol=1e-12)
    assert_allclose(
        field(seen, "handle_pos_predicted_fine"), field(seen, "handle_pos_fine"), atol=1e-12
    )


@given(angle=st.floats(-1, 1), seed=st.integers(0, 1000))
def test_robot_and_object_turned_together_about_the_base_look_the_same(angle, seed):
    """Nothing but the first joint's angle knows where the world's x axis points."""
    rng = np.random.default_rng(seed)
    T_wh = pose(rng.normal(size=(1, 3)) * 0.3 + [0.6, 0, 0.5])
    turn = pose(np.zeros(3), axis_angle_to_matrix([0, 0, 1], angle))
    q = HOME + np.array([angle, 0, 0, 0, 0, 0, 0])
    a, b = observe(T_wh=T_wh), observe(T_wh=turn @ T_wh, q=q)
    a[0] = b[0] = 0.0
    assert_allclose(a, b, atol=1e-9)


def test_target_ahead_of_the_tool_is_a_lead_in_the_tools_frame():
    """A target 1 mm along the tool's z and turned by 0.004 rad about its x."""
    twist = np.array([[0, 0, 0.001, 0.004, 0, 0]])
    target = HOME + resolved(twist)
    seen = field(observe(target=target), "tracking_error")
    assert_allclose(seen, [0, 0, 0.02, 0.02, 0, 0], atol=6e-4)


@pytest.mark.parametrize(
    ("name", "values", "expected"),
    [
        ("joint_vel", {"dq": np.full((1, 7), 0.3)}, 0.3),
        ("joint_tracking_error", {"target": HOME + 0.05}, 0.5),
        ("gripper_width", {"gripper_width": np.array([0.04])}, 0.8),
        ("gripper_speed", {"gripper_speed": np.array([-0.1])}, -1.0),
        ("last_action", {"last_action": np.full((1, 8), -0.2)}, -0.2),
        ("pending_actions", {"pending_actions": np.full((1, 7), 1.5)}, 1.5),
        ("time_left", {"time_left": 0.25}, 0.25),
        (
            "part_open",
            {"estimate": Estimate(np.eye(4)[None], np.array([0.4]), np.array([0.03]))},
            0.4,
        ),
        (
            "goal_error_fine",
            {"estimate": Estimate(np.eye(4)[None], np.array([0.79]), np.zeros(1))},
            -0.2,
        ),
        (
            "goal_error_fine",
            {"estimate": Estimate(np.eye(4)[None], np.zeros(1), np.zeros(1))},
            -4.0,
        ),
        (
            "goal_error_fine",
            {"estimate": Estimate(np.eye(4)[None], np.array([0.85]), np.zeros(1))},
            1.0,
        ),
        *(
            (
                "goal_error_fine",
                {
                    "estimate": Estimate(np.eye(4)[None], np.array([opened]), np.zeros(1)),
                    "goal": 0.05,
                    "closes": True,
                },
                beyond,
            )
            for opened, beyond in ((0.06, -0.2), (0.02, 0.6), (0.0, 1.0), (-0.06, -0.2))
        ),
        (
            "part_speed",
            {"estimate": Estimate(np.eye(4)[None], np.array([0.4]), np.array([0.03]))},
            0.3,
        ),
    ],
)
def test_each_field_has_the_unit_that_its_layout_says(name, values, expected):
    assert_allclose(field(observe(**values), name), expected, atol=1e-12)


def test_force_is_felt_in_the_axes_of_the_tool():
    """At home the tool points ahead along x: what pushes the hand back pushes against its z."""
    T_wt = tool_pose(PANDA, HOME)[0]
    back = field(observe(measured_force=np.array([[-20.0, 0.0, 0.0]])), "measured_force")
    assert_allclose(back, [0, 0, -2], atol=5e-3)
    along_y = observe(measured_force=5.0 * T_wt[:3, 1][None])
    assert_allclose(field(along_y, "measured_force"), [0, 0.5, 0], atol=1e-12)


def test_hand_command_shows_the_time_since_it_was_sent():
    gripper = new_gripper_state(1)
    gripper.since_s[:] = COMMAND_TIME_S / 4
    gripper.smooth[:], gripper.command[:] = 0.3, 1.0
    assert_allclose(field(observe(gripper=gripper), "gripper_command"), [0.3, 1.0, 0.25])
    gripper.since_s[:] = 100.0
    assert field(observe(gripper=gripper), "gripper_command")[2] == 1.0


def test_values_out_of_bounds_are_clipped():
    far = observe(T_wh=pose(np.array([[100.0, 0.0, 0.0]])))
    assert np.all((far >= OBSERVATION.low) & (far <= OBSERVATION.high))


def test_action_is_a_motion_of_seven_numbers_and_a_hand_within_one():
    assert ACTION.size == 8
    assert ACTION.slice("gripper") == slice(7, 8)
    assert (ACTION.low.min(), ACTION.high.max()) == (-1, 1)


def test_nothing_a_robot_cannot_know_is_observed():
    assert {f.source for f in OBSERVATION.fields} <= {
        "robot",
        "estimator",
        "controller",
        "clock",
        "policy",
        "expert",
    }
