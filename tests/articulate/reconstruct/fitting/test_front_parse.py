"""Division of synthetic fronts into drawers and doors."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from articulate.reconstruct.fitting.front_cells import classify_cells, panels_of
from articulate.reconstruct.fitting.front_parse import covered, find_handles, parse_front, rectify
from articulate.render.raster import Pixels

WOOD, DARK, STEEL = (170, 130, 90), (120, 90, 60), (60, 60, 65)


def front(width: int, height: int, gaps: list[tuple[int, int, int, int]]) -> Pixels:
    """Return a plain front with dark gaps (x0, y0, x1, y1)."""
    rng = np.random.default_rng(0)
    image = np.clip(np.array(WOOD) + rng.normal(0, 2.0, (height, width, 3)), 0, 255)
    out = image.astype(np.uint8)
    for x0, y0, x1, y1 in gaps:
        cv2.line(out, (x0, y0), (x1, y1), DARK, 2)
    return out


def bar(image: Pixels, x: int, y: int, *, upright: bool) -> None:
    half = (2, 20) if upright else (20, 2)
    cv2.rectangle(image, (x - half[0], y - half[1]), (x + half[0], y + half[1]), STEEL, -1)


def test_a_stack_of_drawers() -> None:
    image = front(200, 240, [(0, 80, 199, 80), (0, 160, 199, 160)])
    for y in (40, 120, 200):
        bar(image, 100, y, upright=False)
    cells = parse_front(image)
    panels = panels_of(classify_cells(cells, 200 / 240))
    assert [panel.kind for panel in panels] == ["drawer"] * 3
    assert [panel.top for panel in panels] == pytest.approx([1.0, 2 / 3, 1 / 3], abs=0.02)


def test_a_pair_of_doors_is_hinged_at_its_outer_edges() -> None:
    image = front(200, 240, [(100, 0, 100, 239)])
    bar(image, 85, 120, upright=True)
    bar(image, 115, 120, upright=True)
    panels = panels_of(classify_cells(parse_front(image), 200 / 240))
    assert [(panel.kind, panel.hinge) for panel in panels] == [("door", "left"), ("door", "right")]


def test_a_drawer_above_two_doors() -> None:
    image = front(240, 240, [(0, 70, 239, 70), (120, 70, 120, 239)])
    bar(image, 120, 35, upright=False)
    bar(image, 105, 150, upright=True)
    bar(image, 135, 150, upright=True)
    panels = panels_of(classify_cells(parse_front(image), 1.0))
    assert [panel.kind for panel in panels] == ["drawer", "door", "door"]


def test_handles_separate_drawers_whose_gap_is_not_visible() -> None:
    image = front(220, 200, [])
    for y in (50, 150):
        bar(image, 110, y, upright=False)
    assert len(find_handles(image)) == 2
    assert len(parse_front(image)) == 2


def test_a_plain_front_and_a_decorated_door_are_one_part() -> None:
    assert len(parse_front(front(150, 220, []))) == 1
    image = front(150, 220, [])
    cv2.rectangle(image, (25, 25), (125, 195), DARK, 2)
    assert len(parse_front(image)) == 1


def test_legs_are_not_part_of_the_front() -> None:
    mask = np.zeros((100, 80), dtype=bool)
    mask[:80] = True
    mask[80:, :6] = mask[80:, -6:] = True
    rows, columns = covered(mask)
    assert (rows.start, rows.stop) == (0, 80)
    assert (columns.start, columns.stop) == (0, 80)


def test_rectification_undoes_a_perspective() -> None:
    image = front(256, 256, [(128, 0, 128, 255)])
    corners = np.array([[60, 40], [300, 80], [290, 260], [50, 300]], dtype=np.float64)
    source = np.array([[0, 0], [255, 0], [255, 255], [0, 255]], dtype=np.float32)
    H = cv2.getPerspectiveTransform(source, corners.astype(np.float32))
    photo = np.asarray(cv2.warpPerspective(image, H, (360, 340)), dtype=np.uint8)
    back = rectify(photo, corners, 1.0)
    gap = back[:, :, 0].mean(axis=0)
    assert abs(int(np.argmin(gap[20:-20])) + 20 - 128) <= 2
