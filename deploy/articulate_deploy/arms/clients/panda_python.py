"""Client panda-python: libfranka 0.9.2, protocol 5 (Panda).

The raw ``libfranka.Robot`` is used: ``panda_py.Panda`` clears reflexes by itself when a motion
starts. The callback runs at 1 kHz in Python; nothing else runs in its process.
"""

from __future__ import annotations

from typing import Any

import panda_py
from panda_py import libfranka

from articulate_deploy.arms.client import ArmSettings, ArmState, ClientInfo, Motion, TorqueLaw
from articulate_deploy.arms.clients.libfranka import arm_state, read_back, thresholds

PROTOCOL = 5


class PandaPythonClient:
    """Torques from a callback; see :class:`articulate_deploy.arms.client.ArmClient`."""

    def __init__(self, address: str) -> None:
        """Keep the address."""
        self._address = address
        self._robot: Any = None
        self._law: TorqueLaw | None = None
        self._settings: ArmSettings | None = None

    def connect(self) -> ClientInfo:
        """Connect without a real-time kernel being required."""
        self._robot = libfranka.Robot(self._address, libfranka.RealtimeConfig.kIgnore)
        version = getattr(panda_py, "__version__", "")
        return ClientInfo(f"panda-python {version}", PROTOCOL)

    def read_state(self) -> ArmState:
        """Return the present state."""
        return arm_state(self._robot.read_once(), in_motion=False)

    def configure(self, settings: ArmSettings) -> tuple[str, ...]:
        """Set collision thresholds; the gains are those of the callback."""
        low, high, low_force, high_force = thresholds(settings)
        self._robot.set_collision_behavior(
            low, high, low, high, low_force, high_force, low_force, high_force
        )
        self._settings = settings
        return read_back(self._robot.read_once())

    def run(self, motion: Motion) -> None:
        """Run a motion; libfranka limits the torque rate as well."""
        assert self._settings is not None
        law = TorqueLaw(self._settings)

        def callback(state: Any, _: Any) -> Any:
            measured = arm_state(state, in_motion=True)
            set_point, finished = motion.set_point(measured)
            torques = libfranka.Torques(law.torque(set_point, measured).tolist())
            torques.motion_finished = finished
            return torques

        self._robot.control(callback, True, 1000.0)

    def recover(self) -> None:
        """Clear the errors of a reflex."""
        self._robot.automatic_error_recovery()

    def close(self) -> None:
        """Disconnect."""
        self._robot = None
