"""Configuration of the control stack; it loads no numpy, for the sake of ``--help``."""

from __future__ import annotations

import math
from dataclasses import dataclass

from articulate.config import check_above_0, check_bounds


@dataclass(frozen=True, kw_only=True)
class ControlConfig:
    """Parameters that turn actions of a policy into set points of the arm."""

    rate_hz: float = 20.0
    """Control steps of the policy per second [Hz]."""
    omega_rad_s: float = 22.0
    """Bandwidth of the set-point filter: its three poles are at -omega [rad/s]."""
    step_rad: float = 0.028
    """Largest change of target in one control step, for the joint that accelerates least [rad];
    other joints may change more in proportion to their acceleration limit."""
    move_m: float = 0.008
    """Motion of the tool along an axis for an action of 1 [m per control step]."""
    turn_rad: float = 0.026
    """Rotation of the tool about an axis for an action of 1 [rad per control step]."""
    max_tracking_error_rad: float = 0.4
    """Largest distance of a target from its measured joint [rad]."""
    margin_rad: float = 0.05
    """Distance of targets from the joint limits [rad]."""
    force_limit_n: float = 15.0
    """Force on an open gripper above which targets retract instead of moving on [N]."""
    force_limit_holding_n: float = 30.0
    """Force limit of a closed gripper: the load that an object may need to be opened [N]."""

    def __post_init__(self) -> None:
        check_above_0(
            "control", self,
            "rate_hz", "omega_rad_s", "step_rad", "max_tracking_error_rad", "move_m", "turn_rad",
            "force_limit_n", "force_limit_holding_n",
        )  # fmt: skip
        check_bounds("control", self, 0.0, math.inf, "margin_rad")

    @property
    def step_s(self) -> float:
        """Length of a control step [s]."""
        return 1.0 / self.rate_hz
