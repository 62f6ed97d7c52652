"""The light of a clip, from what is seen of surfaces whose colour is known."""

import numpy as np
import pytest
import trimesh

from articulate.reconstruct.actors.geometric import compositing
from articulate.reconstruct.actors.geometric.compositing import (
    Crop,
    fit_light,
    plain_light,
    rasterize,
    solve_light,
)
from articulate.reconstruct.actors.geometric.kernels import face_colours
from articulate.reconstruct.actors.geometric.parameters import LIGHT as LIGHT_PARAMETERS
from articulate.reconstruct.actors.geometric.surface import PartSurface
from articulate.render.camera import front_camera
from articulate.transforms import pose

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


def test_costs_of_many_directions_are_those_of_each():
    rng = np.random.default_rng(1)
    albedo, colours = rng.uniform(0.1, 0.9, (2, 200, 3))
    directions = NORMALS[:7]
    many = compositing._first_costs(VIEWS, albedo, colours, directions)
    for direction, cost in zip(directions, many, strict=True):
        strength = compositing._strengths(VIEWS, albedo, colours, direction, rounds=1)
        lamp = np.maximum(VIEWS[:, :3] @ direction, 0.0)
        shade = strength[0] + strength[1] * VIEWS[:, 3] + strength[2] * lamp
        off = np.abs(albedo * shade[:, None] - colours)
        assert cost == pytest.approx(
            np.minimum(off, 5.0 * LIGHT_PARAMETERS.soft_residual).sum(), rel=1e-9
        )


def test_of_a_black_object_the_first_belief_stays():
    light = solve_light(VIEWS, np.zeros((200, 3)), np.full((200, 3), 3.0))
    assert np.allclose(light[:3].mean(axis=1), LIGHT_PARAMETERS.prior_strengths, atol=1e-6)


LIGHT = np.array([[0.2] * 3, [0.1] * 3, [0.6] * 3, [0.6, -0.8, 0.0]])


def light_of_a_ball_that_is(*aside_m):
    """What is found where nothing stands still, of a ball that is so far from its place at 0."""
    body = trimesh.creation.icosphere(subdivisions=3, radius=0.4)
    surface = PartSurface(
        points_o=np.asarray(body.vertices) + np.array([0.0, 0.0, 0.5]),
        faces=np.asarray(body.faces, dtype=np.int64),
        albedo=np.full((len(body.faces), 3), 150.0),
        part_ids=np.zeros(len(body.faces), dtype=np.int64),
    )
    camera = front_camera(96, 72)
    pinhole = np.array([camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px])
    frames = np.full((len(aside_m), 72, 96, 3), 255.0, dtype=np.float32)
    shot = Crop(frames, np.arange(len(aside_m)), pinhole, camera.T_cw)
    for frame, y in zip(frames, aside_m, strict=True):
        seen = rasterize(surface, shot, pose(np.array([0.0, y, 0.0])))
        colours = face_colours(seen.points_c, surface.faces, surface.albedo, LIGHT)
        frame[seen.face_ids >= 0] = colours[seen.face_ids[seen.face_ids >= 0]]
    return fit_light(shot, surface, np.ones((72, 96), dtype=np.bool_))


def test_where_nothing_stands_still_the_frame_that_shows_the_object_at_0_tells_the_light():
    found = light_of_a_ball_that_is(0.3, 0.2, 0.0, -0.2)
    assert found[3] @ LIGHT[3] > 0.98
    assert found[2].mean() == pytest.approx(0.6, abs=0.05)


def test_where_no_frame_shows_the_object_at_0_either_the_first_belief_stays():
    assert np.array_equal(light_of_a_ball_that_is(0.3, 0.2, 0.15, -0.2), plain_light())
