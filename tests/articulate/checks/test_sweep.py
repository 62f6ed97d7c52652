"""What stands in the way of a joint is found where it stands; what does not, is not."""

from __future__ import annotations

import math

import pytest
from tests.articulate.checks.objects import Box, Part, make_object
from tests.assets import make_cabinet, make_cupboard

from articulate.assets.asset import Asset
from articulate.assets.check_report import Check, JointCheck
from articulate.checks.interference import LIMIT_M, STEP_M, Sweeper
from articulate.checks.model import load_model
from articulate.checks.sweep import sweep_joints

TRAVEL_M = 0.3
BLOCK: Box = ((0.0, 0.0, 0.0), (0.05, 0.05, 0.05))
SLIDER = Part(name="drawer", kind="slide", axis=(1.0, 0.0, 0.0), span=TRAVEL_M, boxes=(BLOCK,))


def swept(asset: Asset) -> tuple[dict[tuple[str, str], Check], dict[str, JointCheck]]:
    """Clauses by name and joint, and joints by name."""
    found = sweep_joints(load_model(asset))
    return {(c.name, c.subject): c for c in found.checks}, {j.name: j for j in found.joints}


def plug(near_x: float, thick: float = 0.02) -> Box:
    """A wall across the way of ``SLIDER`` whose near side stands at ``near_x``."""
    return ((near_x + thick / 2, 0.0, 0.0), (thick / 2, 0.2, 0.2))


def walls(gap: float) -> tuple[Box, ...]:
    """Floor and top, ``gap`` away from ``BLOCK`` on both sides, along the whole way."""
    return tuple(((0.15, 0.0, s * (0.05 + gap + 0.01)), (0.3, 0.1, 0.01)) for s in (-1.0, 1.0))


def test_drawers_of_a_cabinet_go_through_their_range(tmp_path):
    checks, joints = swept(make_cabinet(tmp_path / "a"))
    assert {c.outcome for c in checks.values()} == {"passed"}
    assert {name for name, _ in checks} == {"joint_sweep", "joint_sweep_random"}
    assert all(j.swept == 1.0 and not j.blocked and not j.needs for j in joints.values())


def test_a_door_goes_through_its_range(tmp_path):
    checks, joints = swept(make_cupboard(tmp_path / "a"))
    assert [c.outcome for c in checks.values()] == ["passed"]
    assert joints["door_hinge"].swept == 1.0


@pytest.mark.parametrize("free", [0.01, 0.1, 0.25])
def test_a_plug_blocks_a_drawer_where_it_stands(tmp_path, free):
    checks, joints = swept(make_object(tmp_path / "a", SLIDER, body=(plug(0.05 + free),)))
    check, joint = checks["authored_overlap", "drawer_joint"], joints["drawer_joint"]
    assert check.outcome == "failed"
    assert joint.blocked
    assert joint.swept == pytest.approx((free + LIMIT_M) / TRAVEL_M, abs=1.1 * STEP_M / TRAVEL_M)
    assert "drawer goes" in check.message
    assert "authored parts overlap there too" in check.message


def test_depth_beyond_rest_is_measured(tmp_path):
    body = (plug(0.05 + TRAVEL_M - 0.015, thick=0.2),)
    checks, _ = swept(make_object(tmp_path / "a", SLIDER, body=body))
    assert checks["authored_overlap", "drawer_joint"].measured == pytest.approx(0.015, abs=2e-5)


@pytest.mark.parametrize("thick", [0.004, 0.0021])
def test_a_thin_wall_is_not_jumped_over(tmp_path, thick):
    body = (plug(0.15, thick=thick),)
    checks, _ = swept(make_object(tmp_path / "a", SLIDER, body=body))
    assert checks["authored_overlap", "drawer_joint"].outcome == "failed"


def test_an_overlap_that_stays_as_it_is_at_rest_is_none(tmp_path):
    checks, _ = swept(make_object(tmp_path / "a", SLIDER, body=walls(gap=-0.01)))
    assert checks["joint_sweep", "drawer_joint"].outcome == "passed"


def test_an_overlap_with_the_next_shape_of_the_same_link_is_at_rest_too(tmp_path):
    floor = [((x, 0.0, -0.056), (0.05, 0.1, 0.011)) for x in (0.0, 0.1, 0.2, 0.3)]
    checks, _ = swept(make_object(tmp_path / "a", SLIDER, body=tuple(floor)))
    assert checks["joint_sweep", "drawer_joint"].outcome == "passed"


def test_an_overlap_that_grows_beyond_rest_is_found(tmp_path):
    floor = (((0.0, 0.0, -0.057), (0.05, 0.1, 0.01)), ((0.3, 0.0, -0.051), (0.05, 0.1, 0.01)))
    checks, _ = swept(make_object(tmp_path / "a", SLIDER, body=floor))
    check = checks["authored_overlap", "drawer_joint"]
    assert check.outcome == "failed"
    assert check.measured == pytest.approx(0.006, abs=2e-5)  # 9 mm deep after 3 mm at rest


def test_a_hull_that_seals_a_drawer_is_found_and_blamed(tmp_path):
    tray: tuple[Box, ...] = (
        ((0.2, 0.0, 0.0), (0.005, 0.09, 0.09)),  # front, outside
        ((0.05, 0.0, -0.08), (0.14, 0.09, 0.005)),  # floor
        ((-0.08, 0.0, 0.0), (0.005, 0.09, 0.09)),  # back, 15 mm before that of the carcass
    )
    seen = tuple(((0.05, 0.0, s * 0.1), (0.145, 0.1, 0.005)) for s in (-1.0, 1.0))
    drawer = Part(name="drawer", kind="slide", axis=(1.0, 0.0, 0.0), span=0.2, boxes=tray)
    hull = (((0.05, 0.0, 0.0), (0.145, 0.1, 0.105)),)
    sealed = make_object(tmp_path / "sealed", drawer, body=hull, shown=seen)
    checks, joints = swept(sealed)
    check = checks["joint_sweep", "drawer_joint"]
    assert check.outcome == "failed"
    assert "only the collision shapes overlap there" in check.message
    assert joints["drawer_joint"].blocked
    open_ = make_object(tmp_path / "open", drawer, body=seen)
    assert swept(open_)[0]["joint_sweep", "drawer_joint"].outcome == "passed"


def covered(**door_changes) -> tuple[Part, Part]:
    """A drawer that opens along -x behind a door that turns away about z at its side."""
    drawer = Part(name="drawer", kind="slide", axis=(-1.0, 0.0, 0.0), span=0.2, boxes=(BLOCK,))
    leaf: tuple[Box, ...] = (((0.0, -0.1, 0.0), (0.01, 0.1, 0.1)),)
    changes = {"boxes": leaf, "axis": (0.0, 0.0, -1.0), "pos": (-0.07, 0.1, 0.0)}
    return drawer, Part(name="door", kind="hinge", span=math.pi / 2, **(changes | door_changes))


def test_a_drawer_behind_a_door_needs_it_open(tmp_path):
    checks, joints = swept(make_object(tmp_path / "a", *covered()))
    assert joints["drawer_joint"].needs == ("door_joint",)
    assert not joints["drawer_joint"].blocked
    assert joints["drawer_joint"].swept == 1.0
    assert joints["door_joint"].needs == ()
    assert checks["joint_sweep", "drawer_joint"].outcome == "passed"
    assert "door_joint open" in checks["joint_sweep", "drawer_joint"].message


def test_a_drawer_behind_the_shapes_of_a_door_alone_is_blocked_by_them(tmp_path):
    asset = make_object(tmp_path / "a", *covered(shown=(((0.0, -0.1, 0.5), (0.01, 0.1, 0.1)),)))
    checks, joints = swept(asset)
    assert joints["drawer_joint"].needs == ()
    assert joints["drawer_joint"].blocked
    assert "only the collision shapes" in checks["joint_sweep", "drawer_joint"].message


def test_two_doors_in_the_way_are_both_needed(tmp_path):
    drawer, door = covered()
    second = Part(
        name="second", kind="hinge", axis=(0.0, 0.0, -1.0), pos=(-0.1, 0.15, 0.0),
        span=math.pi / 2, boxes=(((0.0, -0.125, 0.0), (0.01, 0.125, 0.1)),),
    )  # fmt: skip
    _, joints = swept(make_object(tmp_path / "a", drawer, door, second))
    assert set(joints["drawer_joint"].needs) == {"door_joint", "second_joint"}
    assert joints["door_joint"].needs == ("second_joint",)
    assert joints["second_joint"].needs == ()


def twins(shown: tuple[Box, ...] | None) -> tuple[Part, Part]:
    """Two leaves that turn towards each other, each free while the other is closed."""
    leaf: tuple[Box, ...] = (((0.0, 0.1, 0.0), (0.005, 0.1, 0.1)),)
    left = Part(name="left", kind="hinge", axis=(0.0, 0.0, -1.0), pos=(-0.3, 0.0, 0.0),
                span=1.5, boxes=leaf, shown=shown)  # fmt: skip
    right = Part(name="right", kind="hinge", axis=(0.0, 0.0, 1.0), pos=(0.05, 0.0, 0.0),
                 span=1.5, boxes=leaf, shown=shown)  # fmt: skip
    return left, right


def test_states_in_which_authored_parts_meet_are_drawn_again_and_counted(tmp_path):
    checks, joints = swept(make_object(tmp_path / "a", *twins(None)))
    check = checks["joint_sweep_random", "left_joint"]
    assert check.outcome == "passed"
    assert "sampled again" in check.message
    assert not joints["left_joint"].needs


def test_shapes_that_meet_in_random_states_without_the_authored_parts_are_found(tmp_path):
    checks, _ = swept(make_object(tmp_path / "a", *twins((((0.0, 0.01, 0.0), (0.001,) * 3),))))
    assert checks["joint_sweep", "left_joint"].outcome == "passed"
    check = checks["joint_sweep_random", "left_joint"]
    assert check.outcome == "failed"
    assert check.message.startswith("with the others at random: ")
    assert "only the collision shapes" in check.message


def test_a_joint_without_end_is_swept_over_a_whole_turn(tmp_path):
    arm: tuple[Box, ...] = (((0.1, 0.0, 0.0), (0.1, 0.01, 0.01)),)
    paddle = Part(name="paddle", kind="hinge", axis=(0.0, 0.0, 1.0), span=None, boxes=arm)
    post = (((0.15 * math.cos(4.0), 0.15 * math.sin(4.0), 0.0), (0.01, 0.01, 0.05)),)
    checks, joints = swept(make_object(tmp_path / "post", paddle, body=post))
    assert checks["authored_overlap", "paddle_joint"].outcome == "failed"
    assert joints["paddle_joint"].swept == pytest.approx(4.0 / (2 * math.pi), abs=0.03)
    checks, joints = swept(make_object(tmp_path / "free", paddle))
    assert joints["paddle_joint"].swept == 1.0


def test_joints_that_follow_move_with_their_leader(tmp_path):
    follower = Part(
        name="slave", kind="slide", axis=(0.0, 1.0, 0.0), pos=(0.0, 0.3, 0.0), span=TRAVEL_M,
        boxes=(BLOCK,), follows="drawer",
    )  # fmt: skip
    body = (((0.0, 0.45, 0.0), (0.1, 0.02, 0.1)),)  # only the follower meets it, after 80 mm
    checks, joints = swept(make_object(tmp_path / "a", SLIDER, follower, body=body))
    assert set(checks) == {("authored_overlap", "drawer_joint")}
    assert checks["authored_overlap", "drawer_joint"].outcome == "failed"
    for name in ("drawer_joint", "slave_joint"):
        assert joints[name].blocked
        assert joints[name].swept == pytest.approx(0.082 / TRAVEL_M, abs=1.1 * STEP_M / TRAVEL_M)


def test_a_part_on_a_part_counts_against_what_it_moves_on(tmp_path):
    lid = Part(name="lid", kind="slide", axis=(0.0, 0.0, -1.0), pos=(0.0, 0.0, 0.15), span=0.1,
               boxes=(BLOCK,), parent="drawer")  # fmt: skip
    checks, joints = swept(make_object(tmp_path / "a", SLIDER, lid))
    assert checks["joint_sweep", "drawer_joint"].outcome == "passed"
    assert joints["lid_joint"].swept == pytest.approx(0.052 / 0.1, abs=1.1 * STEP_M / 0.1)
    assert "lid goes 50.0 mm deeper into drawer" in checks["authored_overlap", "lid_joint"].message


def test_the_same_object_gives_the_same_clauses_twice(tmp_path):
    asset = make_object(tmp_path / "a", *twins(None))
    assert sweep_joints(load_model(asset)).checks == sweep_joints(load_model(asset)).checks


def test_states_that_the_authored_parts_rule_out_are_not_held_against_a_joint(tmp_path):
    # a fan that passes a closed leaf by 5 mm, and meets it in most other positions
    left, _ = twins(None)
    fan = Part(name="fan", kind="hinge", axis=(0.0, 0.0, 1.0), pos=(-0.09, 0.0, 0.0), span=None,
               boxes=(((0.0, 0.1, 0.0), (0.005, 0.1, 0.1)),))  # fmt: skip
    checks, _ = swept(make_object(tmp_path / "a", left, fan))
    assert checks["joint_sweep", "fan_joint"].outcome == "passed"
    check = checks["joint_sweep_random", "fan_joint"]
    assert check.outcome in {"passed", "not_applicable"}
    assert "authored parts" in check.message


def test_two_parts_that_lock_each_other_are_found(tmp_path):
    # one goes along x once the other has gone along y, and the other way round
    block = (0.02, 0.02, 0.02)
    one = Part(name="one", kind="slide", axis=(1.0, 0.0, 0.0), span=0.2,
               boxes=(((0.0, 0.0, 0.0), block), ((0.1, 0.1, 0.0), block)))  # fmt: skip
    other = Part(name="other", kind="slide", axis=(0.0, 1.0, 0.0), span=0.2,
                 boxes=(((0.1, 0.0, 0.0), block),))  # fmt: skip
    checks, joints = swept(make_object(tmp_path / "a", one, other))
    for name, needed in (("one_joint", "other_joint"), ("other_joint", "one_joint")):
        assert joints[name].needs == (needed,)
        assert joints[name].blocked
        assert "needs this one open first" in checks["authored_overlap", name].message


def test_a_part_that_scrapes_on_the_body_still_knows_what_it_needs(tmp_path):
    sill: Box = ((-0.2, 0.0, -0.052), (0.05, 0.1, 0.01))  # the drawer goes 8 mm into it
    checks, joints = swept(make_object(tmp_path / "a", *covered(), body=(sill,)))
    assert joints["drawer_joint"].needs == ("door_joint",)
    assert checks["authored_overlap", "drawer_joint"].measured == pytest.approx(0.008, abs=2e-5)


def test_the_ends_of_what_is_free_are_told(tmp_path):
    model = load_model(make_object(tmp_path / "a", SLIDER, body=(plug(0.15),)))
    low, high = Sweeper(model=model).sweep("drawer_joint", {}).ends
    assert low == 0.0
    assert high == pytest.approx(0.1 + LIMIT_M, abs=1.1 * STEP_M)


def test_a_follower_that_is_faster_than_its_leader_does_not_jump_over_a_wall(tmp_path):
    knob = Part(name="knob", kind="slide", axis=(0.0, 0.0, 1.0), pos=(-0.3, 0.0, 0.0), span=0.02,
                boxes=(((0.0, 0.0, 0.0), (0.01, 0.01, 0.01)),))  # fmt: skip
    plate = Part(name="plate", kind="slide", axis=(1.0, 0.0, 0.0), span=0.4,
                 boxes=(((0.0, 0.0, 0.0), (0.002, 0.1, 0.1)),), follows="knob")  # fmt: skip
    asset = make_object(tmp_path / "a", knob, plate, body=(plug(0.12, thick=0.004),))
    text = asset.mjcf_path.read_text()
    assert 'polycoef="0 1 0 0 0"' in text
    asset.mjcf_path.write_text(text.replace('polycoef="0 1 0 0 0"', 'polycoef="0 20 0 0 0"'))
    checks, joints = swept(asset)
    assert checks["authored_overlap", "knob_joint"].outcome == "failed"
    assert joints["knob_joint"].swept == pytest.approx(0.12 / 0.4, abs=0.02)


def test_steps_are_those_of_the_fastest_point_and_bounded(tmp_path):
    arm: tuple[Box, ...] = (((0.1, 0.0, 0.0), (0.1, 0.01, 0.01)),)
    turn = Part(name="arm", kind="hinge", axis=(0.0, 0.0, 1.0), span=1.0, boxes=arm,
                follows="drawer")  # fmt: skip
    asset = make_object(tmp_path / "a", SLIDER, turn)
    alone = make_object(tmp_path / "b", SLIDER)
    way = len(Sweeper(model=load_model(alone)).positions("drawer_joint", 400)[0])
    assert way == math.ceil(TRAVEL_M / STEP_M)
    text = asset.mjcf_path.read_text()
    for factor, least, most in ((0.1, way, way), (10.0, 2 * way, 3 * way), (1e300, 400, 400)):
        asset.mjcf_path.write_text(text.replace("0 1 0 0 0", f"0 {factor} 0 0 0"))
        found = Sweeper(model=load_model(asset)).positions("drawer_joint", 400)[0]
        assert least <= len(found) <= most
