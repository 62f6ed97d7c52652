"""Guard of the set points: speed, acceleration, jerk and joint box, whatever the targets are.

The state of a joint is (position, speed, acceleration) on a trajectory of bounded jerk. Every
millisecond a joint takes one of three steps:

1. the step of the set-point filter of training, if it keeps to the limits;
2. otherwise a step with that filter's jerk, clipped for the limits;
3. if the joint could not stop from there within its box, a braking step of Ruckig.

A state is accepted only if the arm can stop from it within the box and the speed limit. A braking
step follows the trajectory of an earlier stop, so the property holds at all times, for every
sequence of targets. The samples lie on a continuous trajectory, so their backward differences,
which the robot's controller checks, are within the same limits.

Waypoints of Ruckig would be sent to a web service and its position limits have no effect in the
free version: neither is used.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from articulate.errors import ConfigError
from articulate.robot.arm import Arm
from articulate.robot.control import discretize_filter, filter_start
from articulate.transforms import Array, Mask
from articulate_deploy.arms.ruckig_library import ruckig

MAX_FRACTION = 0.5
"""Largest share of the arm's speed, acceleration and jerk that set points may use."""
SET_POINT_S = 0.001
"""Time between set points [s]."""
SLACK = 1e-9
"""Relative slack of comparisons with limits."""


@dataclass(frozen=True)
class GuardLimits:
    """Limits of set points, arrays (7,)."""

    low: Array
    """Smallest angles [rad]."""
    high: Array
    """Largest angles [rad]."""
    speed: Array
    """Largest speeds [rad/s]."""
    acceleration: Array
    """Largest accelerations [rad/s^2]."""
    jerk: Array
    """Largest jerks [rad/s^3]."""


def guard_limits(
    arm: Arm, *, fraction: float = MAX_FRACTION, margin_rad: float = 0.0
) -> GuardLimits:
    """Return the limits of set points for ``arm``.

    Args:
        arm: Limit tables.
        fraction: Share of speed, acceleration and jerk, in (0, 0.5].
        margin_rad: Distance from the joint limits [rad].

    Raises:
        ConfigError: The fraction is outside its range.
    """
    if not 0.0 < fraction <= MAX_FRACTION:
        raise ConfigError(f"fraction is {fraction}; it must be in (0, {MAX_FRACTION}]")
    low, high = arm.bounds(margin_rad)
    tables = (fraction * np.asarray(table) for table in (arm.dq_max, arm.ddq_max, arm.dddq_max))
    return GuardLimits(low, high, *tables)


def is_stoppable(state: Array, limits: GuardLimits) -> Mask:
    """Return for states (..., 7, 3) where a stop stays within speed limit and box (..., 7).

    The acceleration is brought to 0, then the speed. The distance is bounded from above by
    ``v |a| / J + v^2 / (2 A) + v A / (2 J)`` with ``v = |speed| + a^2 / (2 J)``: a stop with full
    jerk takes ``v / A + A / J`` at half the speed, or less where A is not reached.
    """
    x, speed, acceleration = state[..., 0], np.abs(state[..., 1]), np.abs(state[..., 2])
    A, J = limits.acceleration, limits.jerk
    peak = speed + acceleration * acceleration / (2.0 * J)
    distance = peak * (acceleration / J + peak / (2.0 * A) + A / (2.0 * J))
    most = 1.0 + SLACK
    return np.asarray(
        (peak <= limits.speed * most)
        & (acceleration <= A * most)
        & (x + distance <= limits.high)
        & (x - distance >= limits.low)
    )


class SetPoints:
    """Set points of one motion, or of several at once: the filter of training behind the guard."""

    def __init__(self, q: Array, omega_rad_s: float, limits: GuardLimits) -> None:
        """Begin at rest at ``q``.

        Args:
            q: Angles at rest (..., 7) [rad].
            omega_rad_s: Bandwidth of the set-point filter [rad/s].
            limits: Limits of set points.

        Raises:
            ConfigError: ``q`` is outside the joint box.
        """
        q = np.asarray(q, dtype=np.float64)
        outside = ((q < limits.low) | (q > limits.high)).reshape(-1, 7).any(axis=0)
        if outside.any():
            worst = int(np.argmax(outside))
            raise ConfigError(
                f"joint_{worst + 1} is at {np.ravel(q)[worst]:.3f} rad; set points must be in "
                f"[{limits.low[worst]:.3f}, {limits.high[worst]:.3f}] rad: move the arm by hand"
            )
        self.limits = limits
        self.state: Array = filter_start(q)
        """Position, speed and acceleration of each joint (..., 7, 3)."""
        self.limited = 0
        """Number of joint steps that differ from those of the set-point filter."""
        self.braked = 0
        """Number of joint steps that were braking steps."""
        self._target = q.copy()
        self._A, self._B = discretize_filter(omega_rad_s, SET_POINT_S)
        self._feedback = omega_rad_s ** np.array([3.0, 2.0, 1.0]) * np.array([1.0, 3.0, 3.0])
        self._otg = ruckig.Ruckig(7, SET_POINT_S)
        self._out, self._brake = ruckig.OutputParameter(7), _braking_input(limits)

    @property
    def target(self) -> Array:
        """Targets (..., 7) [rad]."""
        return self._target

    def set_target(self, target: Array) -> None:
        """Take targets (..., 7) [rad]; a joint whose target is not a number keeps its last one."""
        finite = np.where(np.isfinite(target), target, self._target)
        self._target = np.clip(finite, self.limits.low, self.limits.high)

    def step(self) -> Array:
        """Advance by 1 ms towards the targets; return the set points (..., 7) [rad]."""
        candidate = self.state @ self._A.T + self._target[..., None] * self._B
        good = self._is_within_jerk(candidate) & is_stoppable(candidate, self.limits)
        if not good.all():
            self.limited += int(good.size - np.count_nonzero(good))
            candidate = np.where(good[..., None], candidate, self._limited_step())
            good = is_stoppable(candidate, self.limits)
            if not good.all():
                self.braked += int(good.size - np.count_nonzero(good))
                candidate = np.where(good[..., None], candidate, self._braking_step(~good))
        self.state = candidate
        return np.asarray(candidate[..., 0])

    def stop_step(self) -> Array:
        """Brake for 1 ms; return the set points (..., 7) [rad]."""
        self.state = self._braking_step(np.ones(self._target.shape, dtype=bool))
        self._target = np.clip(self.state[..., 0], self.limits.low, self.limits.high)
        return np.asarray(self.state[..., 0])

    @property
    def at_rest(self) -> bool:
        """True if speed and acceleration are 0."""
        return bool(np.all(np.abs(self.state[..., 1:]) < 1e-6))

    def _jerk(self, state: Array) -> Array:
        """Return the jerk of the set-point filter at ``state`` (..., 7) [rad/s^3]."""
        k0, k1, k2 = self._feedback
        error = self._target - state[..., 0]
        return np.asarray(k0 * error - k1 * state[..., 1] - k2 * state[..., 2])

    def _is_within_jerk(self, candidate: Array) -> Mask:
        """Return whether the filter's jerk is within the limit at both ends of the step."""
        most = self.limits.jerk
        first, last = np.abs(self._jerk(self.state)), np.abs(self._jerk(candidate))
        return np.asarray((first <= most) & (last <= most))

    def _limited_step(self) -> Array:
        """Return the state after 1 ms with the filter's jerk, clipped for the limits.

        The acceleration is clipped to one that can vanish before the speed limit is reached.
        """
        limits, dt = self.limits, SET_POINT_S
        x, v, a = self.state[..., 0], self.state[..., 1], self.state[..., 2]
        jerk = np.clip(self._jerk(self.state), -limits.jerk, limits.jerk)
        room = limits.acceleration * dt
        up = np.sqrt(2.0 * limits.jerk * np.maximum(limits.speed - v - room, 0.0))
        down = np.sqrt(2.0 * limits.jerk * np.maximum(limits.speed + v - room, 0.0))
        after = np.clip(
            a + jerk * dt,
            -np.minimum(limits.acceleration, down),
            np.minimum(limits.acceleration, up),
        )
        jerk = np.clip((after - a) / dt, -limits.jerk, limits.jerk)
        return np.stack(
            [
                x + dt * (v + dt * (a / 2.0 + jerk * dt / 6.0)),
                v + dt * (a + jerk * dt / 2.0),
                a + jerk * dt,
            ],
            axis=-1,
        )

    def _braking_step(self, which: Mask) -> Array:
        """Return the states after 1 ms of braking for the joints ``which`` (..., 7)."""
        out = self.state.copy()
        rows, chosen = out.reshape(-1, 7, 3), which.reshape(-1, 7)
        for i in np.flatnonzero(chosen.any(axis=1)):
            request = self._brake
            request.current_position = rows[i, :, 0].tolist()
            request.current_velocity = rows[i, :, 1].tolist()
            request.current_acceleration = rows[i, :, 2].tolist()
            self._otg.reset()
            result = self._otg.update(request, self._out)
            assert result >= 0, "a state of the guard can always brake"
            done = self._out
            after = np.array([done.new_position, done.new_velocity, done.new_acceleration]).T
            rows[i, chosen[i]] = after[chosen[i]]
        return out


def _braking_input(limits: GuardLimits) -> Any:
    request = ruckig.InputParameter(7)
    request.control_interface = ruckig.ControlInterface.Velocity
    request.synchronization = ruckig.Synchronization.No
    request.target_velocity = request.target_acceleration = [0.0] * 7
    request.max_velocity = limits.speed.tolist()
    request.max_acceleration = limits.acceleration.tolist()
    request.max_jerk = limits.jerk.tolist()
    return request
