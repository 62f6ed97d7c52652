"""A joint that follows another one is closed where that one is."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from tests.articulate.conversion.boxes import loaded, repairs_text

from articulate.conversion import ConvertConfig, convert
from articulate.conversion.joints import Travel
from articulate.conversion.mimic import apply_mimics, resolve_mimics
from articulate.formats.repairs import Repairs
from articulate.formats.source_object import SourceJoint
from articulate.simulator import mujoco

LEAVES = """<robot name="leaves">
  <link name="body"><visual><origin xyz="0 0 .5"/><geometry><box size=".4 .4 .2"/></geometry>
  </visual></link>
  <link name="left"><visual><origin xyz="0 -.15 0"/><geometry><box size=".3 .3 .02"/></geometry>
  </visual></link>
  <link name="right"><visual><origin xyz="0 .15 0"/><geometry><box size=".3 .3 .02"/></geometry>
  </visual></link>
  <joint name="R" type="revolute"><parent link="body"/><child link="right"/>
    <origin xyz="0 .22 .5"/><axis xyz="1 0 0"/><limit lower="-1.5" upper="1.5"/>
    <mimic joint="L" multiplier="-1"/></joint>
  <joint name="L" type="revolute"><parent link="body"/><child link="left"/>
    <origin xyz="0 -.22 .5"/><axis xyz="1 0 0"/><limit lower="0" upper="0.6"/></joint>
</robot>"""
"""Two leaves at the sides of a box that open together, the follower first in the file."""


def joint(name: str, *mimic: object) -> SourceJoint:
    lead = (str(mimic[0]), float(mimic[1]), float(mimic[2])) if mimic else None  # type: ignore[arg-type]
    return SourceJoint(
        name=name, kind="revolute", parent="a", child=name, T_pc=np.eye(4), mimic=lead
    )


def travel(lower: float | None, upper: float | None, closed: float, far: float) -> Travel:
    return Travel(
        kind="hinge",
        axis=np.array([0.0, 0.0, 1.0]),
        lower=lower,
        upper=upper,
        closed=closed,
        open=far,
        closed_rule="own",
    )


WIDE = travel(-1.5, 1.5, -1.5, 1.5)


def ends(found: Travel) -> tuple[float, float]:
    return found.closed, found.open


def test_the_closed_object_is_one_that_occurs(tmp_path: Path) -> None:
    (tmp_path / "leaves.urdf").write_text(LEAVES)
    asset = convert(tmp_path / "leaves.urdf", tmp_path / "out")
    lead, follower = asset.joint("L"), asset.joint("R")
    assert (lead.closed, lead.open) == (0.0, 0.6)
    assert (follower.closed, follower.open) == (0.0, -0.6)
    assert (follower.lower, follower.upper) == (-1.5, 1.5)
    assert follower.closed_rule == "follows L"
    np.testing.assert_allclose(asset.bounds_o, [[-0.2, -0.52, 0.0], [0.2, 0.52, 0.2]], atol=1e-9)
    model = loaded(asset)
    data = mujoco.MjData(model)
    for part in (lead, follower):
        data.joint(part.name).qpos[0] = part.open
    mujoco.mj_forward(model, data)
    np.testing.assert_allclose(data.efc_pos[: model.neq], 0.0, atol=1e-9)


def test_the_requested_limit_is_the_leaders(tmp_path: Path) -> None:
    (tmp_path / "leaves.urdf").write_text(LEAVES)
    asset = convert(tmp_path / "leaves.urdf", tmp_path / "out", ConvertConfig(closed="upper"))
    assert (asset.joint("R").closed, asset.joint("R").open) == (-0.6, 0.0)
    assert "independent" not in repairs_text(asset)


def test_leaders_come_before_their_followers_along_a_chain() -> None:
    leads, dropped = resolve_mimics([joint("c", "b", 2, 0.1), joint("b", "a", -1, 0.2), joint("a")])
    assert not dropped
    travels = {"c": WIDE, "b": WIDE, "a": travel(0.0, 0.5, 0.0, 0.5)}
    found = apply_mimics(travels, leads, Repairs())
    assert ends(found["a"]) == (0.0, 0.5)
    assert ends(found["b"]) == pytest.approx((0.2, -0.3))
    assert ends(found["c"]) == pytest.approx((0.5, -0.5))


def test_those_that_follow_nothing_that_moves_stay_as_they_are() -> None:
    joints = [joint("a", "b", 1, 0), joint("b", "a", 1, 0), joint("c", "absent", 1, 0)]
    leads, dropped = resolve_mimics(joints)
    assert list(leads) == ["b"]
    assert dropped == {"a": "itself", "c": "absent, which does not move"}
    found = apply_mimics({"a": WIDE, "b": WIDE, "c": WIDE}, leads, Repairs())
    assert found["c"] is WIDE
    assert found["b"].closed_rule == "follows a"


def test_a_follower_goes_as_far_as_its_own_limits_and_is_listed() -> None:
    leads, _ = resolve_mimics([joint("a"), joint("b", "a", 4, 0)])
    repairs = Repairs()
    found = apply_mimics({"a": travel(0.0, 0.6, 0.0, 0.6), "b": WIDE}, leads, repairs)
    assert ends(found["b"]) == (0.0, 1.5)
    assert repairs.messages == (
        "note: joint b would go from 0 to 2.4 with a, and its limits are -1.5 and 1.5",
    )


@pytest.mark.parametrize("multiplier", [0.0, 1e308, -1e308])
def test_a_factor_that_leads_nowhere_changes_nothing(multiplier: float) -> None:
    leads, _ = resolve_mimics([joint("a"), joint("b", "a", multiplier, 0)])
    endless = travel(None, None, 0.0, 1.5)
    found = apply_mimics({"a": travel(0.0, 10.0, 0.0, 10.0), "b": endless}, leads, Repairs())
    assert found["b"] is endless


def test_a_follower_of_a_follower_follows_the_one_that_leads_both() -> None:
    leads, dropped = resolve_mimics([joint("c", "b", 2, 0.1), joint("b", "a", -1, 0.2), joint("a")])
    assert not dropped
    assert leads["b"] == ("a", -1.0, 0.2)
    assert leads["c"] == pytest.approx(("a", -2.0, 0.5))


def test_factors_that_multiply_beyond_all_numbers_are_left_out() -> None:
    leads, dropped = resolve_mimics(
        [joint("a"), joint("b", "a", 1e200, 0), joint("c", "b", 1e200, 0)]
    )
    assert list(leads) == ["b"]
    assert dropped == {"c": "b by a factor that is not finite"}


VIRTUAL = """<robot name="virtual">
  <link name="body"><visual><geometry><box size=".4 .4 .02"/></geometry></visual></link>
  <link name="none"/>
  <link name="one"><visual><geometry><box size=".05 .05 .05"/></geometry></visual></link>
  <joint name="lead" type="prismatic"><parent link="body"/><child link="none"/>
    <axis xyz="1 0 0"/><limit lower="0" upper="0.1"/></joint>
  <joint name="follow" type="prismatic"><parent link="body"/><child link="one"/>
    <origin xyz="0 0 .1"/><axis xyz="1 0 0"/><limit lower="0" upper="0.1"/>
    {mimic}</joint>
</robot>"""


def test_a_part_without_geometry_stays_while_it_leads_another(tmp_path: Path) -> None:
    path = tmp_path / "virtual.urdf"
    path.write_text(VIRTUAL.format(mimic='<mimic joint="lead"/>'))
    asset = convert(path, tmp_path / "out")
    assert {joint.name for joint in asset.joints} == {"lead", "follow"}
    assert loaded(asset).neq == 1
    path.write_text(VIRTUAL.format(mimic=""))
    asset = convert(path, tmp_path / "out")
    assert [joint.name for joint in asset.joints] == ["follow"]
    assert "link none has no geometry: left out with its joint" in repairs_text(asset)
