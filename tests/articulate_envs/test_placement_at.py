"""An object stands where the user says; where the arm cannot reach it, how far it has to move."""

import dataclasses

import pytest
from tests.scenes import drawer_scene

from articulate.errors import ReachError
from articulate.robot.arm import PANDA
from articulate.task.floor_pose import (
    FloorPose,
    ObjectLocation,
    load_location,
    parse_floor_pose,
    save_location,
)
from articulate.task.randomization_config import RandomizationConfig
from articulate_envs.placement_at import nearest_placement, placement_at

DRAWS = dataclasses.replace(RandomizationConfig(), scales=3)


@pytest.fixture(scope="module")
def drawer(tmp_path_factory):
    return drawer_scene(tmp_path_factory.mktemp("cabinet") / "cabinet")


def test_an_object_within_reach_stays_where_it_is(drawer):
    at = FloorPose(x_m=0.75, y_m=0.12, yaw_deg=12.0, z_m=0.31)
    found = placement_at(drawer.asset, drawer.task, PANDA, DRAWS, at)
    assert found.pos_w == (0.75, 0.12, 0.31)
    assert found.yaw_rad == pytest.approx(at.yaw_rad)
    assert found.reachable_share >= 0.99
    assert found.start_q[0] > 0.05  # the arm turns towards it


@pytest.mark.slow
def test_the_nearest_reachable_pose_is_named(drawer, error_line):
    far = FloorPose(x_m=1.5, y_m=0.0, yaw_deg=0.0, z_m=0.31)
    args = drawer.asset, drawer.task, PANDA, DRAWS
    error_line("placement_at(1.5 m ahead)", lambda: placement_at(*args, far))
    near = nearest_placement(*args, far)
    assert near is not None
    assert 0.8 < near.x_m < 1.1
    assert placement_at(*args, near).reachable_share >= 0.99
    with pytest.raises(ReachError, match=r"to the target$"):
        placement_at(*args, far, with_nearest=False)


def test_placements_are_numbers_or_a_file(tmp_path, error_line):
    at = FloorPose(x_m=0.7, y_m=-0.1, yaw_deg=90.0)
    assert parse_floor_pose((0.7, -0.1, 90.0)) == at
    assert parse_floor_pose((0.7, -0.1, 90.0, 0.0)) == at
    assert at.words() == "0.7 -0.1 90"
    assert dataclasses.replace(at, z_m=0.25).words() == "0.7 -0.1 90 0.25"
    location = ObjectLocation(object="cabinet", pose=at, camera="c", images=3, joints={"a": 0.1})
    save_location(tmp_path / "placement.json", location)
    assert load_location(tmp_path / "placement.json") == location
    assert parse_floor_pose((tmp_path / "placement.json",)) == at
    error_line("parse_floor_pose(0.7 0.1)", lambda: parse_floor_pose((0.7, 0.1)))
    error_line("parse_floor_pose(9 m)", lambda: parse_floor_pose((9.0, 0.0, 0.0)))
    error_line("parse_floor_pose(yaw 720)", lambda: parse_floor_pose((0.7, 0.0, 720.0)))
    (tmp_path / "other.json").write_text("{}")
    error_line("parse_floor_pose(other.json)", lambda: parse_floor_pose((tmp_path / "other.json",)))
