"""A handle goes along with its door; what stays where it is does not."""

import numpy as np
import pytest

from articulate.reconstruct.actors.geometric.image_pyramid import build_scene
from articulate.reconstruct.actors.geometric.parts import add_comoving_parts
from articulate.reconstruct.actors.geometric.search import MotionFit
from articulate.reconstruct.actors.geometric.surface import JointMotion
from articulate.render.camera import front_camera
from articulate.render.joint_video import poses_of_parts
from articulate.render.parts import plain_part
from articulate.render.scene import PartScene

BOX_FACES = np.array(
    [
        *([0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1]),
        *([2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]),
    ]
)
SWING = JointMotion("turn", np.array([0.0, 0.0, 1.0]), np.array([0.3, 0.6, 0.0]), "test")
Q = np.linspace(0.0, -1.4, 14)


def box(name, low, high, rgb):
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=float)
    return plain_part(name, np.array(low) + corners * np.subtract(high, low), BOX_FACES, rgb)


PARTS = (
    box("door", (0.3, 0.0, 0.2), (0.34, 0.6, 1.3), (0.3, 0.5, 0.8)),
    box("body", (-0.4, 0.0, 0.2), (0.28, 0.6, 1.3), (0.7, 0.6, 0.5)),
    box("handle", (0.34, 0.04, 0.7), (0.4, 0.08, 0.9), (0.8, 0.2, 0.2)),
    box("drawer", (-0.2, -0.5, 0.6), (0.35, -0.02, 0.9), (0.2, 0.7, 0.3)),
    box("catch", (0.295, 0.3, 0.7), (0.3, 0.32, 0.72), (0.2, 0.2, 0.2)),
)


def company(*moving):
    """Names of what is taken to move where all of ``moving`` do."""
    scene = PartScene(PARTS)
    camera = front_camera(320, 240)
    numbers = [k for k, part in enumerate(PARTS) if part.name in moving]
    poses = poses_of_parts(len(PARTS), numbers, SWING.T_o(Q))
    clip = np.stack([scene.render_image(camera, T) for T in poses])
    seen = build_scene(clip, camera, PARTS)
    fit = add_comoving_parts(seen, MotionFit(SWING, Q, 0.0, (0,)))
    return {PARTS[k].name for k in fit.parts}


@pytest.mark.parametrize("moving", [("door", "handle", "catch"), ("door", "handle")])
def test_handle_goes_along_and_the_drawer_beside_it_does_not(moving):
    assert company(*moving) - {"catch"} == {"door", "handle"}


def test_what_is_seen_to_stay_does_not_go_along():
    assert "handle" not in company("door", "catch")


def test_what_is_out_of_sight_goes_along_with_what_alone_it_touches():
    assert "catch" in company("door", "handle", "catch")


def test_what_already_moves_is_kept():
    scene = PartScene(PARTS[:2])
    clip = np.stack([scene.render_image(front_camera(320, 240))] * 3)
    seen = build_scene(clip, front_camera(320, 240), PARTS[:2])
    fit = MotionFit(SWING, np.zeros(3), 0.0, (0, 1))
    assert add_comoving_parts(seen, fit).parts == (0, 1)
