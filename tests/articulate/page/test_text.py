import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from articulate.page.text import axis_values, format_axis_value, format_number


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (None, "–"),
        (True, "yes"),
        ("as it is", "as it is"),
        (0, "0"),
        (1234567, "1\u202f234\u202f567"),
        (0.123456, "0.1235"),
        (-2.5, "−2.5"),
        (0.00021, "2.1e−4"),
        (123456.7, "123\u202f457"),
        (math.nan, "–"),
        (math.inf, "∞"),
    ],
)
def test_numbers_are_shown_as_people_read_them(value, text):
    assert format_number(value) == text


@pytest.mark.parametrize(
    ("value", "text"), [(0.25, "0.25"), (5000, "5\u202f000"), (250000, "250k"), (1.5e6, "1.5M")]
)
def test_ticks_are_short(value, text):
    assert format_axis_value(value) == text


def test_ticks_are_round():
    assert axis_values(0.0, 1.0) == [0.0, 0.2, 0.4, 0.6, 0.8, 1.0]
    assert axis_values(-139.0, -38.0) == [-120.0, -100.0, -80.0, -60.0, -40.0]
    assert axis_values(0.0, 5e-324) == [0.0]


@given(st.floats(-1e9, 1e9), st.floats(1e-3, 1e9))
def test_ticks_lie_in_the_range_in_order(low, width):
    values = axis_values(low, low + width)
    assert 2 <= len(values) <= 8
    assert values == sorted(set(values))
    assert all(low - 1e-6 * width <= v <= low + width * (1 + 1e-6) for v in values)
