"""Common parts of the clients that wrap libfranka."""

from __future__ import annotations

from typing import Any

import numpy as np

from articulate_deploy.arms.client import (
    GUIDING,
    IDLE,
    MOVING,
    OTHER,
    REFLEX,
    USER_STOP,
    ArmSettings,
    ArmState,
)

MODES = {
    "idle": IDLE, "move": MOVING, "reflex": REFLEX, "userstopped": USER_STOP, "guiding": GUIDING,
}  # fmt: skip
"""Modes by the end of the names in libfranka's ``RobotMode``, in lower case."""


def mode_name(value: Any) -> str:
    """Return the mode of a ``RobotMode`` of any client."""
    word = str(getattr(value, "name", value)).lower().replace("_", "").replace(" ", "")
    for end, name in MODES.items():
        if word.endswith(end):
            return name
    return OTHER


def error_names(errors: Any) -> tuple[str, ...]:
    """Return the names of the active flags of libfranka's ``Errors``."""
    if isinstance(errors, (list, tuple)):
        return tuple(map(str, errors))
    names = (name for name in dir(errors) if "_" in name and not name.startswith("_"))
    return tuple(name for name in names if getattr(errors, name) is True)


def seconds(duration: Any) -> float:
    """Return a duration of any client [s]."""
    return float(duration.to_sec() if hasattr(duration, "to_sec") else duration)


def arm_state(state: Any, *, in_motion: bool) -> ArmState:
    """Return the state of any client; modes and errors only outside of motions.

    ``O_F_ext_hat_K`` is the wrench on the gripper in axes of the base. Within a motion a client
    raises an exception as soon as the mode changes.
    """
    return ArmState(
        time_s=seconds(state.time),
        q=np.array(state.q),
        dq=np.array(state.dq),
        torque=np.array(state.tau_J),
        wrench=np.array(state.O_F_ext_hat_K),
        mode=MOVING if in_motion else mode_name(state.robot_mode),
        errors=() if in_motion else error_names(state.current_errors),
    )


def thresholds(settings: ArmSettings) -> tuple[list[float], list[float], list[float], list[float]]:
    """Return lower and upper collision thresholds: torques (7), (7), forces and moments (6), (6).

    The lower ones report a contact and do not stop the arm.
    """
    torque, force = settings.collision_torque_nm, settings.collision_force_n
    return [torque / 2.0] * 7, [torque] * 7, [force / 2.0] * 6, [force] * 6


def read_back(state: Any) -> tuple[str, ...]:
    """Return lines on the values that a state reports of the settings.

    libfranka has no getter for thresholds; a client raises an exception if they are rejected.
    """
    mass = float(state.m_ee) + float(state.m_load)
    line = f"mass on the flange {mass:.3f} kg"
    if mass < 0.1:
        line += "; no gripper is configured in the arm's Desk, so measured forces are wrong"
    return (line,)
