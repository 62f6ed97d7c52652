"""Limits that the simulated robot enforces on commands, as the arm itself does.

Sources: Franka Control Interface documentation, "Robot limits" (Panda, and FR3 with system 5.9 or
newer), and libfranka ``rate_limiting.h`` for the speed of the FR3, which depends on the position.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from articulate.robot.arm import PANDA, Arm
from articulate.transforms import Array
from articulate_deploy.wire.messages import ERROR

STEP_S = 1e-3
"""Control cycle of the arm [s]."""
START_TOLERANCE_RAD = 0.1
"""Largest distance of a first position command from the reported set point [rad]. The arm's
tolerance is not published; ``franka-sim`` uses this one."""
SPEED_MARGIN_RAD_S = 0.1
"""Margin of the measured speed above its limit [rad/s], as in ``franka-sim``."""
MAX_LOST = 20
"""Commands lost in a row that end a motion."""
RELATIVE = 1e-6
"""Rounding of a limit, relative to it."""


@dataclass(frozen=True, eq=False)
class SpeedEnvelope:
    """Speed limits of the FR3 near its position limits.

    The upper limit is ``sqrt(2 deceleration (q_high - q)) - offset``, between 0 and ``dq_max``.
    """

    offset: Array
    """Offset of the speed (7,) [rad/s]."""
    deceleration: Array
    """Deceleration limit (7,) [rad/s^2]."""
    q_low: Array
    """Position at which the lower limit is 0, without the offset (7,) [rad]."""
    q_high: Array
    """Position at which the upper limit is 0, without the offset (7,) [rad]."""


@dataclass(frozen=True, eq=False)
class MotionLimits:
    """Limits of an arm's joints."""

    q_min: Array
    """Lower position limits (7,) [rad]."""
    q_max: Array
    """Upper position limits (7,) [rad]."""
    dq_max: Array
    """Speed limits (7,) [rad/s]."""
    ddq_max: Array
    """Acceleration limits (7,) [rad/s^2]."""
    dddq_max: Array
    """Jerk limits (7,) [rad/s^3]."""
    tau_max: Array
    """Torque limits (7,) [Nm]."""
    dtau_max: float
    """Limit of the torque's rate [Nm/s]."""
    envelope: SpeedEnvelope | None = None
    """Speed limits that depend on the position."""

    def speed_bounds(self, q: Array) -> tuple[Array, Array]:
        """Return the lowest and the highest speed (7,), (7,) [rad/s] at ``q`` (7,) [rad]."""
        e = self.envelope
        if e is None:
            return -self.dq_max, self.dq_max
        room = np.maximum(0.0, 2.0 * e.deceleration * (e.q_high - q))
        high = np.clip(np.sqrt(room) - e.offset, 0.0, self.dq_max)
        room = np.maximum(0.0, 2.0 * e.deceleration * (q - e.q_low))
        low = np.clip(e.offset - np.sqrt(room), -self.dq_max, 0.0)
        return low, high


def _of_arm(arm: Arm) -> MotionLimits:
    return MotionLimits(
        q_min=np.array(arm.q_min),
        q_max=np.array(arm.q_max),
        dq_max=np.array(arm.dq_max),
        ddq_max=np.array(arm.ddq_max),
        dddq_max=np.array(arm.dddq_max),
        tau_max=np.array(arm.tau_max),
        dtau_max=arm.dtau_max,
    )


PANDA_LIMITS = _of_arm(PANDA)
"""Panda."""
FR3_LIMITS = MotionLimits(
    q_min=np.array([-2.9007, -1.8361, -2.9007, -3.0770, -2.8763, 0.4398, -3.0508]),
    q_max=np.array([2.9007, 1.8361, 2.9007, -0.1169, 2.8763, 4.6216, 3.0508]),
    dq_max=np.array([2.62, 2.62, 2.62, 2.62, 5.26, 4.18, 5.26]),
    ddq_max=np.full(7, 10.0),
    dddq_max=np.full(7, 5000.0),
    tau_max=np.array(PANDA.tau_max),
    dtau_max=PANDA.dtau_max,
    envelope=SpeedEnvelope(
        offset=np.array([0.30, 0.20, 0.20, 0.30, 0.35, 0.35, 0.35]),
        deceleration=np.array([6.0, 2.585, 3.5, 4.0, 17.0, 5.5, 17.0]),
        q_low=np.array([-2.7501, -1.7918, -2.9065, -3.0481, -2.8101, 0.54092, -3.0196]),
        q_high=np.array([2.7501, 1.7918, 2.9065, -0.1458, 2.8101, 4.5205, 3.0196]),
    ),
)
"""FR3 with system 5.9 or newer."""
LIMITS = {5: PANDA_LIMITS, 10: FR3_LIMITS}
"""Limits by the version of the protocol."""


def generator_violation(
    limits: MotionLimits, q: Array, dq: Array, ddq: Array, dddq: Array
) -> int | None:
    """Return the index of the first limit that a motion generator's output exceeds, or None.

    A number that is not finite exceeds its limit.

    Args:
        limits: Limits of the arm.
        q: Set point (7,) [rad].
        dq: Its speed, by backward differences over 1 ms as all derivatives (7,) [rad/s].
        ddq: Its acceleration (7,) [rad/s^2].
        dddq: Its jerk (7,) [rad/s^3].
    """
    if not ((limits.q_min <= q) & (q <= limits.q_max)).all():
        return ERROR["joint_motion_generator_position_limits_violation"]
    low, high = limits.speed_bounds(q)
    slack = RELATIVE * limits.dq_max
    if not ((low - slack <= dq) & (dq <= high + slack)).all():
        return ERROR["joint_motion_generator_velocity_limits_violation"]
    if not (np.abs(ddq) <= limits.ddq_max * (1.0 + RELATIVE)).all():
        return ERROR["joint_motion_generator_velocity_discontinuity"]
    if not (np.abs(dddq) <= limits.dddq_max * (1.0 + RELATIVE)).all():
        return ERROR["joint_motion_generator_acceleration_discontinuity"]
    return None


def torque_violation(limits: MotionLimits, torque: Array, last: Array) -> int | None:
    """Return the index of the limit that a commanded torque exceeds, or None.

    Args:
        limits: Limits of the arm.
        torque: Commanded torque, without gravity (7,) [Nm].
        last: The command of the cycle before (7,) [Nm].
    """
    rate = np.abs(torque - last) / STEP_S
    if not (rate <= limits.dtau_max * (1.0 + RELATIVE)).all():
        return ERROR["controller_torque_discontinuity"]
    if not (np.abs(torque) <= limits.tau_max * (1.0 + RELATIVE)).all():
        return ERROR["tau_J_range_violation"]
    return None


def measured_violation(limits: MotionLimits, q: Array, dq: Array) -> int | None:
    """Return the index of the limit that the measured joints exceed, or None."""
    if not (np.abs(dq) <= limits.dq_max + SPEED_MARGIN_RAD_S).all():
        return ERROR["joint_velocity_violation"]
    if not ((limits.q_min <= q) & (q <= limits.q_max)).all():
        return ERROR["joint_position_limits_violation"]
    return None
