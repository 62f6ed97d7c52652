import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from tests.assets import make_cabinet, make_cupboard

from articulate.asset import Joint
from articulate.task import (
    TASK_RULES,
    Limits,
    Task,
    at_target,
    beyond_target,
    fraction,
    make_task,
    matching_joints,
    no_joint_error,
    part_kind,
)


@pytest.fixture(scope="module")
def cabinet(tmp_path_factory):
    return make_cabinet(tmp_path_factory.mktemp("cabinet"))


@pytest.fixture(scope="module")
def cupboard(tmp_path_factory):
    return make_cupboard(tmp_path_factory.mktemp("cupboard"))


def joint(kind="slide", axis=(-1.0, 0.0, 0.0), lower=0.0, upper=0.3, closed=0.0, opened=0.3):
    return Joint(
        name="j",
        kind=kind,
        link="part",
        parent="body",
        axis_o=axis,
        pivot_o=(0.0, 0.0, 0.0),
        lower=lower,
        upper=upper,
        closed=closed,
        open=opened,
        closed_rule="given",
    )


@pytest.mark.parametrize(
    ("kind", "axis", "part"),
    [
        ("slide", (-1.0, 0.0, 0.0), "drawer"),
        ("slide", (0.0, 1.0, 0.0), "drawer"),
        ("slide", (0.0, 0.0, 1.0), "lid"),
        ("hinge", (0.0, 0.0, -1.0), "door"),
        ("hinge", (0.0, 1.0, 0.0), "lid"),
        ("hinge", (0.6, 0.0, 0.8), "door"),
        ("hinge", (0.8, 0.0, 0.6), "lid"),
    ],
)
def test_a_level_slide_is_a_drawer_a_steep_hinge_a_door_and_the_rest_are_lids(kind, axis, part):
    assert part_kind(joint(kind=kind, axis=axis)) == part


def test_open_drawer_matches_drawers_and_open_joint_matches_all(cabinet, cupboard):
    assert matching_joints("open_drawer", cabinet) == cabinet.joints
    assert matching_joints("open_drawer", cupboard) == ()
    assert matching_joints("open_joint", cupboard) == cupboard.joints


def with_joint(asset, item):
    return dataclasses.replace(asset, joints=(dataclasses.replace(item, name="j"),))


def test_target_of_a_slide_is_four_fifths_of_its_range(cabinet):
    task = make_task("open_drawer", cabinet, "drawer_1_slide")
    assert task.target * task.span == pytest.approx(0.8 * 0.28)
    assert (task.kind, task.slow) == ("slide", 0.02)


def test_target_of_a_narrow_hinge_is_four_fifths_of_its_range(cupboard):
    door = joint("hinge", (0.0, 0.0, 1.0), upper=np.pi / 3, opened=np.pi / 3)
    task = make_task("open_joint", with_joint(cupboard, door), "j")
    assert task.target == pytest.approx(0.8)
    assert task.slow == 0.1


def test_target_of_a_wide_hinge_is_four_fifths_of_a_quarter_turn(cupboard):
    task = make_task("open_joint", cupboard, "door_hinge")
    assert task.target * task.span == pytest.approx(0.8 * np.pi / 2)


def test_target_of_a_joint_that_turns_without_end_is_a_quarter_turn(cupboard):
    knob = joint("hinge", (1.0, 0.0, 0.0), lower=None, upper=None, opened=np.pi / 2)
    task = make_task("open_joint", with_joint(cupboard, knob), "j")
    assert task.target * task.span == pytest.approx(np.pi / 2)


def test_target_of_a_joint_that_opens_backwards_has_its_sign(cabinet):
    back = joint(lower=-0.3, upper=0.0, closed=0.0, opened=-0.3)
    task = make_task("open_drawer", with_joint(cabinet, back), "j")
    assert task.span == pytest.approx(-0.3)
    assert task.target == pytest.approx(0.8)


@given(closed=st.floats(-2, 2), span=st.floats(0.1, 3), sign=st.sampled_from([-1, 1]))
def test_fraction_is_0_when_closed_and_1_at_the_open_end(closed, span, sign):
    q = np.array([closed, closed + sign * span, closed + 2 * sign * span])
    part = fraction(q, np.full(3, closed), np.full(3, sign * span))
    assert_allclose(part, [0, 1, 2], atol=1e-9)


def test_part_is_at_its_target_only_at_rest_and_in_both_directions_of_motion():
    task = Task(name="open_joint", joint="j", kind="slide", span=0.3, target=0.8)
    opened = np.array([0.8, 0.8, 0.8, 0.79, 1.1])
    speed = np.array([0.0, task.slow, -task.slow, 0.0, 0.0])
    assert at_target(task, opened, speed).tolist() == [True, False, False, False, True]
    assert beyond_target(task, opened).tolist() == [True, True, True, False, True]


def test_unknown_names_and_joints_are_refused_with_what_exists(error_line, cabinet, cupboard):
    error_line('make_task("open_drawr", ...)', lambda: make_task("open_drawr", cabinet, "x"))
    error_line('make_task("boil", ...)', lambda: make_task("boil", cabinet, "x"))
    error_line(
        'make_task("open_drawer", cabinet, "drawer_9_slide")',
        lambda: make_task("open_drawer", cabinet, "drawer_9_slide"),
    )
    error_line(
        'make_task("open_drawer", cupboard, "door_hinge")',
        lambda: make_task("open_drawer", cupboard, "door_hinge"),
    )


def test_an_object_without_a_joint_for_the_task_says_what_it_has(cupboard):
    message = str(no_joint_error("open_drawer", cupboard))
    assert message == "cupboard: no joint for open_drawer; it has door_hinge (door)"
    bare = dataclasses.replace(cupboard, joints=())
    assert str(no_joint_error("open_drawer", bare)).endswith("it has no movable joint")


def test_rules_that_would_loosen_the_judgement_are_refused(error_line, cabinet):
    error_line("Limits(speed_share=1.1)", lambda: Limits(speed_share=1.1))
    error_line("Limits(filter_s=0.06)", lambda: Limits(filter_s=0.06))
    error_line(
        'make_task("open_drawer", cabinet, "drawer_0_slide", episode_s=11)',
        lambda: make_task("open_drawer", cabinet, "drawer_0_slide", episode_s=11.0),
    )


@pytest.mark.parametrize("name", TASK_RULES)
def test_every_task_can_be_asked_of_a_drawer(name, cabinet):
    assert make_task(name, cabinet, "drawer_0_slide").name == name
