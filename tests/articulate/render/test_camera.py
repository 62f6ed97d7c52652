from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from articulate.render.camera import Camera, front_camera, look_at, pinhole
from articulate.transforms import inverse


def camera() -> Camera:
    return pinhole(width_px=64, height_px=48, fovy_rad=0.8, T_wc=look_at((2, 1, 1), (0, 0, 0)))


def test_the_target_is_seen_in_the_middle_of_the_picture():
    uv, depth = camera().project(np.zeros(3))
    assert uv == pytest.approx([31.5, 23.5])
    assert depth == pytest.approx(np.sqrt(6.0))


def test_up_in_the_scene_is_up_in_the_picture_and_left_of_the_way_is_left():
    looking_along_x = pinhole(
        width_px=11, height_px=11, fovy_rad=1.0, T_wc=look_at((0, 0, 0), (1, 0, 0))
    )
    above, _ = looking_along_x.project([1.0, 0.0, 0.1])
    left, _ = looking_along_x.project([1.0, 0.1, 0.0])
    assert above[1] < 5.0
    assert left[0] < 5.0


def test_a_picture_is_as_high_as_its_angle():
    tall = pinhole(
        width_px=10, height_px=10, fovy_rad=np.pi / 2, T_wc=look_at((0, 0, 0), (1, 0, 0))
    )
    uv, _ = tall.project([1.0, 0.0, 1.0])
    assert uv[1] == pytest.approx(-0.5)  # the upper edge of the first row


def test_what_is_behind_the_camera_has_no_pixel():
    uv, depth = camera().project([4.0, 2.0, 2.0])
    assert np.isnan(uv).all()
    assert depth < 0.0


@given(
    st.lists(st.floats(-0.7, 0.7), min_size=3, max_size=3),
    st.lists(st.floats(1.5, 4.0), min_size=3, max_size=3),
)
def test_unprojecting_what_was_projected_gives_the_point_back(point, eye):
    seen_from = camera().at(look_at(eye, (0, 0, 0)))
    uv, depth = seen_from.project(point)
    assert np.allclose(seen_from.unproject(uv, depth), point, atol=1e-9)


def test_the_pose_is_rigid_and_its_inverse_takes_the_eye_to_the_origin():
    T_wc = look_at((1, 2, 3), (0, 0, 0.5))
    assert np.linalg.det(T_wc[:3, :3]) == pytest.approx(1.0)
    assert (inverse(T_wc) @ [1, 2, 3, 1])[:3] == pytest.approx(0.0, abs=1e-12)


def test_scaling_keeps_what_is_seen_where():
    fine = camera().scaled(2.0)
    point = [0.1, -0.2, 0.15]
    coarse_uv, _ = camera().project(point)
    fine_uv, _ = fine.project(point)
    assert (fine.width_px, fine.height_px) == (128, 96)
    assert (fine_uv + 0.5) / 2.0 - 0.5 == pytest.approx(coarse_uv)


def test_the_front_camera_is_that_of_the_released_code():
    uv, depth = front_camera().project([0.0, 0.0, 0.8])
    assert uv == pytest.approx([319.5, 239.5])
    assert depth == pytest.approx(np.sqrt(9.0 + 2.25 + 1.44))
    assert front_camera().fy_px == pytest.approx(240.0 / np.tan(np.radians(17.5)))


def test_a_camera_that_looks_along_up_is_refused(error_line):
    error_line("look_at((0, 0, 1), (0, 0, 0))", lambda: look_at((0, 0, 1), (0, 0, 0)))


def test_a_field_of_view_of_half_a_turn_is_refused(error_line):
    error_line(
        "pinhole(fovy_rad=3.2)",
        lambda: pinhole(width_px=4, height_px=4, fovy_rad=3.2, T_wc=np.eye(4)),
    )
