"""Boxes and hulls round points, and how far they stray from a surface."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from hypothesis import given, reject
from hypothesis import strategies as st

from articulate.geometry.convex_fit import (
    MAX_CORNERS,
    THIN_M,
    hull,
    spanning,
    thick,
    turned_box,
)
from articulate.geometry.rays import LIFT_M, Surface
from articulate.geometry.shapes import BOX_CORNERS, QUASI, on_boxes


def plate() -> Surface:
    """A square of 2 m in the plane z = 0."""
    corners = [[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]
    return Surface(trimesh.Trimesh(corners, [[0, 1, 2], [0, 2, 3]], process=False))


def test_the_depth_of_a_plane_is_the_height_above_it():
    points = np.array([[0.1, 0.2, 0.05], [0.1, 0.2, 0.0], [1.5, 0.0, 0.05]])
    depths = plate().depths(points, np.tile([0.0, 0.0, 1.0], (3, 1)))
    np.testing.assert_allclose(depths, [0.05, 0.0, np.inf], atol=1e-6)


def test_a_plane_a_little_above_a_point_counts_as_near():
    below = np.array([[0.1, 0.2, -LIFT_M / 2.0]])
    depth = plate().depths(below, np.array([[0.0, 0.0, 1.0]]))
    assert depth[0] == pytest.approx(-LIFT_M / 2.0, abs=1e-6)


@given(
    st.lists(st.floats(-3.0, 3.0), min_size=3, max_size=3),
    st.lists(st.floats(0.05, 1.0), min_size=3, max_size=3),
)
def test_a_turned_box_finds_a_box_however_it_is_turned(angles, half):
    turn = trimesh.transformations.euler_matrix(*angles)[:3, :3]
    corners = (BOX_CORNERS * half) @ turn.T + [0.1, 0.2, 0.3]
    tight = hull(corners, "p")
    assert tight is not None
    box = turned_box(corners, tight)
    assert box is not None
    np.testing.assert_allclose(sorted(box.half), sorted(half), rtol=1e-6)
    np.testing.assert_allclose(box.T_ps[:3, 3], [0.1, 0.2, 0.3], atol=1e-9)
    assert np.linalg.det(box.T_ps[:3, :3]) == pytest.approx(1.0)


def test_a_turned_box_holds_points_beyond_a_hull_of_few_corners():
    points = np.asarray(trimesh.creation.icosphere(subdivisions=4).vertices)
    tight = hull(points, "p")
    assert tight is not None
    assert len(tight.corners) <= MAX_CORNERS
    box = turned_box(points, tight)
    assert box is not None
    assert float(box.outside(points).max()) <= 1e-9


def test_points_that_span_a_thin_plate_keep_its_rim():
    flat = np.random.default_rng(0).uniform(-1.0, 1.0, (5000, 3)) * [1.0, 0.5, 0.001]
    kept = spanning(flat)
    assert len(kept) <= 128
    np.testing.assert_allclose(np.ptp(kept, axis=0), np.ptp(flat, axis=0), rtol=0.02)


def test_a_hull_of_few_corners_keeps_most_of_a_ball():
    ball = trimesh.creation.icosphere(subdivisions=4)
    shape = hull(np.asarray(ball.vertices), "p")
    assert shape is not None
    assert shape.volume > 0.75 * ball.volume
    assert shape.mesh.is_watertight
    assert shape.mesh.volume == pytest.approx(shape.volume)


def test_points_on_boxes_lie_on_their_faces_by_area():
    half = np.array([[0.5, 0.2, 0.1]])
    points, normals = on_boxes(half, QUASI)
    relative = np.abs(points[0] / half[0])
    np.testing.assert_allclose(relative.max(axis=1), 1.0)
    faced = np.abs(normals[0]).mean(axis=0)
    area = np.array([0.2 * 0.1, 0.5 * 0.1, 0.5 * 0.2])
    np.testing.assert_allclose(faced, area / area.sum(), atol=0.03)


def sheet() -> np.ndarray:
    """The corners of a square of 40 mm in the plane z = 0."""
    return 0.02 * np.array([[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.0]])


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_sheet_beside_a_cavity_grows_away_from_it(side):
    hollow = np.random.default_rng(0).uniform((-0.02, -0.02, 0.001), (0.02, 0.02, 0.02), (200, 3))
    hollow[:, 2] *= side
    heights = thick(sheet(), hollow=hollow)[:, 2]
    assert (side * heights).max() == pytest.approx(0.0, abs=1e-12)
    assert np.ptp(heights) == pytest.approx(THIN_M)


def test_a_sheet_between_two_cavities_or_beside_none_grows_both_ways():
    both = np.random.default_rng(0).uniform((-0.02, -0.02, -0.02), (0.02, 0.02, 0.02), (200, 3))
    aside = both + np.array([0.1, 0.0, 0.02])
    for hollow in (both, aside, np.zeros((0, 3))):
        heights = thick(sheet(), hollow=hollow)[:, 2]
        np.testing.assert_allclose([heights.min(), heights.max()], [-THIN_M / 2, THIN_M / 2])


def test_beyond_a_sharp_edge_a_hull_covers_only_what_is_really_near():
    wedge = hull(np.array([[0, 0, 0], [1, 0, 0.05], [1, 0, -0.05], [0, 1, 0], [1, 1, 0.05],
                           [1, 1, -0.05]], float), "p")  # fmt: skip
    assert wedge is not None
    points = np.array([[-0.1, 0.5, 0.0], [-0.01, 0.5, 0.0], [0.9, 0.5, 0.0], [0.9, 0.5, 0.06]])
    assert float(wedge.outside(points)[0]) < 0.01  # its planes are near
    np.testing.assert_array_equal(wedge.covers(points, 0.02), [False, True, True, True])
    away = trimesh.proximity.closest_point(wedge.mesh, points)[1]
    np.testing.assert_array_equal(wedge.covers(points, 0.012), (away <= 0.012) | [0, 0, 1, 0])


@given(st.integers(0, 10_000), st.integers(4, 30))
def test_distances_to_a_hull_are_those_to_its_nearest_triangle(seed, corners):
    rng = np.random.default_rng(seed)
    shape = hull(rng.normal(size=(corners, 3)) * (0.3, 0.1, 0.02), "p")
    if shape is None:
        reject()
    points = rng.normal(size=(50, 3)) * (0.4, 0.2, 0.1)
    triangles = shape.faces.triangles
    every = np.repeat(points, len(triangles), axis=0)
    nearest = trimesh.triangles.closest_point(np.tile(triangles, (len(points), 1, 1)), every)
    away = np.linalg.norm(nearest - every, axis=1).reshape(len(points), -1).min(axis=1)
    outside = shape.outside(points) > 0.0
    told = shape.distances(points, 0.05)
    near = outside & (away <= 0.05)
    np.testing.assert_allclose(told[near], away[near], atol=1e-8)
    assert np.all(told[outside & (away > 0.05)] > 0.05)
    assert np.all(told[~outside] <= 0.0)
