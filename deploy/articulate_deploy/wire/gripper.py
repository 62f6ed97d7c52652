"""Simulated Franka gripper: commands that take time, grasp with tolerance, state at 20 Hz.

Speeds of commands are those of the opening: each finger moves at half of them. A ``Move`` that an
object blocks returns after :data:`BLOCKED_S`, as on the real gripper; close with ``Grasp``.
"""

from __future__ import annotations

from dataclasses import dataclass

from articulate_deploy.wire.limits import STEP_S
from articulate_deploy.wire.messages import GRIPPER_STATE
from articulate_deploy.wire.physics import FingerDrive

LATENCY_S = 0.2
"""Time from a command to the motion of the fingers [s]."""
SETTLE_S = 0.2
"""Time that the fingers are at rest before a command returns [s]."""
BLOCKED_S = 100.0
"""Time after which a blocked ``Move`` returns [s]."""
HOMING_CLOSE_S = 1.5
"""Time for which homing closes the fingers before it opens them [s]."""
MOVE_TOLERANCE_M = 1e-3
"""Distance from its width at which a ``Move`` is complete [m]."""
STILL_M_S = 2e-3
"""Speed of the opening below which the fingers are at rest [m/s]."""
MAX_FORCE_N, MOVE_FORCE_N = 70.0, 30.0
"""Largest force of a finger in a grasp, and force in a move [N]; the vendor's figures are not
public."""
STIFFNESS_N_M = 2000.0
"""Increase of the force with the distance of the set point ahead of the finger [N/m]."""
MAX_SPEED_M_S = 0.4
"""Largest speed of the opening [m/s]: the URDF allows 0.2 for a finger."""
STATE_CYCLES = 50
"""Cycles between two states."""
TEMPERATURE = 30
"""Temperature in a state [degrees Celsius]."""


@dataclass
class GripperCommand:
    """Command in progress."""

    kind: str
    """``Homing``, ``Move`` or ``Grasp``."""
    width_m: float
    """Requested opening [m]."""
    speed_m_s: float
    """Speed of the opening [m/s]."""
    force_n: float = MOVE_FORCE_N
    """Force of a finger [N]."""
    inner_m: float = 0.0
    """Tolerance of a grasp below its width [m]."""
    outer_m: float = 0.0
    """Tolerance of a grasp above its width [m]."""
    time_s: float = 0.0
    """Time since the command arrived [s]."""
    still_s: float = 0.0
    """Time since the fingers are at rest [s]."""


class GripperMechanism:
    """Set points of the fingers and completion of commands."""

    def __init__(self, max_width_m: float, latency_s: float = LATENCY_S) -> None:
        """Begin open.

        Args:
            max_width_m: Largest opening.
            latency_s: Time from a command to motion.
        """
        self.max_width_m, self.latency_s = max_width_m, latency_s
        self.is_grasped = False
        self.command: GripperCommand | None = None
        self._force_n = MOVE_FORCE_N
        self.reset_to(max_width_m)

    def reset_to(self, width_m: float) -> None:
        """Rest at an opening [m] without a command."""
        self.width_m = float(width_m)
        self._set_point_m = float(width_m)
        self._force_n = MOVE_FORCE_N
        self.command, self.is_grasped = None, False

    @property
    def is_busy(self) -> bool:
        """True while a command is in progress."""
        return self.command is not None

    def begin(self, command: GripperCommand) -> str:
        """Begin a command; return "" or the status of one that is rejected or interrupted."""
        finite = (command.width_m, command.speed_m_s, command.force_n)
        if not all(value == value and abs(value) < 1e6 for value in finite):
            return "fail"
        if not (0.0 <= command.width_m <= self.max_width_m + 0.005 and command.speed_m_s > 0.0):
            return "fail"
        command.speed_m_s = min(command.speed_m_s, MAX_SPEED_M_S)
        command.force_n = min(max(command.force_n, 1.0), MAX_FORCE_N)
        self.command, self.is_grasped = command, False
        return ""

    def stop(self) -> None:
        """Rest at the present opening; the force of a grasp stays."""
        self.command = None
        if not self.is_grasped:
            self._set_point_m = self.width_m

    def drive(self) -> FingerDrive:
        """Return the input of the fingers for one cycle."""
        command = self.command
        if command is not None and command.time_s >= self.latency_s:
            self._force_n = command.force_n
            step = command.speed_m_s * STEP_S
            low = 0.0 if command.kind == "Move" else -2.0 * command.force_n / STIFFNESS_N_M
            goal = command.width_m if command.kind == "Move" else low
            if command.kind == "Homing" and command.time_s > self.latency_s + HOMING_CLOSE_S:
                goal = self.max_width_m
            if goal > self._set_point_m:  # an opening gripper continues from its fingers
                self._set_point_m = max(self._set_point_m, self.width_m)
            change = min(max(goal - self._set_point_m, -step), step)
            self._set_point_m += change
        return FingerDrive(self._set_point_m / 2.0, self._force_n)

    def update(self, width_m: float) -> str:
        """Take the opening after a cycle; return the status of a command that is complete."""
        speed = abs(width_m - self.width_m) / STEP_S
        self.width_m = width_m
        command = self.command
        if command is None:
            return ""
        command.time_s += STEP_S
        if command.time_s <= self.latency_s + 2.0 * STEP_S:
            return ""
        command.still_s = command.still_s + STEP_S if speed < STILL_M_S else 0.0
        status = self._status(command)
        if status:
            self.command = None
        return status

    def _status(self, command: GripperCommand) -> str:
        if command.kind == "Homing":
            near = abs(self.width_m - self.max_width_m) <= MOVE_TOLERANCE_M
            is_late = command.time_s > self.latency_s + HOMING_CLOSE_S
            return "success" if is_late and near and command.still_s >= SETTLE_S else ""
        if command.kind == "Move":
            near = abs(self.width_m - command.width_m) <= MOVE_TOLERANCE_M
            if near and command.still_s >= SETTLE_S:
                return "success"
            return "unsuccessful" if command.time_s > BLOCKED_S else ""
        if command.still_s < SETTLE_S:
            return ""
        low, high = command.width_m - command.inner_m, command.width_m + command.outer_m
        self.is_grasped = low <= self.width_m <= high
        return "success" if self.is_grasped else "unsuccessful"

    def state(self, message_id: int) -> bytes:
        """Return a state message."""
        return GRIPPER_STATE.pack(
            message_id, self.width_m, self.max_width_m, self.is_grasped, TEMPERATURE
        )
