"""Configuration of the control stack, without arrays: `--help` does not load numpy."""

from __future__ import annotations

import math
from dataclasses import dataclass

from articulate.errors import ConfigError


@dataclass(frozen=True, kw_only=True)
class ControlConfig:
    """How a policy's actions become set points."""

    rate_hz: float = 20.0
    """Ticks of the policy per second [Hz]."""
    omega_rad_s: float = 22.0
    """Bandwidth of the follower: its three poles lie at -omega [rad/s]."""
    step_rad: float = 0.028
    """Largest change in one tick of the target of the joint that accelerates least [rad]; others go
    further in proportion to their acceleration, and whole motions are scaled down to it."""
    move_m: float = 0.008
    """Motion of the tool along an axis that an action of 1 asks for [m a tick]."""
    turn_rad: float = 0.026
    """Turn of the tool about an axis that an action of 1 asks for [rad a tick]."""
    lead_rad: float = 0.4
    """Largest distance of a target from its measured joint [rad]."""
    margin_rad: float = 0.05
    """Distance that targets keep from the joint limits [rad]."""
    force_limit_n: float = 15.0
    """Force on an open hand from which on its targets are taken back instead of moved [N]."""
    force_limit_holding_n: float = 30.0
    """The same of a hand that closes: as much as an object may ask of who opens it [N]."""

    def __post_init__(self) -> None:
        for name in (
            "rate_hz", "omega_rad_s", "step_rad", "lead_rad", "move_m", "turn_rad",
            "force_limit_n", "force_limit_holding_n",
        ):  # fmt: skip
            if not 0.0 < getattr(self, name) < math.inf:
                raise ConfigError(f"control.{name} is {getattr(self, name)}; it must be above 0")
        if not 0.0 <= self.margin_rad < math.inf:
            raise ConfigError(
                f"control.margin_rad is {self.margin_rad}; it must be finite and at least 0"
            )

    @property
    def step_s(self) -> float:
        """Length of a tick [s]."""
        return 1.0 / self.rate_hz
