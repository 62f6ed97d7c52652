"""The protocol of robots: LeRobot's names, and what we need beside them.

Names and meanings of ``observation_features`` to ``disconnect`` are those of
``lerobot.robots.Robot`` (LeRobot 0.6); keys are flat, one number each. ``reset_to``, ``stop``,
``take_samples`` are ours.
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
"""Net force of the surroundings on hand and fingers as the arm feels it, world axes [N], filtered
over the ``filter_s`` of the task's limits as the judgement filters it."""
GRIPPER_KEY = "gripper.pos"
"""Opening between the fingers [m]."""
OBSERVATION_FEATURES: dict[str, type] = dict.fromkeys(
    (*JOINT_KEYS, *SPEED_KEYS, GRIPPER_KEY, *FORCE_KEYS), float
)
ACTION_FEATURES: dict[str, type] = dict.fromkeys((*JOINT_KEYS, GRIPPER_KEY), float)


class NotConnectedError(ArticulateError, ConnectionError):
    """The robot is not connected."""


@dataclass(frozen=True)
class Sample:
    """What is measured at one step of the robot's controller."""

    dq: Array
    """Joint speeds (7,) [rad/s]."""
    torque: Array
    """Joint torques, gravity included (7,) [Nm]."""
    wrench: Array
    """Force [N] and moment about the tool [Nm] of the surroundings on the hand, world axes (6,)."""
    touch: bool
    """Whether anything but hand and fingers touches the object."""
    dt: float
    """Time since the sample before [s]."""


class Robot(Protocol):
    """An arm with a hand that follows targets sent once a tick."""

    name: str

    @property
    def observation_features(self) -> dict[str, type]:
        """Keys of observations; readable before :meth:`connect`."""

    @property
    def action_features(self) -> dict[str, type]:
        """Keys of actions; readable before :meth:`connect`."""

    @property
    def is_connected(self) -> bool:
        """Whether :meth:`connect` was called."""

    @property
    def is_calibrated(self) -> bool:
        """Whether the robot needs no calibration."""

    def connect(self, calibrate: bool = True) -> None:
        """Open the connection."""

    def calibrate(self) -> None:
        """Calibrate, where there is something to calibrate."""

    def configure(self) -> None:
        """Write settings to the robot."""

    def get_observation(self) -> dict[str, float]:
        """Joint angles [rad], joint speeds [rad/s], opening of the hand [m], force on it [N]."""

    def send_action(self, action: dict[str, float]) -> dict[str, float]:
        """Send targets [rad] and an opening [m]; returns what was really sent."""

    def disconnect(self) -> None:
        """Close the connection."""

    def reset_to(self, q: Array, gripper_width_m: float) -> None:
        """Bring the arm to rest at ``q`` (7,) [rad] and the hand to an opening [m]."""

    def stop(self) -> None:
        """Hold the arm where it is; actions are refused until :meth:`reset_to`."""

    def take_samples(self) -> list[Sample]:
        """Samples since the last call."""

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
    """A robot in simulation: it can be told what was drawn, and knows the object's state.

    Time passes by one tick with each :meth:`Robot.send_action`.
    """

    @property
    def notes(self) -> tuple[str, ...]:
        """What of a draw it takes otherwise than the simulator of training, or not at all."""

    def set_episode_params(
        self,
        drawn: EpisodeParams,
        *,
        force_noise_n: float = 0.0,
        noise: np.random.Generator | None = None,
    ) -> None:
        """What the next episodes are like (one row); takes effect at :meth:`Robot.reset_to`.

        Args:
            drawn: The draw.
            force_noise_n: Standard deviation of the error of the felt force, each reading [N].
            noise: Where that comes from; None reads without it.
        """

    def object_state(self) -> Estimate:
        """The true state of the object (one row)."""


def joints_of(values: dict[str, float], keys: tuple[str, ...] = JOINT_KEYS) -> Array:
    """The numbers under ``keys`` in their order (len(keys),)."""
    return np.array([values[key] for key in keys], dtype=np.float64)


def action_of(target: Array, gripper_width_m: float) -> dict[str, float]:
    """Targets (7,) [rad] and an opening [m] under their keys."""
    return {
        **dict(zip(JOINT_KEYS, target.tolist(), strict=True)),
        GRIPPER_KEY: float(gripper_width_m),
    }
