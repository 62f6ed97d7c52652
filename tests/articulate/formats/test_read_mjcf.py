from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image
from tests.articulate.conversion.mjcf import (
    BALL,
    DRAWER,
    has_message,
    joint_of,
    model,
    moving,
    raw_poses,
    read,
    states,
    write,
    written_poses,
)

from articulate.conversion import ConvertConfig, convert
from articulate.errors import AssetError
from articulate.formats.link_tree import build_parts, poses_at
from articulate.formats.load_meshes import Loader
from articulate.formats.read_mjcf import read_mjcf
from articulate.simulator import mujoco
from articulate.transforms import apply, pose

pytestmark = pytest.mark.usefixtures("quick")

TWISTED = """<mujoco model="twisted">
  <compiler angle="degree" eulerseq="zyx"/>
  <default><default class="turned"><geom euler="0 10 20"/><joint axis="1 2 3"/></default></default>
  <worldbody>
    <body name="base" pos="0.4 0.1 0.3" euler="30 0 0">
      <geom type="box" size="0.2 0.2 0.1"/>
      <frame pos="0 0 0.2" euler="0 40 0">
        <body name="door" pos="0.3 0 0" childclass="turned">
          <joint name="door_hinge" pos="0.05 -0.1 0" range="-60 90" ref="15"/>
          <geom type="box" size="0.1 0.02 0.1" pos="-0.1 0 0"/>
          <body name="plate" axisangle="0 0 1 25"><geom type="box" size="0.02 0.03 0.04"/>
            <body name="wagon" pos="0 0.1 0.1" xyaxes="0 1 0 -1 0 0">
              <joint name="along" type="slide" axis="0 1 0" range="-0.1 0.2" ref="0.05"/>
              <joint name="round" type="hinge" axis="0 0 1" pos="0.02 0.03 0" range="-45 45"/>
              <joint name="tilt" type="hinge" axis="1 0 0" pos="0 0.01 0.04" range="-45 45"/>
              <geom type="cylinder" size="0.03 0.05" zaxis="1 0 1"/>
            </body>
          </body>
        </body>
      </frame>
    </body>
  </worldbody>
</mujoco>"""


def test_every_notation_of_a_frame_moves_as_muJoCo_moves_it(tmp_path: Path) -> None:
    """Classes, frames, degrees, anchors, references and several joints of one body."""
    source = read(tmp_path, TWISTED)
    raw = mujoco.MjModel.from_xml_string(TWISTED)
    parts = build_parts(source)
    for q in states(source, 50):
        here, there = poses_at(parts, q), raw_poses(raw, q)
        for name in ("door", "wagon"):
            np.testing.assert_allclose(here[name], there[name], atol=1e-12)


@pytest.mark.usefixtures("in_child")
def test_written_asset_moves_as_the_input_up_to_the_object_frame(tmp_path: Path) -> None:
    asset = convert(write(tmp_path, TWISTED), tmp_path / "out")
    source, raw = read_mjcf(tmp_path / "thing.xml"), mujoco.MjModel.from_xml_string(TWISTED)
    names = [link.name for link in asset.links]
    assert names == ["base", "door", "wagon_along", "wagon_round", "wagon"]
    first = states(source, 1)[0]
    offset = written_poses(asset, first)["door"][:3, 3] - raw_poses(raw, first)["door"][:3, 3]
    T_ow = pose(offset)
    for q in states(source, 20):
        here, there = written_poses(asset, q), raw_poses(raw, q)
        for name in ("door", "wagon"):
            np.testing.assert_allclose(here[name], T_ow @ there[name], atol=1e-6)


def test_drawer_becomes_an_asset_that_keeps_the_values_of_its_author(tmp_path: Path) -> None:
    asset = convert(write(tmp_path, DRAWER), tmp_path / "out", ConvertConfig(decompose=False))
    joint = asset.joint("slide")
    assert (joint.kind, joint.lower, joint.upper) == ("slide", 0.0, 0.3)
    np.testing.assert_allclose(joint.axis_o, (-1.0, 0.0, 0.0))
    assert (joint.damping, joint.frictionloss) == (7.0, 3.0)
    made = mujoco.MjModel.from_xml_path(str(asset.folder / "object.xml"))
    assert made.dof_armature[0] == pytest.approx(0.2)
    rod = math.pi * 0.008**2 * (0.12 + 4.0 / 3.0 * 0.008)
    volume = 8.0 * (0.01 * 0.24 * 0.15 + 0.16 * 0.2 * 0.01) + rod
    assert asset.link("drawer").mass_kg == pytest.approx(400.0 * volume, rel=1e-6)


# what is made of joints


def test_body_with_a_free_joint_is_fixed_and_listed(tmp_path: Path) -> None:
    source = read(tmp_path, model(f'<body name="cup"><freejoint/>{BALL}</body>'))
    assert list(source.links) == ["cup"]
    assert not source.joints
    assert has_message(source, "body cup is free to move: fixed at its pose")


def test_range_of_an_unlimited_joint_is_used_and_listed(tmp_path: Path) -> None:
    joint = '<joint name="j" limited="false" range="0 1.5"/>'
    source = read(tmp_path, model(moving(BALL, joint=joint)))
    assert (joint_of(source, "j").lower, joint_of(source, "j").upper) == (0.0, 1.5)
    assert has_message(source, "joint j has a range but limited=false")


def test_joints_without_a_range_have_no_limits(tmp_path: Path) -> None:
    body = moving(BALL) + '<body name="b"><joint name="s" type="slide"/>' + BALL + "</body>"
    source = read(tmp_path, model(body))
    hinge, slide = joint_of(source, "j"), joint_of(source, "s")
    assert (hinge.kind, hinge.lower, hinge.upper) == ("continuous", None, None)
    assert (slide.kind, slide.lower, slide.upper) == ("prismatic", None, None)


def test_swapped_range_does_not_stop_the_reader(tmp_path: Path) -> None:
    source = read(tmp_path, model(moving(BALL, joint='<joint name="j" range="1 -1"/>')))
    assert (joint_of(source, "j").lower, joint_of(source, "j").upper) == (1.0, -1.0)


def test_linear_equality_between_joints_becomes_a_mimic(tmp_path: Path) -> None:
    """q - ref = a + b (q_leader - ref_leader) is q = b q_leader + (ref + a - b ref_leader)."""
    body = (
        f'<body name="a"><joint name="lead" ref="0.2"/>{BALL}</body>'
        f'<body name="b"><joint name="follow" ref="0.5"/>{BALL}</body>'
        f'<body name="c"><joint name="bent"/>{BALL}</body>'
    )
    text = model(body).replace(
        "</worldbody>",
        '</worldbody><equality><joint joint1="follow" joint2="lead" polycoef="0.1 3 0 0 0"/>'
        '<joint joint1="bent" joint2="lead" polycoef="0 1 2 0 0"/>'
        '<weld body1="a" body2="b" active="false"/></equality>',
    )
    source = read(tmp_path, text)
    assert joint_of(source, "follow").mimic == pytest.approx(("lead", 3.0, 0.5 + 0.1 - 0.6))
    assert joint_of(source, "bent").mimic is None
    assert has_message(source, "coupling of joint bent to lead is not linear")
    assert has_message(source, "1 constraints between bodies left out")


def test_slide_follows_the_knob_that_follows_it(tmp_path: Path) -> None:
    """q_knob = 0.1 + 50 q_slide is q_slide = q_knob / 50 - 0.002."""
    body = (
        f'<body name="a"><joint name="knob"/>{BALL}</body>'
        f'<body name="b"><joint name="burner" type="slide"/>{BALL}</body>'
    )
    text = model(body).replace(
        "</worldbody>",
        '</worldbody><equality><joint joint1="knob" joint2="burner" polycoef="0.1 50 0 0 0"/>'
        "</equality>",
    )
    source = read(tmp_path, text)
    assert joint_of(source, "knob").mimic is None
    assert joint_of(source, "burner").mimic == pytest.approx(("knob", 0.02, -0.002))
    assert has_message(source, "joint burner follows knob, which turns it")


def test_equality_without_a_leader_holds_the_joint_at_its_position(tmp_path: Path) -> None:
    slide = '<joint name="j" type="slide" axis="0 0 1" ref="0.1"/>'
    text = model(moving(BALL, joint=slide)).replace(
        "</worldbody>",
        '</worldbody><equality><joint joint1="j" polycoef="0.3 0 0 0 0"/></equality>',
    )
    held = joint_of(read(tmp_path, text), "j")
    assert held.kind == "fixed"
    np.testing.assert_allclose(held.T_pc[:3, 3], (0.2, 0.0, 0.6))


def test_spring_is_left_out_and_listed(tmp_path: Path) -> None:
    source = read(tmp_path, model(moving(BALL, joint='<joint name="j" stiffness="5"/>')))
    assert has_message(source, "spring of joint j left out")


def test_nameless_bodies_and_joints_are_named_after_each_other_and_the_model(
    tmp_path: Path,
) -> None:
    body = f'<body>{BALL}<body><joint name="lid"/>{BALL}</body><body><joint/>{BALL}</body></body>'
    source = read(tmp_path, model(body))
    assert list(source.links) == ["thing", "lid_link", "thing_2"]
    assert [joint.name for joint in source.joints] == ["lid", "thing_2_joint"]


def test_repeated_names_are_made_different(tmp_path: Path) -> None:
    twin = f'<body name="twin"><joint name="j"/>{BALL}</body>'
    source = read(tmp_path, model(f'<body name="base">{BALL}{twin}{twin}</body>'))
    assert list(source.links) == ["base", "twin", "twin_2"]
    assert has_message(source, "a second joint is called j: renamed j_2")


# what is made of geometry


def test_primitives_keep_their_sizes_and_an_ellipsoid_becomes_triangles(tmp_path: Path) -> None:
    geoms = (
        '<geom name="b" type="box" size=".1 .2 .3"/><geom type="cylinder" size=".1 .2"/>'
        '<geom type="capsule" size=".1 .2"/><geom type="sphere" size=".1"/>'
        '<geom type="ellipsoid" size=".1 .2 .3" pos="1 0 0"/>'
    )
    found = read(tmp_path, model(f'<body name="base">{geoms}</body>')).links["base"].visuals
    assert [(g.kind, g.size) for g in found[:4]] == [
        ("box", (0.2, 0.4, 0.6)),
        ("cylinder", (0.1, 0.4)),
        ("capsule", (0.1, 0.4)),
        ("sphere", (0.1,)),
    ]
    assert found[0].name == "b"
    corners = np.asarray(found[4].triangles).reshape(-1, 3)
    np.testing.assert_allclose(corners.max(axis=0), (0.1, 0.2, 0.3), rtol=0.01)
    assert found[4].T_lg[0, 3] == 1.0


def test_meshes_stand_where_muJoCo_puts_them(tmp_path: Path) -> None:
    """With refpos, refquat and scale, from a file and from the text; MuJoCo itself recentres."""
    (tmp_path / "parts").mkdir()
    trimesh.creation.icosahedron().export(tmp_path / "parts" / "ball.stl")
    head = (
        '<asset><mesh file="ball.stl" scale="0.1 0.1 0.1" refpos="1 2 3" refquat="1 1 0 0"/>'
        '<mesh name="text" vertex="0 0 0 1 0 0 0 2 0 0 0 3" refpos="0.1 0 0.2" '
        'refquat="1 0 2 0" scale="1 0.5 2"/></asset>'
    )
    body = (
        '<body name="base" pos="0.3 0 0"><geom type="mesh" mesh="ball" euler="0.1 0.2 0.3" '
        'pos="0 1 0"/><geom type="mesh" mesh="text"/></body>'
    )
    text = model(body, head=head, compiler='angle="radian" meshdir="parts"')
    source = read(tmp_path, text)
    raw = mujoco.MjModel.from_xml_path(str(tmp_path / "thing.xml"))
    data = mujoco.MjData(raw)
    mujoco.mj_kinematics(raw, data)
    part = build_parts(source)[0]
    for g, piece in enumerate(
        Loader(source, ConvertConfig(allow_missing=False)).part(part).visuals
    ):
        mesh = raw.geom_dataid[g]
        start = raw.mesh_vertadr[mesh]
        corners = raw.mesh_vert[start : start + raw.mesh_vertnum[mesh]]
        T_wg = pose(data.geom_xpos[g], data.geom_xmat[g].reshape(3, 3))
        corners_w = apply(T_wg, corners)
        distance = np.linalg.norm(corners_w[:, None] - piece.mesh.vertices[None], axis=-1)
        assert distance.min(axis=0).max() < 1e-6
        assert distance.min(axis=1).max() < 1e-6


def test_turned_mesh_with_uneven_scale_is_rejected(tmp_path: Path) -> None:
    trimesh.creation.box().export(tmp_path / "a.stl")
    head = '<asset><mesh name="a" file="a.stl" scale="1 1 2" refquat="1 1 0 0"/></asset>'
    text = model('<body name="b"><geom type="mesh" mesh="a"/></body>', head=head)
    with pytest.raises(AssetError, match="refquat and a scale that differs by axis"):
        read(tmp_path, text)


def test_planes_are_ground_and_left_out(tmp_path: Path) -> None:
    ground = '<geom type="plane" size="1 1 1"/>'
    source = read(tmp_path, model(f'{ground}<body name="base">{BALL}</body>'))
    assert list(source.links) == ["base"]
    assert has_message(source, "a plane, the ground, left out")


GROUPS = {
    "all plain": ('<geom name="x" type="box" size="1 1 1"/>', ["x"], ["x"]),
    "robosuite": (
        '<geom name="look" size="1" group="1" contype="0" conaffinity="0"/>'
        '<geom name="touch" size="1" group="0"/>',
        ["look"],
        ["touch"],
    ),
    "menagerie": (
        '<geom name="look" size="1" group="2" contype="0" conaffinity="0"/>'
        '<geom name="touch" size="1" group="3"/>',
        ["look"],
        ["touch"],
    ),
    "one side of the mask": (
        '<geom name="look" size="1" contype="0" conaffinity="0"/>'
        '<geom name="touch" size="1" contype="0" conaffinity="1" group="4"/>',
        ["look"],
        ["touch"],
    ),
    "clear": (
        '<geom name="look" size="1"/><geom name="touch" size="1" rgba="1 1 1 0"/>'
        '<geom name="mark" size="1" rgba="1 0 0 0" contype="0" conaffinity="0"/>',
        ["look"],
        ["look", "touch"],
    ),
}


@pytest.mark.parametrize("case", GROUPS)
def test_looks_and_contact_are_distinguished_by_masks_and_groups(tmp_path: Path, case: str) -> None:
    geoms, looks, touches = GROUPS[case]
    link = read(tmp_path, model(f'<body name="base">{geoms}</body>')).links["base"]
    assert [g.name for g in link.visuals] == looks
    assert [g.name for g in link.collisions] == touches


def test_colours_come_from_geom_material_and_texture(tmp_path: Path) -> None:
    Image.new("RGB", (16, 16), (0, 51, 255)).save(tmp_path / "blue.png")
    head = (
        '<asset><texture name="t" type="2d" file="blue.png"/>'
        '<material name="m" texture="t" rgba="1 1 0.5 0.25"/>'
        '<texture name="absent" type="2d" file="absent.png"/><material name="g" texture="absent"/>'
        "</asset>"
    )
    body = (
        '<body name="base"><geom size="1" rgba="1 0 0 1" material="m"/>'
        '<geom size="1" material="m"/><geom size="1"/><geom size="1" material="elsewhere"/>'
        '<geom size="1" material="g"/></body>'
    )
    source = read(tmp_path, model(body, head=head))
    colours = [g.rgba for g in source.links["base"].visuals]
    assert colours[0] == (1.0, 0.0, 0.0, 1.0)
    assert colours[1] == pytest.approx((0.0, 0.2, 0.5, 0.25))
    assert colours[2:4] == [None, None]
    assert colours[4] == (1.0, 1.0, 1.0, 1.0)
    assert has_message(source, "material 'elsewhere' is not defined: grey instead")
    assert has_message(source, "texture 'absent.png' not found: plain colour instead")


# what is made of masses


def test_inertial_elements_are_kept_however_they_are_turned(tmp_path: Path) -> None:
    element = '<inertial pos="0 0 0.1" euler="0 0 90" mass="2" diaginertia="1 2 2.5"/>'
    joint = '<joint name="j" pos="0 0 0.05"/>'
    text = model(moving(element + BALL, joint=joint), compiler='angle="degree"')
    inertial = read(tmp_path, text).links["part"].inertial
    assert inertial is not None
    assert inertial.mass == 2.0
    np.testing.assert_allclose(inertial.T_li[:3, 3], (0.0, 0.0, 0.05))
    turned = inertial.T_li[:3, :3] @ inertial.inertia @ inertial.T_li[:3, :3].T
    np.testing.assert_allclose(np.diag(turned), (2.0, 1.0, 2.5), atol=1e-12)


def test_mass_of_geoms_is_kept_where_the_author_gave_one(tmp_path: Path) -> None:
    """A box of 0.1 x 0.2 x 0.3 and 6 kg: Ixx = m (b2 + c2) / 12."""
    box = '<geom type="box" size=".05 .1 .15" mass="6"/><geom size="1" mass="0"/>'
    inertial = read(tmp_path, model(moving(box))).links["part"].inertial
    assert inertial is not None
    assert inertial.mass == pytest.approx(6.0)
    T = inertial.T_li[:3, :3]
    np.testing.assert_allclose(
        np.diag(T @ inertial.inertia @ T.T), 0.5 * np.array([0.13, 0.10, 0.05]), rtol=1e-9
    )


@pytest.mark.parametrize(
    "marker",
    [
        '<geom type="box" size="1e-4 1e-4 1e-4" rgba="0 1 0 0" contype="0" conaffinity="0"/>',
        '<geom size=".1" group="4" contype="0" conaffinity="0"/>',
        '<geom size=".1" material="clear" contype="0" conaffinity="0"/>',
    ],
)
def test_a_marker_without_a_mass_has_no_vote_on_masses(tmp_path: Path, marker: str) -> None:
    """Robosuite's and robocasa's fixtures mark regions by such geoms."""
    geoms = '<geom type="box" size=".05 .1 .15" mass="0.2"/>' * 8
    head = '<asset><material name="clear" rgba="1 0 0 0"/></asset>'
    with_marker, without = (
        read(tmp_path, model(moving(geoms + extra), head=head)).links["part"].inertial
        for extra in (marker, "")
    )
    assert with_marker is not None
    assert without is not None
    assert with_marker.mass == pytest.approx(1.6)
    np.testing.assert_array_equal(with_marker.inertia, without.inertia)


def test_a_visible_geom_without_a_mass_still_has_a_vote(tmp_path: Path) -> None:
    geoms = '<geom size=".1" mass="0.2"/><geom size=".2"/>'
    assert read(tmp_path, model(moving(geoms))).links["part"].inertial is None


def test_a_marker_with_a_mass_counts(tmp_path: Path) -> None:
    geoms = '<geom size=".1" mass="0.2"/><geom size=".1" mass="0.3" group="4" contype="0" '
    source = read(tmp_path, model(moving(geoms + 'conaffinity="0"/>')))
    inertial = source.links["part"].inertial
    assert inertial is not None
    assert inertial.mass == pytest.approx(0.5)


def test_masses_that_nobody_gave_are_left_to_the_presets(tmp_path: Path) -> None:
    """MuJoCo's 1000 kg/m3 is no statement of the author's."""
    assert read(tmp_path, model(moving(BALL))).links["part"].inertial is None


def test_mass_of_a_mesh_counts_and_one_that_is_missing_does_not_stop_the_reader(
    tmp_path: Path,
) -> None:
    trimesh.creation.box((0.1, 0.1, 0.1)).export(tmp_path / "cube.stl")
    head = '<asset><mesh file="cube.stl"/></asset>'
    text = model(moving('<geom type="mesh" mesh="cube" density="500"/>'), head=head)
    inertial = read(tmp_path, text).links["part"].inertial
    assert inertial is not None
    assert inertial.mass == pytest.approx(0.5, rel=1e-5)
    (tmp_path / "cube.stl").unlink()
    source = read(tmp_path, text)
    assert source.links["part"].inertial is None
    assert has_message(source, "masses by geometry are not known from MuJoCo")


# the surroundings of the object


def test_scene_that_is_included_is_left_out(tmp_path: Path) -> None:
    scene = (
        '<mujocoinclude><worldbody><light pos="0 0 1"/><body name="table">'
        f'{BALL}</body><geom type="plane" size="1 1 1"/></worldbody></mujocoinclude>'
    )
    write(tmp_path, scene, "scene/room.xml")
    write(tmp_path, f"<mujocoinclude>{moving(BALL)}</mujocoinclude>", "parts/body.xml")
    text = model('<include file="parts/body.xml"/>', head='<include file="scene/room.xml"/>')
    source = read(tmp_path, text)
    assert set(source.links) == {"base", "part"}
    assert has_message(source, "scene room.xml with table left out")
    assert joint_of(source, "j").where == "body.xml:1"
    assert set(source.files) == {"scene/room.xml", "parts/body.xml"}


def test_fragment_is_read_as_a_model_with_its_angles_in_radians(tmp_path: Path) -> None:
    source = read(
        tmp_path,
        "<mujocoinclude><geom type='box' size='.1 .1 .1' euler='0 1.5708 0'/>"
        f"<body name='lid'><joint name='j' range='0 1.2'/>{BALL}</body></mujocoinclude>",
    )
    assert joint_of(source, "j").upper == 1.2
    assert has_message(source, "a fragment that other files include")
    assert has_message(source, "angles have no unit and none is above 1.571: read as radians")


def test_angles_without_a_unit_are_degrees_where_one_is_large(tmp_path: Path) -> None:
    text = model(moving(BALL, joint='<joint name="j" range="0 90"/>'), compiler="")
    assert joint_of(read(tmp_path, text), "j").upper == pytest.approx(math.pi / 2)


def test_what_does_not_belong_to_the_object_is_left_out_with_a_word(tmp_path: Path) -> None:
    text = model(
        f'<body name="base">{BALL}<site name="s"/><region name="r"/><camera name="c"/></body>'
        f'<body name="goal" mocap="true">{BALL}</body>',
        head='<option timestep="1"/><size njmax="3"/><extension/><asset>'
        '<texture name="t" builtin="flat"/><texture name="t" builtin="flat"/>'
        '<material name="m"/><material name="m"/></asset>',
    ).replace("</worldbody>", '</worldbody><contact><pair geom1="a" geom2="b"/></contact>')
    source = read(tmp_path, text)
    assert list(source.links) == ["base"]
    for words in ("unknown element <region>", "1 contact pairs", "a second material called 'm'"):
        assert has_message(source, words)
    assert has_message(source, "body goal is a mocap body: left out")


# rejected input


@pytest.mark.dataset
@pytest.mark.slow
@pytest.mark.usefixtures("in_child")
def test_all_objects_of_the_index_move_as_muJoCo_moves_them(
    data_folder: Path, data_index: list[dict[str, object]]
) -> None:
    """Every MJCF object that MuJoCo loads as it is; one, eight kettles, is a scene."""
    compared = 0
    for entry in data_index:
        if entry["format"] != "mjcf" or entry["id"] == "furniture_sim_kettle":
            continue
        path = data_folder / str(entry["path"])
        source = read_mjcf(path)
        parts = build_parts(source)
        assert len(parts) > 0
        try:
            raw = mujoco.MjModel.from_xml_path(str(path))
        except ValueError:
            continue
        known = {raw.joint(j).name for j in range(raw.njnt)}
        named = {raw.body(b).name for b in range(raw.nbody)}
        for q in states(source, 10):
            here = poses_at(parts, q)
            there = raw_poses(raw, {n: v for n, v in q.items() if n in known})
            for part in parts[1:]:
                if set(q) <= known and part.name in named:
                    np.testing.assert_allclose(here[part.name], there[part.name], atol=1e-9)
                    compared += 1
    assert compared > 500
