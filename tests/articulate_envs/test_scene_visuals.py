import numpy as np
import pytest

from articulate.render.scene_style import PART_RGBA
from articulate.simulator import mujoco
from articulate.task.object_placement import object_pose
from articulate_envs.scene import PREFIX, scene_spec
from articulate_envs.scene_visuals import add_scene_visuals


def _spec(scene, scale=1.0):
    return scene_spec(
        scene.asset,
        arm=scene.arm,
        physics=scene.physics,
        placement=scene.placement,
        scale=scale,
        visuals=True,
    )


def _single(rgba):
    return tuple(np.array(rgba, dtype=np.float32).tolist())


@pytest.mark.parametrize("scale", [0.9, 1.1])
def test_object_and_robot_stand_on_what_is_below_them(drawer, scale):
    T_wo = object_pose(
        drawer.asset,
        drawer.task.joint,
        drawer.placement,
        scale=np.array([scale]),
        shift=np.zeros((1, 2)),
        yaw=np.array([0.1]),
    )[0]
    spec = _spec(drawer, scale)
    add_scene_visuals(spec, drawer.asset, scale=scale, T_wo=T_wo, size=(64, 48))
    model = spec.compile()
    floor_z = model.geom("floor").pos[2]
    assert floor_z == min(0.0, T_wo[2, 3])
    world = [i for i in range(model.ngeom) if model.geom_bodyid[i] == 0]
    boxes = [i for i in world if int(model.geom_type[i]) == int(mujoco.mjtGeom.mjGEOM_BOX)]
    tops = [float(model.geom_pos[i, 2] + model.geom_size[i, 2]) for i in boxes]
    wanted = [z for z in (0.0, float(T_wo[2, 3])) if z - floor_z >= 0.01]
    assert tops == pytest.approx(wanted, abs=0.002)
    assert all(model.geom_pos[i, 2] - model.geom_size[i, 2] >= floor_z - 1e-9 for i in boxes)


def test_an_object_without_visual_geoms_shows_its_others_in_a_colour_for_each_link(drawer):
    spec = _spec(drawer)
    add_scene_visuals(spec, drawer.asset, scale=1.0, T_wo=drawer.placement.T_wo(), size=(64, 48))
    model = spec.compile()
    colours: dict[str, set[tuple[float, ...]]] = {}
    for i in range(model.ngeom):
        name = model.body(int(model.geom_bodyid[i])).name
        if name.startswith(PREFIX):
            assert model.geom_group[i] == 2
            colours.setdefault(name[len(PREFIX) :], set()).add(tuple(model.geom_rgba[i].tolist()))
    assert colours["carcass"] == {_single(PART_RGBA[0])}
    assert colours["drawer_0"] == {_single(PART_RGBA[1])}
    assert colours["drawer_1"] == {_single(PART_RGBA[2])}


def test_the_model_moves_as_the_one_that_is_simulated(drawer):
    spec = _spec(drawer)
    add_scene_visuals(spec, drawer.asset, scale=1.0, T_wo=drawer.placement.T_wo(), size=(64, 48))
    model = spec.compile()
    assert model.nq == drawer.nominal.nq
    for i in range(model.njnt):
        assert model.joint(i).name == drawer.nominal.joint(i).name
