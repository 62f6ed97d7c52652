"""Objects whose parts do not pass each other: mended where that is sound, left alone where not."""

from __future__ import annotations

import math
import re
from pathlib import Path

import pytest
from tests.articulate.checks.objects import Part, make_object
from tests.articulate.conversion.boxes import BODY_BOX, LIMIT, written

from articulate.assets.check_report import CheckReport
from articulate.checks.interference import LIMIT_M, Sweeper
from articulate.checks.model import load_model
from articulate.checks.sweep import sweep_joints
from articulate.conversion import ConvertConfig, convert
from articulate.errors import AssetError
from articulate.geometry.presets import SLIDE
from articulate.preparation.joint_travel import reach, weight_on
from articulate.preparation.prepare import check_asset, load_checked_asset

PLATE = ((0.0, 0.0, 0.0), (0.1, 0.1, 0.01))


def checked(path: Path, tmp_path: Path) -> CheckReport:
    """The proof of a URDF."""
    return check_asset(path, tmp_path / "checked", ConvertConfig(cache_dir=tmp_path / "cache"))


def plug(near: float, thick: float = 0.3, high: float = 0.4) -> tuple[str, str]:
    """A second box of the body, whose near side lies ``near`` before the drawer's front."""
    x = -0.23 - near - thick / 2.0
    text = (
        f'</geometry></visual><visual><origin xyz="{x} 0 0"/>'
        f'<geometry><box size="{thick} 0.1 {high}"/></geometry></visual>'
    )
    return BODY_BOX + "</geometry></visual>", BODY_BOX + text


def sentences(check_report: CheckReport) -> str:
    """All that was changed, a sentence a line."""
    return "\n".join(check_report.repairs)


def test_a_way_that_ends_at_an_authored_wall_is_shortened(tmp_path):
    check_report = checked(written(tmp_path / "in", plug(0.2)), tmp_path)
    assert check_report.verdict == "repaired", check_report.reasons
    (joint,) = check_report.joints
    assert joint.span == pytest.approx(0.2 + LIMIT_M, abs=2e-4)
    assert joint.swept == 1.0
    assert "travel of joint slide shortened to 0 to 0.20" in sentences(check_report)
    assert "was 0 to 0.3" in sentences(check_report)
    limits = [c for c in check_report.checks if c.name == "joint_limits"]
    assert [c.outcome for c in limits] == ["passed"]


def test_a_way_of_which_too_little_would_be_left_is_refused(tmp_path):
    check_report = checked(written(tmp_path / "in", plug(0.1)), tmp_path)
    assert check_report.verdict == "rejected"
    assert check_report.joints[0].span == pytest.approx(0.3)
    assert any(reason.startswith("authored_overlap of slide") for reason in check_report.reasons)
    assert "shortened" not in sentences(check_report)


LEAF = """<robot name="leaf">
  <link name="jamb"><visual><origin xyz="-0.015 0 0"/><geometry><box size="0.03 0.03 0.15"/>
  </geometry></visual></link>
  <link name="leaf"><visual><origin xyz="0.06 0 0"/><geometry><box size="0.12 0.01 0.12"/>
  </geometry></visual></link>
  <joint name="hinge" type="revolute"><parent link="jamb"/><child link="leaf"/>
    <axis xyz="0 0 1"/><limit lower="0" upper="2.8"/></joint>
</robot>"""
"""Turns about the middle of its edge, which goes 5 mm into the jamb at a right angle, where each
may lose 3 mm; at its end it stands right across the jamb."""


def test_shapes_are_cut_back_as_far_as_that_goes_and_the_way_ends_there(tmp_path):
    (tmp_path / "leaf.urdf").write_text(LEAF)
    check_report = checked(tmp_path / "leaf.urdf", tmp_path)
    assert check_report.verdict == "repaired", check_report.reasons
    (joint,) = check_report.joints
    assert math.radians(90.0) < joint.span < 2.79
    assert "travel of joint hinge shortened" in sentences(check_report)
    assert "goes into jamb, as authored" in sentences(check_report)
    assert "collision shapes trimmed where parts pass" in sentences(check_report)


SILL = (
    BODY_BOX + "</geometry></visual>",
    BODY_BOX + '</geometry></visual><visual><origin xyz="-0.3 0 -0.053"/>'
    '<geometry><box size="0.1 0.3 0.012"/></geometry></visual>',
)
"""Its top lies 3 mm above the drawer's lower edge."""


def test_cuts_that_take_too_long_are_not_made(tmp_path, monkeypatch):
    monkeypatch.setattr("articulate.preparation.prepare.REPAIR_S", -1.0)
    check_report = checked(written(tmp_path / "in", SILL), tmp_path)
    assert check_report.verdict == "rejected"
    assert "trimmed" not in sentences(check_report)


def test_an_edge_that_reaches_a_little_into_the_way_is_cut_back(tmp_path):
    check_report = checked(written(tmp_path / "in", SILL), tmp_path)
    assert check_report.verdict == "repaired", check_report.reasons
    assert check_report.joints[0].span == pytest.approx(0.3)
    assert "collision shapes trimmed where parts pass each other" in sentences(check_report)
    coverage = [c for c in check_report.checks if c.name == "collision_coverage"]
    assert all(c.outcome == "passed" for c in coverage)


def test_a_way_ends_where_a_cut_mends_no_more_and_shapes_are_cut_before(tmp_path):
    (old, sill), (_, wall) = SILL, plug(0.2)
    both = (old, sill + wall.removeprefix(old))
    source = written(tmp_path / "in", both)
    model = load_model(convert(source, tmp_path / "asset"))
    (violation,) = sweep_joints(model).violations
    pairs = {(met.one, met.other) for met in violation.sweep.interferences}
    sweeper = Sweeper(model=model)
    grazed = reach(sweeper, violation, pairs)[1]
    barred = reach(sweeper, violation, pairs, lambda met: met.excess_m > 0.01)[1]
    assert grazed < 0.03  # the sill
    assert barred == pytest.approx(0.21, abs=5e-4)  # the plug, and 10 mm into it
    check_report = checked(source, tmp_path)
    assert check_report.verdict == "repaired", check_report.reasons
    assert 0.2 < check_report.joints[0].span < 0.215
    assert "travel of joint slide shortened to 0 to 0.21" in sentences(check_report)
    assert "collision shapes trimmed where parts pass each other" in sentences(check_report)


def walled(wall: float) -> tuple[str, str]:
    """The body as five walls, open at the back; a drawer inside must pass the front one."""
    middle, side = (0.4 - wall) / 2.0, 0.4
    walls = ""
    for axis in range(3):
        for sign in (-1.0, 1.0) if axis else (-1.0,):
            xyz, size = [0.0, 0.0, 0.0], [side, side, side]
            xyz[axis], size[axis] = sign * middle, wall
            walls += (
                f'<visual><origin xyz="{xyz[0]} {xyz[1]} {xyz[2]}"/><geometry>'
                f'<box size="{size[0]} {size[1]} {size[2]}"/></geometry></visual>'
            )
    return "<visual><geometry>" + BODY_BOX + "</geometry></visual>", walls


@pytest.mark.parametrize("wall", [0.003, 0.006, 0.015])
def test_no_way_is_carved_through_a_wall(tmp_path, wall):
    inside = ('<origin xyz="-0.22 0 0"/>', '<origin xyz="-0.1 0 0"/>')
    out = (LIMIT, '<limit lower="0" upper="0.5"/>')
    check_report = checked(written(tmp_path / "in", walled(wall), inside, out), tmp_path)
    assert check_report.verdict == "rejected"
    assert "trimmed" not in sentences(check_report)
    (reason,) = (reason for reason in check_report.reasons if reason.startswith("authored_overlap"))
    assert re.search(r"of slide: drawer goes [\d.]+ mm deeper into body at", reason)


def test_two_parts_that_both_reach_too_far_are_cut_by_half_each(tmp_path):
    sill = (
        '</geometry></visual><visual><origin xyz="-0.4 0 -0.056"/>'
        '<geometry><box size="0.3 0.4 0.03"/></geometry></visual>'
    )  # its top lies 9 mm above the drawer's lower edge; each strays by 3 to 7 mm at most
    path = written(tmp_path / "in", (BODY_BOX + "</geometry></visual>", BODY_BOX + sill))
    check_report = checked(path, tmp_path)
    assert check_report.verdict == "repaired", check_report.reasons
    assert check_report.joints[0].span == pytest.approx(0.3)
    assert (
        len(re.findall("collision shapes trimmed where parts pass", sentences(check_report))) == 2
    )


HATCH = """<robot name="hatch">
  <link name="body"><visual><geometry><box size="0.4 0.4 0.1"/></geometry></visual></link>
  <link name="hatch">{inertial}<visual><geometry><box size="0.3 0.3 {thick}"/></geometry></visual>
  </link>
  <joint name="slide" type="prismatic"><parent link="body"/><child link="hatch"/>
    <origin xyz="0 0 -0.4"/><axis xyz="0 0 -1"/><limit lower="0" upper="0.2"/></joint>
</robot>"""
"""Falls open; a hand must lift it to close it."""


def hatch(folder: Path, thick: float, inertial: str = "") -> Path:
    """The hatch in a file of its own."""
    folder.mkdir()
    (folder / "hatch.urdf").write_text(HATCH.format(thick=thick, inertial=inertial))
    return folder / "hatch.urdf"


def test_what_is_too_heavy_to_be_lifted_shut_is_balanced(tmp_path):
    check_report = checked(hatch(tmp_path / "in", 0.1), tmp_path)
    assert check_report.verdict == "repaired", check_report.reasons
    found = re.search(
        r"lowered from ([\d.]+) to ([\d.]+) kg, as if a spring", sentences(check_report)
    )
    assert found is not None
    assert float(found[2]) * 9.81 == pytest.approx(0.8 * 30.0 - SLIDE.frictionloss, rel=0.01)


@pytest.mark.parametrize("given", [False, True])
def test_far_too_heavy_and_given_masses_stay_and_are_refused(tmp_path, given):
    mass = '<mass value="4.5"/><inertia ixx="0.04" iyy="0.04" izz="0.07" ixy="0" ixz="0" iyz="0"/>'
    inertial = f"<inertial>{mass}</inertial>" if given else ""
    check_report = checked(hatch(tmp_path / "in", 0.1 if given else 0.6, inertial), tmp_path)
    assert check_report.verdict == "rejected"
    assert any(reason.startswith("closing of slide") for reason in check_report.reasons)
    assert "spring" not in sentences(check_report)


def test_weight_on_a_joint_is_that_of_its_closed_form(tmp_path):
    down = Part(name="drop", kind="slide", axis=(0.0, 0.0, -1.0), mass_kg=4.0, boxes=(PLATE,))
    flap = Part(
        name="flap", kind="hinge", axis=(0.0, 1.0, 0.0), span=1.2, mass_kg=3.0, boxes=(PLATE,),
        com=(-0.2, 0.0, 0.0), inertia=0.1,
    )  # fmt: skip
    model = load_model(make_object(tmp_path / "a", down, flap))
    asset = model.asset
    assert weight_on(model, asset.joint(down.joint)) == pytest.approx(4.0 * 9.81)
    assert weight_on(model, asset.joint(flap.joint)) == pytest.approx(3.0 * 9.81 * 0.2)


def test_what_already_passes_is_left_as_it_is(tmp_path):
    check_report = checked(written(tmp_path / "in"), tmp_path)
    assert check_report.verdict != "rejected", check_report.reasons
    assert "trimmed" not in sentences(check_report)
    assert "shortened" not in sentences(check_report)


def test_a_door_that_opens_into_a_wall_stops_before_it(tmp_path):
    door = (
        (LIMIT, f'<limit lower="0" upper="{math.pi}"/>'),
        ('type="prismatic"', 'type="revolute"'),
        ('<origin xyz="-0.22 0 0"/><axis xyz="-1 0 0"/>', '<origin xyz="-0.22 0.16 0"/>'
         '<axis xyz="0 0 -1"/>'),
        ('<visual><geometry><box size="0.02 0.3 0.1"/>',
         '<visual><origin xyz="0 -0.16 0"/><geometry><box size="0.02 0.3 0.1"/>'),
        (BODY_BOX + "</geometry></visual>",
         BODY_BOX + '</geometry></visual><visual><origin xyz="-0.4 0.45 0"/>'
         '<geometry><box size="0.1 0.3 0.4"/></geometry></visual>'),
    )  # fmt: skip
    check_report = checked(written(tmp_path / "in", *door), tmp_path)
    assert check_report.verdict == "repaired", check_report.reasons
    (joint,) = check_report.joints
    assert math.radians(90.0) < joint.span < math.radians(170.0)
    assert "goes into body, as authored" in sentences(check_report)


def test_a_proven_asset_comes_from_the_cache_the_second_time(tmp_path, monkeypatch):
    path = written(tmp_path / "in", plug(0.2))
    asset = load_checked_asset(path, tmp_path / "cache")
    assert asset.joint("slide").open == pytest.approx(0.2, abs=0.01)
    monkeypatch.setattr("articulate.preparation.prepare.run_checks", None)
    assert load_checked_asset(path, tmp_path / "cache") == asset


def test_a_refused_asset_is_no_asset(tmp_path):
    path = written(tmp_path / "in", plug(0.1))
    with pytest.raises(AssetError, match=r"rejected: authored_overlap of slide.*check-asset"):
        load_checked_asset(path, tmp_path / "cache")


def test_what_cannot_be_read_keeps_its_own_sentence(tmp_path):
    path = tmp_path / "no.urdf"
    path.write_text("nothing")
    with pytest.raises(AssetError, match=r"no\.urdf") as caught:
        load_checked_asset(path, tmp_path / "cache")
    assert "rejected" not in str(caught.value)


def test_what_no_hand_could_turn_and_weighs_nothing_is_refused_in_a_sentence(tmp_path):
    """A link that only carries another: 30 N have no arm on it, and no weight is to be balanced."""
    (tmp_path / "in").mkdir()
    path = tmp_path / "in/needle.urdf"
    path.write_text("""<robot name="needle">
      <link name="body"><visual><geometry><box size="0.4 0.4 0.1"/></geometry></visual></link>
      <link name="pin"/>
      <joint name="turn" type="revolute"><parent link="body"/><child link="pin"/>
        <origin xyz="0 0 0.2"/><axis xyz="0 0 1"/><limit lower="0" upper="1"/></joint>
      <link name="tip"><visual><geometry><box size="0.05 0.05 0.05"/></geometry></visual></link>
      <joint name="tilt" type="revolute"><parent link="pin"/><child link="tip"/>
        <axis xyz="1 0 0"/><limit lower="0" upper="1"/></joint>
    </robot>""")
    check_report = checked(path, tmp_path)
    assert check_report.verdict == "rejected"
    assert any("are on its axis" in reason for reason in check_report.reasons), check_report.reasons
