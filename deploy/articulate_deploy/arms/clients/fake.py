"""Arm without contacts in the child process itself, for tests of the rest of the program."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np

from articulate.robot.arm import PANDA
from articulate_deploy.arms.client import (
    REFLEX,
    USER_STOP,
    ArmSettings,
    ArmState,
    ClientInfo,
    Motion,
    TorqueLaw,
)

INERTIA = np.array([1.0, 1.0, 0.8, 0.8, 0.2, 0.15, 0.1])
"""Inertias of the joints [kg m^2]."""
TEXTS = {
    "reflex": 'Move command aborted: motion aborted by reflex! ["joint_reflex"]',
    "user_stop": "Move command aborted: User Stop pressed!",
    "lost": "UDP receive: Timeout",
}
"""Texts of libfranka."""


class FakeClient:
    """See :class:`articulate_deploy.arms.client.ArmClient`; faults are given by time of motion."""

    def __init__(
        self,
        address: str,
        *,
        q: list[float] | None = None,
        fault: str = "",
        at_ms: int = 0,
        force_n: float = 0.0,
        real_time: bool = False,
    ) -> None:
        """Keep the options.

        Args:
            address: Not used.
            q: Angles at the start (7,) [rad].
            fault: ``silent``, ``unreachable``, ``version``, ``reflex``, ``user_stop``, ``lost``,
                ``gap``, ``rejected`` or ``in_reflex``.
            at_ms: Time of the fault in an episode [ms].
            force_n: Force on the gripper from then on [N].
            real_time: Run at 1 kHz instead of as fast as possible.
        """
        self._fault, self._at_ms, self._force_n, self._real_time = fault, at_ms, force_n, real_time
        self._q = np.array(PANDA.home if q is None else q)
        self._dq, self._time_s = np.zeros(7), 1.0
        self._settings: ArmSettings | None = None
        self._mode, self._motions = "idle", 0
        self.commands_after_fault = 0

    def connect(self) -> ClientInfo:
        """Connect, or fail as a controller would."""
        if self._fault == "silent":
            time.sleep(3600.0)
        if self._fault == "unreachable":
            raise RuntimeError("libfranka: UDP receive: no connection to the network")
        if self._fault == "version":
            raise RuntimeError("libfranka: Incompatible library version (server version: 7)")
        if self._fault == "in_reflex":
            self._mode = REFLEX
        return ClientInfo("fake", 0)

    def read_state(self) -> ArmState:
        """Return the present state."""
        return self._state(0.0)

    def configure(self, settings: ArmSettings) -> tuple[str, ...]:
        """Keep the settings."""
        if self._fault == "rejected":
            raise RuntimeError("libfranka: Set Collision Behavior command rejected: not possible")
        self._settings = settings
        return ()

    def run(self, motion: Motion) -> None:
        """Simulate a motion."""
        assert self._settings is not None
        law, first_s = TorqueLaw(self._settings), self._time_s
        self._motions += 1
        begun, finished, n = time.perf_counter(), False, 0
        while not finished:
            elapsed_ms = round((self._time_s - first_s) * 1e3)
            due = self._motions > 1 and elapsed_ms >= self._at_ms
            if due and self._fault in TEXTS:
                self._mode = {"reflex": REFLEX, "user_stop": USER_STOP}.get(self._fault, "idle")
                raise RuntimeError(f"libfranka: {TEXTS[self._fault]}")
            if due and self._fault == "gap":
                self._time_s, self._fault = self._time_s + 0.05, ""
            state = self._state(self._force_n if due else 0.0)
            set_point, finished = motion.set_point(state)
            self._dq += law.torque(set_point, state) / INERTIA * 0.001
            self._q += self._dq * 0.001
            self._time_s += 0.001
            n += 1
            if self._real_time:
                time.sleep(max(begun + n * 0.001 - time.perf_counter(), 0.0))

    def recover(self) -> None:
        """Clear a reflex."""
        self._mode = "idle"

    def close(self) -> None:
        """Do nothing."""

    def _state(self, force_n: float) -> ArmState:
        state = ArmState(
            self._time_s, self._q.copy(), self._dq.copy(), np.zeros(7), np.zeros(6), self._mode
        )
        return replace(state, wrench=np.array([force_n, 0.0, 0.0, 0.0, 0.0, 0.0]))


class FakeGripper:
    """Gripper whose commands take some time; see :mod:`articulate_deploy.arms.gripper`."""

    def __init__(self, address: str = "", seconds: float = 0.02) -> None:
        """Begin open; a command takes ``seconds`` and the address is not used."""
        self.width, self._seconds = 0.08, seconds
        self.calls: list[str] = []

    def grasp(self, width: float, speed: float, force: float, inner: float, outer: float) -> bool:
        """Close."""
        self.calls.append("grasp")
        time.sleep(self._seconds)
        self.width = 0.01
        return True

    def move(self, width: float, speed: float) -> bool:
        """Open."""
        self.calls.append("move")
        time.sleep(self._seconds)
        self.width = width
        return True

    def homing(self) -> bool:
        """Do nothing."""
        self.calls.append("homing")
        return True

    def read_once(self) -> FakeGripper:
        """Return the state."""
        time.sleep(self._seconds)
        return self
