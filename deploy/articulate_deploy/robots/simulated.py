"""Common part of simulated robots in this process: the control stack around an engine's physics.

The set-point filter, the latency and speed of the gripper and the sampled push are here; an engine
adds the torques of the joint impedance, the fingers' forces, and contacts.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence

import numpy as np

from articulate.errors import ConfigError, nearest
from articulate.robot.control import (
    apply_gripper_latency,
    discretize_filter,
    filter_start,
    filter_step,
    finger_params,
    finger_start,
    finger_step,
    new_gripper_state,
)
from articulate.task.episode_monitor import filter_gain, low_pass
from articulate.task.object_placement import handle_path_of, object_pose
from articulate.task.observation import Estimate
from articulate.task.randomization import EpisodeParams, nominal_params, push_is_active
from articulate.task.state_estimation import measured_force
from articulate.task.task import fraction_open
from articulate.transforms import Array
from articulate_deploy.bundle import Bundle
from articulate_deploy.robots.robot import (
    ACTION_FEATURES,
    FORCE_KEYS,
    GRIPPER_KEY,
    JOINT_KEYS,
    SPEED_KEYS,
    NotConnectedError,
    Sample,
    SimulatedRobot,
    action_dict,
    read_keys,
)


class BaseSimulatedRobot(SimulatedRobot, ABC):
    """Arm of a bundle in an engine."""

    def __init__(self, bundle: Bundle) -> None:
        """Keep ``bundle``; the scene is made by :meth:`connect`."""
        self._bundle = bundle
        self._manifest = bundle.manifest
        self._params = nominal_params(begin=bundle.manifest.task.begin)
        self._force_noise_n, self._noise = 0.0, np.random.default_rng(0)
        self._is_open = False
        self._stopped = True

    @property
    def is_connected(self) -> bool:
        """True while the scene is open."""
        return self._is_open

    @property
    def is_calibrated(self) -> bool:
        """True; a simulated arm needs no calibration."""
        return True

    @property
    def notes(self) -> tuple[str, ...]:
        """Episode parameters that this engine handles differently, or not at all."""
        return ()

    @property
    @abstractmethod
    def physics_step_s(self) -> float:
        """Length of a physics step [s]; training's is an integer multiple."""

    @abstractmethod
    def _open(self) -> None:
        """Make the scene; BundleError if it cannot be used."""

    @abstractmethod
    def _close(self) -> None:
        """Release the scene."""

    @abstractmethod
    def _begin(self, q: Array, gripper_width_m: float, part: float) -> None:
        """Begin under ``self._params``, the object at ``self._T_wo``, all at rest.

        Args:
            q: Angles of the arm (7,) [rad].
            gripper_width_m: Opening of the gripper [m].
            part: Position of the task's joint [m or rad]; all others are closed.
        """

    @abstractmethod
    def _push(self, force_w: Array) -> None:
        """Push the moving part with a force (3,) [N] during the next control step."""

    @abstractmethod
    def _step(self, set_point: Array, finger_m: float) -> Sample:
        """Run one physics step with set points (7,) [rad] and a finger's [m]."""

    @abstractmethod
    def _read(self) -> tuple[Array, Array, float]:
        """Return angles (7,) [rad], speeds (7,) [rad/s], opening of the gripper [m]."""

    @abstractmethod
    def _part(self) -> tuple[float, float]:
        """Return position and speed of the task's joint [m or rad, and per second]."""

    def connect(self, calibrate: bool = True) -> None:
        """Make the scene, with the arm at the bundle's start."""
        self._open()
        self._is_open = True
        start = self._manifest.start
        try:
            self.reset_to(np.asarray(start.q), start.gripper_width_m)
        except BaseException:
            self.disconnect()
            raise

    def calibrate(self) -> None:
        """Do nothing: a simulated arm needs no calibration."""

    def configure(self) -> None:
        """Do nothing: the gains are the bundle's."""

    def disconnect(self) -> None:
        """Release the scene."""
        self._is_open = False
        self._close()

    def set_episode_params(
        self,
        params: EpisodeParams,
        *,
        force_noise_n: float = 0.0,
        noise: np.random.Generator | None = None,
    ) -> None:
        """Set the parameters of the next episodes; see :meth:`SimulatedRobot.set_episode_params`.

        Raises:
            ConfigError: They have another size of the object.
        """
        scale = float(params["scale"][0])
        if scale != self._manifest.scene.scale:
            raise ConfigError(
                f"the bundle's scene has size {self._manifest.scene.scale}, not {scale:.3g}; "
                "sample with one size"
            )
        self._params = params
        self._force_noise_n = 0.0 if noise is None else force_noise_n
        self._noise = np.random.default_rng(0) if noise is None else noise

    def reset_to(self, q: Array, gripper_width_m: float) -> None:
        """Begin an episode with the arm at rest at ``q`` (7,) [rad].

        All parts are closed except the task's, whose position is an episode parameter.
        """
        self._check_connected()
        manifest, dt = self._manifest, self.physics_step_s
        self._T_wo = self._object_pose()
        joint = manifest.object.joint(manifest.task.joint)
        part = joint.closed + float(self._params["part_open"][0]) * joint.span
        self._begin(np.asarray(q, dtype=np.float64), gripper_width_m, part)
        self._A, self._B = discretize_filter(manifest.control.omega_rad_s, dt)
        self._filter = filter_start(np.asarray(q))
        self._target = np.asarray(q, dtype=np.float64).copy()
        self._fingers = finger_params(manifest.robot.gripper, dt)
        self._finger = gripper_width_m / 2.0
        self._gripper = new_gripper_state(1)
        self._steps = 0
        self._samples: list[Sample] = []
        self._force = np.zeros(3)
        self._stopped = False

    def stop(self) -> None:
        """Hold the arm at its targets."""
        self._stopped = True

    def get_observation(self) -> dict[str, float]:
        """Return joint angles [rad], joint speeds [rad/s], gripper opening [m], force [N]."""
        self._check_connected()
        q, dq, width = self._read()
        force, noise = np.empty(3), self._noise.normal(size=3)
        measured_force(self._force, self._params.values[0], noise, self._force_noise_n, force)
        return {
            **dict(zip(JOINT_KEYS, q.tolist(), strict=True)),
            **dict(zip(SPEED_KEYS, dq.tolist(), strict=True)),
            GRIPPER_KEY: width,
            **dict(zip(FORCE_KEYS, force.tolist(), strict=True)),
        }

    def send_action(self, action: dict[str, float]) -> dict[str, float]:
        """Send targets [rad] and an opening [m], and simulate one control step.

        Returns:
            The values that were sent.

        Raises:
            NotConnectedError: The robot is not connected, or was stopped.
            ConfigError: A key is missing or unknown.
        """
        self._check_connected()
        if self._stopped:
            raise NotConnectedError("the robot was stopped; call reset_to first")
        for key in ACTION_FEATURES.keys() ^ action.keys():
            raise ConfigError(f"action: {key} is missing or unknown{nearest(key, ACTION_FEATURES)}")
        manifest = self._manifest
        self._target = read_keys(action)
        wide = manifest.robot.gripper.max_width_m
        width = wide if not action[GRIPPER_KEY] < wide / 2.0 else 0.0
        self._command_gripper(1.0 if width == 0.0 else -1.0)
        closing = self._gripper.closing[0]
        self._finger = finger_start(self._finger, self._read()[2], closing)
        self._push(self._present_push())
        together = round(manifest.scene.timestep_s / self.physics_step_s)
        samples: list[Sample] = []
        for _ in range(round(manifest.control.step_s / self.physics_step_s)):
            filter_step(self._filter, self._target, self._A, self._B)
            self._finger = finger_step(self._finger, closing, self._fingers)
            samples.append(self._step(self._filter[:, 0], self._finger))
            if len(samples) == together:
                self._store(joined(samples))
                samples = []
        self._steps += 1
        return action_dict(self._target, width)

    def take_samples(self) -> list[Sample]:
        """Return the samples since the last call, one for each physics step of training."""
        samples, self._samples = self._samples, []
        return samples

    def object_state(self) -> Estimate:
        """Return the true state of the object."""
        self._check_connected()
        manifest = self._manifest
        path = handle_path_of(manifest.object, manifest.task.joint, flip=manifest.placement.flip)
        position, speed = self._part()
        opened = np.array([fraction_open(position, path.closed, path.span)])
        T_wh = path.in_world(T_wo=self._T_wo, scale=np.ones(1), opened=opened)
        return Estimate(T_wh=T_wh, opened=opened, speed=np.array([speed * np.sign(path.span)]))

    def _check_connected(self) -> None:
        if not self._is_open:
            raise NotConnectedError("the robot is not connected; call connect first")

    def _object_pose(self) -> Array:
        params, manifest = self._params, self._manifest
        return object_pose(
            manifest.object,
            manifest.task.joint,
            manifest.placement,
            scale=np.ones(1),
            shift=np.stack([params["x_m"], params["y_m"]], axis=1),
            yaw=params["yaw_rad"],
        )

    def _store(self, sample: Sample) -> None:
        """Keep a sample, and filter its force as the episode monitor does."""
        self._samples.append(sample)
        gain = filter_gain(sample.dt, self._manifest.task.limits.filter_s)
        low_pass(self._force, 0, sample.wrench, 3, gain)

    def _command_gripper(self, command: float) -> None:
        """Take a command, +1 close or -1 open, which acts after the sampled latency."""
        sent = command != self._gripper.command[0]
        self._gripper.command[0] = command
        latency_s = float(self._params["gripper_latency_s"][0])
        step_s = self._manifest.control.step_s
        apply_gripper_latency(self._gripper, 0, sent, latency_s, step_s)

    def _present_push(self) -> Array:
        """Force of the sampled push (3,) [N], 0 outside its time."""
        time_s, episode_s = (
            self._steps * self._manifest.control.step_s,
            self._manifest.task.episode_s,
        )
        active = push_is_active(self._params.values[0], time_s, episode_s)
        return np.asarray(self._params["push"][0] if active else np.zeros(3))


def joined(samples: Sequence[Sample]) -> Sample:
    """Return one sample at training's rate from samples of shorter physics steps.

    The limits hold for that rate: the change of a torque over 1 ms differs from that over 5 ms.
    Speed and torque are those at the end, the wrench is the mean.
    """
    if len(samples) == 1:
        return samples[0]
    return Sample(
        dq=samples[-1].dq,
        torque=samples[-1].torque,
        wrench=np.mean([sample.wrench for sample in samples], axis=0),
        touch=any(sample.touch for sample in samples),
        dt=sum(sample.dt for sample in samples),
    )
