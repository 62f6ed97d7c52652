"""Common mistakes in URDFs and in their readers, a test for each."""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
import yourdfpy
from PIL import Image
from tests.articulate.conversion.boxes import (
    AXIS,
    BODY_BOX,
    LIMIT,
    loaded,
    made,
    repairs_text,
    written,
)

from articulate.conversion import ConvertConfig, convert
from articulate.errors import AssetError
from articulate.formats.mesh_paths import MissingMesh
from articulate.geometry.presets import MASS_KG, SLIDE
from articulate.simulator import mujoco

HINGE = ('type="prismatic"', 'type="revolute"')
REST = '<limit lower="0" upper="0.3"/>\n  </joint>'


def more(text: str) -> tuple[str, str]:
    """Put ``text`` before the end of the file."""
    return "</robot>", f"{text}</robot>"


LID = (
    '<link name="lid"><visual><geometry><box size="0.4 0.4 0.02"/></geometry></visual></link>'
    '<joint name="turn" type="{kind}"><parent link="body"/><child link="lid"/>'
    '<origin xyz="0 0 0.21"/>{inside}</joint>'
)


def lid(kind: str, inside: str = "") -> tuple[str, str]:
    return more(LID.format(kind=kind, inside=inside))


def test_commas_in_vectors_are_spaces(tmp_path: Path) -> None:
    asset = made(
        tmp_path, (AXIS, '<axis xyz="-1, 0, 0"/>'), (BODY_BOX, '<box size="0.4,0.4,0.4"/>')
    )
    assert asset.joint("slide").axis_o == (-1.0, 0.0, 0.0)
    assert "commas between numbers read as spaces" in repairs_text(asset)


def test_an_axis_of_another_length_is_made_one_and_the_travel_stays(tmp_path: Path) -> None:
    asset = made(
        tmp_path, (AXIS, '<axis xyz="-0.6 0 0.8"/>'.replace("0.6", "1.2").replace("0.8", "1.6"))
    )
    joint = asset.joint("slide")
    np.testing.assert_allclose(joint.axis_o, [-0.6, 0.0, 0.8], atol=1e-12)
    assert joint.span == 0.3
    assert "had length 2" in repairs_text(asset)


def test_an_absent_axis_is_x_by_default(tmp_path: Path) -> None:
    assert made(tmp_path, (AXIS, "")).joint("slide").axis_o == (1.0, 0.0, 0.0)


def test_a_zero_axis_is_rejected_where_it_moves_something(tmp_path: Path) -> None:
    with pytest.raises(AssetError, match=r"two\.urdf:\d+: joint 'slide' has a zero axis"):
        made(tmp_path, (AXIS, '<axis xyz="0 0 0"/>'))


def test_a_zero_axis_of_a_fixed_joint_is_ignored(tmp_path: Path) -> None:
    asset = made(tmp_path, lid("fixed", '<axis xyz="0 0 0"/>'))
    assert [joint.name for joint in asset.joints] == ["slide"]


def test_swapped_limits_are_turned_round(tmp_path: Path) -> None:
    asset = made(tmp_path, (LIMIT, '<limit lower="0.3" upper="0"/>'))
    assert (asset.joint("slide").lower, asset.joint("slide").upper) == (0.0, 0.3)
    assert "swapped" in repairs_text(asset)


@pytest.mark.parametrize("value", [0.0, 0.12])
def test_equal_limits_hold_the_part_where_they_are(tmp_path: Path, value: float) -> None:
    asset = made(tmp_path, (LIMIT, f'<limit lower="{value}" upper="{value}"/>'))
    assert asset.joints == ()
    assert f"lower = upper = {value:g}: fixed" in repairs_text(asset)
    low, high = np.array(asset.bounds_o)
    np.testing.assert_allclose((high - low)[0], 0.43 + value, atol=1e-9)


@pytest.mark.parametrize("text", ["", "<limit/>", '<limit lower="nan" upper="nan"/>'])
def test_a_slide_without_limits_gets_some_and_a_hinge_turns_without_end(
    tmp_path: Path, text: str
) -> None:
    slide = made(tmp_path / "slide", (LIMIT, text))
    assert slide.joint("slide").upper == pytest.approx(0.8 * 0.02)
    hinge = made(tmp_path / "hinge", (LIMIT, text), HINGE)
    assert hinge.joint("slide").upper is None
    assert not bool(loaded(hinge).jnt_limited[0])
    for asset in (slide, hinge):
        assert "had no limits" in repairs_text(asset)


@pytest.mark.parametrize("text", ["nan", "inf", "-inf"])
def test_one_limit_that_is_not_finite_is_read_as_zero(tmp_path: Path, text: str) -> None:
    asset = made(tmp_path, (LIMIT, f'<limit lower="{text}" upper="0.3"/>'))
    assert (asset.joint("slide").lower, asset.joint("slide").upper) == (0.0, 0.3)
    assert f"lower={text} ignored" in repairs_text(asset)


@pytest.mark.parametrize(
    ("lower", "upper"), [("-1000", "1000"), ("0", "1e16"), ("-1e308", "1e308")]
)
def test_absurd_limits_are_none(tmp_path: Path, lower: str, upper: str) -> None:
    asset = made(tmp_path, (LIMIT, f'<limit lower="{lower}" upper="{upper}"/>'), HINGE)
    assert asset.joint("slide").upper is None
    assert "are meaningless" in repairs_text(asset)


def test_absent_effort_and_velocity_bound_nothing(tmp_path: Path) -> None:
    asset = made(tmp_path)
    assert not loaded(asset).jnt_actfrclimited.any()
    other = made(tmp_path / "given", (LIMIT, LIMIT.replace("/>", ' effort="0" velocity="0"/>')))
    assert (other.folder / "object.xml").read_bytes() == (asset.folder / "object.xml").read_bytes()


def test_a_continuous_joint_has_no_limits_with_any_limits_in_the_file(tmp_path: Path) -> None:
    asset = made(tmp_path, ('type="prismatic"', 'type="continuous"'))
    assert asset.joint("slide").upper is None
    assert "limits of the continuous joint slide left out" in repairs_text(asset)


def test_types_in_capitals_are_read(tmp_path: Path) -> None:
    asset = made(tmp_path, ('type="prismatic"', 'type="Prismatic"'))
    assert asset.joint("slide").kind == "slide"
    assert "read as 'prismatic'" in repairs_text(asset)


@pytest.mark.parametrize("kind", ["spherical", "", "joint_type"])
def test_types_that_no_format_knows_are_rejected(tmp_path: Path, kind: str) -> None:
    with pytest.raises(AssetError, match=f"is of type '{kind}'; revolute, .* are accepted"):
        made(tmp_path, ('type="prismatic"', f'type="{kind}"'))


def test_a_planar_joint_is_two_slides_and_a_turn(tmp_path: Path) -> None:
    """At zero nothing moves; the child goes to the composed pose, as in the format."""
    inside = '<axis xyz="0 0 1"/><limit lower="-0.1" upper="0.2"/>'
    asset = made(tmp_path, lid("planar", inside))
    names = ["turn_x", "turn_y", "turn"]
    assert [j.name for j in asset.joints if j.name != "slide"] == names
    assert [asset.joint(name).kind for name in names] == ["slide", "slide", "hinge"]
    assert asset.joint("turn_x").upper == 0.2
    assert "joint turn is planar" in repairs_text(asset)
    model = loaded(asset)
    data = mujoco.MjData(model)
    for name, value in zip(names, (0.15, -0.05, 0.7), strict=True):
        data.qpos[int(model.joint(name).qposadr[0])] = value
    mujoco.mj_kinematics(model, data)
    rest = np.array(asset.link("lid").pos_o)
    np.testing.assert_allclose(
        data.body("lid").xpos, rest + np.array([0.15, -0.05, 0.0]), atol=1e-9
    )
    turned: Any = [[math.cos(0.7), -math.sin(0.7), 0], [math.sin(0.7), math.cos(0.7), 0], [0, 0, 1]]
    np.testing.assert_allclose(data.body("lid").xmat.reshape(3, 3), turned, atol=1e-9)


@pytest.mark.parametrize("pitch", [0.02, -0.02])
def test_a_screw_goes_its_pitch_for_each_turn(tmp_path: Path, pitch: float) -> None:
    inside = (
        '<axis xyz="0 0 1"/><limit lower="0" upper="12.56"/>'
        f'<drake:screw_thread_pitch value="{pitch}"/>'
    )
    asset = made(tmp_path, lid("screw", inside))
    assert [j.name for j in asset.joints if j.name != "slide"] == ["turn_slide", "turn"]
    model = loaded(asset)
    assert model.neq == 1
    np.testing.assert_allclose(model.eq_data[0, :2], [0.0, pitch / (2 * math.pi)], rtol=1e-9)
    slide = asset.joint("turn_slide")
    assert (slide.lower, slide.upper) == pytest.approx(sorted([0.0, pitch * 12.56 / math.tau]))
    robot = yourdfpy.URDF.load(str(asset.folder / "object.urdf"), load_meshes=False)
    robot.update_cfg({"turn": 2 * math.pi})
    moved = robot.get_transform("lid", "body")[2, 3]
    robot.update_cfg({"turn": 0.0})
    np.testing.assert_allclose(moved - robot.get_transform("lid", "body")[2, 3], pitch, atol=1e-9)


def test_a_screw_without_a_pitch_turns_in_place(tmp_path: Path) -> None:
    asset = made(tmp_path, lid("screw", '<axis xyz="0 0 1"/>'))
    assert asset.joint("turn").kind == "hinge"
    assert "without a pitch" in repairs_text(asset)


def test_a_floating_part_is_held_where_it_is(tmp_path: Path) -> None:
    asset = made(tmp_path, lid("floating"))
    assert [joint.name for joint in asset.joints] == ["slide"]
    assert "joint turn is floating: link lid is fixed at its pose" in repairs_text(asset)


def test_a_mimic_follows_in_both_files(tmp_path: Path) -> None:
    follow = '<axis xyz="0 0 1"/><limit lower="0" upper="1"/><mimic joint="slide" multiplier="3"/>'
    asset = made(tmp_path, lid("revolute", follow))
    model = loaded(asset)
    np.testing.assert_allclose(model.eq_data[0, :2], [0.0, 3.0])
    text = (asset.folder / "object.urdf").read_text()
    assert '<mimic joint="slide" multiplier="3" offset="0"/>' in text


def test_a_mimic_of_a_continuous_joint_follows_it(tmp_path: Path) -> None:
    follow = '<axis xyz="0 0 1"/><mimic joint="slide" multiplier="2" offset="0.1"/>'
    asset = made(tmp_path, ('type="prismatic"', 'type="continuous"'), lid("continuous", follow))
    np.testing.assert_allclose(loaded(asset).eq_data[0, :2], [0.1, 2.0])


@pytest.mark.parametrize(
    ("leader", "words"),
    [
        ("turn", "mimics itself"),
        ("absent", "mimics absent, which does not move"),
        ("", "without a joint"),
    ],
)
def test_a_mimic_of_nothing_moves_on_its_own(tmp_path: Path, leader: str, words: str) -> None:
    follow = f'<axis xyz="0 0 1"/><limit lower="0" upper="1"/><mimic joint="{leader}"/>'
    asset = made(tmp_path, lid("revolute", follow))
    assert loaded(asset).neq == 0
    assert words in repairs_text(asset)


def test_two_joints_that_mimic_each_other_are_cut_once(tmp_path: Path) -> None:
    follow = '<axis xyz="0 0 1"/><limit lower="0" upper="1"/><mimic joint="slide"/>'
    asset = made(tmp_path, (LIMIT, f'{LIMIT}<mimic joint="turn"/>'), lid("revolute", follow))
    assert loaded(asset).neq == 1
    assert "mimics itself" in repairs_text(asset)


def test_fixed_links_keep_their_names_and_places(tmp_path: Path) -> None:
    tip = (
        '<link name="tip"/><joint name="hold" type="fixed"><parent link="drawer"/>'
        '<child link="tip"/><origin xyz="-0.05 0.1 0" rpy="0 0 1.2"/></joint>'
    )
    asset = made(tmp_path, more(tip), config=ConvertConfig(size_m=0.86))
    model = loaded(asset)
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    expected = np.array(asset.link("drawer").pos_o) + 2.0 * np.array([-0.05, 0.1, 0.0])
    np.testing.assert_allclose(data.site("tip").xpos, expected, atol=1e-9)
    robot = yourdfpy.URDF.load(str(asset.folder / "object.urdf"), load_meshes=False)
    T = robot.get_transform("tip", "body")
    np.testing.assert_allclose(T[:3, 3], expected, atol=1e-9)
    np.testing.assert_allclose(T[:3, :3], data.site("tip").xmat.reshape(3, 3), atol=1e-9)


def test_frames_of_the_canonical_urdf_weigh_nothing(tmp_path: Path) -> None:
    """PyBullet gives 1 kg to a link without a mass; MuJoCo fuses all of them."""
    pybullet = pytest.importorskip("pybullet")
    tip = (
        '<link name="tip"/><joint name="hold" type="fixed"><parent link="drawer"/>'
        '<child link="tip"/></joint>'
    )
    asset = made(tmp_path, more(tip))
    client = pybullet.connect(pybullet.DIRECT)
    try:
        robot = pybullet.loadURDF(str(asset.folder / "object.urdf"), physicsClientId=client)
        joints = range(pybullet.getNumJoints(robot, physicsClientId=client))
        mass = {
            pybullet.getJointInfo(robot, j, physicsClientId=client)[12].decode(): (
                pybullet.getDynamicsInfo(robot, j, physicsClientId=client)[0]
            )
            for j in joints
        }
    finally:
        pybullet.disconnect(client)
    assert mass == {"drawer": pytest.approx(asset.link("drawer").mass_kg), "tip": 0.0}


def test_visual_geometry_is_kept_and_does_not_collide(tmp_path: Path) -> None:
    model = loaded(made(tmp_path))
    seen = [g for g in range(model.ngeom) if int(model.geom_group[g]) == 2]
    assert len(seen) == 2
    assert not model.geom_contype[seen].any()


def test_a_second_root_is_fixed_to_the_first_and_listed(tmp_path: Path) -> None:
    stray = (
        '<link name="shelf"><visual><geometry><box size="0.1 0.1 0.1"/></geometry></visual></link>'
    )
    asset = made(tmp_path, more(stray))
    assert "several root links; shelf fixed to body" in repairs_text(asset)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ([('<child link="drawer"/>', '<child link="drawers"/>')], "did you mean drawer"),
        ([('<parent link="body"/>', '<parent link="drawer"/>')], "cycle"),
        (
            [
                lid("fixed", ""),
                more(LID.format(kind="fixed", inside="").split("</link>")[1].replace("turn", "u")),
            ],
            "two parents",
        ),
        ([('<parent link="body"/>', "")], "lacks a parent or a child"),
    ],
)
def test_joints_that_make_no_tree_are_rejected(tmp_path: Path, changes, words: str) -> None:
    with pytest.raises(AssetError, match=words):
        made(tmp_path, *changes)


def test_the_ground_need_not_be_declared(tmp_path: Path) -> None:
    weld = '<joint name="weld" type="fixed"><parent link="world"/><child link="body"/></joint>'
    asset = made(tmp_path, more(weld))
    assert [link.name for link in asset.links] == ["body", "drawer"]
    assert "link world is not declared" in repairs_text(asset)


def test_a_root_called_world_with_geometry_is_renamed(tmp_path: Path) -> None:
    path = written(tmp_path)
    path.write_text(
        path.read_text().replace('"body"', '"world"').replace('"drawer"', '"world_link"')
    )
    asset = convert(path, tmp_path / "out")
    assert [link.name for link in asset.links] == ["world_link_2", "world_link"]
    assert loaded(asset).nbody == 3


def test_a_second_joint_of_the_same_name_is_renamed(tmp_path: Path) -> None:
    text = LID.replace('"turn"', '"slide"').format(
        kind="revolute", inside='<axis xyz="0 1 0"/><limit lower="0" upper="1"/>'
    )
    asset = made(tmp_path, more(text))
    assert [joint.name for joint in asset.joints] == ["slide", "slide_2"]
    assert "a second joint is called slide: renamed slide_2" in repairs_text(asset)


def test_identical_duplicates_are_read_once(tmp_path: Path) -> None:
    text = written(tmp_path).read_text()
    again = text[text.index('<link name="drawer">') : text.index("</robot>")]
    asset = made(tmp_path, more(again))
    assert [joint.name for joint in asset.joints] == ["slide"]
    assert "link drawer is defined twice, identically" in repairs_text(asset)
    assert "joint slide is defined twice, identically" in repairs_text(asset)


def test_two_links_of_one_name_that_differ_are_rejected(tmp_path: Path) -> None:
    with pytest.raises(AssetError, match="a second link is called 'drawer' and differs"):
        made(tmp_path, more('<link name="drawer"/>'))


def inertial(mass: str, values: str, origin: str = "0 0 0") -> tuple[str, str]:
    xx, yy, zz = values.split()
    text = (
        f'<inertial><origin xyz="{origin}"/><mass value="{mass}"/>'
        f'<inertia ixx="{xx}" iyy="{yy}" izz="{zz}" ixy="0" ixz="0" iyz="0"/></inertial>'
    )
    return '<link name="drawer">', f'<link name="drawer">{text}'


@pytest.mark.parametrize(
    ("mass", "values"),
    [
        ("1", "0.1 0.1 0.5"),
        ("1", "-0.1 0.1 0.1"),
        ("1", "0 0 0"),
        ("0", "0.1 0.1 0.1"),
        ("nan", "0.1 0.1 0.1"),
        ("1e30", "0.1 0.1 0.1"),
        ("abc", "0.1 0.1 0.1"),
    ],
)
def test_inertia_that_no_body_has_is_computed_from_the_shapes(
    tmp_path: Path, mass: str, values: str
) -> None:
    asset = made(tmp_path, inertial(mass, values))
    expected = max(500.0 * 0.02 * 0.3 * 0.1, MASS_KG["slide"][0])
    assert asset.link("drawer").mass_kg == pytest.approx(expected)
    assert re.search("computed|left out", repairs_text(asset))


def test_absent_inertia_is_computed_and_listed(tmp_path: Path) -> None:
    asset = made(tmp_path)
    text = "mass and inertia of links body, drawer computed from their shapes at 500 kg/m3"
    assert text in repairs_text(asset)
    assert asset.link("body").mass_kg == pytest.approx(500.0 * 0.4**3)


def test_inertia_of_a_source_that_is_not_metric_is_left_out_and_listed(tmp_path: Path) -> None:
    config = ConvertConfig(size_m=0.86)
    asset = made(tmp_path, inertial("1", "0.1 0.1 0.1"), config=config)
    assert "ignored, for it is not metric" in repairs_text(asset)
    assert asset.link("drawer").mass_kg == pytest.approx(500.0 * 8 * 0.02 * 0.3 * 0.1)


def test_a_moving_link_without_geometry_and_inertia_carries_others(tmp_path: Path) -> None:
    """MuJoCo rejects moving bodies without mass; the format allows them between others."""
    chain = (
        '<link name="between"/><link name="lid"><visual><geometry><box size="0.1 0.1 0.02"/>'
        '</geometry></visual></link><joint name="a" type="continuous"><parent link="body"/>'
        '<child link="between"/><axis xyz="0 0 1"/></joint><joint name="b" type="revolute">'
        '<parent link="between"/><child link="lid"/><axis xyz="0 1 0"/>'
        '<limit lower="0" upper="1"/></joint>'
    )
    model = loaded(made(tmp_path, more(chain)))
    assert (model.body_mass[1:] > 0.0).all()
    assert (model.body_inertia[1:] > 0.0).all()


def test_a_moving_leaf_without_geometry_is_left_out_and_listed(tmp_path: Path) -> None:
    leaf = (
        '<link name="leaf"/><joint name="a" type="continuous"><parent link="body"/>'
        '<child link="leaf"/><axis xyz="0 0 1"/></joint>'
    )
    asset = made(tmp_path, more(leaf))
    assert [joint.name for joint in asset.joints] == ["slide"]
    assert "link leaf has no geometry: left out with its joint" in repairs_text(asset)


def test_what_moves_in_the_carcass_does_not_collide_with_it(tmp_path: Path) -> None:
    """The carcass is welded to the world, so that MuJoCo's own filter leaves the pair in."""
    model = loaded(made(tmp_path, ('<origin xyz="-0.22 0 0"/>', '<origin xyz="-0.1 0 0"/>')))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    assert model.nexclude == 1
    assert data.ncon == 0


def test_misspelt_attributes_and_unknown_elements_are_ignored(tmp_path: Path) -> None:
    plain = made(tmp_path / "plain")
    extra = '<gazebo reference="drawer"><mu1>0.9</mu1></gazebo><sensor naem="x"/>'
    asset = made(tmp_path / "extra", more(extra), (AXIS, '<axis xyz="-1 0 0" xzy="0 0 1"/>'))
    assert (asset.folder / "object.xml").read_bytes() == (plain.folder / "object.xml").read_bytes()


def test_the_links_whose_masses_are_computed_are_named(tmp_path: Path) -> None:
    """Whatever the others have."""
    asset = made(tmp_path, inertial("1", "0.0083 0.0009 0.0075"))
    computed = "mass and inertia of link body computed from their shapes at 500 kg/m3"
    assert computed in repairs_text(asset)
    assert asset.link("drawer").mass_kg == 1.0


def test_an_object_without_a_movable_joint_is_rigid_and_listed(tmp_path: Path) -> None:
    asset = made(tmp_path, ('type="prismatic"', 'type="fixed"'))
    assert asset.joints == ()
    assert asset.handles == ()
    assert "note: no joint moves: the object is rigid" in asset.repairs
    model = loaded(asset)
    assert model.nv == 0
    assert (model.body_mass[1:] > 0.0).all()


def test_a_mirrored_mesh_has_a_hull_with_outward_normals(tmp_path: Path) -> None:
    """MuJoCo turns the polygons of a mesh inside out whose scale mirrors it."""
    (tmp_path / "meshes").mkdir()
    wedge = trimesh.convex.convex_hull(
        [[0, 0, 0], [0.3, 0, 0], [0, 0.2, 0], [0.3, 0.2, 0], [0, 0.05, 0.1], [0.3, 0.05, 0.1]]
    )
    wedge.export(tmp_path / "meshes" / "wedge.obj")
    mesh = '<mesh filename="meshes/wedge.obj" scale="1 -2 0.5"/>'
    asset = made(tmp_path, ('<box size="0.02 0.3 0.1"/>', mesh))
    assert "mirrored mesh wedge.obj: face orientation reversed" in repairs_text(asset)
    visual = max((asset.folder / "meshes").glob("v01*.obj"), key=lambda p: p.stat().st_size)
    found = trimesh.load_mesh(visual)
    np.testing.assert_allclose(found.bounds, [[0, -0.4, 0], [0.3, 0, 0.05]], atol=1e-9)
    np.testing.assert_allclose(found.volume, wedge.volume, rtol=1e-9)
    model = loaded(asset)
    for m in range(model.nmesh):
        start, count = int(model.mesh_polyadr[m]), int(model.mesh_polynum[m])
        centre = model.mesh_vert[int(model.mesh_vertadr[m]) :][: int(model.mesh_vertnum[m])].mean(
            axis=0
        )
        for k in range(start, start + count):
            vertex = int(model.mesh_polyvert[int(model.mesh_polyvertadr[k])])
            corner = model.mesh_vert[int(model.mesh_vertadr[m]) + vertex]
            assert np.dot(model.mesh_polynormal[k], corner - centre) > 0.0


@pytest.mark.parametrize(
    ("corners", "faces"),
    [
        ([[0, 0, 0], [0, 0.3, 0], [0, 0.3, 0.1], [0, 0, 0.1]], [[0, 1, 2], [0, 2, 3]]),
        ([[0, 0, 0], [0, 0.3, 0], [0, 0.3, 0.1]], [[0, 1, 2]]),
        (
            [[0, 0, 0], [0, 0.3, 0], [0.01, 0.3, 0.1], [0, 0, 0.1]],
            [[0, 1, 2], [2, 1, 0], [0, 2, 3]],
        ),
    ],
)
def test_flat_meshes_single_triangles_and_open_sheets_are_thickened(
    tmp_path: Path, corners, faces
) -> None:
    (tmp_path / "meshes").mkdir()
    sheet = trimesh.Trimesh(corners, faces, process=False)
    sheet.export(tmp_path / "meshes" / "sheet.obj")
    mesh = '<mesh filename="meshes/sheet.obj"/>'
    asset = made(tmp_path, ('<box size="0.02 0.3 0.1"/>', mesh))
    model = loaded(asset)
    assert asset.link("drawer").collisions >= 1
    assert model.body("drawer").mass[0] > 0.0


@pytest.mark.parametrize("content", ["", "v 0 0 0\n", "v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n"])
def test_a_mesh_of_nothing_is_left_out_or_rejected(tmp_path: Path, content: str) -> None:
    (tmp_path / "meshes").mkdir()
    (tmp_path / "meshes" / "empty.obj").write_text(content)
    mesh = '<mesh filename="meshes/empty.obj"/>'
    with pytest.raises(AssetError, match=r"mesh empty\.obj: (has no|cannot be read)"):
        made(tmp_path, ('<box size="0.02 0.3 0.1"/>', mesh))
    other = f"<visual><geometry>{mesh}</geometry></visual></link>\n  <joint"
    asset = made(tmp_path, ("</link>\n  <joint", other))
    assert "left out: " in repairs_text(asset)
    assert "empty.obj" in repairs_text(asset)


def test_a_mesh_that_may_come_is_distinguished_from_one_that_cannot_be_read(tmp_path: Path) -> None:
    changes = ('<box size="0.02 0.3 0.1"/>', '<mesh filename="meshes/leaf.obj"/>')
    with pytest.raises(MissingMesh, match=r"two\.urdf:\d+: mesh 'meshes/leaf\.obj' not found"):
        made(tmp_path, changes)
    (tmp_path / "meshes").mkdir()
    (tmp_path / "meshes" / "leaf.obj").write_text("v 0 0 0\n")
    with pytest.raises(AssetError, match=r"leaf\.obj") as caught:
        made(tmp_path, changes)
    assert not isinstance(caught.value, MissingMesh)


def test_dynamics_absent_are_those_of_the_table(tmp_path: Path) -> None:
    joint = made(tmp_path).joint("slide")
    assert (joint.damping, joint.frictionloss) == (SLIDE.damping, SLIDE.frictionloss)


@pytest.mark.parametrize("factor", [1000.0, 0.001])
def test_an_object_of_no_likely_size_is_converted_or_rejected_until_its_size_is_set(
    tmp_path: Path, factor: float
) -> None:
    side = f"{0.4 * factor:g}"
    changes = (
        (BODY_BOX, f'<box size="{side} {side} {side}"/>'),
        ('<box size="0.02 0.3 0.1"/>', f'<box size="{0.02 * factor:g} {side} {side}"/>'),
        ('xyz="-0.22 0 0"', f'xyz="{-0.21 * factor:g} 0 0"'),
        (LIMIT, f'<limit lower="0" upper="{0.05 * factor:g}"/>'),
    )
    if factor > 1.0:
        asset = made(tmp_path / "plain", *changes)
        assert "numbers are mm" in repairs_text(asset)
        np.testing.assert_allclose(np.ptp(np.array(asset.bounds_o), axis=0).max(), 0.42)
        return
    with pytest.raises(AssetError, match=r"in metres with --size|no link has geometry"):
        made(tmp_path / "plain", *changes)
    asset = made(tmp_path / "given", *changes, config=ConvertConfig(size_m=0.42))
    np.testing.assert_allclose(np.ptp(np.array(asset.bounds_o), axis=0).max(), 0.42)


def test_a_mesh_in_another_folder_is_found_and_listed(tmp_path: Path) -> None:
    (tmp_path / "meshes").mkdir()
    trimesh.creation.box((0.02, 0.3, 0.1)).export(tmp_path / "meshes" / "Front.obj")
    mesh = '<mesh filename="../../data/meshes/front.obj"/>'
    asset = made(tmp_path, ('<box size="0.02 0.3 0.1"/>', mesh))
    assert "mesh '../../data/meshes/front.obj' was found at meshes/Front.obj" in repairs_text(asset)


def test_a_texture_of_the_file_colours_a_mesh(tmp_path: Path) -> None:
    (tmp_path / "meshes").mkdir()
    trimesh.creation.box((0.02, 0.3, 0.1)).export(tmp_path / "meshes" / "front.stl")
    Image.new("RGB", (4, 4), (51, 102, 204)).save(tmp_path / "meshes" / "wood.png")
    mesh = (
        '<mesh filename="meshes/front.stl"/></geometry><material name="m">'
        '<texture filename="meshes/wood.png"/></material><geometry>'
    )
    asset = made(tmp_path, ('<box size="0.02 0.3 0.1"/>', mesh))
    model = loaded(asset)
    visual = next(g for g in range(model.ngeom) if int(model.geom_bodyid[g]) == 2)
    np.testing.assert_allclose(model.geom_rgba[visual], [0.2, 0.4, 0.8, 1.0], atol=0.01)
    assert "textures were replaced by the mean colour" in repairs_text(asset)


def test_specks_are_left_out_and_listed(tmp_path: Path) -> None:
    speck = (
        '</visual><visual><geometry><sphere radius="1e-6"/></geometry></visual></link>\n  <joint'
    )
    asset = made(tmp_path, ("</visual>\n  </link>\n  <joint", speck))
    assert asset.link("drawer").visuals == 1
    assert "part drawer: 1 visual pieces of next to no area left out" in repairs_text(asset)


def test_an_object_of_only_specks_is_rejected(tmp_path: Path) -> None:
    speck = '<sphere radius="1e-6"/>'
    with pytest.raises(AssetError, match="no link has geometry of any area"):
        made(tmp_path, (BODY_BOX, speck), ('<box size="0.02 0.3 0.1"/>', speck))
