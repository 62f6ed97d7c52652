"""Controller of the simulated arm: motions, limits, reflexes, recovery.

One call of :meth:`ArmController.cycle` is one control cycle. A motion generator's output is
differentiated backward over 1 ms from the robot's set point, as the arm does it. A missing command
is extrapolated with constant acceleration, a missing torque is repeated.
"""

from __future__ import annotations

from collections import Counter, deque
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from articulate.transforms import Array, Mask
from articulate_deploy.wire.limits import (
    MAX_LOST,
    START_TOLERANCE_RAD,
    STEP_S,
    MotionLimits,
    generator_violation,
    measured_violation,
    torque_violation,
)
from articulate_deploy.wire.messages import (
    CONTROLLER,
    ERROR,
    ERRORS,
    GENERATOR,
    IDLE_CONTROLLER,
    IDLE_GENERATOR,
    ROBOT_MODE,
)
from articulate_deploy.wire.physics import STIFFNESS, Drive, Measured, critical_damping

START_CYCLES = 100
"""Cycles within which the first command of a motion must arrive; the client sends none for the
first one or two states."""
COUNTED_ONLY = tuple(
    ERROR[name]
    for name in (
        "joint_motion_generator_velocity_discontinuity",
        "joint_motion_generator_acceleration_discontinuity",
        "controller_torque_discontinuity",
    )
)
"""Violations that end a motion in lockstep and are only counted in wall-clock time, where a busy
computer causes them."""
MOVING_RAD_S2 = 0.01
"""Acceleration of a set point above which the thresholds of acceleration apply [rad/s^2]."""
AT_REST_RAD_S = 1e-5
"""Joint speed below which the arm is at rest [rad/s]."""


@dataclass
class Thresholds:
    """Contact and collision thresholds of ``SetCollisionBehavior``."""

    lower_torque_acceleration: Array = field(default_factory=lambda: np.full(7, 20.0))
    upper_torque_acceleration: Array = field(default_factory=lambda: np.full(7, 20.0))
    lower_torque_nominal: Array = field(default_factory=lambda: np.full(7, 20.0))
    upper_torque_nominal: Array = field(default_factory=lambda: np.full(7, 20.0))
    lower_force_acceleration: Array = field(default_factory=lambda: np.full(6, 20.0))
    upper_force_acceleration: Array = field(default_factory=lambda: np.full(6, 20.0))
    lower_force_nominal: Array = field(default_factory=lambda: np.full(6, 20.0))
    upper_force_nominal: Array = field(default_factory=lambda: np.full(6, 20.0))

    @classmethod
    def from_numbers(cls, numbers: Array) -> Thresholds:
        """Return the thresholds from the 52 numbers of a request [Nm, N]."""
        torques, forces = numbers[:28].reshape(4, 7), numbers[28:].reshape(4, 6)
        return cls(*torques, *forces)


@dataclass
class Motion:
    """Motion in progress."""

    command_id: int
    """Identifier of its ``Move`` request."""
    controller: int
    """Number in :data:`articulate_deploy.wire.messages.CONTROLLER`."""
    generator: int
    """Number in :data:`articulate_deploy.wire.messages.GENERATOR`."""
    started: bool = False
    """True from the first command on."""
    waited: int = 0
    """Cycles before the first command."""
    lost: int = 0
    """Commands lost in a row."""


class ArmController:
    """State of the arm between its network interface and its physics."""

    def __init__(self, limits: MotionLimits, *, lockstep: bool) -> None:
        """Begin idle; :meth:`hold` gives the first set point.

        Args:
            limits: Limits of the arm.
            lockstep: End a motion for every violation; otherwise see :data:`COUNTED_ONLY`.
        """
        self.limits, self.lockstep = limits, lockstep
        self.robot_mode = ROBOT_MODE["idle"]
        self.errors: set[int] = set()
        """Indices of the active errors."""
        self.reflex_reason: set[int] = set()
        """Indices of the errors that ended the last motion."""
        self.motion: Motion | None = None
        self.thresholds = Thresholds()
        self.set_stiffness(STIFFNESS)
        self.violations: Counter[str] = Counter()
        """Number of violations by the name of the error, with those that are only counted."""
        self.lost = 0
        """Number of commands that did not arrive in time."""
        self.ended: list[tuple[int, str]] = []
        """Motions that ended since the last look: their command id and the status of ``Move``."""
        self.joint_contact: Mask = np.zeros(7, dtype=np.bool_)
        self.joint_collision: Mask = np.zeros(7, dtype=np.bool_)
        self.cartesian_contact: Mask = np.zeros(6, dtype=np.bool_)
        self.cartesian_collision: Mask = np.zeros(6, dtype=np.bool_)
        self.is_persistent = False
        """True if recovery fails."""
        self._hold_measured = False
        self._received: deque[bool] = deque(maxlen=100)
        self.torque = np.zeros(7)
        """Commanded torque without gravity (7,) [Nm]."""
        self.hold(np.zeros(7))

    @property
    def generator_mode(self) -> int:
        """Generator's number in a state."""
        return IDLE_GENERATOR if self.motion is None else self.motion.generator + 1

    @property
    def controller_mode(self) -> int:
        """Controller's number in a state."""
        return IDLE_CONTROLLER if self.motion is None else self.motion.controller

    @property
    def is_torque_controlled(self) -> bool:
        """True during a motion with a client's torques."""
        return self.motion is not None and self.motion.controller == CONTROLLER["external"]

    @property
    def success_rate(self) -> float:
        """Share of the last 100 commands that arrived in time, 0 without a motion."""
        if self.motion is None or not self._received:
            return 0.0
        return sum(self._received) / len(self._received)

    def set_stiffness(self, stiffness: Array) -> None:
        """Set the stiffness of the internal joint impedance (7,) [Nm/rad]."""
        self.stiffness, self._damping = stiffness, critical_damping(stiffness)

    def hold(self, q: Array) -> None:
        """Set the set point at rest at ``q`` (7,) [rad]."""
        self.q_d, self.dq_d, self.ddq_d = np.array(q, dtype=np.float64), np.zeros(7), np.zeros(7)
        self.torque = np.zeros(7)

    def move(self, command_id: int, controller: int, generator: int) -> str:
        """Begin a motion; return the status of its request."""
        if self.robot_mode != ROBOT_MODE["idle"]:
            return "not_possible"
        joint = generator in (GENERATOR["joint_position"], GENERATOR["joint_velocity"])
        torque_only = generator == GENERATOR["none"] and controller == CONTROLLER["external"]
        if not (joint or torque_only) or controller > CONTROLLER["external"]:
            return "invalid"
        self.motion = Motion(command_id, controller, generator)
        self.robot_mode = ROBOT_MODE["move"]
        self.reflex_reason = set()
        self.torque = np.zeros(7)
        self._received.clear()
        return "started"

    def stop(self) -> str:
        """Stop the motion; return the status of the request."""
        if self.motion is None:
            return "success" if self.robot_mode == ROBOT_MODE["idle"] else "not_possible"
        self._end("preempted", ROBOT_MODE["idle"])
        return "success"

    def recover(self) -> str:
        """Clear the errors of a reflex; return the status of the request."""
        if self.robot_mode == ROBOT_MODE["reflex"] and self.is_persistent:
            return "reflex"
        if self.robot_mode == ROBOT_MODE["reflex"]:
            self.errors = set()
            self.robot_mode = ROBOT_MODE["idle"]
            return "success"
        return "success" if self.robot_mode == ROBOT_MODE["idle"] else "not_possible"

    def press_user_stop(self) -> None:
        """Stop the arm as the user stop does."""
        if self.motion is not None:
            self._end("emergency", ROBOT_MODE["user_stopped"])
        self.robot_mode = ROBOT_MODE["user_stopped"]

    def release_user_stop(self) -> None:
        """Release the user stop; the arm is idle without errors."""
        if self.robot_mode == ROBOT_MODE["user_stopped"]:
            self.robot_mode, self.errors = ROBOT_MODE["idle"], set()

    def fault(self, error: int) -> None:
        """Stop with an error, as a reflex does."""
        self.violations[ERRORS[error]] += 1
        self.errors = {error}
        self.reflex_reason = {error}
        if self.motion is not None:
            self._end("reflex", ROBOT_MODE["reflex"])
        self.robot_mode = ROBOT_MODE["reflex"]

    def _end(self, status: str, mode: int) -> None:
        assert self.motion is not None
        self.ended.append((self.motion.command_id, status))
        self.motion, self.robot_mode = None, mode
        self._hold_measured = True

    def cycle(self, command: Any | None, measured: Measured) -> Drive:
        """Return the input of the arm for one cycle.

        Args:
            command: Command that answers the last state, None if none arrived.
            measured: Measurements of that state.
        """
        motion = self.motion
        if motion is not None:
            self._follow(motion, command, measured)
        if self._hold_measured:
            self._hold_measured = False
            self.hold(measured.q)
        torque = self.torque if self.is_torque_controlled else None
        return Drive(self.q_d, self.dq_d, self.stiffness, self._damping, torque)

    def _follow(self, motion: Motion, command: Any | None, measured: Measured) -> None:
        """Update set points and torque from a command, or without one."""
        if command is None:
            self._miss(motion)
            return
        error = None
        if not motion.started:
            error = self._start_error(motion, command)
            motion.started = True
        motion.lost = 0
        self._received.append(True)
        error = error if error is not None else self._take(motion, command)
        if error is None:
            error = measured_violation(self.limits, measured.q, measured.dq)
        if error is not None:
            self.fault(error)
            return
        finished = command["motion_generation_finished"]
        if "torque_command_finished" in command.dtype.names:
            finished |= command["torque_command_finished"]
        if finished:
            self._finish()

    def _start_error(self, motion: Motion, command: Any) -> int | None:
        if motion.generator == GENERATOR["joint_position"]:
            distance = np.abs(command["q_c"] - self.q_d)
            if not (distance <= START_TOLERANCE_RAD).all():
                return ERROR["joint_position_motion_generator_start_pose_invalid"]
        return None

    def _take(self, motion: Motion, command: Any) -> int | None:
        """Take a command; return the index of an error or None."""
        error = None
        if motion.generator == GENERATOR["joint_position"]:
            q = np.array(command["q_c"], dtype=np.float64)
            error = self._advance(q, (q - self.q_d) / STEP_S)
        elif motion.generator == GENERATOR["joint_velocity"]:
            dq = np.array(command["dq_c"], dtype=np.float64)
            error = self._advance(self.q_d + STEP_S * dq, dq)
        if error is None and motion.controller == CONTROLLER["external"]:
            torque = np.array(command["tau_J_d"], dtype=np.float64)
            error = self._enforced(torque_violation(self.limits, torque, self.torque))
            if error is None:
                self.torque = np.clip(torque, -self.limits.tau_max, self.limits.tau_max)
        return error

    def _advance(self, q: Array, dq: Array) -> int | None:
        """Move the set point; return the index of a violation or None."""
        ddq = (dq - self.dq_d) / STEP_S
        dddq = (ddq - self.ddq_d) / STEP_S
        error = self._enforced(generator_violation(self.limits, q, dq, ddq, dddq))
        if error is None:
            self.q_d, self.dq_d, self.ddq_d = q, dq, ddq
        return error

    def _enforced(self, error: int | None) -> int | None:
        """Return ``error`` if it ends a motion; count it otherwise."""
        if error is None or self.lockstep or error not in COUNTED_ONLY:
            return error
        self.violations[ERRORS[error]] += 1
        return None

    def _miss(self, motion: Motion) -> None:
        """Handle a cycle without a command: extrapolate with constant acceleration."""
        if not motion.started:
            motion.waited += 1
            if motion.waited > START_CYCLES:
                self.fault(ERROR["communication_constraints_violation"])
            return
        self.lost += 1
        motion.lost += 1
        self._received.append(False)
        low, high = self.limits.speed_bounds(self.q_d)
        dq = np.clip(self.dq_d + STEP_S * self.ddq_d, low, high)
        self.ddq_d = (dq - self.dq_d) / STEP_S
        self.dq_d, self.q_d = dq, self.q_d + STEP_S * dq
        if motion.lost >= MAX_LOST:
            self.fault(ERROR["communication_constraints_violation"])

    def _finish(self) -> None:
        """End a motion at its set point, which must be at rest."""
        motion = self.motion
        assert motion is not None
        stopping = np.abs(self.dq_d) / STEP_S
        error = None
        if not (stopping <= self.limits.ddq_max).all():
            error = self._enforced(ERROR["joint_motion_generator_velocity_discontinuity"])
        if error is not None:
            self.fault(error)
            return
        self._end("success", ROBOT_MODE["idle"])
        if motion.controller != CONTROLLER["external"]:
            self._hold_measured = False
            self.dq_d, self.ddq_d = np.zeros(7), np.zeros(7)

    def check_contact(self, measured: Measured) -> None:
        """Compare the external torque and wrench with the thresholds; stop above the upper ones."""
        t = self.thresholds
        torque, force = np.abs(measured.external_torque), np.abs(measured.external_wrench)
        if np.abs(self.ddq_d).max() > MOVING_RAD_S2:
            lower, upper = t.lower_torque_acceleration, t.upper_torque_acceleration
            lower_force, upper_force = t.lower_force_acceleration, t.upper_force_acceleration
        else:
            lower, upper = t.lower_torque_nominal, t.upper_torque_nominal
            lower_force, upper_force = t.lower_force_nominal, t.upper_force_nominal
        self.joint_contact, self.joint_collision = torque > lower, torque > upper
        self.cartesian_contact, self.cartesian_collision = force > lower_force, force > upper_force
        if self.motion is None:
            return
        if self.joint_collision.any():
            self.fault(ERROR["joint_reflex"])
        elif self.cartesian_collision.any():
            self.fault(ERROR["cartesian_reflex"])
