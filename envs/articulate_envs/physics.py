"""Physics settings that are shipped."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from articulate.errors import ConfigError


@dataclass(frozen=True, kw_only=True)
class PhysicsConfig:
    """MuJoCo's settings for scenes."""

    timestep_s: float = 0.005
    """Length of a physics step [s]; a tick must hold a whole number of them."""
    cone: Literal["elliptic", "pyramidal"] = "elliptic"
    """Friction cone."""
    impratio: float = 100.0
    """Ratio of frictional to normal impedance; above 1 against slip of held parts."""
    iterations: int = 30
    """Largest number of solver iterations."""
    tolerance: float = 1e-8
    """The solver stops below this."""

    def substeps(self, step_s: float) -> int:
        """Physics steps in a tick of ``step_s`` [s]; ConfigError if it is not a whole number."""
        count = round(step_s / self.timestep_s)
        if count < 1 or abs(count * self.timestep_s - step_s) > 1e-9:
            raise ConfigError(
                f"physics.timestep_s is {self.timestep_s}; a tick of {step_s} s must be a "
                "whole number of steps"
            )
        return count
