"""Procedural cabinets, as files and as simulators read them."""

import itertools
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import trimesh
import yourdfpy

from articulate.errors import ConfigError
from articulate.library.procedural.cabinet import (
    EMBEDDED,
    CabinetConfig,
    embedded_cabinet,
    embedded_door_cabinet,
    write_cabinet,
)
from articulate.library.procedural.cabinet_parts import GAP_M, cabinet_parts
from articulate.library.procedural.meshes import mass_properties
from articulate.simulator import mujoco

SEEDS = range(12)


@pytest.fixture(scope="module")
def embedded(tmp_path_factory):
    return embedded_cabinet(tmp_path_factory.mktemp("cabinet"))


def _bytes_of(folder: Path) -> dict[str, bytes]:
    return {str(p.relative_to(folder)): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


def _boxes_o(size):
    """(part, box) of every box in the object frame, closed."""
    for part in cabinet_parts(size):
        x, y, z = (0.0, 0.0, 0.0) if part.motion is None else part.motion.origin_p
        for box in part.solids:
            yield part.name, box.seen_from((-x, -y, -z))


def test_the_same_seed_gives_the_same_bytes(tmp_path):
    write_cabinet(CabinetConfig(seed=5), tmp_path / "a")
    write_cabinet(CabinetConfig(seed=5), tmp_path / "b")
    code = (
        "from pathlib import Path; from articulate.library.procedural.cabinet import *; "
        f"write_cabinet(CabinetConfig(seed=5), Path({str(tmp_path / 'c')!r}))"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
    first = _bytes_of(tmp_path / "a")
    assert first == _bytes_of(tmp_path / "b")
    assert first == _bytes_of(tmp_path / "c")


def test_other_seeds_give_other_cabinets():
    sizes = {CabinetConfig(seed=seed).size() for seed in SEEDS}
    assert len(sizes) == len(SEEDS)


def test_seed_0_is_the_embedded_cabinet():
    assert CabinetConfig().size() == EMBEDDED
    assert CabinetConfig(width_m=0.5).size().depth_m == EMBEDDED.depth_m


def test_what_is_given_is_kept_and_leaves_other_draws_alone():
    free, given = CabinetConfig(seed=3).size(), CabinetConfig(seed=3, depth_m=0.5).size()
    assert given.depth_m == 0.5
    assert (given.width_m, given.height_m) == (free.width_m, free.height_m)


@pytest.mark.parametrize("seed", SEEDS)
def test_boxes_never_overlap_and_parts_keep_their_gap(seed):
    size = CabinetConfig(seed=seed).size()
    for (part_a, a), (part_b, b) in itertools.combinations(_boxes_o(size), 2):
        apart = max(max(a.low[k] - b.high[k], b.low[k] - a.high[k]) for k in range(3))
        assert apart >= (0.0 if part_a == part_b else GAP_M) - 1e-12, (a.name, b.name)


@pytest.mark.parametrize("seed", SEEDS)
def test_the_cabinet_stands_on_the_floor_within_its_dimensions(seed):
    size = CabinetConfig(seed=seed).size()
    boxes = [box for _, box in _boxes_o(size)]
    low, high = np.min([b.low for b in boxes], axis=0), np.max([b.high for b in boxes], axis=0)
    thick = size.handle_thickness_m * (0.5 if size.handle == "knob" else 1.0)
    front = -size.depth_m / 2 - size.handle_clear_m - thick
    np.testing.assert_allclose(low, [front, -size.width_m / 2, 0.0], atol=1e-12)
    np.testing.assert_allclose(high, [size.depth_m / 2, size.width_m / 2, size.height_m])


def test_mujoco_and_yourdfpy_read_the_mass_and_inertia_of_the_panels(embedded):
    model = mujoco.MjModel.from_xml_path(str(embedded))
    urdf = yourdfpy.URDF.load(str(embedded), load_meshes=True)
    for part in cabinet_parts(EMBEDDED):
        what = mass_properties(part.solids)
        inertial = urdf.link_map[part.name].inertial
        np.testing.assert_allclose(inertial.mass, what.mass_kg, rtol=1e-8)
        np.testing.assert_allclose(inertial.inertia, what.inertia_l, rtol=1e-6, atol=1e-8)
        if part.motion is not None:  # a fixed root is fused with the world
            body = model.body(part.name)
            np.testing.assert_allclose(body.mass, what.mass_kg, rtol=1e-8)
            np.testing.assert_allclose(
                np.sort(body.inertia), np.linalg.eigvalsh(what.inertia_l), rtol=1e-6
            )


def test_the_drawer_has_the_mass_written_out_by_hand(embedded):
    wide, deep = 0.45 - 2 * 0.016 - 2 * 0.003, 0.42 - 0.016 - 0.008 - 0.02
    free = (0.584 - 0.003 / 2) - (0.04 + 0.003 / 2)
    inner = free / 3 - 0.003 / 2 - 0.006 + 0.003 / 2  # second drawer: between its neighbours
    side = 0.75 * inner - 0.012
    board = (0.45 - 0.006) * (free / 3 - 0.003) * 0.016 + wide * deep * 0.012
    board += 2 * deep * side * 0.012 + (wide - 0.024) * side * 0.012
    handle = 0.012**2 * (0.12 + 2 * 0.038)
    urdf = yourdfpy.URDF.load(str(embedded), load_meshes=False)
    expected = 650.0 * board + 2700.0 * handle
    np.testing.assert_allclose(urdf.link_map["drawer_1"].inertial.mass, expected, rtol=1e-6)


def test_names_axes_and_limits_are_as_promised(tmp_path):
    config = CabinetConfig(seed=7, n_drawers=2, n_doors=2, arrangement="beside", handle="bar")
    urdf = yourdfpy.URDF.load(str(write_cabinet(config, tmp_path)))
    assert list(urdf.link_map) == ["carcass", "drawer_0", "drawer_1", "door_0", "door_1"]
    assert urdf.base_link == "carcass"
    assert urdf.actuated_joint_names == [
        "drawer_0_slide",
        "drawer_1_slide",
        "door_0_hinge",
        "door_1_hinge",
    ]
    for k, name in enumerate(list(urdf.link_map)[1:]):
        assert f"handle_{k}" in [visual.name for visual in urdf.link_map[name].visuals]
    for joint in urdf.joint_map.values():
        assert joint.limit.lower == 0.0 < joint.limit.upper
        damping = float(joint.dynamics.damping)  # yourdfpy keeps the text
        assert min(joint.limit.effort, joint.limit.velocity, damping) > 0.0
    np.testing.assert_array_equal(urdf.joint_map["drawer_0_slide"].axis, [-1, 0, 0])
    assert EMBEDDED.travel_share * 0.376 == pytest.approx(0.28, abs=0.01)


@pytest.mark.parametrize("seed", SEEDS)
def test_every_part_opens_by_itself_without_touching(seed, tmp_path):
    """Contacts of parts with the fused carcass are not filtered, so any overlap would show."""
    path = write_cabinet(CabinetConfig(seed=seed), tmp_path)
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    for joint in range(model.njnt):
        for share in np.linspace(0.0, 1.0, 15):
            mujoco.mj_resetData(model, data)
            data.qpos[joint] = share * model.jnt_range[joint, 1]
            mujoco.mj_forward(model, data)
            assert data.ncon == 0


def test_doors_swing_to_the_front(tmp_path):
    config = CabinetConfig(seed=1, n_drawers=0, n_doors=2)
    urdf = yourdfpy.URDF.load(str(write_cabinet(config, tmp_path)))
    for name in ("door_0", "door_1"):
        mesh = urdf.link_map[name].visuals[-1].geometry.mesh.filename
        handle_l = np.append(trimesh.load(tmp_path / mesh, force="mesh").centroid, 1.0)
        x_closed = (urdf.get_transform(name, "carcass") @ handle_l)[0]
        urdf.update_cfg({f"{name}_hinge": np.pi / 2})
        x_open = (urdf.get_transform(name, "carcass") @ handle_l)[0]
        assert x_open < x_closed - 0.1


def test_a_drawer_slides_under_30_newton_and_not_under_1(embedded):
    model = mujoco.MjModel.from_xml_path(str(embedded))
    for force, opens in ((30.0, True), (1.0, False)):
        data = mujoco.MjData(model)
        for _ in range(round(2.0 / model.opt.timestep)):
            data.qfrc_applied[0] = force
            mujoco.mj_step(model, data)
        assert (data.qpos[0] > 0.97 * model.jnt_range[0, 1]) == opens
        assert abs(data.qpos[1:]).max() < 1e-3


def test_a_drawer_is_hollow_and_has_walls(embedded):
    """A ball fits in the open tray; rays down into it meet the floor, not a lid."""
    model = mujoco.MjModel.from_xml_path(str(embedded))
    data = mujoco.MjData(model)
    data.qpos[0] = model.jnt_range[0, 1]
    mujoco.mj_forward(model, data)
    hit = np.zeros(1, dtype=np.int32)
    start = np.array([-0.21 - 0.12, 0.0, 1.0])
    down = np.array([0.0, 0.0, -1.0])
    distance = mujoco.mj_ray(model, data, start, down, None, 1, -1, hit, None)
    floor_z = 1.0 - distance
    front_top_z = 0.584 - GAP_M
    assert 0.10 < front_top_z - floor_z < 0.18
    along = mujoco.mj_ray(
        model, data, np.array([-0.33, 0.0, floor_z + 0.04]), np.array([0.0, 1.0, 0.0]), None, 1,
        -1, hit, None,
    )  # fmt: skip
    assert along == pytest.approx(0.45 / 2 - 0.016 - 0.003 - 0.012, abs=1e-6)


def test_the_embedded_handle_can_be_grasped_by_a_parallel_hand():
    assert EMBEDDED.handle == "bar"
    assert EMBEDDED.handle_length_m == 0.12
    assert EMBEDDED.handle_thickness_m == 0.012
    assert 0.035 <= EMBEDDED.handle_clear_m <= 0.040


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ({"width_m": 9.0}, r"cabinet.width_m is 9.0; it must be in \[0.2, 2.0\]"),
        ({"handle": "rope"}, "cabinet.handle is 'rope'; known: bar, knob"),
        ({"n_drawers": 0, "n_doors": 0}, "give it one or the other"),
        ({"height_m": 0.4, "n_drawers": 8}, "at least 0.08 m each way"),
        ({"handle_length_m": 0.5}, "at most 0.404"),
        ({"seed": -1}, "at least 0"),
    ],
)
def test_a_bad_value_is_one_line_that_says_what_is_accepted(given, says):
    with pytest.raises(ConfigError, match=says) as caught:
        CabinetConfig(**given).size()
    assert "\n" not in str(caught.value)


def test_the_door_cabinet_of_the_examples_has_a_drawer_above_two_doors(tmp_path):
    urdf = yourdfpy.URDF.load(str(embedded_door_cabinet(tmp_path)), load_meshes=False)
    assert list(urdf.link_map) == ["carcass", "drawer_0", "door_0", "door_1"]
    heights = [urdf.get_transform(name, "carcass")[2, 3] for name in ("drawer_0", "door_0")]
    assert heights[0] > heights[1]
