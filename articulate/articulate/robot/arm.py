"""Constants of the arm: limit tables with their sources, gains, home pose, gripper.

All tables are in joint order 1 to 7. Sources:

* joint positions, velocities, accelerations, jerks, torques: Franka Control Interface
  documentation, "Robot limits for Panda"; equal to ``rate_limiting.h`` and
  ``joint_limits.yaml`` of libfranka 0.9.2 and franka_ros.
* gripper: ``franka_description`` (``gripper.xacro``) for stroke, speed and mass.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from articulate.errors import ConfigError, nearest, quote
from articulate.transforms import Array

Seven = tuple[float, float, float, float, float, float, float]


PAD_M = 0.008
"""Extent of the finger pads to either side of the tool along the approach [m]."""


@dataclass(frozen=True, kw_only=True)
class Gripper:
    """Two-finger gripper of the Panda, with latency."""

    max_width_m: float = 0.08
    """Opening between the fingers when open [m]."""
    finger_speed_m_s: float = 0.05
    """Speed of one finger [m/s], as DROID drives this gripper; the URDF's limit is 0.2. A slower
    finger gets less reaction from an object that it pushes aside."""
    force_n: float = 60.0
    """Grasp force of one finger [N], for an object of any thickness; the largest that frankapy
    requests of this gripper."""
    stiffness_n_m: float = 2000.0
    """Increase of that force with the distance of the finger's set point ahead of it [N/m]."""
    tcp_z_m: float = 0.0994
    """Middle of the finger pads above the gripper frame, along the approach axis [m]."""
    on_threshold: float = 0.25
    """The smoothed command closes the gripper above +threshold and opens it below -threshold."""
    smoothing: float = 0.85
    """Share of the old value in the smoothed command, per 50 ms."""
    dwell_s: float = 1.0
    """Shortest time between two commands to the gripper [s]."""

    @property
    def finger_m(self) -> tuple[float, float]:
        """Limits of a finger's set point, closing and open [m].

        Closing continues beyond the point where fingers meet, so that any object gets the full
        grasp force.
        """
        return -self.force_n / self.stiffness_n_m, self.max_width_m / 2.0


@dataclass(frozen=True, kw_only=True)
class Arm:
    """Limits, gains and poses of an arm."""

    name: str
    """Kind of robot; the manifest of a bundle names it."""
    joint_names: tuple[str, ...]
    """Names of the joints, in order."""
    q_min: Seven
    """Lower joint limits [rad]."""
    q_max: Seven
    """Upper joint limits [rad]."""
    dq_max: Seven
    """Joint speed limits [rad/s]."""
    ddq_max: Seven
    """Joint acceleration limits [rad/s^2]."""
    dddq_max: Seven
    """Joint jerk limits [rad/s^3]."""
    tau_max: Seven
    """Joint torque limits, gravity included [Nm]."""
    dtau_max: float
    """Torque rate at which the controller saturates [Nm/s]."""
    stiffness: Seven
    """Joint stiffness passed to the impedance controller [Nm/rad]."""
    damping: Seven
    """Joint damping passed to the impedance controller [Nm s/rad]."""
    armature: Seven
    """Reflected inertia of motors and gears used in simulation [kg m^2]."""
    friction: Seven
    """Dry friction left after the arm's own compensation, used in simulation [Nm]."""
    home: Seven
    """Start pose with the gripper pointing forward [rad]."""
    gripper: Gripper
    """Gripper on its flange."""

    def bounds(self, margin_rad: float = 0.0) -> tuple[Array, Array]:
        """Return lower and upper joint limits (7,), (7,) [rad], reduced by ``margin_rad``."""
        return np.asarray(self.q_min) + margin_rad, np.asarray(self.q_max) - margin_rad


def _scaled(factor: float, values: Seven) -> Seven:
    a, b, c, d, e, f, g = (round(factor * v, 6) for v in values)
    return (a, b, c, d, e, f, g)


LIBFRANKA_STIFFNESS: Seven = (600.0, 600.0, 600.0, 600.0, 250.0, 150.0, 50.0)
"""Stiffness of libfranka's ``joint_impedance_control`` example [Nm/rad]."""
LIBFRANKA_DAMPING: Seven = (50.0, 50.0, 50.0, 50.0, 30.0, 25.0, 15.0)
"""Damping of the same example [Nm s/rad]."""
STIFFNESS_SHARE = 0.15
"""Share of the example's stiffness that is used: the softest arm that still opens all objects."""
DAMPING_SHARE = 1.1 * STIFFNESS_SHARE**0.5
"""Share of its damping: a tenth more than keeps the damping ratio."""

PANDA = Arm(
    name="panda",
    joint_names=tuple(f"joint_{i}" for i in range(1, 8)),
    q_min=(-2.8973, -1.7628, -2.8973, -3.0718, -2.8973, -0.0175, -2.8973),
    q_max=(2.8973, 1.7628, 2.8973, -0.0698, 2.8973, 3.7525, 2.8973),
    dq_max=(2.175, 2.175, 2.175, 2.175, 2.61, 2.61, 2.61),
    ddq_max=(15.0, 7.5, 10.0, 12.5, 15.0, 20.0, 20.0),
    dddq_max=(7500.0, 3750.0, 5000.0, 6250.0, 7500.0, 10000.0, 10000.0),
    tau_max=(87.0, 87.0, 87.0, 87.0, 12.0, 12.0, 12.0),
    dtau_max=1000.0,
    stiffness=_scaled(STIFFNESS_SHARE, LIBFRANKA_STIFFNESS),
    damping=_scaled(DAMPING_SHARE, LIBFRANKA_DAMPING),
    armature=(0.2, 0.2, 0.2, 0.2, 0.1, 0.1, 0.1),
    friction=(0.2, 0.2, 0.2, 0.2, 0.1, 0.1, 0.1),
    home=(0.0, -0.75, 0.0, -2.35, 0.0, 3.17, 0.7853981633974483),
    gripper=Gripper(),
)
"""Franka Emika Panda with its two-finger gripper."""

ARMS = {"panda": PANDA}


def arm_named(name: str) -> Arm:
    """Return the arm called ``name``; ConfigError lists the known ones."""
    if name not in ARMS:
        raise ConfigError(f"unknown arm {quote(name)}{nearest(name, ARMS)}")
    return ARMS[name]
