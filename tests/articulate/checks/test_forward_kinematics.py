import json
import re
import shutil

import numpy as np
import pytest
from tests.articulate.conversion.cabinets import write_cabinet

from articulate.assets.asset import load_asset
from articulate.checks.forward_kinematics import (
    InputFrame,
    bullet_reader,
    check_forward_kinematics,
    check_input_kinematics,
    fk_noted,
    mujoco_reader,
    yourdfpy_reader,
)
from articulate.checks.model import load_model
from articulate.conversion import ConvertConfig, convert
from articulate.conversion.convert import placement_of, read_input
from articulate.transforms import axis_angle_to_matrix, pose

MIMIC = """<robot name="pair">
  <link name="body"><visual><origin xyz="0 0 0.1"/><geometry><box size="1 1 0.2"/></geometry>
  </visual></link>
  <link name="lead"><visual><geometry><box size="0.1 0.2 0.3"/></geometry></visual></link>
  <link name="tail"><visual><geometry><box size="0.3 0.2 0.1"/></geometry></visual></link>
  <joint name="slide" type="prismatic"><parent link="body"/><child link="lead"/>
    <origin xyz="0 0 1" rpy="0.3 -0.2 0.5"/><axis xyz="0 0 -2"/>
    <limit lower="0" upper="0.3" effort="1" velocity="1"/></joint>
  <joint name="turn" type="revolute"><parent link="lead"/><child link="tail"/>
    <origin xyz="0.3 0 0"/><axis xyz="1 1 0"/>
    <limit lower="-1" upper="2" effort="1" velocity="1"/>
    <mimic joint="slide" multiplier="-4" offset="0.25"/></joint>
</robot>
"""


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """Input and asset of a cabinet that is halved in size; not to be changed."""
    folder = tmp_path_factory.mktemp("forward_kinematics")
    source = write_cabinet(folder)
    config = ConvertConfig(size_m=0.25, decompose=False)
    return source, convert(source, folder / "asset", config), frame_of(source, config)


def frame_of(source, config):
    place = placement_of(read_input(source, config), config)
    return InputFrame(scale=place.scale, T_os=place.T_os)


def changed(asset, folder, old, new):
    """A copy of the asset with one thing changed in its MJCF."""
    shutil.copytree(asset.folder, folder)
    path = folder / "object.xml"
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))
    return load_model(load_asset(folder))


def test_both_judges_agree_with_a_converted_cabinet(made):
    checks = check_forward_kinematics(load_model(made[1]))
    assert [c.outcome for c in checks] == ["passed"] * 3
    readers = ("yourdfpy", "PyBullet", "asset.json")
    assert [reader in c.message for reader, c in zip(readers, checks, strict=True)] == [True] * 3
    assert [c.measured for c in checks] == pytest.approx([0.0] * 3, abs=1e-6)


def test_the_input_agrees_up_to_scale_and_frame(made):
    source, asset, frame = made
    assert frame.scale == pytest.approx(0.5, abs=0.05)
    (check,) = check_input_kinematics(load_model(asset), source, frame)
    assert check.outcome == "passed"
    assert check.measured == pytest.approx(0.0, abs=1e-9)


def test_a_wrong_scale_is_found_and_blamed_on_a_link(made):
    source, asset, frame = made
    wrong = InputFrame(scale=1.01 * frame.scale, T_os=frame.T_os)
    (check,) = check_input_kinematics(load_model(asset), source, wrong)
    assert check.outcome == "failed"
    assert check.subject == "drawer"


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ('axis="0 0 1"', 'axis="0 0.0872 0.9962"'),  # 5 degrees
        ('<joint name="door_joint"', '<joint name="door_joint" pos="0 0.01 0"'),
    ],
)
def test_a_turned_axis_and_a_moved_pivot_are_found_by_every_judge(made, tmp_path, old, new):
    source, asset, frame = made
    model = changed(asset, tmp_path / "bad", old, new)
    checks = (*check_forward_kinematics(model), *check_input_kinematics(model, source, frame))
    assert [c.outcome for c in checks] == ["failed"] * 4
    assert {c.subject for c in checks} == {"door"}
    assert all("door_joint" in c.message for c in checks)


def moved(vector, by):
    return [a + b for a, b in zip(vector, by, strict=True)]


NOTED = {
    "axis": ("joints", 1, "axis_o", lambda v: [-a for a in v]),
    "pivot": ("joints", 1, "pivot_o", lambda v: moved(v, (0.0, 0.01, 0.0))),
    "slide": ("joints", 0, "axis_o", lambda v: [-a for a in v]),
    "place": ("links", 2, "pos_o", lambda v: moved(v, (0.0, 0.0, 1e-4))),
    "turn": ("links", 2, "quat_o", lambda _: [0.7071067811865476, 0.7071067811865475, 0.0, 0.0]),
    "root": ("links", 0, "pos_o", lambda v: moved(v, (0.0, 0.0, 1e-4))),
    "handle": ("handles", 1, "pos_l", lambda v: moved(v, (0.0, 1e-4, 0.0))),
    "approach": ("handles", 1, "normal_l", lambda v: [-a for a in v]),
}


@pytest.mark.parametrize("which", NOTED)
def test_what_asset_json_says_of_places_is_compared(made, tmp_path, which):
    kind, index, field, change = NOTED[which]
    shutil.copytree(made[1].folder, tmp_path / "bad")
    path = tmp_path / "bad" / "asset.json"
    content = json.loads(path.read_text())
    part = content[kind][index]
    part[field] = change(part[field])
    path.write_text(json.dumps(content))
    check = fk_noted(load_model(load_asset(tmp_path / "bad")))
    assert check.outcome == "failed"
    assert check.subject == part.get("link", part["name"])
    assert "make both files agree" in check.message


def test_couplings_and_sites_that_are_not_there_do_not_matter(made, tmp_path):
    path = tmp_path / "pair.urdf"
    path.write_text(MIMIC)
    asset = convert(path, tmp_path / "asset", ConvertConfig(decompose=False))
    assert fk_noted(load_model(asset)).outcome == "passed"
    bare = changed(made[1], tmp_path / "bare", "<mujoco", "<mujoco")
    text = bare.asset.mjcf_path.read_text()
    bare.asset.mjcf_path.write_text(re.sub(r"<site [^>]*/>", "", text))
    model = load_model(bare.asset)
    assert model.model.nsite == 0
    assert fk_noted(model).outcome == "passed"


def test_a_link_that_the_judge_does_not_know_is_found(made, tmp_path):
    model = changed(made[1], tmp_path / "bad", "<mujoco", "<mujoco")
    path = tmp_path / "bad" / "object.urdf"
    path.write_text(path.read_text().replace('"drawer"', '"tray"'))
    assert {(c.outcome, c.subject) for c in check_forward_kinematics(model)[:2]} == {
        ("failed", "drawer")
    }


def test_an_urdf_that_cannot_be_read_fails(made, tmp_path):
    model = changed(made[1], tmp_path / "bad", "<mujoco", "<mujoco")
    (tmp_path / "bad" / "object.urdf").write_text("<robot")
    assert [c.outcome for c in check_forward_kinematics(model)] == ["failed", "failed", "passed"]


def test_mimic_offset_and_an_axis_that_is_no_unit_vector(tmp_path):
    source = tmp_path / "pair.urdf"
    source.write_text(MIMIC)
    config = ConvertConfig(decompose=False)
    model = load_model(convert(source, tmp_path / "asset", config))
    assert [f.joint for f in model.followers] == ["turn"]
    checks = (
        *check_forward_kinematics(model),
        *check_input_kinematics(model, source, frame_of(source, config)),
    )
    assert [c.outcome for c in checks] == ["passed"] * 4, [c.message for c in checks]


def test_yourdfpy_is_asked_for_positions_along_unit_axes(tmp_path):
    source = tmp_path / "pair.urdf"
    source.write_text(MIMIC)
    poses = yourdfpy_reader(source)({"slide": 0.2})
    turn = (
        axis_angle_to_matrix([0, 0, 1], 0.5)
        @ axis_angle_to_matrix([0, 1, 0], -0.2)
        @ axis_angle_to_matrix([1, 0, 0], 0.3)
    )
    expected = pose([0.0, 0.0, 1.0], turn) @ pose([0.0, 0.0, -0.2])
    np.testing.assert_allclose(poses["lead"], expected, atol=1e-12)


def test_an_input_that_nobody_reads_is_not_compared(made, tmp_path):
    source = tmp_path / "broken.urdf"
    source.write_text("<robot")
    (check,) = check_input_kinematics(load_model(made[1]), source, made[2])
    assert check.outcome == "not_applicable"


def test_nothing_is_printed(made, capfd):
    check_forward_kinematics(load_model(made[1]))
    assert capfd.readouterr() == ("", "")


def test_an_mjcf_input_with_a_joint_off_the_origin_of_its_body_agrees(tmp_path):
    source = tmp_path / "door.xml"
    source.write_text(
        '<mujoco model="door"><worldbody><body name="frame">'
        '<geom type="box" size="0.05 0.4 0.5" pos="0 0 0.5"/>'
        '<body name="leaf" pos="-0.1 0 0.5"><joint name="hinge" type="hinge" axis="0 0 1" '
        'pos="0 0.3 0" range="0 1.5"/><geom type="box" size="0.01 0.3 0.4"/></body>'
        "</body></worldbody></mujoco>"
    )
    config = ConvertConfig(decompose=False)
    model = load_model(convert(source, tmp_path / "asset", config))
    (check,) = check_input_kinematics(model, source, frame_of(source, config))
    assert check.outcome == "passed", check.message


def test_worlds_of_pybullet_are_closed_after_use(tmp_path):
    pybullet = pytest.importorskip("pybullet")
    path = tmp_path / "pair.urdf"
    path.write_text(MIMIC)
    first = pybullet.connect(pybullet.DIRECT)
    pybullet.disconnect(first)
    for _ in range(3):
        assert set(bullet_reader(path)({"slide": 0.1})) == {"body", "lead", "tail"}
    last = pybullet.connect(pybullet.DIRECT)
    pybullet.disconnect(last)
    assert last == first


LINKS = "".join(
    f'<link name="{name}"><visual><geometry><box size=".05 .05 .05"/></geometry></visual></link>'
    for name in ("base", "one", "two", "three")
)


def slide(name, parent, child, inside='<limit lower="0" upper="0.1"/>', kind="prismatic"):
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="0 0.1 0.1"/><axis xyz="1 0 0"/>{inside}</joint>'
    )


def mimic(leader, multiplier, offset):
    return (
        f'<limit lower="-1" upper="1"/><mimic joint="{leader}" multiplier="{multiplier}" '
        f'offset="{offset}"/>'
    )


AS_READ = {
    "followers of followers": slide("a", "base", "one")
    + slide("b", "base", "two", mimic("c", -0.5, 0.02))
    + slide("c", "two", "three", mimic("a", 3.0, 0.1)),
    "a follower of an absent joint": slide("a", "base", "one", mimic("nobody", 1.0, 0.0))
    + slide("b", "one", "two")
    + slide("c", "two", "three"),
    "a follower of a fixed joint": slide("a", "base", "one", "", "fixed")
    + slide("b", "one", "two", mimic("a", 2.0, 0.0))
    + slide("c", "two", "three"),
    "a joint held off 0": slide("a", "base", "one", '<limit lower="0.5" upper="0.5"/>', "revolute")
    + slide("b", "one", "two")
    + slide("c", "two", "three"),
}


@pytest.mark.parametrize("case", AS_READ)
def test_yourdfpy_is_told_what_the_file_says_and_it_does_not_do(tmp_path, case):
    source = tmp_path / "thing.urdf"
    source.write_text(f'<robot name="thing">{LINKS}{AS_READ[case]}</robot>')
    config = ConvertConfig(decompose=False)
    model = load_model(convert(source, tmp_path / "asset", config))
    checks = (
        *check_forward_kinematics(model),
        *check_input_kinematics(model, source, frame_of(source, config)),
    )
    assert [c.outcome for c in checks] == ["passed"] * 4, [c.message for c in checks]
    assert checks[3].measured == pytest.approx(0.0, abs=1e-9)


BOX = '<geom type="box" size=".03 .03 .03"/>'
X, Y = ('type="slide" axis="1 0 0" range="0 .1"', 'type="slide" axis="0 1 0" range="0 .1"')
IN_MJCF = {
    "joints without names": f'<body name="x" pos="0 0 .1"><joint {X}/><joint {Y}/>{BOX}</body>',
    "a body without a name": f'<body pos="0 0 .1"><joint {X}/>{BOX}<body name="y" pos="0 0 .1">'
    f"<joint {Y}/>{BOX}</body></body>",
    "radians that are not said": '<body name="x" euler="0 0 1.5708"><joint name="h" axis="0 1 0" '
    f'range="0 1.57"/>{BOX}</body>',
    "degrees": '<body name="x" euler="0 0 90"><joint name="h" axis="0 1 0" range="0 80"/>'
    f"{BOX}</body>",
    "a slide with a place": f'<body name="x"><joint name="j" pos="0 .1 .2" {X}/>{BOX}</body>',
    "a joint that an equality holds": f'<body name="x"><joint name="held" {X}/>{BOX}'
    f'<body name="y" pos="0 0 .1"><joint name="j" {Y}/>{BOX}</body></body>',
}
HELD = '<equality><joint joint1="held" polycoef="0.05 0 0 0 0"/></equality>'


@pytest.mark.parametrize("case", IN_MJCF)
def test_mujoco_reads_the_input_as_conversion_did(tmp_path, case):
    source = tmp_path / "thing.xml"
    base = '<geom type="box" size=".2 .2 .01"/>'
    source.write_text(
        f'<mujoco model="thing"><worldbody><body name="base">{base}{IN_MJCF[case]}</body>'
        f"</worldbody>{HELD if 'holds' in case else ''}</mujoco>"
    )
    config = ConvertConfig(decompose=False)
    model = load_model(convert(source, tmp_path / "asset", config))
    (check,) = check_input_kinematics(model, source, frame_of(source, config))
    assert check.outcome == "passed", check.message
    assert check.measured == pytest.approx(0.0, abs=1e-9)


def test_names_are_not_guessed_where_bodies_stand_in_another_order(tmp_path):
    """A body that is repeated is one element in the file and several in MuJoCo."""
    source = tmp_path / "thing.xml"
    source.write_text(
        f'<mujoco model="thing"><worldbody><body name="base">{BOX}<body name="x" pos="0 0 .1">'
        f'<joint {X}/>{BOX}</body></body><replicate count="2" offset="1 0 0"><body name="n">{BOX}'
        "</body></replicate></worldbody></mujoco>"
    )
    assert {"base", "x"} <= set(mujoco_reader(source)({"x_joint": 0.1}))
