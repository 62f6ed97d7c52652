"""Draws: what was randomised in an episode, recorded with it."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from articulate.errors import ConfigError
from articulate.transforms import Array

Range = tuple[float, float]
FACTORS = (
    "friction", "joint_damping", "joint_friction", "armature", "mass", "stiffness", "damping",
    "scale",
)  # fmt: skip
"""Ranges that multiply a nominal value."""
LOG_UNIFORM = ("joint_damping", "joint_friction", "armature")
"""Those that are drawn evenly over the logarithm."""
MAX_DELAY_TICKS = 5
"""Longest delay that engines and estimators keep [ticks]."""


@dataclass(frozen=True, kw_only=True)
class DrawConfig:
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
    delay_ticks: tuple[int, int] = (0, 2)
    """Delay of the motions, whole ticks, both ends included."""
    hand_latency_s: Range = (0.1, 1.2)
    """From a command of the hand to its motion [s]."""
    estimate_bias_m: float = 0.004
    """Standard deviation of the handle's constant position error, each axis [m]."""
    estimate_noise_m: float = 0.003
    """Standard deviation of its error anew each tick, each axis [m]."""
    estimate_yaw_rad: float = 0.01745
    """Standard deviation of the handle's constant yaw error [rad]."""
    part_noise: float = 0.0167
    """Standard deviation of the measured opening, anew each tick, as a share of 0.3 m or 1 rad."""
    estimate_delay_ticks: tuple[int, int] = (0, 2)
    """Age of the object's state, whole ticks, both ends included."""
    push_n: Range = (0.0, 5.0)
    """Force of a push on the moving part, once in an episode, any direction [N]."""

    def __post_init__(self) -> None:
        if self.scales < 1:
            raise ConfigError(f"draw.scales is {self.scales}; it must be at least 1")
        for f in fields(self):
            value = getattr(self, f.name)
            if isinstance(value, tuple) and value[0] > value[1]:
                raise ConfigError(f"draw.{f.name} is {value}; the smaller number comes first")
            if f.name in FACTORS and not value[0] > 0.0:
                raise ConfigError(f"draw.{f.name} is {value}; factors must be above 0")
            if f.name.endswith("delay_ticks") and not 0 <= value[0] <= value[1] <= MAX_DELAY_TICKS:
                raise ConfigError(
                    f"draw.{f.name} is {value}; it must lie within 0 to {MAX_DELAY_TICKS} ticks"
                )

    def widened(self, factor: float) -> DrawConfig:
        """Every range ``factor`` times as wide.

        Factors are widened about 1, those drawn over the logarithm there; what begins at 0 still
        does; other ranges are widened about their middle and do not fall below 0; whole ticks are
        rounded up from a half on.

        Raises:
            ConfigError: A range would hold what cannot be, such as a negative friction.
        """
        if not (np.isfinite(factor) and factor > 0.0):
            raise ConfigError(f"ranges are to be {factor:g} times as wide; it must be above 0")
        wide: dict[str, Any] = {"scales": 1 + round((self.scales - 1) * factor)}
        for f in fields(self):
            value = getattr(self, f.name)
            if f.name in LOG_UNIFORM:
                wide[f.name] = tuple(bound**factor for bound in value)
            elif f.name in FACTORS:
                wide[f.name] = tuple(1.0 + factor * (bound - 1.0) for bound in value)
            elif f.name.endswith("delay_ticks"):
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
        if low == high:
            return (low,)
        return tuple(float(s) for s in np.linspace(low, high, self.scales))


NO_DRAW = DrawConfig(
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
    delay_ticks=(0, 0),
    hand_latency_s=(0.3, 0.3),
    estimate_bias_m=0.0,
    estimate_noise_m=0.0,
    estimate_yaw_rad=0.0,
    part_noise=0.0,
    estimate_delay_ticks=(0, 0),
    push_n=(0.0, 0.0),
)
"""Nothing is randomised."""

PUSH_S = 0.2
"""How long a push lasts [s]."""

COLUMNS = (
    "friction", "joint_damping", "joint_friction", "armature", "mass", "stiffness", "damping",
    "scale", "x_m", "y_m", "yaw_rad",
    "start_1", "start_2", "start_3", "start_4", "start_5", "start_6", "start_7",
    "delay_ticks", "hand_latency_s", "bias_x_m", "bias_y_m", "bias_z_m", "bias_yaw_rad",
    "estimate_delay_ticks", "push_x_n", "push_y_n", "push_z_n", "push_time", "part_open",
)  # fmt: skip
"""Names of a draw's numbers; ``part_open`` is the fraction open at which the part begins."""


@dataclass(frozen=True)
class Draw:
    """What was drawn for N episodes, one row each with the columns :data:`COLUMNS`."""

    values: Array

    def __getitem__(self, name: str) -> Array:
        """Column ``name`` (N,); ``"start"`` and ``"push"`` and ``"bias"`` give their blocks."""
        blocks = {"start": slice(11, 18), "bias": slice(20, 23), "push": slice(25, 28)}
        if name in blocks:
            return np.asarray(self.values[:, blocks[name]])
        return np.asarray(self.values[:, COLUMNS.index(name)])


def draw(
    config: DrawConfig, rng: np.random.Generator, n: int = 1, *, begin: Range = (0.0, 0.0)
) -> Draw:
    """Draw the parameters of N episodes from ``rng``.

    Args:
        config: Ranges.
        rng: Where the numbers come from.
        n: How many episodes.
        begin: Fractions between which the part is at their beginning, as the task says; part of
            the task and no randomisation. Nothing is drawn where both are the same.
    """

    def log_uniform(bounds: Range) -> Array:
        return np.exp(rng.uniform(np.log(bounds[0]), np.log(bounds[1]), n))

    scales = np.asarray(config.scale_values)
    direction = rng.normal(size=(n, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    push = direction * rng.uniform(*config.push_n, n)[:, None]
    columns: list[Array] = [
        rng.uniform(*config.friction, n),
        log_uniform(config.joint_damping),
        log_uniform(config.joint_friction),
        log_uniform(config.armature),
        rng.uniform(*config.mass, n),
        rng.uniform(*config.stiffness, n),
        rng.uniform(*config.damping, n),
        scales[rng.integers(len(scales), size=n)],
        config.position_m * rng.uniform(-1.0, 1.0, n),
        config.position_m * rng.uniform(-1.0, 1.0, n),
        config.yaw_rad * rng.uniform(-1.0, 1.0, n),
        *(config.start_rad * rng.uniform(-1.0, 1.0, (7, n))),
        rng.integers(config.delay_ticks[0], config.delay_ticks[1] + 1, n).astype(float),
        rng.uniform(*config.hand_latency_s, n),
        *(config.estimate_bias_m * rng.normal(size=(3, n))),
        config.estimate_yaw_rad * rng.normal(size=n),
        rng.integers(config.estimate_delay_ticks[0], config.estimate_delay_ticks[1] + 1, n).astype(
            float
        ),
        *push.T,
        rng.uniform(0.0, 0.9, n),
        rng.uniform(*begin, n) if begin[0] < begin[1] else np.full(n, begin[0]),
    ]
    return Draw(np.stack(columns, axis=1))


def at_size(config: DrawConfig, scale: float) -> DrawConfig:
    """``config`` with the object at one size."""
    return replace(config, scale=(scale, scale), scales=1)


def drawn_one_by_one(
    config: DrawConfig, seed: int, n: int, *, begin: Range = (0.0, 0.0), first: int = 0
) -> Draw:
    """Draw N episodes, each from a generator of its own: row k is the same for every N.

    Args:
        config: Ranges.
        seed: Decides all that is drawn.
        n: How many episodes.
        begin: As in :func:`draw`.
        first: Number of the first episode.
    """
    rows = [
        draw(config, np.random.default_rng(np.random.SeedSequence([seed, k])), begin=begin).values
        for k in range(first, first + n)
    ]
    return Draw(np.concatenate(rows))


def nominal_draw(n: int = 1, *, begin: Range = (0.0, 0.0)) -> Draw:
    """N episodes in which nothing is randomised; parts begin in the middle of ``begin``."""
    middle = sum(begin) / 2.0
    return draw(NO_DRAW, np.random.default_rng(0), n, begin=(middle, middle))
