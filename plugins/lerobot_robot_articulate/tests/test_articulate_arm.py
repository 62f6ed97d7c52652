"""The plugin in LeRobot, with a client that has no arm behind it."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("lerobot", reason="LeRobot is not installed: it needs Python 3.12")

from lerobot.robots import RobotConfig
from lerobot.robots.utils import make_robot_from_config
from lerobot.utils.errors import DeviceNotConnectedError
from lerobot_robot_articulate import ArticulateArm, ArticulateArmConfig

from articulate_deploy.robots.robot import GRIPPER_KEY, JOINT_KEYS, action_dict, read_keys


@pytest.fixture
def config(tmp_path: Path) -> ArticulateArmConfig:
    """Configuration with the bundle in the variable BUNDLE."""
    if "BUNDLE" not in os.environ:
        pytest.skip("BUNDLE is not set: give the path of a bundle of export-policy")
    return ArticulateArmConfig(
        bundle=Path(os.environ["BUNDLE"]),
        address="test",
        client="fake",
        lockstep=True,
        calibration_dir=tmp_path,
    )


def test_lerobot_finds_the_robot_by_its_type(config: ArticulateArmConfig) -> None:
    assert RobotConfig.get_choice_class("articulate_arm") is ArticulateArmConfig
    robot = make_robot_from_config(config)
    assert isinstance(robot, ArticulateArm)
    assert set(robot.action_features) == {*JOINT_KEYS, GRIPPER_KEY}
    with pytest.raises(DeviceNotConnectedError):
        robot.get_observation()


def test_a_far_target_is_limited_to_one_step(config: ArticulateArmConfig) -> None:
    robot = ArticulateArm(config)
    with robot:
        before = robot.get_observation()
        assert set(before) == set(robot.observation_features)
        q = read_keys(before)
        wide = before[GRIPPER_KEY]
        sent = read_keys(robot.send_action(action_dict(q + 1.0, wide)))
        assert 0.0 < np.abs(sent - q).max() < 0.1
        kept = read_keys(robot.send_action(action_dict(np.full(7, np.nan), wide)))
        np.testing.assert_allclose(kept, sent)
        robot.stop()
        robot.send_action(action_dict(read_keys(robot.get_observation()), wide))
    assert not robot.is_connected
