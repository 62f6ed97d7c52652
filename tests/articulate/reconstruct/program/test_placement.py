"""Placements by closed forms: one formula for all sides."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from articulate.reconstruct.program.language import PLACEMENTS
from articulate.reconstruct.program.placement import TABLE, centred, shift

PARENT = np.array([[-1.0, -2.0, -3.0], [1.0, 2.0, 3.0]])
CHILD = np.array([[9.0, 9.0, 9.0], [9.5, 9.7, 9.9]])  # sides 0.5, 0.7, 0.9
EXPECTED = {
    # axis, lower and upper coordinate of the child afterwards, with a clearance of 0.1
    "above": (2, 3.1, 4.0),
    "above_inside": (2, 2.0, 2.9),
    "below": (2, -4.0, -3.1),
    "below_inside": (2, -2.9, -2.0),
    "left": (1, -2.8, -2.1),
    "left_inside": (1, -1.9, -1.2),
    "right": (1, 2.1, 2.8),
    "right_inside": (1, 1.2, 1.9),
    "front": (0, 1.1, 1.6),
    "front_inside": (0, 0.4, 0.9),
    "back": (0, -1.6, -1.1),
    "back_inside": (0, -0.9, -0.4),
}


def side_of(name):
    side = TABLE[name]
    assert side is not None
    return side


def test_the_table_has_all_placements_in_the_order_of_the_language():
    assert tuple(TABLE) == PLACEMENTS
    assert len(PLACEMENTS) == 13
    assert {*EXPECTED, "inside"} == set(PLACEMENTS)


@pytest.mark.parametrize("name", EXPECTED)
def test_a_placement_puts_the_child_where_its_name_says(name):
    side = side_of(name)
    axis, low, high = EXPECTED[name]
    way = shift(side, CHILD, PARENT, 0.1)
    assert side.axis == axis
    np.testing.assert_allclose(CHILD[:, axis] + way, [low, high], atol=1e-12)


@given(
    st.sampled_from(sorted(EXPECTED)),
    st.tuples(*[st.floats(-5, 5)] * 6),
    st.tuples(*[st.floats(-5, 5)] * 6),
    st.floats(-1, 1),
)
def test_mirrored_sides_give_mirrored_ways(name, child, parent, clearance):
    swap = {"above": "below", "left": "right", "front": "back"}
    swap |= {value: key for key, value in swap.items()}
    word, _, rest = name.partition("_")
    mirrored = swap[word] + (f"_{rest}" if rest else "")
    boxes = [np.sort(np.reshape(values, (2, 3)), axis=0) for values in (child, parent)]
    way = shift(side_of(name), boxes[0], boxes[1], clearance)
    back = shift(side_of(mirrored), -boxes[0][::-1], -boxes[1][::-1], clearance)
    assert way == pytest.approx(-back, abs=1e-12)


def test_centres_meet_on_every_axis_but_the_side():
    way = centred(CHILD, PARENT, TABLE["above"])
    np.testing.assert_allclose(CHILD.mean(axis=0) + way, [0.0, 0.0, 9.45])
    way = centred(CHILD, PARENT, TABLE["inside"])
    np.testing.assert_allclose(CHILD.mean(axis=0) + way, [0.0, 0.0, 0.0], atol=1e-12)
