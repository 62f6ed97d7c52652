import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from tests.assets import make_cabinet

from articulate.preparation.prepare import load_checked_asset
from articulate.robot.arm import PANDA
from articulate.robot.kinematics import manipulability, solve_ik, tool_pose
from articulate.task.object_placement import handle_in_world, handle_poses, object_pose
from articulate.task.randomization_config import NO_RANDOMIZATION, RandomizationConfig
from articulate.task.task import make_task
from articulate_envs import placement_search as reach_test
from articulate_envs.placement_search import (
    MIN_JOINT_MARGIN_RAD,
    MIN_MANIPULABILITY,
    find_placement,
)


def in_world(scene, opened):
    opened = np.asarray(opened, dtype=float)
    return handle_in_world(
        scene.asset,
        scene.task.joint,
        T_wo=scene.placement.T_wo(),
        scale=np.ones(len(opened)),
        opened=opened,
        flip=scene.placement.flip,
    )


@pytest.mark.parametrize("name", ["drawer", "door"])
def test_way_of_a_placed_handle_is_reached_with_the_margins_that_are_stated(name, request):
    scene = request.getfixturevalue(name)
    placement = scene.placement
    way = in_world(scene, np.linspace(0, scene.task.target, 5))
    found = solve_ik(PANDA, way, np.asarray(placement.start_q))
    assert found.reached.all()
    low, high = PANDA.bounds()
    margin = np.minimum(found.q - low, high - found.q).min()
    assert margin == pytest.approx(placement.joint_margin_rad, abs=0.02)
    assert manipulability(PANDA, found.q).min() == pytest.approx(
        placement.manipulability, abs=0.005
    )
    assert placement.joint_margin_rad >= MIN_JOINT_MARGIN_RAD
    assert placement.manipulability >= MIN_MANIPULABILITY
    assert 0.0 <= placement.reachable_share <= 1.0


@pytest.mark.parametrize("name", ["drawer", "door"])
def test_closed_handle_faces_the_hand_at_the_start(name, request):
    scene = request.getfixturevalue(name)
    T_wh = in_world(scene, [0.0])[0]
    T_wt = tool_pose(PANDA, scene.placement.start_q)
    tilt = scene.placement.tilt_rad  # a door may be held askew, so that the hand can follow it
    assert_allclose([T_wh[0, 2], T_wh[2, 2]], [np.cos(tilt), 0.0], atol=1e-9)
    assert T_wh[:3, 0] @ T_wt[:3, 0] > 0.99
    assert T_wh[0, 3] > T_wt[0, 3]


def test_same_object_is_placed_alike(drawer):
    again = find_placement(
        drawer.asset, drawer.task, PANDA, dataclasses.replace(RandomizationConfig(), scales=3)
    )
    assert again == drawer.placement


@pytest.mark.usefixtures("short_search")
def test_share_of_drawn_poses_that_are_reached_is_told(drawer):
    far = dataclasses.replace(RandomizationConfig(), scales=3, position_m=1.0)
    shares = [
        find_placement(drawer.asset, drawer.task, PANDA, draws).reachable_share
        for draws in (NO_RANDOMIZATION, far)
    ]
    assert shares[0] == 1.0
    assert shares[1] < 0.3


def test_place_lets_a_hand_go_with_the_handle_all_the_way_and_in_time(drawer, monkeypatch):
    args = drawer.asset, drawer.task, PANDA, RandomizationConfig()
    found = find_placement(*args)
    assert reach_test.followed_share(*args, found) == 1.0
    away = dataclasses.replace(found, pos_w=(found.pos_w[0] + 1.0, *found.pos_w[1:]))
    assert reach_test.followed_share(*args, away) == 0.0
    monkeypatch.setattr(reach_test, "FOLLOW_S", 0.5)  # for 22 cm and more
    assert reach_test.followed_share(*args, found) == 0.0


@pytest.mark.dataset
def test_door_that_closes_does_not_stand_where_the_elbow_is_caught(data_folder, tmp_path):
    """All poses are reached 5 cm farther off too, and a quarter of the ways is not followed."""
    asset = load_checked_asset(
        data_folder / "assets" / "partnet" / "7119" / "mobility.urdf", tmp_path
    )
    args = asset, make_task("close_door", asset, "joint_0"), PANDA, RandomizationConfig()
    found = find_placement(*args)
    farther = dataclasses.replace(found, pos_w=(0.884, -0.109, 0.678))
    assert (
        reach_test.sampled_share(*args, farther, 0.0)
        == reach_test.sampled_share(*args, found, 0.0)
        == 1.0
    )
    assert reach_test.followed_share(*args, farther) < 0.8
    assert reach_test.followed_share(*args, found) == 1.0


def test_object_that_stands_turned_is_turned_back(tmp_path, drawer):
    """A cabinet that opens along +y ends up with its handle before the arm all the same."""
    asset = make_cabinet(tmp_path / "a")
    handles = tuple(
        dataclasses.replace(h, normal_l=(0.0, 1.0, 0.0), along_l=(1.0, 0.0, 0.0))
        for h in asset.handles
    )
    joints = tuple(dataclasses.replace(j, axis_o=(0.0, 1.0, 0.0)) for j in asset.joints)
    turned = dataclasses.replace(asset, handles=handles, joints=joints)
    placement = find_placement(
        turned, make_task("open_drawer", turned, "drawer_2_slide"), PANDA, RandomizationConfig()
    )
    assert abs(placement.yaw_rad) == pytest.approx(np.pi / 2)
    way = placement.T_wo() @ handle_poses(turned, "drawer_2_slide", np.array([0.0, 1.0]))
    assert_allclose(way[0, :3, 2], [1, 0, 0], atol=1e-9)
    assert_allclose(way[1, :3, 3] - way[0, :3, 3], [-0.28, 0, 0], atol=1e-9)


@pytest.mark.parametrize("all_stages", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_a_drawer_longer_than_the_arm_is_refused_in_one_line(
    tmp_path, error_line, request, all_stages
):
    if not all_stages:
        request.getfixturevalue("short_search")
    asset = make_cabinet(tmp_path / "cabinet", travel_m=2.0)
    task = make_task("open_drawer", asset, "drawer_2_slide")
    error_line(
        "find_placement(drawer of 2 m)",
        lambda: find_placement(asset, task, PANDA, RandomizationConfig()),
    )


@given(
    scale=st.floats(0.5, 1.5),
    x=st.floats(-0.1, 0.1),
    y=st.floats(-0.1, 0.1),
    yaw=st.floats(-1, 1),
)
def test_closed_handle_stays_where_it_is_but_for_the_shift_whatever_size_and_turn(
    drawer, scale, x, y, yaw
):
    """Height aside: a smaller object stands on the same floor."""
    T_wo = object_pose(
        drawer.asset,
        drawer.task.joint,
        drawer.placement,
        scale=np.array([scale]),
        shift=np.array([[x, y]]),
        yaw=np.array([yaw]),
    )
    moved = handle_in_world(
        drawer.asset,
        drawer.task.joint,
        T_wo=T_wo,
        scale=np.array([scale]),
        opened=np.zeros(1),
        flip=drawer.placement.flip,
    )[0]
    nominal = in_world(drawer, [0.0])[0]
    assert_allclose(moved[:2, 3] - nominal[:2, 3], [x, y], atol=1e-12)
    assert T_wo[0, 2, 3] == drawer.placement.pos_w[2]
    assert np.arctan2(moved[1, 2], moved[0, 2]) == pytest.approx(yaw, abs=1e-9)


def test_flipped_way_is_the_same_handle_turned_about_its_approach(drawer):
    opened = np.linspace(0, 1, 3)
    plain = handle_poses(drawer.asset, drawer.task.joint, opened)
    flipped = handle_poses(drawer.asset, drawer.task.joint, opened, flip=True)
    assert_allclose(flipped[:, :3, 2:], plain[:, :3, 2:])
    assert_allclose(flipped[:, :3, :2], -plain[:, :3, :2])


def test_place_is_written_as_plain_numbers(drawer):
    content = drawer.placement.as_dict()
    assert type(drawer.placement)(**content) == drawer.placement
