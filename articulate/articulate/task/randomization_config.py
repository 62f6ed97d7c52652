"""Configuration of the randomization; it loads no numpy, for the sake of ``--help``."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace
from typing import Any

from articulate.config import check_bounds
from articulate.errors import ConfigError

Range = tuple[float, float]
FACTORS = (
    "friction", "joint_damping", "joint_friction", "armature", "mass", "stiffness", "damping",
    "scale",
)  # fmt: skip
"""Ranges that multiply a nominal value."""
LOG_UNIFORM = ("joint_damping", "joint_friction", "armature")
"""Factors that are sampled log-uniformly."""
MAX_DELAY_STEPS = 5
"""Longest delay that engines and estimators keep [control steps]."""
MAX_RANGE_FACTOR = 100.0
"""Upper bound of the range multiplier."""
GOAL_ERROR_RANGE: Range = (-0.2, 0.1)
"""Range of ``goal_error_fine``, in fractions of the part's travel beyond the task's target."""


@dataclass(frozen=True, kw_only=True)
class RandomizationConfig:
    """Ranges of the randomization. Factors multiply the nominal value, ``±`` is added."""

    friction: Range = (0.5, 1.5)
    """Factor on the sliding friction between fingers and object."""
    joint_damping: Range = (0.33, 3.0)
    """Factor on the damping of the object's joints, log-uniform."""
    joint_friction: Range = (0.33, 3.0)
    """Factor on the dry friction of the object's joints, log-uniform."""
    armature: Range = (0.5, 2.0)
    """Factor on the arm's reflected inertia, log-uniform."""
    mass: Range = (0.7, 1.3)
    """Factor on the masses of the object's moving links."""
    stiffness: Range = (0.8, 1.2)
    """Factor on the stiffness of the joint impedance."""
    damping: Range = (0.8, 1.2)
    """Factor on its damping."""
    scale: Range = (0.9, 1.1)
    """Factor on the object's size, one of :attr:`scales` values."""
    scales: int = 9
    """Number of prepared sizes between the ends of ``scale``."""
    position_m: float = 0.03
    """Shift of the object along x and y, up to ± [m]."""
    yaw_rad: float = 0.1745
    """Rotation of the object about the vertical through its handle, up to ± [rad]."""
    start_rad: float = 0.1
    """Offset of each joint from its start pose, up to ± [rad]."""
    delay_steps: tuple[int, int] = (0, 2)
    """Delay of the motions [control steps], both ends included."""
    gripper_latency_s: Range = (0.1, 1.2)
    """Time from a command of the gripper to its motion [s]."""
    estimate_bias_m: float = 0.004
    """Standard deviation of the handle's constant position error, each axis [m]."""
    estimate_noise_m: float = 0.003
    """Standard deviation of its noise, each axis and control step [m]."""
    estimate_yaw_rad: float = 0.01745
    """Standard deviation of the handle's constant yaw error [rad]."""
    part_noise: float = 0.0167
    """Standard deviation of the measured opening per control step, as a share of 0.3 m or 1 rad."""
    estimate_delay_steps: tuple[int, int] = (0, 2)
    """Age of the object's state [control steps], both ends included."""
    push_n: Range = (0.0, 5.0)
    """Force of a push on the moving part, once per episode in a random direction [N]."""
    force_bias_n: float = 1.5
    """Standard deviation of the constant error of the measured force, each axis [N]."""
    force_noise_n: float = 0.5
    """Standard deviation of its noise, each axis and control step [N]."""

    def __post_init__(self) -> None:
        if self.scales < 1:
            raise ConfigError(f"randomization.scales is {self.scales}; it must be at least 1")
        for f in fields(self):
            value = getattr(self, f.name)
            if isinstance(value, tuple) and value[0] > value[1]:
                raise ConfigError(
                    f"randomization.{f.name} is {value}; the smaller number comes first"
                )
            if f.name in FACTORS and not value[0] > 0.0:
                raise ConfigError(f"randomization.{f.name} is {value}; factors must be above 0")
            if f.name.endswith("delay_steps") and not 0 <= value[0] <= value[1] <= MAX_DELAY_STEPS:
                raise ConfigError(
                    f"randomization.{f.name} is {value}; it must be within 0 to "
                    f"{MAX_DELAY_STEPS} control steps"
                )
            check_bounds("randomization", self, 0.0, math.inf, f.name)

    def widened(self, factor: float) -> RandomizationConfig:
        """Return the ranges widened by ``factor``.

        Factors are widened about 1, log-uniform ones on the logarithm; ranges that begin at 0 still
        do; others are widened about their middle and do not fall below 0; numbers of control steps
        are rounded, halves up. A factor of 1 changes nothing.

        Raises:
            ConfigError: A range would be impossible, such as a negative friction.
        """
        if not 0.0 < factor <= MAX_RANGE_FACTOR:
            raise ConfigError(
                f"range factor (--ranges) is {factor:g}; it must be above 0 and at most "
                f"{MAX_RANGE_FACTOR:g}"
            )
        if factor == 1.0:
            return self
        wide: dict[str, Any] = {"scales": 1 + round((self.scales - 1) * factor)}
        for f in fields(self):
            value = getattr(self, f.name)
            if f.name in LOG_UNIFORM:
                wide[f.name] = tuple(bound**factor for bound in value)
            elif f.name in FACTORS:
                wide[f.name] = tuple(1.0 + factor * (bound - 1.0) for bound in value)
            elif f.name.endswith("delay_steps"):
                wide[f.name] = (value[0], value[0] + int(factor * (value[1] - value[0]) + 0.5))
            elif isinstance(value, tuple) and value[0] == 0.0:
                wide[f.name] = (0.0, factor * value[1])
            elif isinstance(value, tuple):
                middle, half = (value[0] + value[1]) / 2.0, (value[1] - value[0]) / 2.0
                wide[f.name] = (max(0.0, middle - factor * half), middle + factor * half)
            elif f.name != "scales":
                wide[f.name] = factor * value
        try:
            return replace(self, **wide)
        except ConfigError as error:
            raise ConfigError(f"range factor {factor:g}: {error}") from None

    @property
    def scale_values(self) -> tuple[float, ...]:
        """Prepared sizes."""
        low, high = self.scale
        if low == high or self.scales == 1:
            return (low,)
        step = (high - low) / (self.scales - 1)
        return (*(low + k * step for k in range(self.scales - 1)), high)


NO_RANDOMIZATION = RandomizationConfig(
    friction=(1.0, 1.0),
    joint_damping=(1.0, 1.0),
    joint_friction=(1.0, 1.0),
    armature=(1.0, 1.0),
    mass=(1.0, 1.0),
    stiffness=(1.0, 1.0),
    damping=(1.0, 1.0),
    scale=(1.0, 1.0),
    scales=1,
    position_m=0.0,
    yaw_rad=0.0,
    start_rad=0.0,
    delay_steps=(0, 0),
    gripper_latency_s=(0.3, 0.3),
    estimate_bias_m=0.0,
    estimate_noise_m=0.0,
    estimate_yaw_rad=0.0,
    part_noise=0.0,
    estimate_delay_steps=(0, 0),
    push_n=(0.0, 0.0),
    force_bias_n=0.0,
    force_noise_n=0.0,
)
"""Ranges without randomization."""
