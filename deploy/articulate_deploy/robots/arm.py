"""Real arm behind the protocol of robots; see :mod:`articulate_deploy.arms`.

The set-point filter, the guard and the watchdogs run with the client in a child process, at 1 kHz.
Here is the end of the pipe that the episode loop uses: one exchange for each control step.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from articulate.task.manifest import Manifest
from articulate.transforms import Array
from articulate_deploy.arms.client import ArmSettings, ArmState, ClientSpec
from articulate_deploy.arms.clients import check_installed
from articulate_deploy.arms.connection import (
    LOCKSTEP_S,
    REQUEST_S,
    START_S,
    ClientProcess,
)
from articulate_deploy.arms.errors import CommandRejectedError, WatchdogError
from articulate_deploy.arms.gripper import CLOSE, OPEN, GripperProcess
from articulate_deploy.arms.guard import MAX_FRACTION, guard_limits
from articulate_deploy.arms.motions import EpisodeSettings
from articulate_deploy.robots.robot import (
    FORCE_KEYS,
    GRIPPER_KEY,
    JOINT_KEYS,
    SPEED_KEYS,
    ForceStopError,
    NotConnectedError,
    Robot,
    Sample,
    action_dict,
    read_keys,
)

RAMP_FRACTION = 0.1
"""Share of the limit table that a ramp to a start uses."""
RAMP_TOOL_M_S = 0.15
"""Largest speed of the tool in a ramp [m/s]."""
AT_START_RAD = 5e-3
"""Distance from the start that needs no ramp [rad]."""
BOX_MARGIN_RAD = 0.01
"""Distance of set points from the joint limits [rad]."""
LATE_STEPS = 3
"""Control steps without targets after which the sender stops."""
GRIPPER_S = 10.0
"""Longest time of a command to the gripper [s]."""
RAMP_S = 120.0
"""Longest time of a ramp [s]."""
STOP_S = 30.0
"""Longest time of a stop [s]; franka-rs waits until the arm has settled."""


@dataclass(frozen=True, kw_only=True)
class ArmOptions:
    """Options of a real arm."""

    lockstep: bool = False
    """True for a simulated robot that waits for every command."""
    recover: bool = False
    """Clear a reflex when connecting; a user stop is never cleared."""
    homing: bool = False
    """Home the gripper when connecting; its fingers move."""
    ramp: bool = True
    """Ramp to the start; False rejects an arm that is not there."""
    start_s: float = START_S
    """Longest time until the client is connected [s]."""


class ArmRobot(Robot):
    """Arm and gripper of a real controller; see :class:`articulate_deploy.robots.robot.Robot`."""

    def __init__(
        self,
        manifest: Manifest,
        spec: ClientSpec,
        options: ArmOptions | None = None,
        *,
        name: str = "panda",
        confirm: Callable[[str], None] = lambda _: None,
    ) -> None:
        """Check that the client is installed; :meth:`connect` connects.

        Args:
            manifest: Manifest of the bundle, with the clock of the policy.
            spec: Client and address.
            options: Options.
            name: Name of the robot.
            confirm: Called with a sentence before each kind of motion; it raises to reject it.

        Raises:
            ConfigError: The client is unknown.
            MissingError: The client is not installed.
        """
        check_installed(spec.client)
        self.name = name
        self.notes: tuple[str, ...] = ()
        self.has_moved = False
        """True once a motion was requested."""
        self.sample_source: Callable[[], list[Sample]] | None = None
        """Source of samples of a simulated robot; a real arm has its own measurements only."""
        self.statistics: list[dict[str, Any]] = []
        """Timing of the sender, one row for each motion of an episode."""
        self._manifest, self._spec, self._options = manifest, spec, options or ArmOptions()
        self._confirm = confirm
        self._arm: ClientProcess | None = None
        self._gripper: GripperProcess | None = None
        self._in_episode = False
        self._state: ArmState | None = None
        self._force, self._samples = np.zeros(3), np.zeros((0, 20))
        self._command = OPEN

    @property
    def is_connected(self) -> bool:
        """True while the client is connected."""
        return self._arm is not None

    @property
    def is_calibrated(self) -> bool:
        """True; the arm keeps its own calibration."""
        return True

    def connect(self, calibrate: bool = True) -> None:
        """Connect arm and gripper, and write the settings of the bundle.

        Raises:
            ArmError: A controller does not answer, or the arm cannot move.
        """
        options = self._options
        self._arm = ClientProcess(self._spec, start_s=options.start_s)
        try:
            state: ArmState = self._arm.request("state")
            if state.mode == "reflex" and options.recover:
                state = self._arm.request("recover")
            self._arm.request("check")
            self._state = state
            self.configure()
            self._gripper = GripperProcess(
                self._spec, self._manifest.robot.gripper, start_s=options.start_s
            )
            if options.homing:
                self._confirm("The gripper homes: its fingers open and close completely.")
                self.has_moved = True
                self._gripper.homing()
        except BaseException:
            self.disconnect()
            raise

    def calibrate(self) -> None:
        """Do nothing: the arm keeps its own calibration."""

    def configure(self) -> None:
        """Write collision thresholds and gains of the bundle; keep what is read back."""
        arm = self._connected()
        info = arm.info
        lines = arm.request("configure", arm_settings(self._manifest))
        protocol = f", protocol {info.protocol}" if info.protocol else ""
        self.notes = (f"client {info.client}{protocol}", *lines)

    def disconnect(self) -> None:
        """Stop a motion and close the connection."""
        try:
            if self._in_episode:
                self.stop()
        finally:
            self._in_episode = False
            for process in (self._arm, self._gripper):
                if process is not None:
                    process.close()
            self._arm = self._gripper = None

    def reset_to(self, q: Array, gripper_width_m: float) -> None:
        """Open the gripper, ramp slowly to ``q`` (7,) [rad] and begin an episode at rest.

        Raises:
            ArmError: The arm cannot move, or is not at the start and ramps are off.
        """
        arm, gripper = self._connected(), self._gripper
        if self._in_episode:
            self.stop()
        self._state = arm.request("state")
        offset = float(np.abs(q - self._state.q).max())
        if offset > AT_START_RAD:
            if not self._options.ramp:
                raise CommandRejectedError(
                    f"{self._spec.address}: a joint is {offset:.3f} rad from its start; move the "
                    "arm there, or allow the ramp"
                )
            self._ramp(q, offset)
        assert gripper is not None
        wide = self._manifest.robot.gripper.max_width_m
        closed = self._command != OPEN or gripper.update() < wide - 5e-3
        if gripper_width_m > wide / 2.0 and closed:
            self._confirm("The gripper opens.")
            self.has_moved = True
            gripper.request(OPEN)
            gripper.finish(self._longest(GRIPPER_S))
        self._command = OPEN
        self._begin_episode()

    def _ramp(self, q: Array, offset: float) -> None:
        """Move to ``q`` (7,) [rad], by ``offset`` [rad] at most."""
        arm = self._connected()
        limits = guard_limits(
            self._manifest.robot, fraction=RAMP_FRACTION, margin_rad=BOX_MARGIN_RAD
        )
        self._confirm(f"The arm moves to its start pose, by up to {math.degrees(offset):.0f} deg.")
        self.has_moved = True
        request = ("ramp", np.asarray(q), self._manifest.robot, limits, RAMP_TOOL_M_S)
        arm.request(*request, seconds=self._longest(RAMP_S))

    def _begin_episode(self) -> None:
        manifest, arm = self._manifest, self._connected()
        control, limits = manifest.control, manifest.task.limits
        self._confirm("The policy moves the arm.")
        self.has_moved = True
        settings = EpisodeSettings(
            limits=guard_limits(manifest.robot, fraction=MAX_FRACTION, margin_rad=BOX_MARGIN_RAD),
            omega_rad_s=control.omega_rad_s,
            step_s=control.step_s,
            sample_ms=max(round(manifest.scene.timestep_s * 1e3), 1),
            leash_rad=control.max_tracking_error_rad,
            force_stop_n=limits.force_n,
            filter_s=limits.filter_s,
            policy_timeout_s=LATE_STEPS * control.step_s,
            lockstep=self._options.lockstep,
        )
        arm.send(("episode", settings))
        self._in_episode = True
        self._receive_state()
        self._samples = np.zeros((0, 20))

    def _receive_state(self) -> None:
        """Take the state at the beginning of the next control step.

        Raises:
            ForceStopError: The sender stopped because of the force.
            ArmError: The arm or a watchdog stopped the motion.
        """
        arm = self._connected()
        try:
            reply = arm.receive(self._longest(REQUEST_S))
        except WatchdogError as error:
            self._in_episode = False
            if "force:" in str(error):
                raise ForceStopError(str(error)) from None
            raise
        except BaseException:
            self._in_episode = False
            raise
        if reply[0] != "state":
            self._in_episode = False
            raise NotConnectedError("the motion ended")
        _, self._state, force, samples, self._set_point, self._limited = reply
        self._force = force[:3]
        self._samples = np.concatenate([self._samples, samples])

    def stop(self) -> None:
        """Brake and end the motion; actions are rejected until :meth:`reset_to`."""
        if not self._in_episode or self._arm is None:
            return
        self._in_episode = False
        self._arm.send(("stop",))
        self.statistics.append(self._arm.result(self._longest(STOP_S)))

    def get_observation(self) -> dict[str, float]:
        """Return joint angles [rad], joint speeds [rad/s], gripper opening [m], force [N]."""
        self._connected()
        assert self._state is not None
        assert self._gripper is not None
        return {
            **dict(zip(JOINT_KEYS, self._state.q.tolist(), strict=True)),
            **dict(zip(SPEED_KEYS, self._state.dq.tolist(), strict=True)),
            GRIPPER_KEY: self._gripper.update(),
            **dict(zip(FORCE_KEYS, self._force.tolist(), strict=True)),
        }

    def send_action(self, action: dict[str, float]) -> dict[str, float]:
        """Send targets [rad] and an opening [m], and return after one control step.

        Raises:
            NotConnectedError: The robot is not connected, or was stopped.
            ForceStopError: The force on the gripper was above its limit.
            ArmError: The arm or a watchdog stopped the motion.
        """
        arm, gripper = self._connected(), self._gripper
        assert gripper is not None
        if not self._in_episode:
            raise NotConnectedError("the robot was stopped; call reset_to first")
        wide = self._manifest.robot.gripper.max_width_m
        command = CLOSE if action[GRIPPER_KEY] < wide / 2.0 else OPEN
        if command != self._command:
            self._command = command
            gripper.request(command)
        target = read_keys(action)
        arm.send(("target", target))
        self._receive_state()
        return action_dict(target, wide if command == OPEN else 0.0)

    def take_samples(self) -> list[Sample]:
        """Return the samples since the last call, one for each physics step of training.

        A real arm does not measure which of its parts touches the object.
        """
        if self.sample_source is not None:
            return self.sample_source()
        rows, self._samples = self._samples, np.zeros((0, 20))
        dt = max(round(self._manifest.scene.timestep_s * 1e3), 1) * 1e-3
        return [Sample(row[:7], row[7:14], row[14:], False, dt) for row in rows]

    def _longest(self, seconds: float) -> float:
        """Return the longest wait for a reply [s], which is ``seconds`` for a real arm."""
        return LOCKSTEP_S if self._options.lockstep else seconds

    def _connected(self) -> ClientProcess:
        if self._arm is None:
            raise NotConnectedError("the robot is not connected; call connect first")
        return self._arm


def arm_settings(manifest: Manifest) -> ArmSettings:
    """Return the settings of a bundle: gains, limits, and thresholds of collisions.

    The thresholds are the limits of an episode: beyond them it has failed anyway.
    """
    robot, limits = manifest.robot, manifest.task.limits
    return ArmSettings(
        stiffness=robot.stiffness,
        damping=robot.damping,
        torque_rate=robot.dtau_max,
        torque_max=robot.tau_max,
        collision_force_n=limits.force_n,
        collision_torque_nm=limits.moment_nm,
        speed_fraction=MAX_FRACTION,
        leash_rad=manifest.control.max_tracking_error_rad,
    )
