"""Robot of LeRobot that sends its targets through the safety filter of ``deploy``."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from lerobot.robots import Robot
from lerobot.utils.errors import DeviceAlreadyConnectedError, DeviceNotConnectedError

from articulate_deploy.arm_deployment import DEFAULT_CLIENTS, common_limits
from articulate_deploy.arms.client import ClientSpec
from articulate_deploy.bundle import load_bundle
from articulate_deploy.robots.arm import ArmOptions, ArmRobot
from articulate_deploy.robots.robot import (
    GRIPPER_KEY,
    JOINT_KEYS,
    action_dict,
    read_keys,
)
from articulate_deploy.safety import ToolLimits, limit_tool, safe_target
from lerobot_robot_articulate.config_articulate_arm import ArticulateArmConfig


class ArticulateArm(Robot):
    """Panda or FR3; see :class:`articulate_deploy.robots.arm.ArmRobot`.

    Connecting moves nothing. The first action starts a motion at the present pose, and
    :meth:`stop` or :meth:`disconnect` ends it.
    """

    config_class = ArticulateArmConfig
    name = "articulate_arm"

    def __init__(self, config: ArticulateArmConfig) -> None:
        """Read the bundle and check that the client is installed.

        Raises:
            ArticulateError: The bundle or the client cannot be used.
        """
        super().__init__(config)
        manifest = load_bundle(Path(config.bundle)).manifest
        self._manifest = replace(manifest, robot=common_limits(manifest.robot, config.robot))
        spec = ClientSpec(config.client or DEFAULT_CLIENTS[config.robot], config.address)
        options = ArmOptions(lockstep=config.lockstep)
        self._arm = ArmRobot(self._manifest, spec, options, name=config.robot)
        self._tool = ToolLimits(speed_m_s=config.tool_speed_m_s)
        self._last: np.ndarray | None = None

    @property
    def observation_features(self) -> dict[str, type]:
        """Keys of observations; readable before :meth:`connect`."""
        return self._arm.observation_features

    @property
    def action_features(self) -> dict[str, type]:
        """Keys of actions; readable before :meth:`connect`."""
        return self._arm.action_features

    @property
    def is_connected(self) -> bool:
        """True after :meth:`connect`."""
        return self._arm.is_connected

    @property
    def is_calibrated(self) -> bool:
        """True; the arm keeps its own calibration."""
        return True

    def connect(self, calibrate: bool = True) -> None:
        """Connect arm and gripper, and write gains and thresholds.

        Raises:
            DeviceAlreadyConnectedError: It is connected.
            ArmError: A controller does not answer, or the arm cannot move.
        """
        if self.is_connected:
            raise DeviceAlreadyConnectedError(f"{self} is connected")
        self._arm.connect(calibrate)

    def calibrate(self) -> None:
        """Do nothing: the arm keeps its own calibration."""

    def configure(self) -> None:
        """Do nothing: :meth:`connect` writes the settings."""

    def get_observation(self) -> dict[str, float]:
        """Return joint angles [rad], joint speeds [rad/s], gripper opening [m], force [N].

        Raises:
            DeviceNotConnectedError: It is not connected.
        """
        self._check_connected()
        return self._arm.get_observation()

    def send_action(self, action: dict[str, float]) -> dict[str, float]:
        """Send the nearest safe targets and return them after one control step.

        Args:
            action: Targets [rad] and an opening [m], with the keys of :attr:`action_features`.

        Raises:
            DeviceNotConnectedError: It is not connected.
            ArmError: The arm or a watchdog stopped the motion; the next action starts a new one.
        """
        self._check_connected()
        if self._last is None:
            present = self._arm.get_observation()
            self._arm.reset_to(read_keys(present), present[GRIPPER_KEY])
            self._last = read_keys(self._arm.get_observation())
        control, robot = self._manifest.control, self._manifest.robot
        safe = safe_target(read_keys(action, JOINT_KEYS), self._last, control, robot)
        safe = limit_tool(safe, self._last, self._tool, control, robot)
        try:
            sent = self._arm.send_action(action_dict(safe, float(action[GRIPPER_KEY])))
        except BaseException:
            self._last = None
            raise
        self._last = safe
        return sent

    def stop(self) -> None:
        """Brake and end the motion; the next action starts a new one."""
        self._last = None
        self._arm.stop()

    def disconnect(self) -> None:
        """Brake and close the connection.

        Raises:
            DeviceNotConnectedError: It is not connected.
        """
        self._check_connected()
        self._last = None
        self._arm.disconnect()

    def _check_connected(self) -> None:
        if not self.is_connected:
            raise DeviceNotConnectedError(f"{self} is not connected; call connect first")
