"""Configuration of the randomization, without arrays: `--help` does not load numpy."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Any

from articulate.errors import ConfigError

Range = tuple[float, float]
FACTORS = (
    "friction", "joint_damping", "joint_friction", "armature", "mass", "stiffness", "damping",
    "scale",
)  # fmt: skip
"""Ranges that multiply a nominal value."""
LOG_UNIFORM = ("joint_damping", "joint_friction", "armature")
"""Those that are drawn evenly over the logarithm."""
MAX_DELAY_STEPS = 5
"""Longest delay that engines and estimators keep [ticks]."""
MAX_RANGE_FACTOR = 100.0
"""Ranges may be so many times as wide at most."""
GOAL_ERROR_RANGE: Range = (-0.2, 0.1)
"""Fractions of a part's way beyond its task's target between which policies see it finely."""


@dataclass(frozen=True, kw_only=True)
class RandomizationConfig:
    """Ranges of the randomisation. Factors multiply the nominal value, ``±`` is added."""

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
    """How many sizes are prepared between the ends of ``scale``."""
    position_m: float = 0.03
    """The object is moved by up to ± this along x and y [m]."""
    yaw_rad: float = 0.1745
    """The object is turned by up to ± this about the vertical through its handle [rad]."""
    start_rad: float = 0.1
    """Each joint begins within ± this of its start [rad]."""
    delay_steps: tuple[int, int] = (0, 2)
    """Delay of the motions, whole ticks, both ends included."""
    gripper_latency_s: Range = (0.1, 1.2)
    """From a command of the hand to its motion [s]."""
    estimate_bias_m: float = 0.004
    """Standard deviation of the handle's constant position error, each axis [m]."""
    estimate_noise_m: float = 0.003
    """Standard deviation of its error anew each tick, each axis [m]."""
    estimate_yaw_rad: float = 0.01745
    """Standard deviation of the handle's constant yaw error [rad]."""
    part_noise: float = 0.0167
    """Standard deviation of the measured opening, anew each tick, as a share of 0.3 m or 1 rad."""
    estimate_delay_steps: tuple[int, int] = (0, 2)
    """Age of the object's state, whole ticks, both ends included."""
    push_n: Range = (0.0, 5.0)
    """Force of a push on the moving part, once in an episode, any direction [N]."""
    force_bias_n: float = 1.5
    """Standard deviation of the constant error of the force that is felt, each axis [N]."""
    force_noise_n: float = 0.5
    """Standard deviation of its error anew each tick, each axis [N]."""

    def __post_init__(self) -> None:
        if self.scales < 1:
            raise ConfigError(f"randomization.scales is {self.scales}; it must be at least 1")
        for f in fields(self):
            value = getattr(self, f.name)
            if isinstance(value, tuple) and value[0] > value[1]:
                raise ConfigError(f"randomization.{f.name} is {value}; the smaller number comes first")
            if f.name in FACTORS and not value[0] > 0.0:
                raise ConfigError(f"randomization.{f.name} is {value}; factors must be above 0")
            if f.name.endswith("delay_steps") and not 0 <= value[0] <= value[1] <= MAX_DELAY_STEPS:
                raise ConfigError(
                    f"randomization.{f.name} is {value}; it must lie within 0 to {MAX_DELAY_STEPS} ticks"
                )

    def widened(self, factor: float) -> RandomizationConfig:
        """Every range ``factor`` times as wide.

        Factors are widened about 1, those drawn over the logarithm there; what begins at 0 still
        does; other ranges are widened about their middle and do not fall below 0; whole ticks are
        rounded up from a half on. At a factor of 1 all is as it was, to the bit.

        Raises:
            ConfigError: A range would hold what cannot be, such as a negative friction.
        """
        if not 0.0 < factor <= MAX_RANGE_FACTOR:
            raise ConfigError(
                f"ranges are to be {factor:g} times as wide; it must be above 0 and at most "
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
            raise ConfigError(f"ranges {factor:g} times as wide: {error}") from None

    @property
    def scale_values(self) -> tuple[float, ...]:
        """The sizes that are prepared."""
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
"""Nothing is randomised."""
