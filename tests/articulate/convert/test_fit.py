"""Boxes and hulls round points, and how far they stray from a surface."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st

from articulate.convert.fit import (
    MAX_CORNERS,
    hull,
    spanning,
    turned_box,
)
from articulate.convert.rays import LIFT_M, Surface
from articulate.convert.shapes import BOX_CORNERS, QUASI, on_boxes


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
