"""Client franka-rs: its 1 kHz loop is in Rust; protocol 10 (FR3) and 5 (Panda).

The loop holds the joint impedance of training. The set points go through its generator of
trajectories, which is limited to the same share of the limits as the guard and adds a lag of some
milliseconds.
"""

from __future__ import annotations

import time
from typing import Any

import franka

from articulate_deploy.arms.client import ArmSettings, ArmState, ClientInfo, Motion
from articulate_deploy.arms.clients.libfranka import arm_state, read_back, thresholds
from articulate_deploy.arms.guard import MAX_FRACTION

POLL_S = 2e-4
"""Time between looks for a new state [s]."""
MAX_DEVIATION_RAD = 3.0
"""Largest distance from the start of a motion [rad]; the joint box is checked by the guard."""


class FrankaRsClient:
    """Targets for a loop in Rust; see :class:`articulate_deploy.arms.client.ArmClient`."""

    def __init__(self, address: str) -> None:
        """Keep the address."""
        self._address = address
        self._robot: Any = None
        self._settings: ArmSettings | None = None

    def connect(self) -> ClientInfo:
        """Connect without a real-time kernel being required."""
        self._robot = franka.Robot(self._address, realtime="ignore")
        return ClientInfo(f"franka-rs {franka.__version__}", int(self._robot.fci_version))

    def read_state(self) -> ArmState:
        """Return the present state."""
        return arm_state(self._robot.read_once(), in_motion=False)

    def configure(self, settings: ArmSettings) -> tuple[str, ...]:
        """Set collision thresholds; the gains are passed with each motion."""
        self._robot.set_collision_behavior_simple(*thresholds(settings))
        self._settings = settings
        return read_back(self._robot.read_once())

    def run(self, motion: Motion) -> None:
        """Run a motion: one set point for each new state."""
        settings = self._settings
        assert settings is not None
        with self._robot.joint_targets(
            fraction=MAX_FRACTION,
            max_deviation=MAX_DEVIATION_RAD,
            backend="impedance",
            joint_stiffness=list(settings.stiffness),
            joint_damping=list(settings.damping),
            torque_limits=list(settings.torque_max),
            torque_cutoff=1000.0,
            leash=settings.leash_rad,
        ) as arm:
            last_s, finished = -1.0, False
            while not finished and arm.running:
                state = arm_state(arm.state(), in_motion=True)
                if state.time_s == last_s:
                    time.sleep(POLL_S)
                    continue
                last_s = state.time_s
                set_point, finished = motion.set_point(state)
                arm.move_to(set_point)
            arm.stop()

    def recover(self) -> None:
        """Clear the errors of a reflex."""
        self._robot.automatic_error_recovery()

    def close(self) -> None:
        """Disconnect."""
        self._robot = None
