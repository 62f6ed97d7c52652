"""Physics settings."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from articulate.config import check_above_0, check_bounds
from articulate.errors import ConfigError


@dataclass(frozen=True, kw_only=True)
class PhysicsConfig:
    """Settings of MuJoCo for scenes."""

    timestep_s: float = 0.005
    """Physics step [s]; a control step must be an integer multiple of it."""
    cone: Literal["elliptic", "pyramidal"] = "elliptic"
    """Friction cone."""
    impratio: float = 100.0
    """Ratio of frictional to normal impedance; above 1 it reduces slip of grasped parts."""
    iterations: int = 30
    """Largest number of solver iterations."""
    tolerance: float = 1e-8
    """Tolerance of the solver."""

    def __post_init__(self) -> None:
        check_above_0("physics", self, "timestep_s", "impratio", "iterations")
        check_bounds("physics", self, 0.0, math.inf, "tolerance")

    def substeps(self, step_s: float) -> int:
        """Return the number of physics steps in a control step of ``step_s`` [s].

        Raises:
            ConfigError: It is not an integer.
        """
        count = round(step_s / self.timestep_s)
        if count < 1 or abs(count * self.timestep_s - step_s) > 1e-9:
            raise ConfigError(
                f"physics.timestep_s is {self.timestep_s}; a control step of {step_s} s must be "
                "an integer multiple of it"
            )
        return count
