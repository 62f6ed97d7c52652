"""Configuration of a training run: what the YAML files and the flags of ``train`` say."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Literal

from articulate.errors import ConfigError, nearest
from articulate.robot.config import ControlConfig
from articulate.task.randomization_config import MOST_WIDER, SEEN_BEYOND, RandomizationConfig
from articulate_envs.config import RewardConfig, StartConfig
from articulate_envs.physics import PhysicsConfig

if TYPE_CHECKING:
    from articulate.task.task import Task

SEEDS = 2**32
"""Seeds are below this: numpy's older generators, which Stable-Baselines3 seeds, take no more."""


def check_least(least: int, values: Mapping[str, int]) -> None:
    """ConfigError for the first of ``values``, by the names of their flags, below ``least``."""
    for name, value in values.items():
        if value < least:
            raise ConfigError(f"{name} is {value}; it must be at least {least}")


@dataclass(frozen=True, kw_only=True)
class PpoConfig:
    """Proximal policy optimisation, as Stable-Baselines3 names its parameters."""

    n_envs: int = 64
    """Environments stepped side by side."""
    n_steps: int = 64
    """Ticks of each environment between updates."""
    batch_size: int = 256
    """Samples in a minibatch."""
    n_epochs: int = 4
    """Passes over the samples of an update."""
    learning_rate: float = 2e-4
    """Learning rate at the beginning."""
    learning_rate_last: float = 1e-5
    """Learning rate at the end of the seed's ticks, of which a member has its share; it falls by
    the same factor in the same time, so that it is small for long: noise falls too, and updates as
    large as before undo then what was learnt."""
    gamma: float = 0.99
    """Discount per tick."""
    gae_lambda: float = 0.95
    """Trace decay of the advantage."""
    clip_range: float = 0.2
    """Bound on the ratio of new to old policy."""
    ent_coef: float = 0.0
    """Weight of the entropy."""
    vf_coef: float = 0.5
    """Weight of the value loss."""
    max_grad_norm: float = 0.5
    """Gradients are scaled down to this norm."""
    log_std_init: float = -0.8
    """Logarithm of the first standard deviation of actions."""
    log_std_last: float = -1.9
    """Logarithm of the largest standard deviation of actions at the end of the seed's ticks: what
    is judged is the mean action, and one that was learnt under noise leans on it."""
    log_std_between: tuple[float, float] = (0.3, 0.8)
    """Shares of the training between which that bound falls from the first to the last, linear."""
    net: tuple[int, ...] = (128, 128)
    """Widths of the hidden layers of policy and value, ELU between."""

    def __post_init__(self) -> None:
        counts = {f"ppo.{name}": getattr(self, name) for name in ("n_envs", "n_steps", "n_epochs")}
        check_least(1, counts | {"ppo.net": min(self.net, default=1)})
        for name in ("learning_rate", "learning_rate_last"):
            if not 0.0 < getattr(self, name) < math.inf:
                raise ConfigError(f"ppo.{name} is {getattr(self, name)}; it must be above 0")
        size = self.n_envs * self.n_steps
        if self.batch_size < 2 or size % self.batch_size:
            raise ConfigError(
                f"ppo.batch_size is {self.batch_size}; it must divide n_envs x n_steps = {size}"
            )
        begin, end = self.log_std_between
        if not 0.0 <= begin < end <= 1.0:
            raise ConfigError(
                f"ppo.log_std_between is {begin} {end}; it must be two growing shares in [0, 1]"
            )

    def log_std_bound(self, progress: float) -> float:
        """Largest logarithm of a standard deviation when ``progress`` in [0, 1] is done."""
        begin, end = self.log_std_between
        if progress < begin:
            return math.inf
        done = min((progress - begin) / (end - begin), 1.0)
        return self.log_std_init + done * (self.log_std_last - self.log_std_init)


@dataclass(frozen=True, kw_only=True)
class ImitationConfig:
    """How training begins: the policy is shown what a hand would do that sees everything as it is.

    For the first ticks, which count as all others do, it learns to say what the guide
    (:mod:`articulate_envs.scripted_expert`) would say where it is itself (DAgger; Ross, Gordon and Bagnell,
    2011), from what it sees. What there is to gain beyond that, PPO finds.
    """

    until: float = 0.1
    """Share of the seed's ticks for which each member is shown; 0 shows nothing."""
    lead_until: float = 0.6
    """Share of that in which the guide acts in some environments: in all at first, linearly fewer
    to here."""
    epochs: int = 8
    """Passes over what was seen since the last update."""
    learning_rate: float = 1e-3
    """Learning rate of them."""

    def __post_init__(self) -> None:
        for name in ("until", "lead_until"):
            value = getattr(self, name)
            if not 0.0 <= value <= 1.0:
                raise ConfigError(f"show.{name} is {value}; it must be in [0, 1]")
        check_least(1, {"show.epochs": self.epochs})

    def shows(self, progress: float) -> bool:
        """Whether the policy is still shown when ``progress`` in [0, 1] of the training is done."""
        return progress < self.until

    def leads(self, progress: float) -> float:
        """Share of the environments in which the guide acts then."""
        if not self.shows(progress) or self.lead_until == 0.0:
            return 0.0
        return max(1.0 - progress / (self.until * self.lead_until), 0.0)


@dataclass(frozen=True, kw_only=True)
class ActionScalingConfig:
    """How much finer a hand that holds nothing moves near the handle."""

    share: float = 0.35
    """Share of a motion that is left there to an open hand; 1 changes nothing."""
    closing: float = 0.25
    """Share that is left there from when closing is told until the fingers have closed: that takes
    up to 2 s, and a hand that stood still meanwhile would hold the handle where it was seen."""
    near_m: float = 0.03
    """Distance of the handle up to which all of it counts [m]."""
    far_m: float = 0.10
    """Distance from which nothing of it counts [m]."""
    shut_m: tuple[float, float] = (0.072, 0.078)
    """Openings between which fingers come to count as closed, if they rest [m]: a hand opens to
    0.08 m, and holds what is at most 0.07 m thick."""
    done: float = 0.1
    """Share of a motion that is left, wherever the hand is, where the part is at its target: a
    hand that holds on to the end would drift by what a policy says without meaning it, and one
    that runs a drawer shut at 0.1 m/s presses on with 40 N, by the way that its target is ahead."""
    done_between: tuple[float, float] = (-0.2, 0.0)
    """Fractions of the part's way beyond the target between which that begins and is all of it."""
    done_m: float = 0.05
    """It begins at most so far before its end, along the handle's way [m]: a fifth of the way of a
    door is 10 cm, which a hand that turns with it takes four of its ten seconds for."""
    lead_m: tuple[float, float] = (0.06, 0.01)
    """How far the target of the tool may be ahead of the tool at the first and at the last of
    ``done_between`` [m]; what is more is taken back. A part is slow then when it meets its end, and
    is not pressed on with the sum of what was ever said."""
    lead_rad: tuple[float, float] = (0.2, 0.03)
    """The same of the joint whose target is farthest ahead [rad]: where the arm is nearly straight,
    little of it presses hard."""
    shut_between: tuple[float, float] = (0.03, 0.05)
    """Fractions of the part's way beyond the target between which the last of that falls to 0: a
    part that closes is shut there, and is not pressed on at all."""
    release: float = 3.0
    """Motion, as a share of the largest, that a tick takes back for each 5 cm or 0.2 rad of it;
    nothing in tasks whose stop is far beyond the target."""
    rest_m_s: float = 0.05
    """Change of the opening from which fingers do not rest at all [m/s]; closing, they make 0.1."""

    def __post_init__(self) -> None:
        for name in ("share", "closing", "done"):
            value = getattr(self, name)
            if not 0.0 < value <= 1.0:
                raise ConfigError(f"fine.{name} is {value}; it must be above 0 and at most 1")
        if not 0.0 <= self.near_m < self.far_m:
            raise ConfigError(
                f"fine.near_m is {self.near_m} and fine.far_m {self.far_m}; they must grow from 0"
            )
        for name in ("done_between", "shut_between"):
            begin, end = getattr(self, name)
            if not SEEN_BEYOND[0] <= begin < end <= SEEN_BEYOND[1]:
                raise ConfigError(
                    f"fine.{name} is {begin} {end}; it must be two growing fractions in "
                    f"[{SEEN_BEYOND[0]:g}, {SEEN_BEYOND[1]:g}]"
                )
        begin, end = self.shut_m
        if not 0.0 <= begin < end:
            raise ConfigError(f"fine.shut_m is {begin} {end}; it must be two growing openings")
        for name in ("done_m", "rest_m_s"):
            if not getattr(self, name) > 0.0:
                raise ConfigError(f"fine.{name} is {getattr(self, name)}; it must be above 0")
        self._check_leads()

    def _check_leads(self) -> None:
        for name in ("lead_m", "lead_rad"):
            first, last = getattr(self, name)
            if not math.inf > first >= last >= 0.0:
                raise ConfigError(
                    f"fine.{name} is {first} {last}; it must be finite and fall, not below 0"
                )
        if not 0.0 <= self.release < math.inf:
            raise ConfigError(f"fine.release is {self.release}; it must be finite and at least 0")

    def of(self, task: Task, way_m: float | None) -> ActionScalingConfig:
        """What counts for ``task``.

        Leads are taken back where a part meets its stop; one that is farther beyond the target than
        policies see presses on nothing, and a lid that is held open sags by what is taken back.

        Args:
            task: The task.
            way_m: How far the handle goes from closed to open [m]; None if there is none.
        """
        stop = math.inf if task.stop is None else abs(task.stop - task.target)
        release = self.release if stop <= SEEN_BEYOND[1] else 0.0
        begin, end = self.done_between
        if way_m is not None:
            begin = max(begin, end - self.done_m / way_m)
        return replace(self, release=release, done_between=(begin, end))


@dataclass(frozen=True, kw_only=True)
class CheckpointSelectionConfig:
    """Which state of a training is kept as its policy.

    What a policy has learnt it can lose again while training goes on. States of the second half are
    judged as an evaluation would, on draws that are neither training's nor the evaluation's, and
    the best is kept: each first on a few episodes, then the best of them on more.
    """

    states: int = 10
    """States that are judged, the last of training among them; 1 takes the last unseen."""
    since: float = 0.5
    """Share of the training after which the first of them is; the others follow evenly."""
    episodes: int = 100
    """Drawn episodes that each of them is judged on first."""
    finalists: int = 4
    """So many go on."""
    more: int = 300
    """Drawn episodes that these are judged on besides; the better counts over both."""
    alone: int = 500
    """Drawn episodes on which each member of the chosen state is judged alone, and all together;
    where one is ahead, it is judged on as many once more. 0 lets all act."""
    wider: float = 1.5
    """One acts alone where it is ahead as well with as many draws counted along for which every
    range is so many times as wide."""

    def __post_init__(self) -> None:
        counts = {f"select.{name}": getattr(self, name) for name in ("states", "episodes")}
        check_least(1, counts | {"select.finalists": self.finalists, "select.more": self.more})
        check_least(0, {"select.alone": self.alone})
        if not 1.0 <= self.wider <= MOST_WIDER:
            raise ConfigError(f"select.wider is {self.wider}; it must be in [1, {MOST_WIDER:g}]")
        if not 0.0 < self.since < 1.0:
            raise ConfigError(f"select.since is {self.since}; it must be in (0, 1)")

    def moments(self, steps: int) -> tuple[int, ...]:
        """Ticks after which states are kept in a training of ``steps``, but for the last."""
        between = self.states - 1
        first = self.since * steps
        return tuple(round(first + (steps - first) * k / between) for k in range(between))


@dataclass(frozen=True, kw_only=True)
class TrainConfig:
    """What is trained on what, and how."""

    asset: str
    """URDF or MJCF file, a folder that holds one, or an asset folder; a folder of objects or a
    quoted pattern for many."""
    task: str = "open_drawer"
    """What is asked; --list-tasks lists the names."""
    joint: str | None = None
    """Joint of the asset; by default the reachable one with its handle nearest home height."""
    closed: Literal["auto", "lower", "upper"] = "auto"
    """Which limit of the joint is its closed end."""
    size: float | None = None
    """Longest side of the object [m]; by default its own size, or that of its category."""
    category: str | None = None
    """Category of the object, for its size and material; by default what its folder says."""
    seeds: tuple[int, ...] = (0, 1, 2)
    """One training for each."""
    steps: int = 2_000_000
    """Ticks of experience for each seed."""
    members: int = 2
    """Policies that a seed trains in turn, each from weights of its own and with its share of the
    ticks; the mean of their actions acts. Schedules of noise, reward weights and learning rate
    count the ticks of the seed: of two members, each ends half-way along them."""
    jobs: int = 0
    """Seeds trained side by side; 0 means one for each processor."""
    checkpoint_updates: int = 20
    """Updates between checkpoints."""
    episodes: int = 200
    """Episodes for each seed in the evaluation at the end."""
    evaluation_seed: int = 1_000_003
    """Decides the draws of the evaluation; they are none of training's."""
    ppo: PpoConfig = field(default_factory=PpoConfig)
    """Algorithm."""
    show: ImitationConfig = field(default_factory=ImitationConfig)
    """What training begins with."""
    fine: ActionScalingConfig = field(default_factory=ActionScalingConfig)
    """Finer motions near the handle."""
    select: CheckpointSelectionConfig = field(default_factory=CheckpointSelectionConfig)
    """Which state of the training is kept."""
    draw: RandomizationConfig = field(default_factory=RandomizationConfig)
    """Randomisation."""
    reward: RewardConfig = field(default_factory=RewardConfig)
    """Reward."""
    starts: StartConfig = field(default_factory=StartConfig)
    """Starts along the task."""
    follow: ControlConfig = field(default_factory=ControlConfig)
    """Plant between the policy's tick and the joints."""
    physics: PhysicsConfig = field(default_factory=PhysicsConfig)
    """Physics."""

    @property
    def member_steps(self) -> int:
        """Ticks of experience of each of a seed's members, rounded up."""
        return -(-self.steps // self.members)

    def __post_init__(self) -> None:
        from articulate.task.task import TASK_RULES  # brings numpy, which --help does without

        if self.task not in TASK_RULES:
            raise ConfigError(f"unknown task {self.task!r}{nearest(self.task, TASK_RULES)}")
        seeds = self.seeds
        if not seeds or len(set(seeds)) != len(seeds) or min(seeds) < 0 or max(seeds) >= SEEDS:
            shown = " ".join(map(str, seeds))
            raise ConfigError(
                f"seeds are {shown}; they must be distinct, not negative and below {SEEDS}"
            )
        check_least(1, {"episodes": self.episodes, "checkpoint_updates": self.checkpoint_updates})
        check_least(1, {"members": self.members})
        if self.members > 1 and self.show.until * self.members >= 1.0:
            raise ConfigError(
                f"members is {self.members} and show.until {self.show.until:g}: each would only be "
                "shown, and learn nothing of its own; give less of one of them"
            )
        least = self.members * self.ppo.n_envs * self.ppo.n_steps
        if self.steps < least:
            each = f" of each of {self.members} members" if self.members > 1 else ""
            raise ConfigError(
                f"steps is {self.steps}; one update{each} alone takes {least}, give more"
            )
        check_least(0, {"jobs": self.jobs, "evaluation_seed": self.evaluation_seed})
