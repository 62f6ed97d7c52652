import numpy as np
import pytest
from numpy.testing import assert_allclose

from articulate.errors import AssetError
from articulate.simulator import mujoco
from articulate_envs.export_scene import _points, differences, export_scene, scene_files


@pytest.fixture(scope="module", params=["drawer", "door"])
def pair(request, tmp_path_factory):
    """A scene's model and the one that its exported folder gives."""
    model = request.getfixturevalue(request.param).nominal
    path = export_scene(model, tmp_path_factory.mktemp("scene"))
    return model, mujoco.MjModel.from_xml_path(str(path))


def test_every_array_of_the_model_comes_back(pair):
    assert differences(*pair) == []


def test_bodies_stand_where_they_stood_in_any_pose(pair):
    rng = np.random.default_rng(0)
    a, b = pair
    for _ in range(10):
        data = [mujoco.MjData(a), mujoco.MjData(b)]
        q = rng.uniform(-2.0, 2.0, a.nq)
        for model, d in zip(pair, data, strict=True):
            d.qpos[:] = q
            mujoco.mj_forward(model, d)
        assert_allclose(data[0].xpos, data[1].xpos, rtol=0, atol=1e-12)
        assert_allclose(data[0].qM, data[1].qM, rtol=1e-9, atol=1e-12)
        assert_allclose(data[0].site_xpos, data[1].site_xpos, rtol=0, atol=1e-12)


def test_masses_and_their_sum_are_the_same(pair):
    a, b = pair
    assert_allclose(a.body_mass, b.body_mass, rtol=0, atol=0)
    assert_allclose(a.body_subtreemass[0], b.body_subtreemass[0], rtol=1e-12)


@pytest.mark.parametrize(
    ("name", "change"),
    [
        ("body_mass", lambda m: m.body_mass.__setitem__(5, m.body_mass[5] * (1 + 1e-6))),
        ("geom_friction", lambda m: m.geom_friction.__setitem__((3, 0), 0.9)),
        ("option timestep", lambda m: setattr(m.opt, "timestep", 0.004)),
        ("actuator_biasprm", lambda m: m.actuator_biasprm.__setitem__((0, 2), -1.0)),
        ("eq_data", lambda m: m.eq_data.__setitem__((0, 1), 1.0)),
        ("geom_pos", lambda m: m.geom_pos.__setitem__((20, 0), 9.0)),
        ("points of geom", lambda m: m.mesh_vert.__setitem__((0, 0), 9.0)),
    ],
)
def test_any_difference_is_found(drawer, tmp_path, name, change):
    path = export_scene(drawer.nominal, tmp_path)
    model = mujoco.MjModel.from_xml_path(str(path))
    change(model)
    found = differences(drawer.nominal, model)
    assert any(name in item for item in found), found


def test_a_scene_is_written_the_same_each_time(drawer):
    assert scene_files(drawer.nominal) == scene_files(drawer.nominal)


def test_what_cannot_be_written_is_refused(tmp_path):
    spec = mujoco.MjSpec.from_string(
        "<mujoco><worldbody><body name='b'><joint name='ball' type='ball'/>"
        "<geom size='0.1'/></body></worldbody></mujoco>"
    )
    with pytest.raises(AssetError, match="only slides and hinges"):
        export_scene(spec.compile(), tmp_path)


def test_what_would_be_lost_is_found(tmp_path):
    spec = mujoco.MjSpec.from_string(
        "<mujoco><worldbody><body name='b'><joint name='j'/><geom size='0.1'/>"
        "<camera name='c'/></body></worldbody></mujoco>"
    )
    with pytest.raises(AssetError, match="differs"):
        export_scene(spec.compile(), tmp_path)


def test_points_whose_order_hangs_on_the_last_digits_are_the_same():
    # a turn of 1e-9 lifts two points over the edge of what 5 digits tell, and lowers two below it
    def model(turn, z=0.0):
        return mujoco.MjModel.from_xml_string(
            "<mujoco><compiler angle='radian'/><asset><mesh name='m' vertex='0.1 1 0  0.3 -1 0  "
            "0.2 1 0  0 -1 0  0 0 1'/></asset><worldbody><body><joint/>"
            "<inertial pos='0 0 0' mass='1' diaginertia='1 1 1'/>"
            f"<geom type='mesh' mesh='m' pos='0 0 {z!r}' euler='{turn!r} 0 0'/>"
            "</body></worldbody></mujoco>"
        )

    # the compiler moves a mesh to its middle
    z = 0.000005 - float(_points(model(0.0), 0)[:, 2].min())
    assert differences(model(-1e-9, z), model(1e-9, z)) == []
    assert any("points of geom" in item for item in differences(model(0.0), model(1e-6)))
