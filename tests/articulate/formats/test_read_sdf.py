"""SDF models: closed-form poses, the same cabinet as a URDF, and files that are not accepted."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image
from tests.articulate.conversion.cabinets import CABINET, write_cabinet

from articulate.conversion import ConvertConfig, convert
from articulate.conversion.convert import input_key, read_input
from articulate.errors import AssetError
from articulate.formats.find_source import find_source
from articulate.formats.link_tree import build_parts, poses_at
from articulate.formats.read_sdf import read_sdf
from articulate.formats.read_source import format_of, read_source
from articulate.formats.source_object import MAX_JOINTS, SourceJoint, SourceObject
from articulate.transforms import Array, pose, rpy_to_matrix

BOX = "<geometry><box><size>0.2 0.4 0.6</size></box></geometry>"
VISUAL = f'<visual name="v">{BOX}</visual>'
TWIN = """<?xml version="1.0"?>
<sdf version="1.9"><model name="little">
  <link name="body">
    <visual name="v"><geometry><mesh><uri>model://little/meshes/body.obj</uri></mesh></geometry>
    </visual>
    <collision name="c"><geometry><mesh><uri>meshes/body.obj</uri></mesh></geometry></collision>
  </link>
  <link name="drawer"><pose>0 0 0.33 0 0 0</pose>
    <visual name="v"><geometry><mesh><uri>meshes/tray.stl</uri></mesh></geometry></visual>
  </link>
  <link name="drawer_handle"><pose relative_to="drawer"/>
    <visual name="v"><geometry><mesh><uri>meshes/bar.ply</uri></mesh></geometry></visual>
  </link>
  <link name="door"><pose relative_to="door_joint"/>
    <visual name="v"><geometry><mesh><uri>meshes/door.glb</uri></mesh></geometry></visual>
    <visual name="knob"><geometry><mesh><uri>meshes/knob.obj</uri></mesh></geometry></visual>
  </link>
  <joint name="drawer_joint" type="prismatic">
    <parent>body</parent><child>drawer</child>
    <axis><xyz>-1 0 0</xyz><limit><lower>0</lower><upper>0.3</upper><effort>10</effort>
    </limit></axis>
  </joint>
  <joint name="fix" type="fixed"><parent>drawer</parent><child>drawer_handle</child></joint>
  <joint name="door_joint" type="revolute"><pose relative_to="body">0.016 0.205 0.17 0 0 0</pose>
    <parent>body</parent><child>door</child>
    <axis><xyz expressed_in="body">0 0 1</xyz><limit><lower>-1.6</lower><upper>0</upper></limit>
    </axis>
  </joint>
</model></sdf>
"""
"""The cabinet of ``CABINET`` as SDF."""


def write(folder: Path, text: str, name: str = "model.sdf") -> Path:
    path = folder / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")
    return path


def sdf(content: str, *, version: str = "1.9", attributes: str = "") -> str:
    return f'<sdf version="{version}"><model name="m" {attributes}>{content}</model></sdf>'


def read(folder: Path, content: str, **options: str) -> SourceObject:
    return read_sdf(write(folder, sdf(content, **options)))


def visual_poses(source: SourceObject, q: dict[str, float] | None = None) -> dict[str, Array]:
    """Pose of the first visual of each link in the world (4, 4)."""
    parts = build_parts(source)
    T_sp = poses_at(parts, q or {})
    return {
        link.name: T_sp[part.name] @ T_pl @ link.visuals[0].T_lg
        for part in parts
        for link, T_pl in part.members
        if link.visuals
    }


def joint_of(source: SourceObject, name: str) -> SourceJoint:
    return next(joint for joint in source.joints if joint.name == name)


def at(x: float, y: float, z: float, roll: float = 0, pitch: float = 0, yaw: float = 0) -> Array:
    return pose(np.array([x, y, z]), rpy_to_matrix(np.array([roll, pitch, yaw])))


def slide(axis: str, extra: str = "", *, kind: str = "prismatic") -> str:
    return (
        f'<joint name="j" type="{kind}">{extra}<parent>a</parent><child>b</child>'
        f"<axis>{axis}<limit><lower>0</lower><upper>1</upper></limit></axis></joint>"
    )


def links(pose_b: str = "", pose_a: str = "") -> str:
    return f'<link name="a">{pose_a}{VISUAL}</link><link name="b">{pose_b}{VISUAL}</link>'


def test_links_lie_where_their_poses_put_them(tmp_path: Path) -> None:
    body = links("<pose>0.1 0.2 0.3 0 0 1.5707963267948966</pose>")
    found = visual_poses(read(tmp_path, body + slide("<xyz>1 0 0</xyz>")))
    np.testing.assert_allclose(found["a"], np.eye(4), atol=1e-12)
    np.testing.assert_allclose(found["b"], at(0.1, 0.2, 0.3, yaw=math.pi / 2), atol=1e-12)


def test_an_axis_is_in_the_joint_frame_and_moves_the_child(tmp_path: Path) -> None:
    body = links("<pose>0.1 0.2 0.3 0 0 1.5707963267948966</pose>")
    source = read(tmp_path, body + slide("<xyz>1 0 0</xyz>"))
    moved = visual_poses(source, {"j": 0.5})["b"][:3, 3]
    np.testing.assert_allclose(moved, [0.1, 0.7, 0.3], atol=1e-12)


@pytest.mark.parametrize(
    ("version", "axis", "direction"),
    [
        ("1.9", "<xyz>1 0 0</xyz>", (0, 1, 0)),
        ("1.9", '<xyz expressed_in="__model__">1 0 0</xyz>', (1, 0, 0)),
        ("1.9", '<xyz expressed_in="a">1 0 0</xyz>', (0, 0, -1)),
        ("1.9", '<xyz expressed_in="f">1 0 0</xyz>', (-1, 0, 0)),
        ("1.6", "<xyz>1 0 0</xyz>", (0, 1, 0)),
        (
            "1.6",
            "<xyz>1 0 0</xyz><use_parent_model_frame>true</use_parent_model_frame>",
            (1, 0, 0),
        ),
        ("1.4", "<xyz>1 0 0</xyz>", (1, 0, 0)),
    ],
)
def test_the_frame_of_an_axis_depends_on_version_and_attribute(
    tmp_path: Path, version: str, axis: str, direction: tuple[float, ...]
) -> None:
    quarter = math.pi / 2
    body = links(f"<pose>0 0 0 0 0 {quarter}</pose>", f"<pose>0 0 0 0 {quarter} 0</pose>")
    body += f'<frame name="f"><pose>0 0 0 0 0 {math.pi}</pose></frame>'
    source = read(tmp_path, body + slide(axis), version=version)
    before, after = (visual_poses(source, {"j": q})["b"][:3, 3] for q in (0.0, 1.0))
    np.testing.assert_allclose(after - before, direction, atol=1e-12)


def test_a_hinge_turns_about_the_joint_frame_not_the_link_frame(tmp_path: Path) -> None:
    """A door hinged at its edge 0.2 m from the frame of its link."""
    hinge = slide("<xyz>0 0 1</xyz>", "<pose>0 0.2 0 0 0 0</pose>", kind="revolute")
    source = read(tmp_path, links("<pose>1 0 0 0 0 0</pose>") + hinge)
    q = 0.7
    expected = at(1, 0.2, 0) @ at(0, 0, 0, yaw=q) @ at(0, -0.2, 0)
    np.testing.assert_allclose(visual_poses(source, {"j": q})["b"], expected, atol=1e-12)
    np.testing.assert_allclose(visual_poses(source)["b"], at(1, 0, 0), atol=1e-12)


def test_poses_are_relative_to_frames_joints_and_links(tmp_path: Path) -> None:
    body = (
        f'<link name="a"><pose relative_to="f">0 0 1 0 0 0</pose>{VISUAL}</link>'
        f'<link name="b"><pose relative_to="a">0 1 0 0 0 0</pose>'
        f'<visual name="v"><pose relative_to="f">0.5 0 0 0 0 0</pose>{BOX}</visual></link>'
        '<frame name="f" attached_to="g"><pose>1 0 0 0 0 0</pose></frame>'
        '<frame name="g"><pose degrees="true">0 0 0 0 0 90</pose></frame>'
    )
    source = read(tmp_path, body + slide("<xyz>1 0 0</xyz>"))
    found = visual_poses(source)
    f = at(0, 0, 0, yaw=math.pi / 2) @ at(1, 0, 0)
    np.testing.assert_allclose(found["a"], f @ at(0, 0, 1), atol=1e-12)
    np.testing.assert_allclose(found["b"], f @ at(0.5, 0, 0), atol=1e-12)


def test_poses_as_quaternions_and_of_older_versions_are_read(tmp_path: Path) -> None:
    half = math.sqrt(0.5)
    body = links(f'<pose rotation_format="quat_xyzw">1 0 0 0 0 {half} {half}</pose>')
    found = visual_poses(read(tmp_path, body + slide("<xyz>1 0 0</xyz>")))
    np.testing.assert_allclose(found["b"], at(1, 0, 0, yaw=math.pi / 2), atol=1e-12)
    body = links('<pose frame="a">0 0 2 0 0 0</pose>', "<pose>1 0 0 0 0 0</pose>")
    found = visual_poses(read(tmp_path, body + slide("<xyz>1 0 0</xyz>"), version="1.6"))
    np.testing.assert_allclose(found["b"], at(1, 0, 2), atol=1e-12)


def test_joints_may_name_frames_and_the_world(tmp_path: Path) -> None:
    body = links("<pose>0 0 1 0 0 0</pose>") + (
        '<frame name="fa" attached_to="a"/><frame name="fb" attached_to="b"><pose>0 0 5 0 0 0'
        '</pose></frame><joint name="base" type="fixed"><parent>world</parent><child>a</child>'
        '</joint><joint name="j" type="revolute"><parent>fa</parent><child>fb</child>'
        "<axis><xyz>0 0 1</xyz></axis></joint>"
    )
    source = read(tmp_path, body, attributes="")
    joint = joint_of(source, "j")
    assert (joint.parent, joint.child, joint.kind) == ("a", "b", "continuous")
    np.testing.assert_allclose(joint.T_pc[:3, 3], [0, 0, 6])
    assert joint_of(source, "base").parent == "world"


def test_the_pose_of_the_model_keeps_the_object_upright(tmp_path: Path) -> None:
    body = f"<pose>0 0 0 {math.pi / 2} 0 0</pose>" + links("<pose>0 1 0 0 0 0</pose>")
    found = visual_poses(read(tmp_path, body + slide("<xyz>0 1 0</xyz>")))
    np.testing.assert_allclose(found["b"][:3, 3], [0, 0, 1], atol=1e-12)


def test_limits_dynamics_mimic_and_pitch_are_read(tmp_path: Path) -> None:
    body = links() + (
        f'<link name="c">{VISUAL}</link><link name="d">{VISUAL}</link>'
        '<joint name="j" type="revolute"><parent>a</parent><child>b</child><axis><xyz>0 0 1</xyz>'
        "<limit><lower>-1e16</lower><upper>1e16</upper></limit><dynamics><damping>0.5</damping>"
        "<friction>0.25</friction><spring_stiffness>2</spring_stiffness></dynamics></axis></joint>"
        '<joint name="k" type="revolute"><parent>a</parent><child>c</child><axis><xyz>0 0 1</xyz>'
        "<limit><lower>0</lower><upper>1</upper></limit>"
        '<mimic joint="j"><multiplier>2</multiplier><offset>0.5</offset><reference>0.1</reference>'
        '</mimic></axis></joint><joint name="s" type="screw"><parent>a</parent><child>d</child>'
        "<thread_pitch>-100</thread_pitch><axis><xyz>0 0 1</xyz></axis></joint>"
    )
    source = read(tmp_path, body)
    turn, follower, screw = (joint_of(source, name) for name in "jks")
    assert (turn.kind, turn.lower, turn.upper) == ("continuous", None, None)
    assert (turn.damping, turn.friction) == (0.5, 0.25)
    assert follower.mimic is not None
    assert follower.mimic[0] == "j"
    assert follower.mimic[1:] == pytest.approx((2.0, 0.3))
    assert screw.pitch == pytest.approx(2 * math.pi / 100)
    assert "spring of joint j left out" in source.repairs.messages


def test_geometry_colours_and_inertia_are_read(tmp_path: Path) -> None:
    Image.new("RGB", (4, 4), (255, 0, 0)).save(tmp_path / "red.png")
    shapes = {
        "sphere": "<sphere><radius>0.1</radius></sphere>",
        "cylinder": "<cylinder><radius>0.1</radius><length>0.4</length></cylinder>",
        "capsule": "<capsule><radius>0.1</radius><length>0.4</length></capsule>",
        "cone": "<cone><radius>0.3</radius><length>0.4</length></cone>",
        "ellipsoid": "<ellipsoid><radii>0.1 0.2 0.3</radii></ellipsoid>",
        "plane": "<plane><normal>0 0 1</normal></plane>",
    }
    colour = "<material><diffuse>1 0.5 0 1</diffuse></material><transparency>0.5</transparency>"
    visuals = "".join(
        f'<visual name="{name}"><geometry>{shape}</geometry>{colour}</visual>'
        for name, shape in shapes.items()
    )
    visuals += (
        f'<visual name="gz">{BOX}<material><script><name>Gazebo/Red</name></script></material>'
        f'</visual><visual name="pbr">{BOX}<material><diffuse>1 1 1 1</diffuse><pbr><metal>'
        "<albedo_map>red.png</albedo_map></metal></pbr></material></visual>"
    )
    inertial = (
        "<inertial><pose>0 0 0.1 0 0 0</pose><mass>2.5</mass><inertia><ixx>0.1</ixx><iyy>0.2</iyy>"
        "<izz>0.25</izz><ixy>0.01</ixy></inertia></inertial>"
    )
    source = read(tmp_path, f'<link name="a">{inertial}{visuals}</link>')
    link = source.links["a"]
    found = {shape.name: shape for shape in link.visuals}
    assert set(found) == {*shapes, "gz", "pbr"} - {"plane"}
    assert found["cylinder"].size == (0.1, 0.4)
    assert found["sphere"].rgba == (1.0, 0.5, 0.0, 0.5)
    assert found["gz"].rgba == (1.0, 0.0, 0.0, 1.0)
    assert (found["pbr"].rgba, found["pbr"].texture) == (None, "red.png")
    for name, low, high in (("cone", -0.2, 0.2), ("ellipsoid", -0.3, 0.3)):
        corners = found[name].triangles
        assert corners is not None
        np.testing.assert_allclose([corners[..., 2].min(), corners[..., 2].max()], [low, high])
    assert link.inertial is not None
    assert link.inertial.mass == 2.5
    assert link.inertial.T_li[2, 3] == 0.1
    np.testing.assert_array_equal(
        link.inertial.inertia, [[0.1, 0.01, 0], [0.01, 0.2, 0], [0, 0, 0.25]]
    )


def test_a_cabinet_gives_the_same_asset_as_its_urdf(tmp_path: Path) -> None:
    urdf = write_cabinet(tmp_path, CABINET)
    path = write(urdf.parent, TWIN, "little.sdf")
    config = ConvertConfig(decompose=False)
    one, two = convert(urdf, tmp_path / "one", config), convert(path, tmp_path / "two", config)
    assert [link.name for link in one.links] == [link.name for link in two.links]
    np.testing.assert_allclose(one.bounds_o, two.bounds_o, atol=1e-9)
    for a, b in zip(one.joints, two.joints, strict=True):
        assert (a.name, a.kind, a.parent, a.link) == (b.name, b.kind, b.parent, b.link)
        for key in ("axis_o", "pivot_o", "lower", "upper", "closed", "open"):
            np.testing.assert_allclose(getattr(a, key), getattr(b, key), atol=1e-9)
    for link in one.links:
        other = two.link(link.name)
        assert link.mass_kg == pytest.approx(other.mass_kg)
        assert (link.visuals, link.collisions) == (other.visuals, other.collisions)
    assert [h.joint for h in one.handles] == [h.joint for h in two.handles]


def test_a_folder_with_model_config_is_its_newest_sdf(tmp_path: Path) -> None:
    folder = tmp_path / "cabinet"
    write(folder, sdf(links()), "model.sdf")
    new = write(folder, sdf(links()), "model-1_10.sdf")
    config = (
        '<model><name>x</name><sdf version="1.9">model.sdf</sdf>'
        '<sdf version="1.10">model-1_10.sdf</sdf></model>'
    )
    write(folder, config, "model.config")
    assert find_source(folder) == new
    assert find_source(folder / "model.config") == new
    assert format_of(new) == "sdf"
    write(folder, "<model/>", "model.config")
    with pytest.raises(AssetError, match="names no SDF file"):
        find_source(folder)
    write(folder, '<model><sdf version="1.9">../x.sdf</sdf></model>', "model.config")
    with pytest.raises(AssetError, match="is not in its folder"):
        find_source(folder)
    (folder / "model.config").unlink()
    new.unlink()
    assert find_source(folder) == folder / "model.sdf"


def test_an_included_model_is_read_with_its_meshes_and_its_name(tmp_path: Path) -> None:
    knob = tmp_path / "knob"
    (knob / "meshes").mkdir(parents=True)
    trimesh.creation.box((0.1, 0.1, 0.1)).export(knob / "meshes" / "k.obj")
    mesh = "<geometry><mesh><uri>model://knob/meshes/k.obj</uri></mesh></geometry>"
    part = f'<pose>9 9 9 0 0 0</pose><link name="k"><visual name="v">{mesh}</visual></link>'
    inner = write(knob, sdf(part, version="1.5"))
    include = (
        "<include><uri>model://knob</uri><name>grip</name>"
        '<pose relative_to="b">0 0 0.5 0 0 0</pose></include>'
        '<joint name="fix" type="fixed"><parent>b</parent><child>grip::k</child></joint>'
    )
    body = links("<pose>1 0 0 0 0 0</pose>") + slide("<xyz>1 0 0</xyz>") + include
    path = write(tmp_path / "cabinet", sdf(body))
    source = read_source(path)
    found = visual_poses(source)
    np.testing.assert_allclose(found["grip::k"], at(1, 0, 0.5), atol=1e-12)
    assert source.files == {"model://knob": inner}
    config = ConvertConfig(decompose=False)
    first = input_key(read_input(path, config), config)
    inner.write_text(inner.read_text().replace('name="k"', 'name="k" '))
    assert input_key(read_input(path, config), config) != first
    assert convert(path, tmp_path / "out", config).joints[0].name == "j"


def test_nested_models_have_names_and_poses_in_their_model(tmp_path: Path) -> None:
    nested = f'<model name="n"><pose>0 0 1 0 0 0</pose><link name="a">{VISUAL}</link></model>'
    body = links() + slide("<xyz>1 0 0</xyz>") + nested
    body += '<joint name="fix" type="fixed"><parent>b</parent><child>n::a</child></joint>'
    found = visual_poses(read(tmp_path, body))
    np.testing.assert_allclose(found["n::a"], at(0, 0, 1))


def test_a_world_with_one_model_and_a_ground_is_that_model(tmp_path: Path) -> None:
    ground = '<model name="ground"><link name="g"><collision name="c"><geometry><plane/></geometry>'
    text = f'<sdf version="1.6"><world name="w">{ground}</collision></link></model>'
    text += f'<model name="m">{links()}{slide("<xyz>1 0 0</xyz>")}</model></world></sdf>'
    source = read_sdf(write(tmp_path, text))
    assert source.name == "m"
    assert any("ground" in message for message in source.repairs.messages)


CYCLE = '<link name="a"><pose relative_to="b"/></link><link name="b"><pose relative_to="a"/></link>'
REJECTED = {
    "two models": ('<sdf version="1.9"><model name="a"/><model name="b"/></sdf>', "holds 2 models"),
    "no model": ('<sdf version="1.9"/>', "holds no model"),
    "no link": (sdf(""), "has no <link>"),
    "no name": (sdf("<link/>"), "<link> without a name"),
    "reserved name": (sdf('<link name="world"/>'), "the name 'world' is reserved"),
    "one name twice": (sdf('<link name="a"/><link name="a"/>'), "is called 'a'"),
    "cycle of poses": (sdf(CYCLE), "relative to each other in a cycle"),
    "unknown frame": (sdf(links('<pose relative_to="x"/>')), "names 'x', which does not exist"),
    "unknown link": (sdf(links() + slide("<xyz>1 0 0</xyz>")).replace(">b</c", ">x</c"), "'x'"),
    "no parent": (
        sdf(links() + '<joint name="j" type="fixed"><child>b</child></joint>'),
        "lacks a parent",
    ),
    "ball joint": (sdf(links() + slide("", kind="ball")), "is of type 'ball'"),
    "two axes": (sdf(links() + slide("", kind="universal")), "is of type 'universal'"),
    "short pose": (sdf(links("<pose>1 2 3</pose>")), "<pose> has 3 numbers, not 6"),
    "no number": (sdf(links("<pose>a 0 0 0 0 0</pose>")), "not made of finite numbers"),
    "infinite": (sdf(links("<pose>inf 0 0 0 0 0</pose>")), "not made of finite numbers"),
    "bad limit": (
        sdf(links() + slide("<xyz>1 0 0</xyz>").replace("<upper>1<", "<upper>x<")),
        "<upper> is 'x', not a number",
    ),
    "unknown shape": (sdf(links().replace("box", "teapot")), "geometry <teapot> is not known"),
    "size": (sdf(links().replace("0.2 0.4", "0.2 -0.4")), "needs <size> of 3 positive numbers"),
    "submesh": (
        sdf(
            links()
            .replace("<box><size>", "<mesh><uri>a.obj</uri><submesh/><!--")
            .replace("</size></box>", "--></mesh>")
        ),
        "<submesh> is not read",
    ),
    "absent include": (
        sdf("<include><uri>model://x</uri></include>"),
        "included model 'model://x' not found",
    ),
    "include elsewhere": (
        sdf("<include><uri>../../x</uri></include>"),
        "included model '../../x' not found",
    ),
    "include of itself": (sdf("<include><uri>model.sdf</uri></include>"), "nested deeper than"),
    "world of includes": (
        '<sdf version="1.6"><world name="w"><include><uri>model://x</uri></include></world></sdf>',
        "the world includes models",
    ),
    "many joints": (
        sdf(
            links()
            + "".join(
                f'<joint name="j{k}" type="fixed"><parent>a</parent><child>b</child></joint>'
                for k in range(MAX_JOINTS + 1)
            )
        ),
        f"{MAX_JOINTS + 1} joints; at most",
    ),
    "many frames": (
        sdf(links() + "".join(f'<frame name="f{k}"/>' for k in range(6000))),
        "more than 5000 links, joints and frames",
    ),
    "long name": (sdf(f'<link name="{"n" * 70_000}"/>'), "name has more than 200 characters"),
    "long number": (sdf(links(f"<pose>{'x' * 70_000}</pose>")), "not made of finite numbers"),
    "doctype": ('<!DOCTYPE sdf [<!ENTITY a "b">]>' + sdf(links()), "DOCTYPE or entities"),
    "other root": ("<html/>", "not SDF"),
}


@pytest.mark.parametrize("case", REJECTED)
def test_what_is_not_accepted_is_named_in_one_line(tmp_path: Path, case: str) -> None:
    text, reason = REJECTED[case]
    path = write(tmp_path / "deep", text)
    with pytest.raises(AssetError) as caught:
        build_parts(read_sdf(path))
    line = str(caught.value)
    assert reason in line
    assert "\n" not in line
    assert len(line) < 700
    assert str(path) in line


def test_includes_that_multiply_are_stopped(tmp_path: Path) -> None:
    many = "".join(f"<include><uri>model.sdf</uri><name>n{k}</name></include>" for k in range(9))
    with pytest.raises(AssetError, match=r"more than 64 files are included|nested deeper"):
        read(tmp_path, f'<link name="a">{VISUAL}</link>{many}')
