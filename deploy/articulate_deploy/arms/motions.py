"""Motions of the sender: a slow ramp to a pose, and an episode of a policy."""

from __future__ import annotations

import time
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np

from articulate.robot.arm import Arm
from articulate.robot.kinematics import tool_pose
from articulate.task.episode_monitor import filter_gain
from articulate.transforms import Array
from articulate_deploy.arms.client import ArmState
from articulate_deploy.arms.connection import LOCKSTEP_S
from articulate_deploy.arms.errors import CommunicationLostError, WatchdogError
from articulate_deploy.arms.guard import SET_POINT_S, GuardLimits, SetPoints
from articulate_deploy.arms.ruckig_library import ruckig

MAX_GAP_MS = 20
"""Consecutive milliseconds without a state after which the controller ends a motion itself."""
SETTLE_S = 6.0
"""Longest time at the end of a ramp in which the arm comes to rest [s]: the trained impedance is
soft, and its wrist needs some seconds."""
SETTLED_RAD = 4e-3
"""Distance from the goal at which a ramp ends [rad]."""


class Link(Protocol):
    """End of a pipe."""

    def send(self, message: Any) -> None:
        """Send a message."""

    def poll(self, timeout: float = 0.0) -> bool:
        """Return whether a message is there, after at most ``timeout`` [s]."""

    def recv(self) -> Any:
        """Return the next message."""


@dataclass(frozen=True)
class EpisodeSettings:
    """Settings of the sender during an episode."""

    limits: GuardLimits
    omega_rad_s: float
    """Bandwidth of the set-point filter [rad/s]."""
    step_s: float
    """Length of a control step [s]."""
    sample_ms: int
    """Time between the samples of the episode monitor [ms]."""
    leash_rad: float
    """Largest distance between target and joint [rad]."""
    force_stop_n: float
    """Filtered force at which the sender stops the arm [N]."""
    filter_s: float
    """Time constant of that filter [s]."""
    policy_timeout_s: float
    """Longest time without targets [s]."""
    lockstep: bool
    """True if the controller waits for every command: the sender then waits for every target."""


@dataclass
class SenderStatistics:
    """Timing of the sender, in wall-clock time and in the controller's."""

    wall_s: list[float] = field(default_factory=list)
    """Times of the callbacks [s]."""
    steps: int = 0
    """Milliseconds of the controller's clock."""
    gaps: int = 0
    """States that were missing."""

    def as_dict(self) -> dict[str, float]:
        """Return percentiles of the period and of the counts."""
        period = np.diff(self.wall_s) if len(self.wall_s) > 1 else np.zeros(1)
        p50, p99 = np.percentile(period, [50, 99]) * 1e3
        return {
            "period_p50_ms": float(p50),
            "period_p99_ms": float(p99),
            "period_max_ms": float(period.max() * 1e3),
            "set_points": float(self.steps),
            "missing_states": float(self.gaps),
        }


class RampMotion:
    """Slow motion to a pose on one trajectory of Ruckig; all joints arrive together."""

    def __init__(
        self, link: Link, q: Array, goal: Array, arm: Arm, limits: GuardLimits, tool_m_s: float
    ) -> None:
        """Plan from rest at ``q`` (7,) to ``goal`` (7,) [rad].

        Args:
            link: Pipe on which the parent may request a stop.
            q: Present angles (7,) [rad].
            goal: Angles at the end (7,) [rad].
            arm: Kinematics.
            limits: Limits of set points.
            tool_m_s: Largest speed of the tool [m/s].
        """
        request = ruckig.InputParameter(7)
        request.current_position, request.target_position = q.tolist(), goal.tolist()
        request.max_velocity = limits.speed.tolist()
        request.max_acceleration = limits.acceleration.tolist()
        request.max_jerk = limits.jerk.tolist()
        self._otg, self._trajectory = ruckig.Ruckig(7), ruckig.Trajectory(7)
        self._otg.calculate(request, self._trajectory)
        for _ in range(20):
            fastest = self._tool_speed(arm)
            if fastest <= tool_m_s or self._trajectory.duration == 0.0:
                break
            request.minimum_duration = self._trajectory.duration * max(1.05, fastest / tool_m_s)
            self._otg.calculate(request, self._trajectory)
        self._link, self._goal, self._limits = link, goal, limits
        self._first_s: float | None = None
        self._braking: SetPoints | None = None
        self._last_s = 0.0
        self.statistics = SenderStatistics()

    @property
    def duration_s(self) -> float:
        """Longest time of the ramp [s]."""
        return float(self._trajectory.duration) + SETTLE_S

    def _tool_speed(self, arm: Arm) -> float:
        """Return the largest speed of the tool [m/s]."""
        times = np.linspace(0.0, self._trajectory.duration, 200)
        q = np.array([self._trajectory.at_time(float(t))[0] for t in times])
        pos_w = tool_pose(arm, q)[:, :3, 3]
        dt = max(times[1] - times[0], 1e-9)
        return float(np.linalg.norm(np.diff(pos_w, axis=0), axis=1).max() / dt)

    def set_point(self, state: ArmState) -> tuple[Array, bool]:
        """Return set points (7,) [rad], and True at the end."""
        if self._first_s is None:
            self._first_s = self._last_s = state.time_s
        t = state.time_s - self._first_s
        if self._braking is None and self._link.poll():
            with suppress(EOFError, OSError):  # the parent ended
                self._link.recv()
            self._braking = self._stop_from(t)
        if self._braking is not None:
            for _ in range(max(round((state.time_s - self._last_s) / SET_POINT_S), 1)):
                q = self._braking.stop_step()
            self._last_s = state.time_s
            return q, self._braking.at_rest
        self._last_s = state.time_s
        position = self._trajectory.at_time(min(t, self._trajectory.duration))[0]
        settled = bool(np.all(np.abs(self._goal - state.q) < SETTLED_RAD))
        return np.asarray(position), t >= self._trajectory.duration and (
            settled or t >= self.duration_s
        )

    def _stop_from(self, t: float) -> SetPoints:
        q, dq, ddq = self._trajectory.at_time(min(t, self._trajectory.duration))
        points = SetPoints(np.clip(q, self._limits.low, self._limits.high), 10.0, self._limits)
        points.state = np.array([q, dq, ddq]).T
        return points


class EpisodeMotion:
    """Set points of an episode: targets from the parent, filter, guard, watchdogs.

    At every control step it sends ``("state", ...)`` to the parent. The parent sends
    ``("target", q)`` or ``("stop",)``. The first control step begins with the first targets.
    """

    def __init__(self, settings: EpisodeSettings, link: Link) -> None:
        """Begin at the first state."""
        self._settings, self._link = settings, link
        self._points: SetPoints | None = None
        self._target = np.zeros(7)
        self._time_s = self._next_s = self._fed_s = 0.0
        self._running = self._stopping = False
        self._force = np.zeros(6)
        self._samples: list[Array] = []
        self._pending: list[tuple[Array, Array, Array]] = []
        self.error: Exception | None = None
        """Reason for which the sender stopped the arm."""
        self.statistics = SenderStatistics()

    def set_point(self, state: ArmState) -> tuple[Array, bool]:
        """Return set points (7,) [rad], and True when the arm is at rest after a stop."""
        self.statistics.wall_s.append(time.perf_counter())
        if self._points is None:
            self._begin(state)
        elapsed = self._advance_clock(state)
        assert self._points is not None
        self._observe(state)
        if not self._stopping:
            try:
                self._exchange(state)
            except (EOFError, OSError):  # the parent ended
                self.stop(None)
        points, leash = self._points, self._settings.leash_rad
        if not self._stopping:
            points.set_target(np.clip(self._target, state.q - leash, state.q + leash))
        for _ in range(elapsed):
            q = points.stop_step() if self._stopping else points.step()
        if elapsed == 0:
            q = points.state[:, 0]
        return np.asarray(q), self._stopping and points.at_rest

    def stop(self, error: Exception | None) -> None:
        """Brake from now on."""
        self._stopping = True
        self.error = self.error or error

    def _begin(self, state: ArmState) -> None:
        limits = self._settings.limits
        q = np.clip(state.q, limits.low, limits.high)
        self._points = SetPoints(q, self._settings.omega_rad_s, limits)
        self._target = q
        self._time_s = self._next_s = state.time_s

    def _advance_clock(self, state: ArmState) -> int:
        """Return the milliseconds since the last state."""
        elapsed = round((state.time_s - self._time_s) / SET_POINT_S)
        self._time_s = state.time_s
        self.statistics.steps += elapsed
        if elapsed > 1:
            self.statistics.gaps += elapsed - 1
        if elapsed > MAX_GAP_MS:
            self.stop(CommunicationLostError(f"no state of the controller for {elapsed} ms"))
        return min(elapsed, MAX_GAP_MS)

    def _observe(self, state: ArmState) -> None:
        """Filter the force, keep samples, and stop above the force limit."""
        settings = self._settings
        self._pending.append((state.dq, state.torque, state.wrench))
        gain = filter_gain(SET_POINT_S, settings.filter_s)
        self._force = self._force + gain * (state.wrench - self._force)
        if len(self._pending) >= settings.sample_ms:
            dq, torque, _ = self._pending[-1]
            wrench = np.mean([sample[2] for sample in self._pending], axis=0)
            self._samples.append(np.concatenate([dq, torque, wrench]))
            self._pending = []
        force = float(np.linalg.norm(self._force[:3]))
        if not force <= settings.force_stop_n and not self._stopping:
            self.stop(
                WatchdogError(
                    f"force: {force:.0f} N on the gripper is above the limit of "
                    f"{settings.force_stop_n:.0f} N"
                )
            )

    def _exchange(self, state: ArmState) -> None:
        """Send the state at the beginning of a control step, and take new targets."""
        settings, link = self._settings, self._link
        due = state.time_s >= self._next_s - 1e-6
        if due and (self._running or self.statistics.steps == 0):
            assert self._points is not None
            link.send((
                "state", state, self._force.copy(), np.array(self._samples).reshape(-1, 20),
                self._points.state[:, 0].copy(), self._points.limited,
            ))  # fmt: skip
            self._samples = []
            self._next_s += settings.step_s
            if settings.lockstep and not link.poll(LOCKSTEP_S):
                self.stop(WatchdogError(f"policy: no targets for {LOCKSTEP_S:g} s"))
        while not self._stopping and link.poll():
            self._receive(link.recv(), state)
        late_s = state.time_s - self._fed_s
        if self._running and not self._stopping and late_s > settings.policy_timeout_s:
            self.stop(WatchdogError(
                f"policy: no targets for {late_s * 1e3:.0f} ms; "
                f"{settings.policy_timeout_s * 1e3:.0f} ms are allowed"
            ))  # fmt: skip

    def _receive(self, message: tuple[Any, ...], state: ArmState) -> None:
        if message[0] == "target":
            self._target = np.asarray(message[1], dtype=np.float64)
            self._fed_s = state.time_s
            if not self._running:
                self._running = True
                self._next_s = state.time_s + self._settings.step_s
        else:
            self.stop(None)
