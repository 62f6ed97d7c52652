from __future__ import annotations

import numpy as np
import pytest
import trimesh

from articulate.benchmark.chamfer import chamfer, surface_points
from articulate.render.parts import plain_part


def block(size=(1.0, 1.0, 1.0), shift=(0.0, 0.0, 0.0)):
    mesh = trimesh.creation.box(size)
    return plain_part("block", np.asarray(mesh.vertices) + shift, np.asarray(mesh.faces))


def test_points_are_on_the_surface_in_a_sphere_of_radius_one():
    points = surface_points([block(shift=(5.0, 0.0, 2.0))], np.random.default_rng(0))
    assert points.shape == (2048, 3)
    half_side = 1.0 / np.sqrt(3.0)
    assert np.allclose(np.abs(points).max(axis=1), half_side)


def test_scale_and_position_do_not_change_the_points():
    one = surface_points([block()], np.random.default_rng(0))
    two = surface_points([block((7.0, 7.0, 7.0), (1.0, 2.0, 3.0))], np.random.default_rng(0))
    assert np.allclose(one, two)


def test_the_distance_is_half_the_sum_of_both_directions():
    assert chamfer(np.zeros((1, 3)), np.array([[1.0, 0.0, 0.0], [3.0, 0.0, 0.0]])) == 1.5


def test_the_floor_of_the_distance_is_stated():
    rng = np.random.default_rng(0)
    floor = chamfer(surface_points([block()], rng), surface_points([block()], rng))
    assert 0.015 < floor < 0.04


def test_a_surface_without_area_is_rejected():
    flat = plain_part("flat", np.zeros((3, 3)), np.array([[0, 1, 2]]))
    with pytest.raises(ValueError, match="no area"):
        surface_points([flat], np.random.default_rng(0))
