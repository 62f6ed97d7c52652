"""Configuration of the arm; LeRobot finds the robot's class by this module's name."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from lerobot.robots import RobotConfig


@RobotConfig.register_subclass("articulate_arm")
@dataclass(kw_only=True)
class ArticulateArmConfig(RobotConfig):
    """Configuration of :class:`lerobot_robot_articulate.ArticulateArm`."""

    bundle: Path
    """Bundle with limits, gains and control rate."""
    address: str
    """Address of the controller."""
    robot: str = "panda"
    """``panda``, ``fr3`` or ``bridge``."""
    client: str = ""
    """Client; by default that of the robot."""
    tool_speed_m_s: float = 0.25
    """Largest speed of the tool [m/s]."""
    lockstep: bool = False
    """True for a simulated robot that waits for every command."""
