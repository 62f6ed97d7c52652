"""Franka Panda or FR3 as a robot of LeRobot."""

from lerobot_robot_articulate.articulate_arm import ArticulateArm
from lerobot_robot_articulate.config_articulate_arm import ArticulateArmConfig

__all__ = ["ArticulateArm", "ArticulateArmConfig"]
