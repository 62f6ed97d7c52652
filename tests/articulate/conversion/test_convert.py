from __future__ import annotations

import re
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
import yourdfpy
from PIL import Image
from tests.articulate.conversion.cabinets import CABINET, write_cabinet

from articulate.assets.asset import Asset, load_asset
from articulate.conversion import ConvertConfig, convert
from articulate.conversion.convert import input_key, read_input
from articulate.errors import AssetError, UsageError
from articulate.formats.read_urdf import read_urdf
from articulate.formats.textures import named_files
from articulate.simulator import mujoco
from articulate.transforms import inverse


@pytest.fixture(scope="module")
def asset(tmp_path_factory: pytest.TempPathFactory) -> Asset:
    folder = tmp_path_factory.mktemp("little")
    return convert(write_cabinet(folder), folder / "out")


@pytest.fixture(scope="module")
def model(asset: Asset) -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_path(str(asset.mjcf_path))


def test_links_joints_and_handles_are_those_of_the_source(asset: Asset) -> None:
    assert [link.name for link in asset.links] == ["body", "drawer", "door"]
    assert [(j.name, j.kind, j.link) for j in asset.joints] == [
        ("drawer_joint", "slide", "drawer"),
        ("door_joint", "hinge", "door"),
    ]
    assert {h.joint for h in asset.handles} == {"drawer_joint", "door_joint"}
    assert any("drawer_handle is fixed to drawer" in message for message in asset.repairs)


def test_the_object_is_on_the_ground_in_the_middle(asset: Asset) -> None:
    low, high = np.array(asset.bounds_o)
    np.testing.assert_allclose(low[2], 0.0, atol=1e-9)
    np.testing.assert_allclose(low[:2] + high[:2], 0.0, atol=1e-9)
    assert asset.size_rule.startswith("metric as it is")


def test_closed_is_the_limit_at_zero_on_either_side(asset: Asset) -> None:
    drawer, door = asset.joint("drawer_joint"), asset.joint("door_joint")
    assert (drawer.closed, drawer.open) == (0.0, 0.3)
    assert (door.closed, door.open) == (0.0, -1.6)
    assert "upper limit" in door.closed_rule


def test_forward_kinematics_agree_with_yourdfpy(asset: Asset, model: mujoco.MjModel) -> None:
    """An independent reader of the canonical URDF and MuJoCo place every link alike."""
    robot = yourdfpy.URDF.load(str(asset.folder / "object.urdf"), load_meshes=False)
    data = mujoco.MjData(model)
    rng = np.random.default_rng(0)
    for _ in range(30):
        q = {
            j.name: rng.uniform(min(j.closed, j.open), max(j.closed, j.open)) for j in asset.joints
        }
        robot.update_cfg(q)
        for name, value in q.items():
            data.qpos[model.joint(name).qposadr[0]] = value
        mujoco.mj_kinematics(model, data)
        for link in asset.links:
            T_ol = robot.get_transform(link.name, "body")
            body = data.body(link.name)
            np.testing.assert_allclose(body.xpos, T_ol[:3, 3], atol=1e-6)
            np.testing.assert_allclose(body.xmat.reshape(3, 3), T_ol[:3, :3], atol=1e-6)


def test_forward_kinematics_agree_with_the_input(asset: Asset, tmp_path: Path) -> None:
    """Up to the step from the URDF's root to the ground, which the rule of the frame gives."""
    path = write_cabinet(tmp_path)
    robot = yourdfpy.URDF.load(str(path), load_meshes=False)
    robot.update_cfg({"drawer_joint": 0.21, "door_joint": -0.7})
    T_os = asset.T_ol("drawer_joint", 0.0) @ inverse(_drawer_origin())
    for joint, q in (("drawer_joint", 0.21), ("door_joint", -0.7)):
        link = asset.joint(joint).link
        expected = T_os @ robot.get_transform(link, "body")
        np.testing.assert_allclose(asset.T_ol(joint, q), expected, atol=1e-9)


def _drawer_origin() -> np.ndarray:
    T = np.eye(4)
    T[2, 3] = 0.33
    return T


def test_handle_frames_lie_on_the_geometry(asset: Asset, model: mujoco.MjModel) -> None:
    bar, knob = asset.handle_of("drawer_joint"), asset.handle_of("door_joint")
    assert bar is not None
    assert knob is not None
    assert (bar.kind, bar.source) == ("bar", "name")
    np.testing.assert_allclose(bar.pos_l, [-0.036, 0.0, 0.08], atol=0.002)
    np.testing.assert_allclose(bar.normal_l, [-1.0, 0.0, 0.0], atol=1e-9)
    np.testing.assert_allclose(np.abs(bar.along_l), [0.0, 1.0, 0.0], atol=1e-9)
    np.testing.assert_allclose(bar.extent[0], 0.14, atol=0.01)
    np.testing.assert_allclose(bar.extent[1:], 0.012, atol=0.002)
    assert knob.kind == "knob"
    np.testing.assert_allclose(knob.pos_l, [-0.036, -0.37, 0.05], atol=0.006)
    np.testing.assert_allclose(knob.normal_l, [-1.0, 0.0, 0.0], atol=1e-9)


def test_sites_in_the_mjcf_are_the_handles_of_the_asset(
    asset: Asset, model: mujoco.MjModel
) -> None:
    data = mujoco.MjData(model)
    for joint in asset.joints:
        mujoco.mj_resetData(model, data)
        data.qpos[model.joint(joint.name).qposadr[0]] = joint.open
        mujoco.mj_kinematics(model, data)
        handle = asset.handle_of(joint.name)
        assert handle is not None
        T_oh = asset.T_oh(joint.name, joint.open)
        np.testing.assert_allclose(data.site(handle.name).xpos, T_oh[:3, 3], atol=1e-9)
        rotation = data.site(handle.name).xmat.reshape(3, 3)
        np.testing.assert_allclose(rotation, T_oh[:3, :3], atol=1e-9)


def test_fingers_closing_at_the_handle_meet_it_and_nothing_before(
    asset: Asset, model: mujoco.MjModel
) -> None:
    """Rays along the closing axis from where the fingers are, open to 8 cm."""
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    groups = np.array([0, 0, 0, 1, 0, 0], dtype=np.uint8)
    for joint in asset.joints:
        T_oh = asset.T_oh(joint.name, joint.closed)
        for side in (-1.0, 1.0):
            origin = T_oh[:3, 3] + 0.04 * side * T_oh[:3, 1]
            hit = np.zeros(1, dtype=np.int32)
            distance = mujoco.mj_ray(model, data, origin, -side * T_oh[:3, 1], groups, 1, -1, hit)
            assert model.geom(int(hit[0])).name.startswith(f"{joint.link}_handle")
            handle = asset.handle_of(joint.name)
            assert handle is not None
            np.testing.assert_allclose(distance, 0.04 - handle.extent[1] / 2.0, atol=0.003)


def test_the_drawer_is_hollow_and_the_carcass_open_in_front(
    asset: Asset, model: mujoco.MjModel
) -> None:
    data = mujoco.MjData(model)
    data.qpos[model.joint("drawer_joint").qposadr[0]] = 0.3
    mujoco.mj_forward(model, data)
    groups = np.array([0, 0, 0, 1, 0, 0], dtype=np.uint8)
    hit = np.zeros(1, dtype=np.int32)
    T_od = asset.T_ol("drawer_joint", 0.3)
    above = (T_od @ [0.12, 0.05, 0.4, 1.0])[:3]
    distance = mujoco.mj_ray(model, data, above, np.array([0.0, 0.0, -1.0]), groups, 1, -1, hit)
    np.testing.assert_allclose(distance, 0.4 - 0.02, atol=0.003)  # the bottom panel, not a lid
    assert all(link.collisions <= 12 for link in asset.links)


def test_collision_shapes_follow_the_panels(asset: Asset, model: mujoco.MjModel) -> None:
    boxes = [g for g in range(model.ngeom) if int(model.geom_type[g]) == mujoco.mjtGeom.mjGEOM_BOX]
    solid = [model.geom(g).name for g in boxes if np.prod(2 * model.geom_size[g]) > 0.01]
    assert not solid
    drawer = asset.link("drawer")
    assert 1.0 < drawer.mass_kg < 5.0


@pytest.mark.parametrize("name", ["drawer_joint", "door_joint"])
def test_thirty_newtons_at_the_handle_open_and_close_the_part(
    asset: Asset, model: mujoco.MjModel, name: str
) -> None:
    joint, handle = asset.joint(name), asset.handle_of(name)
    assert handle is not None
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    for sign in (1.0, -1.0):
        for _ in range(int(3.0 / model.opt.timestep)):
            _pull(model, data, name, handle.name, 30.0 * sign * np.sign(joint.span))
            mujoco.mj_step(model, data)
        share = (float(data.joint(name).qpos[0]) - joint.closed) / joint.span
        assert (share > 0.9) if sign > 0 else (share < 0.1)


def _pull(model: mujoco.MjModel, data: mujoco.MjData, joint: str, site: str, force: float) -> None:
    index, body = model.joint(joint).id, model.joint(joint).bodyid[0]
    point = data.site(site).xpos
    axis = data.xaxis[index]
    if int(model.jnt_type[index]) == int(mujoco.mjtJoint.mjJNT_HINGE):
        axis = np.cross(axis, point - data.xanchor[index])
        axis = axis / np.linalg.norm(axis)
    data.xfrc_applied[body, :3] = force * axis
    data.xfrc_applied[body, 3:] = np.cross(point - data.xipos[body], force * axis)


def test_nothing_moves_by_itself(asset: Asset, model: mujoco.MjModel) -> None:
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, int(2.0 / model.opt.timestep))
    np.testing.assert_allclose(data.qpos, 0.0, atol=2e-3)


def test_every_file_of_the_folder_is_referenced_and_the_same_on_every_run(
    asset: Asset, tmp_path: Path
) -> None:
    again = convert(write_cabinet(tmp_path), tmp_path / "out")
    assert again.content_id() == asset.content_id()
    text = (asset.folder / "object.xml").read_text()
    for path in (asset.folder / "meshes").iterdir():
        assert path.name in text
    assert sorted(p.name for p in asset.folder.iterdir()) == [
        "asset.json",
        "meshes",
        "object.urdf",
        "object.xml",
    ]


def test_requested_sizes_scale_everything_but_angles(asset: Asset, tmp_path: Path) -> None:
    longest = float(np.ptp(np.array(asset.bounds_o), axis=0).max())
    config = ConvertConfig(size_m=2.0 * longest)
    twice = convert(write_cabinet(tmp_path), tmp_path / "out", config)
    np.testing.assert_allclose(twice.bounds_o, 2.0 * np.array(asset.bounds_o), atol=1e-9)
    assert twice.joint("drawer_joint").open == pytest.approx(0.6)
    assert twice.joint("door_joint").open == pytest.approx(-1.6)
    assert "requested" in twice.size_rule


def test_a_partnet_folder_is_scaled_by_its_category(tmp_path: Path) -> None:
    path = write_cabinet(tmp_path)
    (path.parent / "meta.json").write_text('{"model_cat": "StorageFurniture"}')
    asset = convert(path, tmp_path / "out")
    assert asset.category == "StorageFurniture"
    assert any(
        "normalised source" in repairs_text
        for repairs_text in asset.repairs
        if "scaled by" in repairs_text
    )
    np.testing.assert_allclose(np.ptp(np.array(asset.bounds_o), axis=0).max(), 0.8, atol=1e-9)


@pytest.mark.parametrize(
    ("robot", "file", "name"),
    [
        ("little", "little.urdf", "little"),
        ("my drawer!", "little.urdf", "my_drawer_"),
        ("", "oven.urdf", "oven"),
        ("3e2ba8bd0af27797154dddaf2978e13f", "oven.urdf", "oven"),
        ("partnet_3e2ba8bd0af27797154dddaf2978e13f", "mobility.urdf", "partnet_little"),
        ("partnet_11e7166d-8424-4edf-98cf-783b60539214", "mobility.urdf", "partnet_little"),
        ("partnet_uadd97420-3888-4be8-89d3-15affc18968d", "mobility.urdf", "partnet_little"),
        ("partnet_fb05baf6da5b0856875c4d98e634f167-0", "mobility.urdf", "partnet_little"),
        ("", "mobility.urdf", "partnet_little"),
        ("cupboard", "mobility.urdf", "cupboard"),
        ("faded-cafe-facade", "a.urdf", "faded-cafe-facade"),
    ],
)
def test_objects_are_named_so_that_people_know_them(
    tmp_path: Path, robot: str, file: str, name: str
) -> None:
    text = CABINET.replace('name="little"', f'name="{robot}"' if robot else "")
    path = write_cabinet(tmp_path, text)
    assert read_urdf(path.rename(path.with_name(file))).name == name


def key(path: Path, config: ConvertConfig | None = None) -> str:
    config = config or ConvertConfig()
    return input_key(read_input(path, config), config)


def test_the_key_of_an_input_knows_content_and_configuration(tmp_path: Path) -> None:
    path = write_cabinet(tmp_path)
    first = key(path)
    assert key(path) == first
    assert key(path, ConvertConfig(closed="upper")) != first
    shutil.copytree(path.parent, tmp_path / "elsewhere" / "little")
    assert key(tmp_path / "elsewhere" / "little" / path.name) == first
    trimesh.creation.box((0.1, 0.1, 0.1)).export(path.parent / "meshes" / "knob.obj")
    assert key(path) != first


@pytest.mark.parametrize("other", ["big/little.urdf", "little/big.urdf"])
def test_alike_objects_that_are_called_otherwise_have_keys_of_their_own(
    tmp_path: Path, other: str
) -> None:
    """Their assets name their source."""
    path = write_cabinet(tmp_path)
    copy = tmp_path / "elsewhere" / other
    shutil.copytree(path.parent, copy.parent)
    shutil.copy(path, copy)
    assert key(copy) != key(path)


def test_the_key_of_an_input_knows_the_colours_of_materials(tmp_path: Path) -> None:
    path = write_cabinet(tmp_path)
    knob = path.parent / "meshes" / "knob.obj"
    knob.write_text("mtllib paint.mtl\nusemtl red\n" + knob.read_text())
    paint = knob.with_name("paint.mtl")
    paint.write_text("newmtl red\nKd 1 0 0\nmap_Kd -s 1 1 1 wood.png\n")
    first = key(path)
    assert named_files(knob) == [paint]
    Image.new("RGB", (4, 4), (90, 60, 30)).save(knob.with_name("wood.png"))
    assert named_files(knob) == [paint, knob.with_name("wood.png")]
    paint.write_text("newmtl red\nKd 0 1 0\n")
    assert key(path) != first


def test_a_part_without_a_named_handle_is_held_where_it_sticks_out(tmp_path: Path) -> None:
    text = CABINET.replace("drawer_handle", "drawer_trim").replace('name="knob"', 'name="x"')
    path = write_cabinet(tmp_path, text.replace("bar.ply", "trim.ply").replace("knob", "x"))
    (path.parent / "meshes" / "bar.ply").rename(path.parent / "meshes" / "trim.ply")
    (path.parent / "meshes" / "knob.obj").rename(path.parent / "meshes" / "x.obj")
    handle = convert(path, tmp_path / "out").handle_of("drawer_joint")
    assert handle is not None
    assert handle.source == "geometry"
    np.testing.assert_allclose(handle.pos_l, [-0.036, 0.0, 0.08], atol=0.005)


def test_a_plain_front_is_held_at_its_rim_or_doubted(tmp_path: Path) -> None:
    start = CABINET.index('  <link name="drawer_handle">')
    end = CABINET.index('  <link name="door">')
    text = CABINET[:start] + CABINET[end:]
    text = text.replace(
        '  <joint name="fix" type="fixed"><parent link="drawer"/>'
        '<child link="drawer_handle"/></joint>\n',
        "",
    )
    asset = convert(write_cabinet(tmp_path, text), tmp_path / "out")
    handle = asset.handle_of("drawer_joint")
    assert handle is not None
    assert handle.source == "edge"


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('<axis xyz="-1 0 0"/>', '<axis xyz="0 0 0"/>', "zero axis"),
        ('<axis xyz="-1 0 0"/>', '<axis xyz="a b c"/>', "not made of numbers"),
        ('<axis xyz="-1 0 0"/>', '<axis xyz="1 0"/>', "3 were expected"),
        ('<axis xyz="-1 0 0"/>', '<axis xyz="nan 0 0"/>', "not finite"),
        ('type="prismatic"', 'type="spherical"', "are accepted"),
        ('<child link="door"/>', '<child link="dor"/>', "did you mean door?"),
        ('<child link="door"/>', '<child link="body"/>', "two parents|cycle"),
        ("tray.stl", "absent.stl", "not found; looked in"),
        ("</robot>", "", "not XML"),
        ("<robot", "<sdf", "not XML|not a URDF"),
        ('<link name="door">', '<link name="drawer">', "a second link"),
        ('<?xml version="1.0"?>', "<!DOCTYPE robot [<!ENTITY x 'y'>]>", "DOCTYPE"),
        (CABINET, "<sdf/>", "holds no model"),
        (CABINET, "<html/>", "not a URDF"),
        (CABINET, "hello", "no XML"),
        (CABINET, "<robot/>", "no <link>"),
    ],
)
def test_unreadable_input_is_rejected_in_one_line(
    tmp_path: Path, old: str, new: str, words: str
) -> None:
    path = write_cabinet(tmp_path, CABINET.replace(old, new, 1))
    with pytest.raises(AssetError, match=words) as caught:
        convert(path, tmp_path / "out")
    assert "\n" not in str(caught.value)
    assert "little" in str(caught.value)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["little"]


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('<axis xyz="-1 0 0"/>', '<axis xyz="-2,0,0"/>', "commas"),
        ('<axis xyz="-1 0 0"/>', '<axis xyz="-2 0 0"/>', "had length 2"),
        ('lower="0" upper="0.3"', 'lower="0.3" upper="0"', "swapped"),
        ('lower="0" upper="0.3"', 'lower="nan" upper="0.3"', "lower=nan ignored"),
        ('<?xml version="1.0"?>', "a line of junk\n", "before the first element"),
        ('<link name="body">', '<link name="body"><xacro:property/>', "undeclared"),
        ("little/meshes/body.obj", "LITTLE/Meshes/BODY.OBJ", ""),
        ("package://little/meshes/tray.stl", "meshes\\tray.stl", ""),
        (
            '<mesh filename="meshes/knob.obj"/>',
            '<mesh filename="meshes/absent.obj"/>',
            "left out: .*absent.obj",
        ),
    ],
)
def test_repairable_input_is_repaired_and_listed(
    asset: Asset, tmp_path: Path, old: str, new: str, words: str
) -> None:
    made = convert(write_cabinet(tmp_path, CABINET.replace(old, new)), tmp_path / "out")
    drawer, expected = made.joint("drawer_joint"), asset.joint("drawer_joint")
    np.testing.assert_allclose(drawer.axis_o, expected.axis_o, atol=1e-12)
    assert (drawer.closed, drawer.open) == pytest.approx((expected.closed, expected.open))
    text = "\n".join(made.repairs)
    assert re.search(words, text), text


def test_missing_limits_are_recorded(tmp_path: Path) -> None:
    text = CABINET.replace('<limit lower="0" upper="0.3" effort="10" velocity="1"/>', "")
    text = text.replace('<limit lower="-1.6" upper="0" effort="10" velocity="1"/>', "")
    asset = convert(write_cabinet(tmp_path, text), tmp_path / "out")
    drawer, door = asset.joint("drawer_joint"), asset.joint("door_joint")
    assert drawer.open == pytest.approx(0.8 * 0.392, abs=0.05)
    assert (door.lower, door.upper) == (None, None)
    assert door.span == pytest.approx(np.pi / 2)
    assert sum("had no limits" in message for message in asset.repairs) == 2


def test_a_mirrored_mesh_keeps_its_place_and_faces_outwards(tmp_path: Path) -> None:
    text = CABINET.replace('knob.obj"/>', 'knob.obj" scale="1 -1 1"/>')
    text = text.replace('<visual name="knob">', '<visual name="knob"><origin xyz="0 -0.74 0"/>')
    asset = convert(write_cabinet(tmp_path, text), tmp_path / "out")
    handle = asset.handle_of("door_joint")
    assert handle is not None
    np.testing.assert_allclose(handle.pos_l[1], -0.37, atol=0.006)
    meshes = [trimesh.load_mesh(p, process=False) for p in (asset.folder / "meshes").glob("v*.obj")]
    small = min(meshes, key=lambda mesh: mesh.scale)
    assert small.volume > 0.0


def test_folders_that_are_no_assets_are_not_overwritten(tmp_path: Path) -> None:
    path = write_cabinet(tmp_path)
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "thesis.txt").write_text("years of work")
    with pytest.raises(UsageError, match="choose another --out"):
        convert(path, tmp_path / "mine")
    assert (tmp_path / "mine" / "thesis.txt").exists()


def test_an_asset_is_replaced_completely(tmp_path: Path) -> None:
    path = write_cabinet(tmp_path)
    first = convert(path, tmp_path / "out")
    convert(path, tmp_path / "out", ConvertConfig(closed="upper"))
    assert load_asset(tmp_path / "out") != replace(first, folder=tmp_path / "out")


@pytest.mark.dataset
@pytest.mark.parametrize(
    "path",
    [
        "assets/isaacgymenvs/sektion_cabinet_model/urdf/sektion_cabinet.urdf",
        "assets/partnet/20555/mobility.urdf",
    ],
)
def test_real_cabinets_open_at_their_named_handles(
    data_folder: Path, tmp_path: Path, path: str
) -> None:
    asset = convert(data_folder / path, tmp_path / "out")
    model = mujoco.MjModel.from_xml_path(str(asset.mjcf_path))
    for joint in asset.joints:
        handle = asset.handle_of(joint.name)
        assert handle is not None
        assert handle.source == "name"
        data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
        for _ in range(int(3.0 / model.opt.timestep)):
            _pull(model, data, joint.name, handle.name, 30.0 * np.sign(joint.span))
            mujoco.mj_step(model, data)
        assert (float(data.joint(joint.name).qpos[0]) - joint.closed) / joint.span > 0.9


def test_a_joint_that_mimics_another_follows_it(tmp_path: Path) -> None:
    mimic = '<mimic joint="drawer_joint" multiplier="-4" offset="-0.1"/>'
    text = CABINET.replace('<limit lower="-1.6"', f'{mimic}<limit lower="-1.6"')
    asset = convert(write_cabinet(tmp_path, text), tmp_path / "out", ConvertConfig(size_m=1.0))
    model = mujoco.MjModel.from_xml_path(str(asset.mjcf_path))
    assert model.neq == 1
    scale = asset.joint("drawer_joint").open / 0.3
    np.testing.assert_allclose(model.eq_data[0, :2], [-0.1, -4.0 / scale], rtol=1e-9)
