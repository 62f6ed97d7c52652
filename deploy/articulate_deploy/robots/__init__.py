"""Robots by name; each is imported on request."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from articulate.errors import ConfigError, MissingError, nearest
from articulate.suppress_output import suppress_output

if TYPE_CHECKING:
    from articulate_deploy.bundle import Bundle
    from articulate_deploy.robots.robot import SimulatedRobot

ROBOTS = {
    "mujoco": "articulate_deploy.robots.mujoco:MujocoRobot",
    "pybullet": "articulate_deploy.robots.pybullet:PybulletRobot",
}
"""Name to ``module:attribute``; the attribute is called with the bundle."""
ARMS = ("panda", "fr3", "bridge")
"""Robots of :mod:`articulate_deploy.arm_deployment`."""


def robot_named(name: str, bundle: Bundle) -> SimulatedRobot:
    """Return the robot called ``name``, not yet connected.

    Raises:
        ConfigError: The name is unknown.
        MissingError: A package that it needs is not installed.
    """
    if name in ARMS:
        raise ConfigError(f"--robot {name}: name one robot only with a real arm")
    if name not in ROBOTS:
        raise ConfigError(f"--robot {name}: unknown{nearest(name, (*ROBOTS, *ARMS))}")
    module, attribute = ROBOTS[name].split(":")
    try:
        with suppress_output():  # PyBullet prints a banner
            make: Any = getattr(importlib.import_module(module), attribute)
    except ModuleNotFoundError as error:
        if (error.name or "").startswith("articulate"):
            raise
        raise MissingError(
            f"--robot {name} needs {error.name}, which is not installed; run: "
            'pip install "articulate-robots[deploy-sim]"'
        ) from None
    robot: SimulatedRobot = make(bundle)
    return robot
