"""What a bounded force opens, against closed forms."""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.optimize import brentq
from tests.articulate.checks.objects import Box, Part, make_object
from tests.assets import make_cabinet, make_cupboard

from articulate.assets.asset import Asset
from articulate.assets.check_report import Check, JointCheck
from articulate.checks.force import (
    CHECK_STEPS,
    ENOUGH,
    FORCE_N,
    PACE_S,
    check_opening,
    pull_of,
)
from articulate.checks.model import load_model
from articulate.checks.sweep import sweep_joints

G = 9.81
BLOCK: Box = ((0.0, 0.0, 0.0), (0.05, 0.05, 0.05))
TICK_S = 0.002 * CHECK_STEPS


def joint_check_of(asset: Asset, name: str, needs: tuple[str, ...] = ()) -> JointCheck:
    joint = asset.joint(name)
    return JointCheck(
        name=name, kind=joint.kind, span=joint.span, swept=1.0, blocked=False, needs=needs
    )


def forced(
    asset: Asset, needs: dict[str, tuple[str, ...]] | None = None
) -> tuple[dict[tuple[str, str], Check], dict[str, JointCheck]]:
    """Clauses by name and joint, and joints by name."""
    joint_checks = [
        joint_check_of(asset, j.name, (needs or {}).get(j.name, ())) for j in asset.joints
    ]
    checks, joints = check_opening(asset, load_model(asset), joint_checks)
    return {(c.name, c.subject): c for c in checks}, {j.name: j for j in joints}


def slide(
    folder: Path, *, upwards: bool = False, excluded: bool = True, body=None, **more
) -> Asset:
    """A drawer on a level slide along x, or one that is lifted."""
    axis = (0.0, 0.0, 1.0) if upwards else (1.0, 0.0, 0.0)
    part = Part(name="drawer", kind="slide", axis=axis, boxes=(BLOCK,), **more)
    return make_object(folder, part, excluded=excluded, **({} if body is None else {"body": body}))


def seconds(check: Check) -> float:
    """Time that the clause's sentence names."""
    return float(check.message.split(" s")[0].split()[-1])


@pytest.mark.parametrize(
    ("mass_kg", "damping", "friction"), [(2.0, 5.0, 2.0), (10.0, 20.0, 5.0), (0.2, 0.0, 20.0)]
)
def test_a_slide_opens_in_the_time_of_its_equation_of_motion(tmp_path, mass_kg, damping, friction):
    travel = 0.3
    asset = slide(tmp_path / "a", mass_kg=mass_kg, damping=damping, friction=friction, span=travel)
    check = forced(asset)[0]["opening", "drawer_joint"]
    drag = damping + FORCE_N * PACE_S / travel
    speed, tau = (FORCE_N - friction) / drag, mass_kg / drag

    def short_of(t: float) -> float:
        return float(speed * (t - tau * (1.0 - math.exp(-t / tau))) - ENOUGH * travel)

    assert check.outcome == "passed"
    assert seconds(check) == pytest.approx(brentq(short_of, 0.0, 10.0), abs=TICK_S + 0.06)
    assert re.match(r"30 N at the part opens (99|100) % of the travel", check.message)


@pytest.mark.parametrize(("friction", "outcome"), [(20.0, "passed"), (29.0, "failed")])
def test_friction_below_the_force_may_still_take_too_long(tmp_path, friction, outcome):
    # at rest all of the force, at speed v what is left: v = v0 (1 - friction / force)
    asset = slide(tmp_path / "a", friction=friction)
    checks, joints = forced(asset)
    assert checks["opening", "drawer_joint"].outcome == outcome
    expected = min(3.0 / PACE_S * (1.0 - friction / FORCE_N), 1.0)
    assert joints["drawer_joint"].opened == pytest.approx(expected, abs=0.03)


def test_friction_above_the_force_holds_and_is_named(tmp_path):
    stiff = 'solreffriction="0.004 1" solimpfriction="0.99 0.999 1"'
    checks, joints = forced(slide(tmp_path / "a", friction=35.0, more=stiff))
    check = checks["opening", "drawer_joint"]
    assert check.outcome == "failed"
    assert joints["drawer_joint"].opened == pytest.approx(0.0, abs=0.02)
    assert "resist with 35 N, and the force gives 30 N" in check.message
    assert ("closing", "drawer_joint") not in checks


@pytest.mark.parametrize(("mass_kg", "outcome"), [(1.5, "passed"), (4.0, "failed")])
def test_a_lift_opens_as_far_as_its_weight_allows(tmp_path, mass_kg, outcome):
    checks, _ = forced(slide(tmp_path / "a", upwards=True, mass_kg=mass_kg))
    assert checks["opening", "drawer_joint"].outcome == outcome


def test_what_falls_open_and_is_too_heavy_to_lift_cannot_be_closed(tmp_path):
    down = Part(name="hatch", kind="slide", axis=(0.0, 0.0, -1.0), mass_kg=4.0, boxes=(BLOCK,))
    checks, _ = forced(make_object(tmp_path / "a", down))
    assert checks["opening", "hatch_joint"].outcome == "passed"
    assert checks["closing", "hatch_joint"].outcome == "failed"
    assert f"{4.0 * G:.3g} N" in checks["closing", "hatch_joint"].message


def door(**more: Any) -> Part:
    """A leaf, 0.4 m wide, on an upright hinge."""
    leaf: Box = ((0.0, 0.2, 0.0), (0.01, 0.2, 0.3))
    given: dict[str, Any] = {
        "span": 2.0,
        "inertia": 0.1,
        "boxes": (leaf,),
        "handle": (0.0, 0.35, 0.0),
    } | more
    return Part(name="door", kind="hinge", axis=(0.0, 0.0, 1.0), **given)


@pytest.mark.parametrize(("share", "outcome"), [(0.6, "passed"), (1.1, "failed")])
def test_a_hinge_feels_the_force_times_the_lever_of_its_handle(tmp_path, share, outcome):
    torque = FORCE_N * 0.35
    checks, joints = forced(make_object(tmp_path / "a", door(friction=share * torque)))
    assert checks["opening", "door_joint"].outcome == outcome
    assert "the handle, 350 mm from the axis" in checks["opening", "door_joint"].message
    assert (joints["door_joint"].opened or 0.0) > 0.9 or outcome == "failed"


def test_a_hinge_is_asked_for_a_quarter_turn_at_most(tmp_path):
    for name, span, travel in (
        ("far", 3.0, math.pi / 2),
        ("near", 1.0, 1.0),
        ("end", None, math.pi / 2),
    ):
        asset = make_object(tmp_path / name, door(span=span))
        assert pull_of(asset, load_model(asset), "door_joint").travel == pytest.approx(travel)


@pytest.mark.parametrize("handle", [None, (0.0, 0.0, 0.1)])
def test_without_a_lever_the_farthest_point_is_turned(tmp_path, handle):
    asset = make_object(tmp_path / "a", door(handle=handle))
    pull = pull_of(asset, load_model(asset), "door_joint")
    assert pull.effort == pytest.approx(FORCE_N * math.hypot(0.4, 0.01))
    assert "the farthest point" in pull.where


def test_a_plug_stops_a_drawer_where_it_stands(tmp_path):
    plug: Box = ((0.05 + 0.1 + 0.01, 0.0, 0.0), (0.01, 0.1, 0.1))
    checks, joints = forced(slide(tmp_path / "a", body=(plug,), excluded=False, mass_kg=5.0))
    assert checks["opening", "drawer_joint"].outcome == "failed"
    assert joints["drawer_joint"].opened == pytest.approx(0.1 / 0.3, abs=0.02)
    assert "stopped by body against drawer" in checks["opening", "drawer_joint"].message


def test_what_the_engine_never_lets_touch_does_not_stop_a_drawer(tmp_path):
    plug: Box = ((0.16, 0.0, 0.0), (0.01, 0.1, 0.1))
    checks, _ = forced(slide(tmp_path / "a", body=(plug,), excluded=True))
    assert {c.outcome for c in checks.values()} == {"passed"}


def test_a_drawer_behind_a_door_opens_with_it_open(tmp_path):
    leaf: Box = ((0.0, -0.1, 0.0), (0.01, 0.1, 0.1))
    drawer = Part(name="drawer", kind="slide", axis=(-1.0, 0.0, 0.0), span=0.2, boxes=(BLOCK,))
    front = Part(name="door", kind="hinge", axis=(0.0, 0.0, -1.0), pos=(-0.07, 0.1, 0.0),
                 span=math.pi / 2, boxes=(leaf,), damping=0.1)  # fmt: skip
    far = (((5.0, 0.0, 0.0), (0.1, 0.1, 0.1)),)
    asset = make_object(tmp_path / "a", drawer, front, body=far, excluded=False)
    model = load_model(asset)
    joint_checks = sweep_joints(model).joints
    checks, joints = check_opening(asset, model, joint_checks)
    assert {c.outcome for c in checks} == {"passed"}
    assert joints[0].needs == ("door_joint",)
    assert "with door_joint open" in checks[0].message
    assert joints[0].opened == pytest.approx(1.0, abs=0.02)


def test_a_part_on_a_part_is_opened_while_its_carrier_is_held(tmp_path):
    lid = Part(name="lid", kind="slide", axis=(1.0, 0.0, 0.0), pos=(0.0, 0.0, 0.15),
               parent="drawer", boxes=(BLOCK,), friction=5.0)  # fmt: skip
    asset = make_object(
        tmp_path / "a", Part(name="drawer", kind="slide", axis=(1.0, 0.0, 0.0), boxes=(BLOCK,)), lid
    )
    checks, joints = forced(asset)
    assert {c.outcome for c in checks.values()} == {"passed"}
    assert joints["lid_joint"].opened == pytest.approx(1.0, abs=0.02)


def test_cabinets_and_cupboards_open_and_close(tmp_path):
    for asset in (make_cabinet(tmp_path / "cabinet"), make_cupboard(tmp_path / "cupboard")):
        checks, joints = forced(asset)
        assert {c.outcome for c in checks.values()} == {"passed"}
        assert len(checks) == 2 * len(asset.joints)
        assert all((j.opened or 0.0) >= 0.98 for j in joints.values())


def test_joints_that_follow_are_left_to_their_leaders(tmp_path):
    leader = Part(name="drawer", kind="slide", axis=(1.0, 0.0, 0.0), boxes=(BLOCK,))
    follower = Part(name="slave", kind="slide", axis=(0.0, 1.0, 0.0), pos=(0.0, 0.5, 0.0),
                    boxes=(BLOCK,), follows="drawer")  # fmt: skip
    checks, joints = forced(make_object(tmp_path / "a", leader, follower))
    assert {subject for _, subject in checks} == {"drawer_joint"}
    assert joints["slave_joint"].opened is None


def test_the_model_is_left_as_it_was(tmp_path):
    asset = make_cabinet(tmp_path / "a")
    model = load_model(asset)
    before = [np.array(v) for v in (model.model.dof_damping, model.model.jnt_range)]
    check_opening(asset, model, [joint_check_of(asset, j.name) for j in asset.joints])
    assert np.array_equal(before[0], model.model.dof_damping)
    assert np.array_equal(before[1], model.model.jnt_range)


def test_a_joint_without_a_way_is_not_opened(tmp_path):
    checks, joints = forced(slide(tmp_path / "a", span=1e-9))
    assert checks["opening", "drawer_joint"].outcome == "failed"
    assert "no travel between closed and open" in checks["opening", "drawer_joint"].message
    assert joints["drawer_joint"].opened == 0.0


def test_a_hinge_without_geometry_cannot_be_turned(tmp_path):
    checks, _ = forced(make_object(tmp_path / "a", door(boxes=(), handle=None, friction=0.1)))
    assert checks["opening", "door_joint"].outcome == "failed"
    assert "all points of the part are on its axis" in checks["opening", "door_joint"].message


def test_what_shuts_by_itself_counts_as_closed(tmp_path):
    sprung: dict[str, Any] = {"more": 'stiffness="60" springref="0"', "mass_kg": 0.5}
    checks, _ = forced(slide(tmp_path / "a", **sprung))
    assert {c.outcome for c in checks.values()} == {"passed"}


@pytest.mark.parametrize(("mass_kg", "outcome"), [(0.5, "passed"), (4.0, "failed")])
def test_what_hangs_open_in_the_way_is_held_shut_by_another_hand(tmp_path, mass_kg, outcome):
    # a shelf slides away, what lay on it sinks into its place; 30 N lift up to 3.1 kg
    shelf = Part(name="shelf", kind="slide", axis=(1.0, 0.0, 0.0), boxes=(BLOCK,))
    load = Part(name="load", kind="slide", axis=(0.0, 0.0, -1.0), pos=(0.0, 0.0, 0.105), span=0.1,
                boxes=(BLOCK,), mass_kg=mass_kg)  # fmt: skip
    slippery = '<default><geom friction="0.05 0.005 0.0001"/></default>'
    checks, _ = forced(make_object(tmp_path / "a", shelf, load, excluded=False, options=slippery))
    assert checks["opening", "shelf_joint"].outcome == "passed"
    assert checks["closing", "shelf_joint"].outcome == outcome
    message = checks["closing", "shelf_joint"].message
    assert ("load_joint kept closed" in message) == (outcome == "passed")
    assert ("stopped by shelf against load" in message) == (outcome == "failed")
