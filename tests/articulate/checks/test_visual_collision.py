"""Crossings of what is seen, told apart from what collides."""

from __future__ import annotations

import numpy as np
import pytest
from tests.articulate.checks.objects import Part, make_object

from articulate.checks.distances import Shapes
from articulate.checks.model import load_model
from articulate.checks.visual_collision import Surfaces, cuts, passes, surface_of

FLAT = np.array([[[-1.0, -1.0, 0.0], [3.0, -1.0, 0.0], [-1.0, 3.0, 0.0]]])
UPRIGHT = np.array([[[0.0, 0.0, -1.0], [0.0, 0.0, 1.0], [0.5, 0.0, 0.0]]])


def test_two_triangles_cut_each_other_in_a_known_line():
    (line,) = cuts(FLAT, UPRIGHT)
    assert np.sort(line, axis=0) == pytest.approx(np.array([[0.0, 0.0, 0.0], [0.5, 0.0, 0.0]]))


def test_the_order_of_two_triangles_does_not_matter():
    one, other = cuts(FLAT, UPRIGHT)[0], cuts(UPRIGHT, FLAT)[0]
    assert np.sort(one, axis=0) == pytest.approx(np.sort(other, axis=0))


@pytest.mark.parametrize("moved", [(0.0, 0.0, 1.01), (0.0, 5.0, 0.0), (3.0, 0.0, 0.0)])
def test_triangles_that_miss_each_other_have_no_line(moved):
    assert not np.isfinite(cuts(FLAT, UPRIGHT + np.array(moved))).any()


def test_triangles_in_one_plane_have_no_line():
    assert not np.isfinite(cuts(FLAT, FLAT + np.array([0.1, 0.1, 0.0]))).all()


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        (((-1.0, 0.5, 0.5), (2.0, 0.5, 0.5)), True),
        (((0.4, 0.4, 0.4), (0.6, 0.6, 0.6)), True),
        (((-1.0, 1.5, 0.5), (2.0, 1.5, 0.5)), False),
        (((-2.0, 0.5, 0.5), (-0.1, 0.5, 0.5)), False),
        (((np.nan,) * 3, (np.nan,) * 3), False),
    ],
)
def test_lines_that_pass_through_a_box(line, expected):
    assert passes(np.array([line]), np.zeros(3), np.ones(3)).tolist() == [expected]


def crossing(folder, *, shown_half: float, at: float) -> bool:
    """Whether a cube of 100 mm crosses what is seen of another one when it stands ``at`` x."""
    cube = ((0.0, 0.0, 0.0), (0.05, 0.05, 0.05))
    seen = ((0.0, 0.0, 0.0), (shown_half, 0.06, 0.06))
    part = Part(name="slider", kind="slide", axis=(1.0, 0.0, 0.0), boxes=(cube,))
    model = load_model(make_object(folder, part, body=(cube,), shown=(seen,)))
    shapes, data = Shapes(model), model.data()
    model.set_joints(data, {"slider_joint": at})
    both = shapes.of_link["slider"], shapes.of_link["body"]
    (overlap,) = shapes.overlaps(data, *both, least_m=0.0)
    return Surfaces(model, shapes).cross(data, overlap)


def test_surfaces_that_cross_where_the_shapes_do_are_found(tmp_path):
    assert crossing(tmp_path / "a", shown_half=0.05, at=0.09)


def test_surfaces_that_only_touch_do_not_cross(tmp_path):
    assert not crossing(tmp_path / "a", shown_half=0.04, at=0.09)


def test_shapes_larger_than_what_is_seen_meet_alone(tmp_path):
    assert not crossing(tmp_path / "a", shown_half=0.03, at=0.09)


def test_the_surface_of_a_link_has_the_area_of_what_it_shows(tmp_path):
    seen = (((0.1, 0.0, 0.0), (0.05, 0.05, 0.05)), ((0.5, 0.0, 0.0), (0.1, 0.2, 0.3)))
    part = Part(name="part", kind="slide", axis=(1.0, 0.0, 0.0), shown=seen)
    corners, faces = surface_of(load_model(make_object(tmp_path / "a", part)), "part")
    a, b, c = (corners[faces[:, k]] for k in range(3))
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2.0
    assert area == pytest.approx(6 * 0.1**2 + 8 * (0.1 * 0.2 + 0.2 * 0.3 + 0.1 * 0.3))
    assert corners.min(axis=0) == pytest.approx((0.05, -0.2, -0.3))
