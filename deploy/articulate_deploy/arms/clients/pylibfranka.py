"""Client pylibfranka: the manufacturer's Python package, protocol 10 (FR3).

Its active interface has no rate limiter; :class:`articulate_deploy.arms.client.TorqueLaw` limits.
"""

from __future__ import annotations

from importlib import metadata
from typing import Any

import pylibfranka as libfranka

from articulate_deploy.arms.client import ArmSettings, ArmState, ClientInfo, Motion, TorqueLaw
from articulate_deploy.arms.clients.libfranka import arm_state, read_back, thresholds

PROTOCOL = 10


class PylibfrankaClient:
    """Torques in a loop; see :class:`articulate_deploy.arms.client.ArmClient`."""

    def __init__(self, address: str) -> None:
        """Keep the address."""
        self._address = address
        self._robot: Any = None
        self._settings: ArmSettings | None = None

    def connect(self) -> ClientInfo:
        """Connect without a real-time kernel being required."""
        self._robot = libfranka.Robot(self._address, libfranka.RealtimeConfig.kIgnore)
        return ClientInfo(f"pylibfranka {metadata.version('pylibfranka')}", PROTOCOL)

    def read_state(self) -> ArmState:
        """Return the present state."""
        return arm_state(self._robot.read_once(), in_motion=False)

    def configure(self, settings: ArmSettings) -> tuple[str, ...]:
        """Set collision thresholds; the gains are those of the loop."""
        self._robot.set_collision_behavior(*thresholds(settings))
        self._settings = settings
        return read_back(self._robot.read_once())

    def run(self, motion: Motion) -> None:
        """Run a motion."""
        assert self._settings is not None
        law, active = TorqueLaw(self._settings), self._robot.start_torque_control()
        finished = False
        while not finished:
            state, _ = active.readOnce()
            measured = arm_state(state, in_motion=True)
            set_point, finished = motion.set_point(measured)
            torques = libfranka.Torques(law.torque(set_point, measured).tolist())
            torques.motion_finished = finished
            active.writeOnce(torques)

    def recover(self) -> None:
        """Clear the errors of a reflex."""
        self._robot.automatic_error_recovery()

    def close(self) -> None:
        """Disconnect."""
        self._robot = None
