import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from articulate.page import Bars, Chart, ChartLine, Points

NUMBERS = st.floats(-1e12, 1e12) | st.sampled_from([np.nan, np.inf, -np.inf])


def paths(figure, kind):
    return re.findall(rf'<path class="{kind}"[^>]* d="([^"]*)"', figure)


def test_line_runs_from_corner_to_corner():
    figure = Chart(
        title="t", marks=[ChartLine(name="a", x=[0, 1], y=[0, 1])], y_range=(0, 1)
    ).figure()
    assert paths(figure, "line") == ["M46.0 222.0L383.0 26.0"]


def test_line_is_broken_at_nan_and_a_lonely_point_is_a_dot():
    y = [0.0, 1.0, np.nan, 1.0]
    figure = Chart(title="t", marks=[ChartLine(name="a", x=np.arange(4), y=y)]).figure()
    first, second = paths(figure, "line")
    assert first.count("L") == 1
    assert second.endswith("h0")


def test_long_line_is_thinned_but_keeps_its_ends():
    x = np.arange(100_000)
    (d,) = paths(Chart(title="t", marks=[ChartLine(name="a", x=x, y=x)]).figure(), "line")
    assert d.count("L") == 399
    assert d.startswith("M46.0")
    assert re.search(r"L383\.0 [\d.]+$", d)


def test_band_is_drawn_around_a_line():
    line = ChartLine(name="a", x=[0, 1], y=[1, 1], low=[0, 0], high=[2, 2])
    assert len(paths(Chart(title="t", marks=[line]).figure(), "band")) == 1


def test_points_have_error_bars():
    points = Points(name="a", x=[0, 1, 2], y=[1, 1, np.nan], low=[0, 0, 0], high=[2, 2, 2])
    figure = Chart(title="t", marks=[points]).figure()
    assert figure.count("<circle") == 2
    assert len(paths(figure, "line")) == 2


def test_key_names_the_series_where_there_are_several():
    line = ChartLine(name="alpha", x=[0, 1], y=[0, 1])
    assert "alpha" not in Chart(title="t", marks=[line]).figure()
    assert Chart(title="t", marks=[line, line]).figure().count("alpha") == 2


def test_longest_bar_takes_the_room_and_zero_takes_none():
    figure = Chart(title="t", marks=Bars(labels=["a", "b", "c"], values=[4.0, 2.0, 0.0])).figure()
    widths = [float(w) for w in re.findall(r'<rect[^>]* width="([\d.]+)"', figure)]
    assert widths[0] == 2.0 * widths[1] > 0.0
    assert widths[2] == 0.0


def test_axes_show_their_labels_and_the_goal_is_on_the_chart():
    line = ChartLine(name="a", x=[0, 1], y=[0.0, 0.1])
    figure = Chart(
        title="t", marks=[line], x_label="time [s]", y_label="way [m]", goal=0.9
    ).figure()
    assert ">time [s]<" in figure
    assert ">way [m]<" in figure
    ((y,),) = [re.findall(r"M[\d.]+ ([\d.]+)H", d) for d in paths(figure, "goal")]
    assert 26.0 <= float(y) <= 222.0


@given(st.lists(st.tuples(NUMBERS, NUMBERS), max_size=8), st.booleans())
def test_any_numbers_give_finite_coordinates(rows, as_points):
    x, y = np.array(rows, dtype=float).reshape(-1, 2).T
    mark = (Points if as_points else ChartLine)(name="a", x=x, y=y, low=y - 1, high=y + 1)
    figure = Chart(title="t", marks=[mark], x_label="", y_label="").figure()
    assert "nan" not in figure
    assert "inf" not in figure


@given(st.lists(NUMBERS, max_size=6))
def test_any_bars_give_finite_coordinates(values):
    bars = Bars(labels=["x"] * len(values), values=values)
    figure = Chart(title="t", marks=bars).figure()
    assert not re.search(r"nan|inf", figure)


def test_series_of_unequal_length_are_named():
    with pytest.raises(ValueError, match=r"a: x, y, low and high have 2, 1, 1 and 1 values"):
        Chart(title="t", marks=[ChartLine(name="a", x=[0, 1], y=[0])]).figure()
    with pytest.raises(ValueError, match="1 labels, but 2 values"):
        Chart(title="t", marks=Bars(labels=["a"], values=[1.0, 2.0])).figure()


def test_bars_have_error_bars_a_goal_and_their_value_beyond_both():
    bars = Bars(labels=["a"], values=[2.0], low=[1.0], high=[4.0])
    figure = Chart(title="t", marks=bars, goal=3.0, x_label="share [%]").figure()
    assert paths(figure, "line") == ["M83.8 27.0H335.0"]
    assert paths(figure, "goal") == ["M251.2 0V40.0"]
    assert '<text x="341.0" y="31.0" text-anchor="start">2</text>' in figure
