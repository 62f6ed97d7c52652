"""Protocol of robots: LeRobot's names, and the additions that episodes need.

Names and meanings of ``observation_features`` to ``disconnect`` are those of
``lerobot.robots.Robot`` (LeRobot 0.6); keys are flat, one number each. ``reset_to``, ``stop``,
``take_samples`` are additions.
"""

from __future__ import annotations

from dataclasses import dataclass
from types import TracebackType
from typing import Protocol, Self

import numpy as np

from articulate.errors import ArticulateError
from articulate.task.observation import Estimate
from articulate.task.randomization import EpisodeParams
from articulate.transforms import Array

JOINT_KEYS = tuple(f"joint_{i}.pos" for i in range(1, 8))
SPEED_KEYS = tuple(f"joint_{i}.vel" for i in range(1, 8))
FORCE_KEYS = ("force.x", "force.y", "force.z")
"""Net force of the surroundings on the gripper as the arm measures it, world axes [N], filtered
over the ``filter_s`` of the task's limits like the monitor's."""
GRIPPER_KEY = "gripper.pos"
"""Opening between the fingers [m]."""
OBSERVATION_FEATURES: dict[str, type] = dict.fromkeys(
    (*JOINT_KEYS, *SPEED_KEYS, GRIPPER_KEY, *FORCE_KEYS), float
)
ACTION_FEATURES: dict[str, type] = dict.fromkeys((*JOINT_KEYS, GRIPPER_KEY), float)


class NotConnectedError(ArticulateError, ConnectionError):
    """The robot is not connected."""


class ForceStopError(ArticulateError):
    """The robot stopped because of the force on the gripper; the episode has failed."""


@dataclass(frozen=True)
class Sample:
    """Measurements at one step of the robot's controller."""

    dq: Array
    """Joint speeds (7,) [rad/s]."""
    torque: Array
    """Joint torques, gravity included (7,) [Nm]."""
    wrench: Array
    """Force [N] and moment about the tool [Nm] of the surroundings on the gripper, world axes
    (6,)."""
    touch: bool
    """True if anything but the gripper touches the object."""
    dt: float
    """Time since the last sample [s]."""


class Robot(Protocol):
    """Arm with a gripper that tracks one set of targets per control step.

    A driver gets targets that the episode loop has made safe, and sends them as they are.
    """

    name: str

    @property
    def observation_features(self) -> dict[str, type]:
        """Keys of observations; readable before :meth:`connect`."""
        return dict(OBSERVATION_FEATURES)

    @property
    def action_features(self) -> dict[str, type]:
        """Keys of actions; readable before :meth:`connect`."""
        return dict(ACTION_FEATURES)

    @property
    def is_connected(self) -> bool:
        """True after :meth:`connect`."""

    @property
    def is_calibrated(self) -> bool:
        """True if the robot needs no calibration."""

    def connect(self, calibrate: bool = True) -> None:
        """Open the connection."""

    def calibrate(self) -> None:
        """Calibrate the robot, if it needs it."""

    def configure(self) -> None:
        """Write settings to the robot."""

    def get_observation(self) -> dict[str, float]:
        """Return joint angles [rad], joint speeds [rad/s], gripper opening [m], force [N]."""

    def send_action(self, action: dict[str, float]) -> dict[str, float]:
        """Send targets [rad] and an opening [m]; return the values that were sent."""

    def disconnect(self) -> None:
        """Close the connection."""

    def reset_to(self, q: Array, gripper_width_m: float) -> None:
        """Bring the arm to rest at ``q`` (7,) [rad] and the gripper to an opening [m]."""

    def stop(self) -> None:
        """Hold the arm in place; actions are rejected until :meth:`reset_to`."""

    def take_samples(self) -> list[Sample]:
        """Return the samples since the last call."""

    def __enter__(self) -> Self:
        """Connect."""
        self.connect()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Disconnect."""
        self.disconnect()


class SimulatedRobot(Robot, Protocol):
    """Robot in simulation: it takes episode parameters and provides the object's true state.

    Time advances by one control step with each :meth:`Robot.send_action`.
    """

    @property
    def notes(self) -> tuple[str, ...]:
        """Episode parameters that it handles differently from training, or not at all."""

    def set_episode_params(
        self,
        params: EpisodeParams,
        *,
        force_noise_n: float = 0.0,
        noise: np.random.Generator | None = None,
    ) -> None:
        """Set the parameters of the next episodes (one row), from :meth:`Robot.reset_to` on.

        Args:
            params: Episode parameters.
            force_noise_n: Standard deviation of the noise of the measured force [N].
            noise: Random generator of that noise; None reads without it.
        """

    def object_state(self) -> Estimate:
        """Return the true state of the object (one row)."""


def read_keys(values: dict[str, float], keys: tuple[str, ...] = JOINT_KEYS) -> Array:
    """Return the numbers under ``keys`` in their order (len(keys),)."""
    return np.array([values[key] for key in keys], dtype=np.float64)


def action_dict(target: Array, gripper_width_m: float) -> dict[str, float]:
    """Return targets (7,) [rad] and an opening [m] under their keys."""
    return {
        **dict(zip(JOINT_KEYS, target.tolist(), strict=True)),
        GRIPPER_KEY: float(gripper_width_m),
    }
