from __future__ import annotations

import re

import numpy as np
import pytest

from articulate.page import Page, Violins


def outlines(figure: str) -> list[np.ndarray]:
    """Corners of each violin [px]."""
    paths = re.findall(r'opacity:\.35" d="M([^"Z]+)Z"', figure)
    return [
        np.array([[float(v) for v in point.split()] for point in path.split("L")]) for path in paths
    ]


def test_a_violin_is_widest_where_most_values_are():
    rng = np.random.default_rng(0)
    values = np.concatenate([rng.normal(0.2, 0.02, 300), rng.normal(0.8, 0.02, 30)])
    chart = Violins(title="t", groups=[("a", values.tolist())], y_range=(0.0, 1.0))
    corners = outlines(chart.figure())[0]
    right = corners[: len(corners) // 2]
    widest = right[np.argmax(right[:, 0]), 1]
    share = (204.0 - widest) / (204.0 - 26.0)
    assert share == pytest.approx(0.2, abs=0.02)


def test_violins_are_symmetric_and_stand_in_order():
    chart = Violins(title="t", groups=[("a", [0.0, 1.0, 2.0]), ("b", [1.0]), ("c", [])])
    shapes = outlines(chart.figure())
    assert len(shapes) == 2
    for shape in shapes:
        n = len(shape) // 2
        middle = (shape[:n, 0] + shape[n:, 0][::-1]) / 2
        assert np.ptp(middle) < 0.11
    assert shapes[0][:, 0].max() < shapes[1][:, 0].min()


def test_values_that_are_not_finite_are_left_out_and_the_number_says_so():
    figure = Violins(title="t", groups=[("a", [0.5, float("nan"), float("inf")])]).figure()
    assert "0.5 (n 1)" in figure


def test_text_is_escaped_and_a_page_takes_violins():
    chart = Violins(title="<i>", groups=[("a&b", [1.0])], goal=0.5, y_label="<rad>")
    html = Page("x").charts(chart).html()
    assert "<i>" not in html
    assert "a&amp;b" in html
    assert 'class="goal"' in html
