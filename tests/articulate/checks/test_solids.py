import numpy as np
import pytest
import trimesh
from tests.assets import make_cabinet

from articulate.assets.asset import Asset, Link
from articulate.checks.model import load_model
from articulate.checks.solids import inside_any, solids_of, union_surface, unknown_shape, within_any

GEOMS = {
    "box": '<geom type="box" size="0.1 0.2 0.3" pos="0.5 0 0" euler="0 0 0.5"/>',
    "sphere": '<geom type="sphere" size="0.2"/>',
    "ellipsoid": '<geom type="ellipsoid" size="0.1 0.2 0.4" pos="0 0.3 0" euler="0.4 0 0"/>',
    "capsule": '<geom type="capsule" size="0.1 0.2"/>',
    "cylinder": '<geom type="cylinder" size="0.1 0.2" euler="1 0 0"/>',
    "mesh": '<geom type="mesh" mesh="ball" pos="0.1 0.2 0.3"/>',
}


def model_of(folder, geoms):
    folder.mkdir()
    trimesh.creation.icosphere(3, 0.2).export(folder / "ball.obj")
    (folder / "object.xml").write_text(
        '<mujoco><compiler angle="radian"/><asset><mesh name="ball" file="ball.obj" '
        'maxhullvert="32"/></asset><worldbody><body name="body">'
        f'<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>{geoms}</body></worldbody></mujoco>'
    )
    zero = (0.0, 0.0, 0.0)
    link = Link(
        name="body",
        parent=None,
        pos_o=zero,
        quat_o=(1.0, 0.0, 0.0, 0.0),
        mass_kg=1.0,
        bounds_l=(zero, zero),
    )
    return load_model(
        Asset(
            name="one",
            category="unknown",
            links=(link,),
            joints=(),
            handles=(),
            bounds_o=(zero, zero),
            folder=folder,
        )
    )


@pytest.mark.parametrize("kind", GEOMS)
def test_points_on_the_surface_of_a_shape_are_neither_inside_nor_outside(tmp_path, kind):
    model = model_of(tmp_path / kind, GEOMS[kind])
    (solid,) = solids_of(model, "body")
    corners = solid.triangles.reshape(-1, 3)
    assert np.abs(solid.outside_m(corners)).max() < 1e-6
    middle = corners.mean(axis=0)
    assert solid.outside_m(middle[None])[0] < -0.05
    far = middle + 3.0 * (corners - middle)
    away = np.linalg.norm(far - corners, axis=1)
    assert (solid.outside_m(far) > 0.0).all()
    assert solid.is_within(far, 1.01 * away.max()).all()
    assert not solid.is_within(far, 0.05).any()


def test_a_hull_has_the_corners_that_the_engine_keeps(tmp_path):
    model = model_of(tmp_path / "mesh", GEOMS["mesh"])
    (solid,) = solids_of(model, "body")
    corners = np.unique(solid.triangles.reshape(-1, 3).round(9), axis=0)
    assert len(corners) <= 32
    np.testing.assert_allclose(np.linalg.norm(corners - [0.1, 0.2, 0.3], axis=1), 0.2, atol=1e-6)


def test_nearness_to_a_sharp_corner_is_measured_to_the_hull_and_not_to_its_planes(tmp_path):
    wedge = '<geom type="mesh" mesh="wedge"/>'
    folder = tmp_path / "wedge"
    model = model_of(folder, GEOMS["box"])
    text = (folder / "object.xml").read_text().replace(GEOMS["box"], wedge)
    corners = "-1 -1 -0.05  -1 -1 0.05  -1 1 -0.05  -1 1 0.05  1 -1 0  1 1 0"
    text = text.replace("<asset>", f'<asset><mesh name="wedge" vertex="{corners}"/>')
    (folder / "object.xml").write_text(text)
    model = load_model(model.asset)
    (solid,) = solids_of(model, "body")
    tip = solid.triangles.reshape(-1, 3)
    beyond = tip[tip[:, 0].argmax()] * [1.0, 0.0, 1.0] + [0.3, 0.0, 0.0]
    assert solid.outside_m(beyond[None])[0] < 0.02
    assert not solid.is_within(beyond[None], 0.29)[0]
    assert solid.is_within(beyond[None], 0.301)[0]


def test_the_surface_of_a_union_has_no_points_inside_it(tmp_path):
    model = load_model(make_cabinet(tmp_path))
    solids = solids_of(model, "drawer_0")
    points = union_surface(solids, 2000)
    assert len(points) > 1000
    assert within_any(solids, points, 1e-6).all()
    inner = points - 1e-4 * (points - points.mean(axis=0))
    assert inside_any(solids, inner).mean() < 0.9  # a tray: most walls face the middle
    assert min(s.outside_m(points).min() for s in solids) > -1e-5


def test_geoms_that_cannot_touch_are_no_solids(tmp_path):
    seen = GEOMS["sphere"].replace("/>", ' contype="0" conaffinity="0"/>')
    assert solids_of(model_of(tmp_path / "seen", seen), "body") == ()


def test_the_distance_to_an_ellipsoid_is_that_to_its_surface(tmp_path):
    geom = '<geom type="ellipsoid" size="0.1 0.2 0.4"/>'
    (solid,) = solids_of(model_of(tmp_path / "one", geom), "body")
    rng = np.random.default_rng(0)
    radii = np.array([0.1, 0.2, 0.4])
    on = rng.normal(size=(200, 3))
    on = radii * on / np.linalg.norm(on, axis=1, keepdims=True)
    normal = on / radii**2
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    for away in (1e-6, 0.003, 0.5, 20.0):
        np.testing.assert_allclose(solid.outside_m(on + away * normal), away, rtol=1e-6)
    deep = solid.outside_m(on - 0.003 * normal)
    assert (deep < 0.0).all()
    assert (deep >= -0.003 - 1e-9).all()
    assert solid.outside_m(np.zeros((1, 3)))[0] == pytest.approx(-0.1)
    axes = np.array([[0.3, 0.0, 0.0], [0.0, 0.3, 0.0], [0.0, 0.0, 0.9], [0.0, 0.0, 0.4]])
    np.testing.assert_allclose(solid.outside_m(axes), [0.2, 0.1, 0.5, 0.0], atol=1e-9)


def test_a_shape_of_a_type_that_is_not_known_is_told_of(tmp_path):
    assert unknown_shape(model_of(tmp_path / "box", GEOMS["box"]), "body") == ""
    model = model_of(tmp_path / "plane", '<geom name="floor" type="plane" size="1 1 1"/>')
    assert unknown_shape(model, "body").startswith("collision shape floor of body is of type plane")
