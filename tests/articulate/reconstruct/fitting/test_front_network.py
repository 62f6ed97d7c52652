"""Parts of a front: its square image, points that predict rectangles, panels, training targets."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from articulate.library.procedural.front_layout import FrontPanel
from articulate.reconstruct.fitting.front_network import (
    KINDS,
    MARGIN,
    WEIGHTS_FILE,
    FrontPart,
    front_square,
    grouped,
    points,
)
from articulate.reconstruct.fitting.front_panels import certainty, panels_of, with_fixed
from articulate.reconstruct.fitting.object_front import covered, rectify
from articulate.transforms import Array

SCALE = 1.0 + 2.0 * MARGIN


def predicted(parts: list[tuple[float, float, float, float, str]]) -> tuple[Array, Array]:
    """Return kinds and distances of all points for parts (left, right, bottom, top, kind)."""
    rng = np.random.default_rng(0)
    at = points()
    kinds = np.tile([0.9, 0.025, 0.025, 0.025, 0.025], (len(at), 1))
    reach = rng.uniform(size=(len(at), 4))
    for left, right, bottom, top, kind in parts:
        edges = np.array([left, right, 1.0 - top, 1.0 - bottom])
        u0, u1, v0, v1 = (edges + MARGIN) / SCALE
        on = (at[:, 0] > u0) & (at[:, 0] < u1) & (at[:, 1] > v0) & (at[:, 1] < v1)
        kinds[on] = 0.05
        kinds[on, KINDS.index(kind)] = 0.8
        found = np.stack([at[:, 0] - u0, u1 - at[:, 0], at[:, 1] - v0, v1 - at[:, 1]], axis=1)
        reach[on] = (found + rng.normal(size=found.shape) * 0.005)[on]
    return kinds, reach


def part(left: float, right: float, bottom: float, top: float, kind: str = "drawer") -> FrontPart:
    kinds = np.full(5, 0.05)
    kinds[KINDS.index(kind)] = 0.8
    return FrontPart(left=left, right=right, bottom=bottom, top=top, kinds=kinds, support=1.0)


def test_points_that_predict_one_rectangle_are_one_part() -> None:
    true = [
        (0.0, 1.0, 0.8, 1.0, "drawer"),
        (0.0, 0.5, 0.1, 0.8, "door_left"),
        (0.5, 1.0, 0.1, 0.8, "door_right"),
    ]
    found = grouped(*predicted(true))
    assert [one.kind for one in found] == [kind for *_, kind in true]
    for one, (left, right, bottom, top, _) in zip(found, true, strict=True):
        edges = [one.left, one.right, one.bottom, one.top]
        assert edges == pytest.approx([left, right, bottom, top], abs=0.02)
        assert one.support > 0.8


def test_a_few_points_are_no_part() -> None:
    kinds, reach = predicted([])
    kinds[[100, 300]] = [0.1, 0.9, 0.0, 0.0, 0.0]
    assert grouped(kinds, reach) == ()


def test_what_two_rectangles_share_is_divided() -> None:
    true = [(0.0, 1.0, 0.0, 0.5, "drawer"), (0.0, 1.0, 0.5, 1.0, "drawer")]
    kinds, reach = predicted(true)
    reach[:, 2:] += 0.02
    upper, lower = grouped(kinds, reach)
    assert upper.bottom == pytest.approx(lower.top)
    assert upper.bottom == pytest.approx(0.5, abs=0.02)


def test_the_square_of_a_front_has_its_margin() -> None:
    image = np.zeros((300, 400, 3), dtype=np.uint8)
    corners = np.array([[100, 60], [300, 90], [290, 250], [110, 230]], dtype=np.float64)
    cv2.fillConvexPoly(image, corners.round().astype(np.int32), (255, 255, 255))
    square, _ = front_square(image, corners)
    rows, columns = np.nonzero(square[..., 0] > 127)
    for lines in (rows, columns):
        assert lines.min() / len(square) == pytest.approx(MARGIN / SCALE, abs=0.015)
        assert lines.max() / len(square) == pytest.approx(1.0 - MARGIN / SCALE, abs=0.015)


def test_panels_have_common_edges_and_fill_the_front() -> None:
    parts = [part(0.01, 0.49, 0.1, 0.98), part(0.51, 0.99, 0.5, 0.97, "door_right")]
    panels = panels_of(parts, 0.1, 1.0)
    assert [p.kind for p in panels] == ["drawer", "door"]
    assert panels[0].right == panels[1].left
    assert (panels[0].left, panels[1].right, panels[0].bottom, panels[0].top) == (0, 1, 0, 1)
    filled = with_fixed(panels, "panel", "gap")
    assert sum((p.right - p.left) * (p.top - p.bottom) for p in filled) == pytest.approx(1.0)
    assert [p.kind for p in filled[2:]] == ["gap"]


def test_the_space_above_a_panel_is_fixed() -> None:
    filled = with_fixed(
        [FrontPanel(kind="drawer", left=0.2, right=0.8, bottom=0.0, top=0.6)], "panel", "gap"
    )
    assert sorted(p.kind for p in filled) == ["drawer", "gap", "gap", "panel"]


def test_a_front_is_as_certain_as_its_least_certain_part() -> None:
    assert certainty([part(0, 1, 0, 1), part(0, 1, 0, 1, "flap")]) == pytest.approx(0.8)
    assert certainty([]) == 0.0


def test_legs_are_not_part_of_the_front() -> None:
    mask = np.zeros((100, 80), dtype=bool)
    mask[:80] = True
    mask[80:, :6] = mask[80:, -6:] = True
    rows, columns = covered(mask)
    assert (rows.start, rows.stop) == (0, 80)
    assert (columns.start, columns.stop) == (0, 80)


def test_rectification_undoes_a_perspective() -> None:
    image = np.full((256, 256, 3), 200, dtype=np.uint8)
    cv2.line(image, (128, 0), (128, 255), (40, 40, 40), 2)
    corners = np.array([[60, 40], [300, 80], [290, 260], [50, 300]], dtype=np.float64)
    source = np.array([[0, 0], [255, 0], [255, 255], [0, 255]], dtype=np.float32)
    H = cv2.getPerspectiveTransform(source, corners.astype(np.float32))
    photo = np.asarray(cv2.warpPerspective(image, H, (360, 340)), dtype=np.uint8)
    gap = rectify(photo, corners, 1.0)[:, :, 0].mean(axis=0)
    assert abs(int(np.argmin(gap[20:-20])) + 20 - 128) <= 2


def test_the_weights_fit_the_network() -> None:
    with np.load(WEIGHTS_FILE, allow_pickle=False) as file:
        assert file["in_8.weight"].shape[1] == 40
        assert file["out.weight"].shape[0] == len(KINDS) + 4
