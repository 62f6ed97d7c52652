import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from tests.assets import make_cabinet, make_cupboard

from articulate.assets.asset import Joint
from articulate.task.task import (
    TASK_RULES,
    Limits,
    Task,
    fraction_open,
    goal_params,
    is_at_goal,
    is_at_rest,
    make_task,
    matching_joints,
    matching_tasks,
    no_joint_error,
)


def beyond_target(task, opened):
    """True for each part at or beyond the target."""
    return [is_at_goal(goal_params(task), each) for each in opened]


def at_target(task, opened, speed):
    """True for each part that is also at rest."""
    goal = goal_params(task)
    return [is_at_rest(goal, *each) for each in zip(opened, speed, strict=True)]


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


@pytest.mark.parametrize("verb", ["open", "close"])
def test_tasks_match_the_joints_of_their_part_and_joint_matches_all(verb, cabinet, cupboard):
    assert matching_joints(f"{verb}_drawer", cabinet) == cabinet.joints
    assert matching_joints(f"{verb}_door", cabinet) == ()
    assert matching_joints(f"{verb}_drawer", cupboard) == ()
    assert matching_joints(f"{verb}_door", cupboard) == cupboard.joints
    assert matching_joints(f"{verb}_joint", cupboard) == cupboard.joints


def test_tasks_of_a_joint_are_those_that_match_it(cupboard):
    names = matching_tasks(cupboard, cupboard.joint("door_hinge"))
    assert names == ("open_door", "close_door", "open_joint", "close_joint")


def with_joint(asset, item):
    """The asset with ``item`` as its only joint ``j``, which moves its last link, ``part``."""
    last = dataclasses.replace(asset.links[-1], name="part")
    item = dataclasses.replace(item, name="j", link="part")
    return dataclasses.replace(asset, links=(*asset.links[:-1], last), joints=(item,))


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


def test_opening_begins_closed_and_may_run_into_the_end_of_the_range(cabinet):
    task = make_task("open_drawer", cabinet, "drawer_1_slide")
    assert (task.begin, task.stop, task.closes, task.far) == ((0.0, 0.0), 1.0, False, task.target)


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize(
    ("kind", "reach", "first"),
    [
        ("slide", 0.3, 0.8),
        ("hinge", np.pi / 3, 0.8),
        ("hinge", np.pi / 2, 0.8),
        ("hinge", np.pi, 0.4),
    ],
)
def test_closing_begins_between_half_and_all_of_the_open_target_and_ends_at_a_twentieth(
    kind, reach, first, sign, cupboard
):
    low, high = sorted((0.0, sign * reach))
    part = joint(kind, (0.0, 0.0, 1.0), lower=low, upper=high, opened=sign * reach)
    task = make_task("close_joint", with_joint(cupboard, part), "j")
    assert task.begin == pytest.approx((first / 2, first))
    assert task.target == 0.05
    assert (task.stop, task.closes, task.far) == (0.0, True, task.begin[1])
    assert task.span == pytest.approx(sign * reach)


def test_closing_a_joint_of_many_turns_asks_for_half_of_where_it_may_begin(cupboard):
    screw = joint("hinge", (0.0, 0.0, 1.0), upper=20 * np.pi, opened=20 * np.pi)
    task = make_task("close_joint", with_joint(cupboard, screw), "j")
    assert task.begin[0] == pytest.approx(0.01)
    assert task.target == pytest.approx(0.005)


def test_joint_that_turns_without_end_is_closed_from_a_quarter_turn_and_has_no_stop(cupboard):
    knob = joint("hinge", (0.0, 0.0, 1.0), lower=None, upper=None, opened=-np.pi / 2)
    asset = with_joint(cupboard, knob)
    opening, closing = (make_task(f"{verb}_joint", asset, "j") for verb in ("open", "close"))
    assert (opening.target, opening.stop) == (1.0, None)
    assert (closing.begin, closing.target, closing.stop) == ((0.5, 1.0), 0.05, None)
    assert closing.span == pytest.approx(-np.pi / 2)


def test_closed_is_within_the_target_on_either_side_of_the_closed_end_and_at_rest(cabinet):
    task = make_task("close_drawer", cabinet, "drawer_1_slide")
    opened = np.array([0.05, 0.0, -0.04, -0.06, 0.051, 0.8, 0.0, 0.0])
    speed = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.02, -0.019])
    beyond = [True, True, True, False, False, False, True, True]
    assert beyond_target(task, opened) == beyond
    assert at_target(task, opened, speed) == [*beyond[:6], False, True]


@given(closed=st.floats(-2, 2), span=st.floats(0.1, 3), sign=st.sampled_from([-1, 1]))
def test_fraction_is_0_when_closed_and_1_at_the_open_end(closed, span, sign):
    q = np.array([closed, closed + sign * span, closed + 2 * sign * span])
    part = fraction_open(q, np.full(3, closed), np.full(3, sign * span))
    assert_allclose(part, [0, 1, 2], atol=1e-9)


def test_part_is_at_its_target_only_at_rest_and_in_both_directions_of_motion():
    task = Task(name="open_joint", joint="j", kind="slide", span=0.3, target=0.8)
    opened = np.array([0.8, 0.8, 0.8, 0.79, 1.1])
    speed = np.array([0.0, task.slow, -task.slow, 0.0, 0.0])
    assert at_target(task, opened, speed) == [True, False, False, False, True]
    assert beyond_target(task, opened) == [True, True, True, False, True]


def test_unknown_names_and_joints_are_refused_with_what_exists(error_line, cabinet, cupboard):
    error_line('make_task("open_drawr", ...)', lambda: make_task("open_drawr", cabinet, "x"))
    error_line('make_task("boil", ...)', lambda: make_task("boil", cabinet, "x"))
    error_line(
        'make_task("open_drawer", cabinet, "drawer_9_slide")',
        lambda: make_task("open_drawer", cabinet, "drawer_9_slide"),
    )
    error_line(
        'make_task("close_lid", cabinet, "drawer_1_slide")',
        lambda: make_task("close_lid", cabinet, "drawer_1_slide"),
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
def test_every_task_can_be_asked_of_some_part(name, cabinet, cupboard):
    lid = joint("hinge", (0.0, 1.0, 0.0), upper=1.5, opened=1.5)
    lids = dataclasses.replace(with_joint(cupboard, lid), name="box")
    flat = dataclasses.replace(lids.links[-1], bounds_l=((0.0, 0.0, 0.0), (0.4, 0.4, 0.02)))
    lids = dataclasses.replace(lids, links=(lids.links[0], flat))
    asset = {"drawer": cabinet, "door": cupboard, "lid": lids, "joint": lids}[name.split("_")[1]]
    task = make_task(name, asset, asset.joints[0].name)
    assert (task.name, task.closes) == (name, name.startswith("close"))


@pytest.mark.parametrize(
    "asked",
    [
        {"name": "open_sesame"},
        {"span": 0.0},
        {"span": float("nan")},
        {"hold_s": 0.0},
        {"hold_s": 11.0},
        {"episode_s": 20.0},
    ],
    ids=repr,
)
def test_tasks_that_mean_nothing_are_refused(asked, error_line):
    sound = Task(name="open_joint", joint="j", kind="slide", span=0.3, target=0.8)
    error_line(f"Task(**{asked})", lambda: dataclasses.replace(sound, **asked))


@pytest.mark.parametrize(
    "asked", [{"torque_share": 1.5}, {"force_n": 0.0}, {"moment_nm": -1.0}], ids=repr
)
def test_limits_that_limit_nothing_are_refused(asked, error_line):
    error_line(f"Limits(**{asked})", lambda: Limits(**asked))
