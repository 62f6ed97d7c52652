"""The light of a clip, from what is seen of surfaces whose colour is known."""

import numpy as np
import pytest

from articulate.actors.geometric.light import FIRST, solve_light

RNG = np.random.default_rng(0)
NORMALS = RNG.normal(size=(200, 3))
NORMALS /= np.linalg.norm(NORMALS, axis=1)[:, None]
VIEWS = np.column_stack([NORMALS, np.maximum(-NORMALS[:, 2], 0.0)])


def test_a_light_is_found_again():
    direction, strength = np.array([0.6, 0.0, 0.8]), (0.4, 0.2, 0.3)
    albedo = RNG.uniform(60.0, 220.0, (200, 3))
    lamp = np.maximum(VIEWS[:, :3] @ direction, 0.0)
    share = strength[0] + strength[1] * VIEWS[:, 3] + strength[2] * lamp
    light = solve_light(VIEWS, albedo, albedo * share[:, None])
    assert light[3] @ direction > 0.99
    assert light[:3].mean(axis=1) == pytest.approx(strength, abs=0.05)


def test_of_a_black_object_the_first_belief_stays():
    light = solve_light(VIEWS, np.zeros((200, 3)), np.full((200, 3), 3.0))
    assert np.allclose(light[:3].mean(axis=1), FIRST, atol=1e-6)
