"""Choice among grasps by a rate of success that the tests define."""

import dataclasses

import pytest
from numpy.testing import assert_allclose

from articulate.assets.asset import handle_frame
from articulate.task.randomization_config import RandomizationConfig
from articulate_envs.feasibility import Feasibility
from articulate_envs.joint_selection import (
    FURTHER_DEPTHS_M,
    FURTHER_TILTS_RAD,
    MAX_RATED,
    choose_scene,
)
from articulate_train import feasibility_check
from articulate_train.config import TrainConfig

ONE_SIZE = dataclasses.replace(RandomizationConfig(), scales=1, scale=(1.0, 1.0))


def chosen(cabinet, rate, **changes):
    rated = []

    def keep(scene):
        rated.append(scene.placement)
        return rate(scene.placement)

    config = TrainConfig(
        asset=str(cabinet.folder), joint="drawer_1_slide", randomization=ONE_SIZE, **changes
    )
    return choose_scene(config, cabinet, keep), rated


def test_a_capable_expert_needs_no_other_grasp(cabinet):
    scene, rated = chosen(cabinet, lambda _: 0.9)
    assert [scene.placement] == rated


def test_an_expert_that_never_succeeds_needs_none_either(cabinet):
    _, rated = chosen(cabinet, lambda _: 0.0, target_open=0.8)
    assert {placement.deeper_m for placement in rated} == {0.0}
    assert len(rated) <= MAX_RATED


def test_the_gripper_turned_by_half_a_turn_is_chosen_where_it_succeeds_more_often(cabinet):
    scene, rated = chosen(cabinet, lambda placement: 0.95 if placement.flip else 0.6)
    assert scene.placement.flip
    assert {placement.tilt_rad for placement in rated} <= {0.0, *FURTHER_TILTS_RAD}


def test_tilts_count_from_the_best_grasp_and_depths_come_after_them(cabinet):
    scene, _ = chosen(cabinet, lambda p: 0.6 + 0.1 * (p.tilt_rad > 0.0) + 10.0 * p.deeper_m)
    assert (scene.placement.tilt_rad, scene.placement.deeper_m) == (
        max(FURTHER_TILTS_RAD),
        max(FURTHER_DEPTHS_M),
    )


@pytest.mark.parametrize("deeper_m", FURTHER_DEPTHS_M)
def test_a_deeper_grasp_moves_the_gripper_along_its_approach(cabinet, deeper_m):
    scene, rated = chosen(cabinet, lambda placement: 0.8 if placement.deeper_m == deeper_m else 0.5)
    assert scene.placement.deeper_m == deeper_m
    assert rated[-len(FURTHER_DEPTHS_M) :] == [
        dataclasses.replace(rated[0], deeper_m=other) for other in FURTHER_DEPTHS_M
    ]

    before, after = (
        handle_frame(asset.handle_of(scene.task.joint)) for asset in (cabinet, scene.asset)
    )
    assert_allclose(after[:3, 3] - before[:3, 3], deeper_m * before[:3, 2], atol=1e-9)


def test_a_grasp_of_a_placement_that_the_user_gives_is_only_made_deeper(cabinet):
    at = (0.466, -0.09, 45.5)
    _, rated = chosen(cabinet, lambda _: 0.5, placement=at)
    assert {placement.deeper_m for placement in rated} == {0.0, *FURTHER_DEPTHS_M}
    assert {placement.pos_w for placement in rated} == {rated[0].pos_w}


def test_a_line_is_printed_before_each_estimate_but_the_first(cabinet, monkeypatch):
    rates = iter([0.25, 0.5, *[0.4] * 10])
    monkeypatch.setattr(
        feasibility_check,
        "feasibility_of",
        lambda *_: Feasibility(success=next(rates), n_episodes=64, dominant_failure="speed"),
    )
    config = TrainConfig(
        asset=str(cabinet.folder),
        joint="drawer_1_slide",
        randomization=ONE_SIZE,
        target_open=0.8,
    )
    lines: list[str] = []
    feasibility_check.best_scene(config, cabinet, lines.append)
    assert "success of the scripted expert so far 25%" in lines[0]
    assert lines[0].endswith("joint drawer_1_slide")
    assert all("so far 50%" in line for line in lines[1:])
