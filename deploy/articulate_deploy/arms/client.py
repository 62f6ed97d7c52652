"""Protocol of clients, and the values that pass between a client and the rest of the program."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np

from articulate.transforms import Array

IDLE, MOVING, REFLEX, USER_STOP, GUIDING, OTHER = (
    "idle", "move", "reflex", "user_stopped", "guiding", "other",
)  # fmt: skip
"""Modes of a controller; libfranka's names."""


@dataclass(frozen=True)
class ArmState:
    """Measurements of a controller."""

    time_s: float
    """Clock of the controller [s]."""
    q: Array
    """Joint angles (7,) [rad]."""
    dq: Array
    """Joint speeds (7,) [rad/s]."""
    torque: Array
    """Joint torques, gravity included (7,) [Nm]."""
    wrench: Array
    """Force [N] and moment [Nm] of the surroundings on the gripper, axes of the base (6,)."""
    mode: str = IDLE
    errors: tuple[str, ...] = ()
    """Names of active errors."""


@dataclass(frozen=True)
class ArmSettings:
    """Settings from the bundle, which are written to the controller."""

    stiffness: tuple[float, ...]
    """Joint stiffness (7,) [Nm/rad]."""
    damping: tuple[float, ...]
    """Joint damping (7,) [Nm s/rad]."""
    torque_rate: float
    """Largest torque rate [Nm/s]."""
    torque_max: tuple[float, ...]
    """Largest torques (7,) [Nm]."""
    collision_force_n: float
    """Contact force at which the controller stops the arm [N]."""
    collision_torque_nm: float
    """External joint torque at which it stops the arm [Nm]."""
    speed_fraction: float
    """Share of the limit table that set points may use."""
    leash_rad: float
    """Largest distance between set point and joint [rad]."""


@dataclass(frozen=True)
class ClientSpec:
    """Client and controller of a robot."""

    client: str
    """Name in :data:`articulate_deploy.arms.clients.CLIENTS`."""
    address: str
    options: dict[str, Any] = field(default_factory=dict)
    """Further arguments of the client."""


@dataclass(frozen=True)
class ClientInfo:
    """Identity of a connected controller."""

    client: str
    """Name and version of the client."""
    protocol: int
    """Version of the controller's protocol; 0 if it has none."""
    notes: tuple[str, ...] = ()
    """Remarks, for example the values that were read back."""


class Motion(Protocol):
    """Source of set points during one motion, called once for each state of the controller."""

    def set_point(self, state: ArmState) -> tuple[Array, bool]:
        """Return set points (7,) [rad], and True if the motion is finished."""


class ArmClient(Protocol):
    """Client of a controller; it lives in a child process and raises its own exceptions."""

    def connect(self) -> ClientInfo:
        """Connect to the controller."""

    def read_state(self) -> ArmState:
        """Return the present state, outside of a motion."""

    def configure(self, settings: ArmSettings) -> tuple[str, ...]:
        """Write settings; return one line for each value that was read back."""

    def run(self, motion: Motion) -> None:
        """Run a motion to its end."""

    def recover(self) -> None:
        """Clear the errors of a reflex."""

    def close(self) -> None:
        """Disconnect."""


class TorqueLaw:
    """Joint impedance of training: torque from set points, saturated like the arm's own."""

    def __init__(self, settings: ArmSettings) -> None:
        """Begin with zero torque; the controller adds the compensation of gravity."""
        self._stiffness, self._damping = np.array(settings.stiffness), np.array(settings.damping)
        self._most = np.array(settings.torque_max)
        self._rate = 0.99 * settings.torque_rate * 0.001
        self._last = np.zeros(7)

    def torque(self, set_point: Array, state: ArmState) -> Array:
        """Return torques without gravity (7,) [Nm]."""
        wanted = self._stiffness * (set_point - state.q) - self._damping * state.dq
        wanted = np.minimum(np.maximum(wanted, -self._most), self._most)
        change = np.minimum(np.maximum(wanted - self._last, -self._rate), self._rate)
        self._last = self._last + change
        return np.asarray(self._last)
