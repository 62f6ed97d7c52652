import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from articulate.render.view_camera import MARGIN, Viewpoint, camera_axes, fit_viewpoint
from articulate.simulator import mujoco

FOV_DEG, ASPECT = 34.0, 4.0 / 3.0
EIGHT = np.array([(x, y, z) for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)])


def _on_picture(view: Viewpoint, points):
    """Places on the picture, 1 at its edges, of points seen by a camera at its distance."""
    ahead, right, up = camera_axes(view.azimuth_deg, view.elevation_deg)
    rel = points - (np.asarray(view.lookat_w) - view.distance_m * ahead)
    tangent = np.tan(np.deg2rad(FOV_DEG) / 2.0)
    return np.stack([rel @ right / ASPECT, rel @ up], axis=1) / (rel @ ahead * tangent)[:, None]


@given(st.integers(0, 2**32 - 1), st.floats(-180.0, 180.0), st.floats(-80.0, 10.0))
def test_all_points_are_inside_the_picture_and_some_near_its_edge(seed, azimuth, elevation):
    points = np.random.default_rng(seed).uniform(-1.0, 1.0, (30, 3)) * [1.0, 0.5, 0.7]
    view = fit_viewpoint(
        points, azimuth_deg=azimuth, elevation_deg=elevation, fov_deg=FOV_DEG, aspect=ASPECT
    )
    places = np.abs(_on_picture(view, points))
    assert places.max() <= 1.0
    assert places.max() > 0.8 / MARGIN


def test_a_cube_is_seen_in_the_middle_from_where_its_near_face_fills_the_picture():
    view = fit_viewpoint(EIGHT, azimuth_deg=0.0, elevation_deg=0.0, fov_deg=90.0, aspect=1.0)
    # The near face at x = -1 fills half a right angle from 1 m before it.
    assert view.distance_m == pytest.approx(2.0 * MARGIN)
    assert view.lookat_w == pytest.approx((0.0, 0.0, 0.0))


def test_axes_are_those_of_mujocos_free_camera():
    model = mujoco.MjModel.from_xml_string("<mujoco/>")
    data = mujoco.MjData(model)
    scene = mujoco.MjvScene(model, maxgeom=10)
    camera = mujoco.MjvCamera()
    camera.lookat[:], camera.distance = (0.3, -0.2, 0.5), 2.0
    camera.azimuth, camera.elevation = 52.0, -22.0
    mujoco.mjv_updateScene(
        model, data, mujoco.MjvOption(), None, camera, mujoco.mjtCatBit.mjCAT_ALL, scene
    )
    ahead, right, up = camera_axes(52.0, -22.0)
    eyes = scene.camera
    assert (eyes[0].pos + eyes[1].pos) / 2 == pytest.approx(camera.lookat - 2.0 * ahead, abs=1e-6)
    assert eyes[0].forward == pytest.approx(ahead, abs=1e-6)
    assert eyes[0].up == pytest.approx(up, abs=1e-6)
    assert np.cross(ahead, up) == pytest.approx(right)
