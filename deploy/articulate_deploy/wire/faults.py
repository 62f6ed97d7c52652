"""Faults that a test injects into the simulated robot.

Faults of the connection change how the next client is answered. Faults of a motion begin after a
number of its cycles, so they are deterministic in lockstep.
"""

from __future__ import annotations

from dataclasses import dataclass

from articulate.errors import ConfigError, nearest

CONNECTION_FAULTS = (
    "silent", "close", "wrong_version", "no_states", "wrong_state_size", "short_header",
    "truncated_reply", "no_model", "no_gripper",
)  # fmt: skip
"""Silent: accept and never answer. Close: accept and close. Wrong version: reply with version 7. No
states: reply, then send none. Wrong state size: send one byte less. Short header: reply with a size
below the header's. Truncated reply: send half of a reply, then close. No model: reject the request
of the model. No gripper: close connections to the gripper."""
MOTION_FAULTS = (
    "drop_commands", "delay_commands", "drop_states", "delay_states", "reorder_states", "stall",
    "reflex", "user_stop", "disconnect", "silence", "external_torque",
)  # fmt: skip
"""Drop or delay: lose ``count`` messages, or take each ``delay`` cycles late. Reorder: send two
states in the wrong order. Stall: send nothing for ``seconds``. Reflex: stop with ``error``. User
stop: press it. Disconnect: close the connection. Silence: keep it open and send nothing. External
torque: press on the arm with ``torque`` [Nm] at each joint for ``count`` cycles, 0 for ever."""
FAULTS = (*CONNECTION_FAULTS, *MOTION_FAULTS)


@dataclass(frozen=True, kw_only=True)
class Fault:
    """One fault."""

    kind: str
    """Name in :data:`FAULTS`."""
    after: int = 0
    """Cycles of the motion before it begins."""
    count: int = 1
    """Number of messages or cycles."""
    delay: int = 1
    """Cycles by which a message is late."""
    seconds: float = 0.05
    """Duration of a stall [s]."""
    error: str = "joint_reflex"
    """Error of a reflex; see :data:`articulate_deploy.wire.messages.ERRORS`."""
    persistent: bool = False
    """Let recovery fail until the fault is cleared."""
    torque: tuple[float, ...] = (0.0,) * 7
    """External torque (7,) [Nm]."""

    def __post_init__(self) -> None:
        if self.kind not in FAULTS:
            raise ConfigError(f"fault {self.kind}: unknown{nearest(self.kind, FAULTS)}")
        if self.after < 0 or self.count < 0 or self.delay < 1:
            raise ConfigError(f"fault {self.kind}: after and count must be 0 or more, delay 1")


class FaultPlan:
    """Faults that are set, and the cycles of the present motion."""

    def __init__(self) -> None:
        """Begin without faults."""
        self._faults: dict[str, Fault] = {}
        self.cycle = 0
        """Cycles since the first command of the motion."""

    def inject(self, fault: Fault) -> None:
        """Set a fault; one of the same kind is replaced."""
        self._faults[fault.kind] = fault

    def clear(self) -> None:
        """Remove all faults."""
        self._faults.clear()

    def connection(self, kind: str) -> bool:
        """Return True if a fault of the connection is set."""
        return kind in self._faults

    def active(self, kind: str) -> Fault | None:
        """Return the fault of ``kind`` if it acts in this cycle of a motion."""
        fault = self._faults.get(kind)
        if fault is None or self.cycle < fault.after:
            return None
        if fault.count and self.cycle >= fault.after + fault.count:
            return None
        return fault

    def begins(self, kind: str) -> Fault | None:
        """Return the fault of ``kind`` if it begins in this cycle; it happens once."""
        fault = self._faults.get(kind)
        if fault is None or self.cycle < fault.after:
            return None
        return self._faults.pop(kind)
