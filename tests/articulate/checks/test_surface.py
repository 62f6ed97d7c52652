import numpy as np
import pytest
import trimesh

from articulate.checks.surface import (
    _solid_angles,
    distances,
    escapes,
    is_near,
    sample,
    winding_numbers,
)


def cube(side=1.0):
    return np.asarray(trimesh.creation.box((side, side, side)).triangles)


def sphere(radius=1.0, subdivisions=4):
    return np.asarray(trimesh.creation.icosphere(subdivisions, radius).triangles)


def test_distance_from_a_triangle_to_face_edge_and_corner():
    triangle = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    points = np.array([[0.2, 0.2, 0.3], [0.5, -2.0, 0.0], [-3.0, -4.0, 0.0], [1.0, 1.0, 0.0]])
    expected = [0.3, 2.0, 5.0, np.sqrt(0.5)]
    assert distances(points, np.stack([triangle] * 4)) == pytest.approx(expected)


def test_distance_from_a_triangle_without_area_is_that_from_its_longest_side():
    flat = np.array([[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.5, 0.0, 0.0]]])
    assert distances(np.array([[0.5, 2.0, 0.0]]), flat) == pytest.approx([2.0])


def test_points_are_near_a_sphere_by_their_radius():
    rng = np.random.default_rng(0)
    ways = rng.normal(size=(500, 3))
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    radii = rng.uniform(0.8, 1.2, 500)
    found = is_near(radii[:, None] * ways, sphere(subdivisions=5), 0.05)
    sure = np.abs(np.abs(radii - 1.0) - 0.05) > 0.002  # its triangles cut corners by 0.0005
    np.testing.assert_array_equal(found[sure], (np.abs(radii - 1.0) < 0.05)[sure])


def test_samples_are_spread_by_area_and_are_the_same_each_time():
    small = np.array([[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]])
    large = 3.0 * small + 10.0
    points, owner = sample(np.concatenate([small, large]), 1000)
    assert (owner == 1).mean() == pytest.approx(0.9, abs=0.002)
    assert (points[owner == 0].sum(axis=1) <= 1.0).all()
    np.testing.assert_array_equal(points, sample(np.concatenate([small, large]), 1000)[0])


def test_winding_number_is_one_inside_and_zero_outside_closed_surfaces():
    points = np.array([[0.0, 0.0, 0.0], [0.45, 0.45, 0.45], [0.6, 0.0, 0.0], [3.0, 1.0, 2.0]])
    np.testing.assert_allclose(winding_numbers(points, cube()), [1, 1, 0, 0], atol=1e-12)
    np.testing.assert_allclose(winding_numbers(points, cube()[:, ::-1]), [-1, -1, 0, 0], atol=1e-12)


def test_winding_number_of_a_box_without_lid_is_five_sixths_in_its_middle():
    triangles = cube()
    lid = triangles[:, :, 2].min(axis=1) > 0.4
    middle = np.zeros((1, 3))
    assert winding_numbers(middle, triangles[~lid]) == pytest.approx([5.0 / 6.0])


def test_far_groups_as_dipoles_agree_with_all_solid_angles():
    triangles = sphere(subdivisions=4)  # 5120 of them
    opened = triangles[triangles.mean(axis=1)[:, 2] < 0.3]
    points = np.random.default_rng(0).uniform(-1.5, 1.5, (300, 3))
    exact = _solid_angles(points, opened) / (4.0 * np.pi)
    assert np.abs(winding_numbers(points, opened) - exact).max() < 0.02


def test_rays_leave_an_open_box_and_no_closed_one():
    triangles = cube()
    lid = triangles[:, :, 2].min(axis=1) > 0.4
    inside = np.random.default_rng(0).uniform(-0.45, 0.45, (50, 3))
    assert not escapes(inside, triangles).any()
    assert escapes(inside, triangles[~lid]).all()
    assert escapes(inside + np.array([0.0, 0.0, 2.0]), triangles).all()
