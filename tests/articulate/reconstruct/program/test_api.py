"""What the functions of the language do, and what they say to wrong arguments."""

import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.articulate.reconstruct.program import scenes

from articulate.reconstruct.program.api import MAX_CALLS, Builder
from articulate.reconstruct.program.compile import link_plans
from articulate.reconstruct.program.language import FUNCTIONS
from articulate.reconstruct.program.program_parts import parts_of
from articulate.reconstruct.program.values import InvalidValueError


@pytest.fixture(scope="module")
def parts():
    return parts_of(scenes.parts())


@pytest.fixture
def builder(parts):
    return Builder(parts)


def call(builder, function_name, *values, **named):
    function = FUNCTIONS[function_name]
    given = {**function.optional, **dict(zip(function.names, values, strict=False)), **named}
    plain = {k: list(v) if isinstance(v, tuple) else v for k, v in given.items()}
    return builder.answer(function_name, plain)


def box(builder, part):
    return np.array(call(builder, "box", part))


def test_boxes_corners_and_vertices_follow_the_part(builder):
    call(builder, "place", "handle", (1, 2, 3))
    np.testing.assert_allclose(box(builder, "handle"), [[0.985, 1.94, 2.99], [1.015, 2.06, 3.01]])
    corners = call(builder, "corners", "handle")
    assert len(corners) == 8
    np.testing.assert_allclose(corners[1], [0.985, 1.94, 3.01])
    np.testing.assert_allclose(sorted(corners), sorted(call(builder, "vertices", "handle")))


def test_a_part_turns_about_the_middle_of_its_box_or_a_pivot(builder):
    call(builder, "place", "handle", (1, 0, 0))
    call(builder, "rotate", "handle", (0, 0, 2), np.pi / 2)
    np.testing.assert_allclose(box(builder, "handle").mean(axis=0), [1, 0, 0], atol=1e-12)
    np.testing.assert_allclose(np.ptp(box(builder, "handle"), axis=0), [0.12, 0.03, 0.02])
    call(builder, "rotate", "handle", (0, 0, 1), np.pi / 2, pivot=(0, 0, 0))
    np.testing.assert_allclose(box(builder, "handle").mean(axis=0), [0, 1, 0], atol=1e-12)


def test_outside_a_part_comes_to_rest_on_the_surface_and_not_on_the_box(builder):
    """The drawer comes from the front and goes in up to the back wall."""
    call(builder, "place", "drawer", (0, 0, 0.2))
    call(builder, "place_relative_to", "drawer", "body", "front")
    assert box(builder, "drawer")[0, 0] == pytest.approx(-0.18, abs=1e-6)


def test_without_snap_a_part_stays_at_the_box(builder):
    call(builder, "place", "drawer", (0, 0, 0.2))
    call(builder, "place_relative_to", "drawer", "body", "front", snap=False, clearance=0.01)
    assert box(builder, "drawer")[0, 0] == pytest.approx(0.21, abs=1e-9)


def test_clearance_is_the_gap_to_the_surface(builder):
    call(builder, "place", "drawer", (0, 0, 0.2))
    call(builder, "place_relative_to", "drawer", "body", "front", clearance=0.015)
    assert box(builder, "drawer")[0, 0] == pytest.approx(-0.165, abs=1e-6)


def test_inside_a_part_goes_from_the_middle_to_the_wall(builder):
    call(builder, "place_relative_to", "drawer", "body", "below_inside", align=True)
    assert box(builder, "drawer")[0, 2] == pytest.approx(0.02, abs=1e-6)
    call(builder, "place_relative_to", "drawer", "body", "above_inside", clearance=0.05)
    assert box(builder, "drawer")[1, 2] == pytest.approx(0.68 - 0.05, abs=1e-6)


def test_inside_towards_an_opening_a_part_ends_flush(builder):
    call(builder, "place_relative_to", "drawer", "body", "below_inside", align=True)
    call(builder, "place_relative_to", "drawer", "body", "front_inside")
    assert box(builder, "drawer")[1, 0] == pytest.approx(0.2, abs=1e-6)
    assert not builder.placed[-1].touches


def test_plain_inside_brings_the_middles_together_if_asked(builder):
    call(builder, "place", "drawer", (3, 3, 3))
    call(builder, "place_relative_to", "drawer", "body", "inside")
    np.testing.assert_allclose(box(builder, "drawer").mean(axis=0), [3, 3, 3])
    call(builder, "place_relative_to", "drawer", "body", "inside", align=True)
    np.testing.assert_allclose(box(builder, "drawer").mean(axis=0), [0, 0, 0.35], atol=1e-9)


def test_what_was_placed_before_stands_in_the_way_and_what_was_not_does_not(builder):
    call(builder, "place_relative_to", "door", "body", "above", align=True)
    on_body = box(builder, "door")[0, 2]
    call(builder, "place_relative_to", "handle", "body", "above", align=True)
    assert box(builder, "handle")[0, 2] == pytest.approx(0.7, abs=1e-6)  # the box's face
    fresh = Builder(builder.parts)
    call(fresh, "place", "door", (0.1, 0, 0.8))  # a shelf above the cabinet
    call(fresh, "place", "handle", (0.1, 0, 2))
    call(fresh, "place_relative_to", "handle", "door", "above")
    assert box(fresh, "handle")[0, 2] == pytest.approx(0.95, abs=1e-6)
    assert on_body == pytest.approx(0.7, abs=1e-6)


def test_the_record_says_what_a_placement_did(builder):
    call(builder, "place_relative_to", "door", "body", "front")
    record = builder.placed[-1]
    assert (record.child, record.parent, record.placement) == ("door", "body", "front")
    assert record.touches
    assert record.checked_by[0] == "sweep"
    assert record.moved_m[1:] == (0.0, 0.0)


def test_what_nothing_joins_is_fixed_to_what_it_was_placed_at(builder):
    call(builder, "place_relative_to", "door", "body", "front")
    call(builder, "place_relative_to", "handle", "door", "front")
    built = builder.built(())
    assert built.root == "body"
    assert {j.child: (j.kind, j.parent) for j in built.joints} == {
        "door": ("fixed", "body"), "handle": ("fixed", "door"), "drawer": ("fixed", "body"),
    }  # fmt: skip
    assert "drawer has no joint: fixed to body" in built.notes


def test_parts_placed_at_each_other_in_a_circle_still_make_a_tree(builder):
    for child, parent in (
        ("door", "body"),
        ("body", "handle"),
        ("handle", "door"),
        ("drawer", "door"),
    ):
        call(builder, "place_relative_to", child, parent, "front", snap=False)
    built = builder.built(())
    above = {joint.child: joint.parent for joint in built.joints}
    for part in built.parts:
        at, steps = part.name, 0
        while at != built.root:
            at, steps = above[at], steps + 1
            assert steps < 5


def test_a_root_can_be_chosen(builder):
    call(builder, "root", "door")
    call(builder, "fixed", "body", "door")
    assert builder.built(()).root == "door"


WRONG = {
    "unknown part": (("box", "bodi"), "did you mean body?"),
    "number for a name": (("box", 3), "not known"),
    "unknown placement": (("place_relative_to", "door", "body", "on top"), "there are: above"),
    "itself": (("place_relative_to", "door", "door"), "relative to itself"),
    "two numbers": (("place", "door", (1, 2)), "three numbers were expected"),
    "text in a vector": (("move", "door", (1, "2", 3)), "a number was expected"),
    "not a number": (("move", "door", (1, float("nan"), 3)), "a number was expected"),
    "endless": (("move", "door", (1, float("inf"), 3)), "a number was expected"),
    "truth for a number": (("rotate", "door", (0, 0, 1), True), "a number was expected"),
    "no direction": (("rotate", "door", (0, 0, 0), 1), "the axis is zero"),
    "snap as text": (("place_relative_to", "door", "body", "front", 0, "yes"), "True or False"),
    "material": (("material", "door", "gold"), "there are: wood"),
    "limits": (("prismatic", "door", "body", (1, 0, 0), 1, 0), "swap them"),
    "one limit": (("prismatic", "door", "body", (1, 0, 0), 1, None), "upper is None"),
    "degrees": (("revolute", "door", "body", (0, 0, 1), (0, 0, 0), 0, 90), "radians(90)"),
    "joint to itself": (("fixed", "door", "door"), "form a cycle"),
    "damping": (("continuous", "door", "body", (0, 0, 1), (0, 0, 0), None, -1), "0 or more"),
    "follower": (("mimic", "a", "b"), "joint 'a' is not known"),
    "frame taken": (("frame", "door"), "is already used"),
    "frame unseen": (("frame", "a\nb"), "visible characters"),
    "empty name": (("fixed", "door", "body", ""), "visible characters"),
}  # fmt: skip


@pytest.mark.parametrize("case", WRONG)
def test_wrong_arguments_are_refused_with_a_sentence(builder, case):
    given, words = WRONG[case]
    with pytest.raises(InvalidValueError, match=r".") as caught:
        call(builder, *given)
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_joined_part_is_not_moved_any_more(builder):
    call(builder, "fixed", "door", "body")
    for part in ("door", "body"):
        with pytest.raises(InvalidValueError, match="place it before joining"):
            call(builder, "move", part, (1, 0, 0))


def test_joints_make_a_tree_with_names_of_their_own(builder):
    call(builder, "fixed", "door", "body", "hinge")
    for wanted, words in (
        (("fixed", "door", "handle"), "child of joint hinge already"),
        (("fixed", "body", "door"), "form a cycle"),
        (("fixed", "handle", "body", "hinge"), "called 'hinge' already"),
        (("root", "door"), "no root"),
    ):
        with pytest.raises(InvalidValueError, match=words):
            call(builder, *wanted)
    call(builder, "root", "body")
    with pytest.raises(InvalidValueError, match="it has no joint"):
        call(builder, "fixed", "body", "handle")


def test_joints_do_not_follow_in_circles(builder):
    for child in ("door", "handle", "drawer"):
        call(builder, "prismatic", child, "body", (1, 0, 0), 0, 1, name=child)
    call(builder, "mimic", "door", "handle", -2, 0.5)
    call(builder, "mimic", "handle", "drawer")
    for follower, leader in (("drawer", "door"), ("door", "door")):
        with pytest.raises(InvalidValueError, match="in a cycle"):
            call(builder, "mimic", follower, leader)
    assert builder.joints["door"].mimic == ("handle", -2.0, 0.5)


DEEP: list[object] = []
for _ in range(5000):
    DEEP = [DEEP]


@pytest.mark.parametrize(
    ("name", "arguments"),
    [
        ("box", {"part": DEEP}), ("move", {"part": "door", "by": DEEP}), ("frame", {"name": DEEP}),
        ("__init__", {}), ("built", {"layers": []}), ("_join", {}), (None, {}), (["box"], {}),
        ("box", None), ("box", {}), ("box", {"part": "door", "self": 1}), ("box", [1]),
        ("move", {"part": "door", "by": {"x": 1}}), ("box", {"part": {"a": [1]}}),
        ("move", {"part": "door", "by": [[1], [2], [3]]}), ("frame", {"name": ["x"]}),
        ("place", {"part": "door", "position": [0, 0, 0], "rpy": [1e308, 0, 0]}),
        ("place", {"part": "door", "position": [10**400, 0, 0], "rpy": [0, 0, 0]}),
    ],
)  # fmt: skip
def test_forged_calls_are_refused(builder, name, arguments):
    with pytest.raises(InvalidValueError):
        builder.answer(name, arguments)


def test_calls_are_counted(builder):
    for _ in range(MAX_CALLS):
        builder.answer("parts", {})
    with pytest.raises(InvalidValueError, match="shorten the program"):
        builder.answer("parts", {})


scalars = st.one_of(
    st.none(), st.booleans(), st.integers(), st.floats(), st.text(max_size=5),
    st.sampled_from(["body", "door", "handle", "drawer", "front", "inside", "wood", "door_joint"]),
)  # fmt: skip
vectors = st.lists(st.floats(-5, 5), min_size=3, max_size=3)
anything = st.recursive(
    st.one_of(scalars, vectors),
    lambda inner: (
        st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=3), inner, max_size=2)
    ),
    max_leaves=6,
)


@settings(max_examples=60)
@given(st.lists(st.sampled_from(sorted(FUNCTIONS)), max_size=12), st.data())
def test_no_arguments_make_the_parent_raise_anything_but_a_refusal(parts, names, data):
    builder = Builder(parts)
    for name in names:
        arguments = {key: data.draw(anything) for key in FUNCTIONS[name].names}
        try:
            answer = builder.answer(name, arguments)
        except InvalidValueError as refused:
            answer = str(refused)
        json.dumps(answer, allow_nan=False)
    built = builder.built(())
    assert len(built.joints) == len(built.parts) - 1
    assert next(iter(link_plans(built))) == built.root
    assert built.json()
