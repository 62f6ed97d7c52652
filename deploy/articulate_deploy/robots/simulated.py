"""What stand-ins in this process share: the plant of training around an engine's physics steps.

The follower, the hand's latency and speed and the drawn push are here; an engine brings the
torques of the joint impedance, the fingers' forces, and contacts.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence

import numpy as np

from articulate.errors import ConfigError, nearest
from articulate.robot.control import (
    ROUNDING_S,
    discretize_filter,
    filter_start,
    filter_step,
    finger_command,
)
from articulate.task.object_placement import handle_in_world, object_pose
from articulate.task.observation import Estimate
from articulate.task.randomization import PUSH_S, EpisodeParams, nominal_params
from articulate.task.state_estimation import felt
from articulate.transforms import Array
from articulate_deploy.bundle import Bundle
from articulate_deploy.robots.robot import (
    ACTION_FEATURES,
    FORCE_KEYS,
    GRIPPER_KEY,
    JOINT_KEYS,
    OBSERVATION_FEATURES,
    SPEED_KEYS,
    NotConnectedError,
    Sample,
    SimulatedRobot,
    action_of,
    joints_of,
)
from articulate_deploy.safety import safe_target


class BaseSimulatedRobot(SimulatedRobot, ABC):
    """The arm of a bundle in an engine."""

    def __init__(self, bundle: Bundle) -> None:
        """Keep ``bundle``; the scene is made by :meth:`connect`."""
        self._bundle = bundle
        self._manifest = bundle.manifest
        self._drawn = nominal_params(begin=bundle.manifest.task.begin)
        self._force_noise_n, self._noise = 0.0, np.random.default_rng(0)
        self._is_open = False
        self._stopped = True

    @property
    def observation_features(self) -> dict[str, type]:
        """Keys of observations."""
        return dict(OBSERVATION_FEATURES)

    @property
    def action_features(self) -> dict[str, type]:
        """Keys of actions."""
        return dict(ACTION_FEATURES)

    @property
    def is_connected(self) -> bool:
        """Whether the scene is there."""
        return self._is_open

    @property
    def is_calibrated(self) -> bool:
        """Nothing is to be calibrated."""
        return True

    @property
    def notes(self) -> tuple[str, ...]:
        """What of a draw this engine takes otherwise, or not at all."""
        return ()

    @property
    @abstractmethod
    def step_s(self) -> float:
        """Length of a physics step [s]; a whole number of them is one of training's."""

    @abstractmethod
    def _open(self) -> None:
        """Make the scene; BundleError if it cannot be used."""

    @abstractmethod
    def _shut(self) -> None:
        """Forget the scene."""

    @abstractmethod
    def _begin(self, q: Array, gripper_width_m: float, part: float) -> None:
        """Begin anew under ``self._drawn``, the object at ``self._T_wo``, all at rest.

        Args:
            q: Angles of the arm (7,) [rad].
            gripper_width_m: Opening of the hand [m].
            part: Position of the task's joint [m or rad]; all others are closed.
        """

    @abstractmethod
    def _push(self, force_w: Array) -> None:
        """Push the moving part with a force (3,) [N] throughout the next tick."""

    @abstractmethod
    def _step(self, set_point: Array, finger_m: float) -> Sample:
        """One physics step with set points (7,) [rad] and a finger's [m]."""

    @abstractmethod
    def _read(self) -> tuple[Array, Array, float]:
        """Angles (7,) [rad], speeds (7,) [rad/s], opening of the hand [m]."""

    @abstractmethod
    def _part(self) -> tuple[float, float]:
        """Position and speed of the task's joint [m or rad, and a second]."""

    def connect(self, calibrate: bool = True) -> None:
        """Make the scene and stand at the bundle's start."""
        self._open()
        self._is_open = True
        start = self._manifest.start
        try:
            self.reset_to(np.asarray(start.q), start.gripper_width_m)
        except BaseException:
            self.disconnect()
            raise

    def calibrate(self) -> None:
        """Nothing is to be calibrated."""

    def configure(self) -> None:
        """Gains are the bundle's."""

    def disconnect(self) -> None:
        """Forget the scene."""
        self._is_open = False
        self._shut()

    def set_episode_params(
        self,
        drawn: EpisodeParams,
        *,
        force_noise_n: float = 0.0,
        noise: np.random.Generator | None = None,
    ) -> None:
        """What the next episodes are like; see :meth:`SimulatedRobot.set_episode_params`.

        Raises:
            ConfigError: It asks for another size of the object.
        """
        scale = float(drawn["scale"][0])
        if scale != self._manifest.scene.scale:
            raise ConfigError(
                f"the bundle's scene has size {self._manifest.scene.scale}, not {scale:.3g}; "
                "draw with one size"
            )
        self._drawn = drawn
        self._force_noise_n = 0.0 if noise is None else force_noise_n
        self._noise = np.random.default_rng(0) if noise is None else noise

    def reset_to(self, q: Array, gripper_width_m: float) -> None:
        """Begin anew under the last draw, the arm at rest at ``q``.

        Every part is closed but the task's, which is where it was drawn.
        """
        self._connected()
        manifest = self._manifest
        self._T_wo = self._object_pose()
        joint = manifest.object.joint(manifest.task.joint)
        part = joint.closed + float(self._drawn["part_open"][0]) * joint.span
        self._begin(np.asarray(q, dtype=np.float64), gripper_width_m, part)
        self._A, self._B = discretize_filter(manifest.control.omega_rad_s, self.step_s)
        self._follower = filter_start(np.asarray(q)[None])
        self._target = np.asarray(q, dtype=np.float64).copy()
        self._finger = gripper_width_m / 2.0
        self._wish = self._closing = -1.0
        self._wait_s = 0.0
        self._tick = 0
        self._samples: list[Sample] = []
        self._force = np.zeros(3)
        self._stopped = False

    def stop(self) -> None:
        """Hold the arm where it is told to be."""
        self._stopped = True

    def get_observation(self) -> dict[str, float]:
        """Joint angles [rad], joint speeds [rad/s], opening of the hand [m], force on it [N]."""
        self._connected()
        q, dq, width = self._read()
        force = felt(self._force[None], self._drawn, self._force_noise_n, self._noise)[0]
        return {
            **dict(zip(JOINT_KEYS, q.tolist(), strict=True)),
            **dict(zip(SPEED_KEYS, dq.tolist(), strict=True)),
            GRIPPER_KEY: width,
            **dict(zip(FORCE_KEYS, force.tolist(), strict=True)),
        }

    def send_action(self, action: dict[str, float]) -> dict[str, float]:
        """Send targets [rad] and an opening [m], and let one tick pass; returns what was sent.

        Raises:
            NotConnectedError: The robot is not connected, or was stopped.
            ConfigError: A key is missing or not known.
        """
        self._connected()
        if self._stopped:
            raise NotConnectedError("the robot was stopped; call reset_to first")
        for key in ACTION_FEATURES.keys() ^ action.keys():
            raise ConfigError(
                f"action: {key} is missing or not known{nearest(key, ACTION_FEATURES)}"
            )
        config, robot = self._manifest.control, self._manifest.robot
        self._target = safe_target(joints_of(action), self._target, config, robot)
        wide = robot.gripper.max_width_m
        width = wide if not action[GRIPPER_KEY] < wide / 2.0 else 0.0
        self._tell_hand(1.0 if width == 0.0 else -1.0)
        held = np.array([self._read()[2]])
        self._finger = float(finger_command(np.array([self._finger]), held, self._closing)[0])
        self._push(self._push_now())
        finger_step = robot.gripper.finger_speed_m_s * self.step_s
        together = round(self._manifest.scene.timestep_s / self.step_s)
        steps: list[Sample] = []
        for _ in range(round(config.step_s / self.step_s)):
            self._follower = filter_step(self._follower, self._target[None], self._A, self._B)
            move = -self._closing * finger_step
            self._finger = float(np.clip(self._finger + move, *robot.gripper.finger_m))
            steps.append(self._step(self._follower[0, :, 0], self._finger))
            if len(steps) == together:
                self._feel(joined(steps))
                steps = []
        self._tick += 1
        return action_of(self._target, width)

    def take_samples(self) -> list[Sample]:
        """Samples since the last call, one for each physics step of training."""
        samples, self._samples = self._samples, []
        return samples

    def object_state(self) -> Estimate:
        """The true state of the object."""
        self._connected()
        manifest = self._manifest
        joint = manifest.object.joint(manifest.task.joint)
        position, speed = self._part()
        opened = np.array([(position - joint.closed) / joint.span])
        T_wh = handle_in_world(
            manifest.object,
            joint.name,
            T_wo=self._T_wo,
            scale=np.ones(1),
            opened=opened,
            flip=manifest.placement.flip,
        )
        return Estimate(T_wh=T_wh, opened=opened, speed=np.array([speed * np.sign(joint.span)]))

    def _connected(self) -> None:
        if not self._is_open:
            raise NotConnectedError("the robot is not connected; call connect first")

    def _object_pose(self) -> Array:
        drawn, manifest = self._drawn, self._manifest
        return object_pose(
            manifest.object,
            manifest.task.joint,
            manifest.placement,
            scale=np.ones(1),
            shift=np.stack([drawn["x_m"], drawn["y_m"]], axis=1),
            yaw=drawn["yaw_rad"],
        )

    def _feel(self, sample: Sample) -> None:
        """Keep a sample, and filter its force as :func:`judge_sample` does."""
        self._samples.append(sample)
        gain = 1.0 - np.exp(-sample.dt / self._manifest.task.limits.filter_s)
        self._force = self._force + gain * (sample.wrench[:3] - self._force)

    def _tell_hand(self, wish: float) -> None:
        """A new command acts after the drawn latency."""
        if wish != self._wish:
            self._wait_s = float(self._drawn["gripper_latency_s"][0])
        else:
            self._wait_s = max(self._wait_s - self._manifest.control.step_s, 0.0)
        self._wish = wish
        if self._wait_s <= ROUNDING_S:
            self._closing = wish

    def _push_now(self) -> Array:
        """The drawn push (3,) [N] if this is its time."""
        t = self._tick * self._manifest.control.step_s
        begin = float(self._drawn["push_time"][0]) * self._manifest.task.episode_s
        on = begin <= t < begin + PUSH_S
        return np.asarray(self._drawn["push"][0] if on else np.zeros(3))


def joined(steps: Sequence[Sample]) -> Sample:
    """What one sample of training's rate shows of shorter steps.

    The judgement was made for that rate: the change of a torque over 1 ms is another number than
    over 5 ms. Speed and torque are those at the end, the wrench is the mean.
    """
    if len(steps) == 1:
        return steps[0]
    return Sample(
        dq=steps[-1].dq,
        torque=steps[-1].torque,
        wrench=np.mean([step.wrench for step in steps], axis=0),
        touch=any(step.touch for step in steps),
        dt=sum(step.dt for step in steps),
    )
