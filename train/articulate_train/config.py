"""Configuration of a training run: keys of the YAML files and flags of ``train``.

Nothing here imports numpy, so that ``--help`` is fast.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from articulate.commands.fields import ADVANCED
from articulate.config import check_above_0, check_bounds
from articulate.errors import ConfigError, nearest
from articulate.robot.config import ControlConfig
from articulate.task.randomization_config import (
    GOAL_ERROR_RANGE,
    MAX_RANGE_FACTOR,
    RandomizationConfig,
)
from articulate_envs.config import EngineName, InitialStatesConfig, WarpConfig
from articulate_envs.physics import PhysicsConfig
from articulate_envs.rewards import RewardConfig

if TYPE_CHECKING:
    pass

GENERALIST_TASKS = (
    "open_drawer", "open_door", "open_lid", "close_drawer", "close_door", "close_lid",
)  # fmt: skip
"""Tasks that the generalist policy was trained for."""
SEEDS = 2**32
"""Upper bound of seeds, that of numpy's legacy generator, which Stable-Baselines3 seeds."""


def check_least(least: int, values: Mapping[str, int]) -> None:
    """Raise ConfigError for the first of ``values``, by configuration key, below ``least``."""
    for name, value in values.items():
        if value < least:
            raise ConfigError(f"{name} is {value}; it must be at least {least}")


@dataclass(frozen=True, kw_only=True)
class PpoConfig:
    """Proximal policy optimization (PPO), with the parameter names of Stable-Baselines3."""

    n_envs: int = 64
    """Number of parallel environments."""
    n_steps: int = 64
    """Control steps of each environment between updates."""
    batch_size: int = 256
    """Minibatch size."""
    n_epochs: int = 4
    """Passes over the samples of an update."""
    learning_rate: float = 2e-4
    """Initial learning rate."""
    learning_rate_final: float = 1e-5
    """Learning rate at the end of the seed's control steps, exponential decay between. It decays
    with the noise of actions: large late updates undo what was learned."""
    gamma: float = 0.99
    """Discount per control step."""
    gae_lambda: float = 0.95
    """Trace decay of generalized advantage estimation."""
    clip_range: float = 0.2
    """Clipping range of the ratio of new to old policy."""
    ent_coef: float = 0.0
    """Coefficient of the entropy bonus."""
    vf_coef: float = 0.5
    """Coefficient of the value loss."""
    max_grad_norm: float = 0.5
    """Maximum gradient norm."""
    log_std_init: float = -0.8
    """Initial logarithm of the standard deviation of actions."""
    log_std_final: float = -1.9
    """Upper bound of that logarithm at the end of the seed's control steps. Evaluation uses the
    mean action; annealing the exploration noise closes the gap to it."""
    log_std_between: tuple[float, float] = (0.3, 0.8)
    """Fractions of the training between which that bound falls linearly from first to final."""
    net_arch: tuple[int, ...] = (128, 128)
    """Widths of the hidden layers of policy and value networks (ELU)."""

    def __post_init__(self) -> None:
        counts = {f"ppo.{name}": getattr(self, name) for name in ("n_envs", "n_steps", "n_epochs")}
        check_least(1, counts | {"ppo.net_arch": min(self.net_arch, default=1)})
        check_above_0(
            "ppo", self, "learning_rate", "learning_rate_final", "clip_range", "max_grad_norm"
        )
        check_bounds("ppo", self, 0.0, 1.0, "gamma", "gae_lambda")
        check_bounds("ppo", self, 0.0, math.inf, "ent_coef", "vf_coef")
        check_bounds("ppo", self, -math.inf, math.inf, "log_std_init", "log_std_final")
        size = self.n_envs * self.n_steps
        if self.batch_size < 2 or size % self.batch_size:
            raise ConfigError(
                f"ppo.batch_size is {self.batch_size}; it must divide n_envs x n_steps = {size}"
            )
        begin, end = self.log_std_between
        if not 0.0 <= begin < end <= 1.0:
            raise ConfigError(
                f"ppo.log_std_between is {begin} {end}; it must be two growing fractions in [0, 1]"
            )

    def log_std_bound(self, progress: float) -> float:
        """Return the upper bound of the log standard deviation at ``progress`` in [0, 1]."""
        begin, end = self.log_std_between
        if progress < begin:
            return math.inf
        done = min((progress - begin) / (end - begin), 1.0)
        return self.log_std_init + done * (self.log_std_final - self.log_std_init)


@dataclass(frozen=True, kw_only=True)
class ImitationConfig:
    """Imitation phase at the beginning of training.

    The policy sees the action of the scripted expert (:mod:`articulate.task.scripted_expert`) and
    corrects it. At the states it visits (DAgger; Ross, Gordon and Bagnell, 2011) it learns the
    expert's action at another sample of the noise, so that in the mean it removes the noise; the
    value function is fitted as well. PPO trains the policy for the rest of the control steps.
    """

    until: float = 0.1
    """Fraction of the seed's control steps with imitation, for each ensemble member; 0 turns
    imitation off."""
    epochs: int = 8
    """Passes over the samples of an update."""
    learning_rate: float = 1e-3
    """Learning rate of the imitation phase."""
    aggregate: bool = False
    """Fit the policy to the samples of all updates of the phase instead of those of the last."""

    def __post_init__(self) -> None:
        check_bounds("imitation", self, 0.0, 1.0, "until")
        check_above_0("imitation", self, "learning_rate")
        check_least(1, {"imitation.epochs": self.epochs})

    def is_active(self, progress: float) -> bool:
        """Return whether imitation still runs at ``progress`` in [0, 1] of the training."""
        return progress < self.until


@dataclass(frozen=True, kw_only=True)
class ActionScalingConfig:
    """Scaling of the policy's corrections near the goal."""

    at_goal: float = 0.5
    """Scale of corrections at the goal. It limits drift while the part is held, and the force on a
    closed part; 1 turns scaling off."""
    goal_range: tuple[float, float] = (-0.2, 0.0)
    """Fractions of the travel relative to the target between which ``at_goal`` fades in."""
    goal_range_max_m: float = 0.05
    """Maximum length of that range along the handle's path [m]."""

    def __post_init__(self) -> None:
        if not 0.0 < self.at_goal <= 1.0:
            raise ConfigError(
                f"action_scaling.at_goal is {self.at_goal}; it must be above 0 and at most 1"
            )
        begin, end = self.goal_range
        if not GOAL_ERROR_RANGE[0] <= begin < end <= GOAL_ERROR_RANGE[1]:
            raise ConfigError(
                f"action_scaling.goal_range is {begin} {end}; it must be two growing fractions in "
                f"[{GOAL_ERROR_RANGE[0]:g}, {GOAL_ERROR_RANGE[1]:g}]"
            )
        check_above_0("action_scaling", self, "goal_range_max_m")

    def for_path(self, path_m: float | None) -> ActionScalingConfig:
        """Return the configuration of a task whose handle moves by ``path_m`` [m].

        Args:
            path_m: Length of the handle's path from closed to open [m]; None without a handle.
        """
        begin, end = self.goal_range
        if path_m is not None:
            begin = max(begin, end - self.goal_range_max_m / path_m)
        return replace(self, goal_range=(begin, end))


@dataclass(frozen=True, kw_only=True)
class CheckpointSelectionConfig:
    """Selection of the checkpoint and of the active ensemble members.

    Success can fall again during training. Checkpoints of its second half are evaluated on
    episodes that neither training nor the evaluation uses: all on a few, the best on more.
    """

    n_checkpoints: int = 10
    """Number of candidate checkpoints, the last of the training included; 1 takes the last without
    evaluation."""
    start_fraction: float = 0.5
    """Fraction of the training after which candidates are kept, evenly spaced."""
    episodes: int = 100
    """Episodes of each candidate in the first stage."""
    finalists: int = 4
    """Candidates of the final stage."""
    final_episodes: int = 300
    """Further episodes of each finalist; both stages count."""
    member_episodes: int = 500
    """Episodes on which each ensemble member and the ensemble are evaluated; a member that is
    ahead gets as many again. 0 always uses the ensemble."""
    ood_scale: float = 1.5
    """Factor on all randomization ranges of an out-of-distribution evaluation. A single member is
    used only if it is ahead with these episodes counted too."""

    def __post_init__(self) -> None:
        least_1 = ("n_checkpoints", "episodes", "finalists", "final_episodes")
        check_least(1, {f"checkpoint_selection.{n}": getattr(self, n) for n in least_1})
        check_least(0, {"checkpoint_selection.member_episodes": self.member_episodes})
        if not 1.0 <= self.ood_scale <= MAX_RANGE_FACTOR:
            raise ConfigError(
                f"checkpoint_selection.ood_scale is {self.ood_scale}; it must be in "
                f"[1, {MAX_RANGE_FACTOR:g}]"
            )
        if not 0.0 < self.start_fraction < 1.0:
            raise ConfigError(
                f"checkpoint_selection.start_fraction is {self.start_fraction}; it must be in "
                "(0, 1)"
            )

    def candidate_steps(self, steps: int) -> tuple[int, ...]:
        """Return the control steps of all candidates of a training of ``steps`` but the last."""
        between = self.n_checkpoints - 1
        first = self.start_fraction * steps
        return tuple(round(first + (steps - first) * k / between) for k in range(between))


@dataclass(frozen=True, kw_only=True)
class FineTuningConfig:
    """Training that starts from the generalist policy.

    The values replace those of ``imitation``, ``ppo`` and ``initial_states``, which apply to
    ``initial_policy: random``. The policy explores little, and imitation on its own states fits the
    value function before PPO begins.
    """

    imitation_steps: int = 45_000
    """Control steps of each ensemble member with imitation; all of its samples are kept."""
    imitation_learning_rate: float = 5e-4
    """Learning rate of the imitation phase."""
    learning_rate: float = 5e-5
    """Initial learning rate of PPO."""
    learning_rate_final: float = 4e-5
    """Learning rate of PPO at the end of the seed's control steps, exponential decay between."""
    log_std_init: float = -1.6
    """Initial logarithm of the standard deviation of actions."""
    share_first: float = 0.3
    """Share of starts along the task at the beginning of training, in [0, 1]."""
    share_last: float = 0.1
    """Share at the end of the curriculum, in [0, 1]."""

    def __post_init__(self) -> None:
        check_least(0, {"fine_tuning.imitation_steps": self.imitation_steps})
        rates = ("imitation_learning_rate", "learning_rate", "learning_rate_final")
        check_above_0("fine_tuning", self, *rates)
        check_bounds("fine_tuning", self, 0.0, 1.0, "share_first", "share_last")
        check_bounds("fine_tuning", self, -math.inf, math.inf, "log_std_init")


@dataclass(frozen=True, kw_only=True)
class EarlyStoppingConfig:
    """Evaluations during training for ``target_success``, on held-out episodes."""

    every: int = 50_000
    """Control steps of a seed between evaluations."""
    first_episodes: int = 50
    """Episodes of an evaluation after which it ends if the policy is far from the target."""
    episodes: int = 200
    """Further episodes; both count."""

    def __post_init__(self) -> None:
        values = {n: getattr(self, n) for n in ("every", "first_episodes", "episodes")}
        check_least(1, {f"early_stopping.{name}": value for name, value in values.items()})


@dataclass(frozen=True, kw_only=True)
class TrainConfig:
    """Configuration of a training run."""

    asset: str
    """URDF, MJCF or SDF file, a folder that holds one, or an asset folder; a folder of objects or
    a quoted pattern for several."""
    task: str = "open_drawer"
    """Task; --list-tasks lists them."""
    joint: str | None = None
    """Joint of the asset; by default the reachable one with its handle nearest home height."""
    target_open: float | None = None
    """Share of the joint's range (at most 90 degrees) at which the part counts as open; by default
    0.8, or less where that is out of reach."""
    placement: tuple[float | Path, ...] | None = None
    """Pose of the object's frame before the robot's base: x y [m], yaw [degrees] and optionally the
    height z of its floor [m]; or a file from `articulate locate`. By default it is searched."""
    closed: Literal["auto", "lower", "upper", "zero"] = "auto"
    """Closed position: a joint limit, or 0 inside the range."""
    up: Literal["z", "y"] = "z"
    """Axis of the file that points up."""
    size: float | None = None
    """Longest side of the object [m]; by default its size in the file, or that of its category."""
    category: str | None = None
    """Category of the object, for its size and material; by default read from its folder."""
    seeds: tuple[int, ...] = (0, 1, 2)
    """Seeds; each is a separate training."""
    steps: int = 2_000_000
    """Control steps of experience for each seed."""
    target_success: float = 0.0
    """Success rate on held-out episodes at which the training of a seed ends, with --steps as the
    upper bound; 0 trains for all steps."""
    ensemble_size: int = 2
    """Policies of a seed, trained independently with an equal share of its control steps; their
    mean action is used. Schedules of noise, reward weights and learning rate count the control
    steps of the seed: each of two members ends half-way along them."""
    jobs: int = 0
    """Number of seeds trained in parallel; 0 means one for each processor."""
    engine: EngineName = "cpu"
    """Engine of the training: MuJoCo on the processors, or MuJoCo Warp on a GPU (extra warp). The
    policy is evaluated on the processors in either case."""
    initial_policy: Annotated[Literal["generalist", "random"], ADVANCED] = "generalist"
    """Initial weights of the policies: those of the generalist policy of the package, or random.
    Tasks open_joint and close_joint always start from random weights."""
    checkpoint_updates: Annotated[int, ADVANCED] = 20
    """Updates between checkpoints."""
    episodes: int = 200
    """Episodes for each seed in the final evaluation."""
    evaluation_seed: Annotated[int, ADVANCED] = 1_000_003
    """Random seed of the evaluation; its episodes are never used in training."""
    ppo: PpoConfig = field(default_factory=PpoConfig)
    """PPO."""
    imitation: ImitationConfig = field(default_factory=ImitationConfig)
    """Imitation of the scripted expert at the beginning of training."""
    action_scaling: ActionScalingConfig = field(default_factory=ActionScalingConfig)
    """Action scaling near the handle and the goal."""
    checkpoint_selection: CheckpointSelectionConfig = field(
        default_factory=CheckpointSelectionConfig
    )
    """Checkpoint selection."""
    fine_tuning: FineTuningConfig = field(default_factory=FineTuningConfig)
    """Training that starts from the generalist policy."""
    early_stopping: EarlyStoppingConfig = field(default_factory=EarlyStoppingConfig)
    """End of the training at the target success."""
    randomization: RandomizationConfig = field(default_factory=RandomizationConfig)
    """Domain randomization."""
    reward: RewardConfig = field(default_factory=RewardConfig)
    """Reward terms."""
    initial_states: InitialStatesConfig = field(default_factory=InitialStatesConfig)
    """Initial-state curriculum."""
    control: ControlConfig = field(default_factory=ControlConfig)
    """Control stack."""
    physics: PhysicsConfig = field(default_factory=PhysicsConfig)
    """Physics."""
    warp: WarpConfig = field(default_factory=WarpConfig)
    """Memory of the engine on MuJoCo Warp."""

    @property
    def member_steps(self) -> int:
        """Control steps of each ensemble member, rounded up."""
        return -(-self.steps // self.ensemble_size)

    @property
    def starts_from_generalist(self) -> bool:
        """True if the initial weights are those of the generalist policy."""
        return self.initial_policy == "generalist" and self.task in GENERALIST_TASKS

    def effective(self) -> TrainConfig:
        """Return the configuration with the values of ``fine_tuning`` where these apply."""
        if not self.starts_from_generalist:
            return self
        own = self.fine_tuning
        return replace(
            self,
            imitation=replace(
                self.imitation,
                until=min(own.imitation_steps / self.steps, 0.99 / self.ensemble_size),
                learning_rate=own.imitation_learning_rate,
                aggregate=True,
            ),
            ppo=replace(
                self.ppo,
                learning_rate=own.learning_rate,
                learning_rate_final=own.learning_rate_final,
                log_std_init=own.log_std_init,
                log_std_final=min(own.log_std_init, self.ppo.log_std_final),
            ),
            initial_states=replace(
                self.initial_states, share_first=own.share_first, share_last=own.share_last
            ),
        )

    def __post_init__(self) -> None:
        from articulate.task.task import TASK_RULES  # imports numpy, which --help does without

        if self.task not in TASK_RULES:
            raise ConfigError(f"unknown task {self.task!r}{nearest(self.task, TASK_RULES)}")
        seeds = self.seeds
        if not seeds or len(set(seeds)) != len(seeds) or min(seeds) < 0 or max(seeds) >= SEEDS:
            values = " ".join(map(str, seeds))
            raise ConfigError(
                f"seeds are {values}; they must be distinct, not negative and below {SEEDS}"
            )
        if not 0.0 <= self.target_success < 1.0:
            raise ConfigError(
                f"target_success is {self.target_success}; it must be at least 0 and below 1"
            )
        check_least(1, {"episodes": self.episodes, "checkpoint_updates": self.checkpoint_updates})
        check_least(1, {"ensemble_size": self.ensemble_size})
        until = self.imitation.until
        if self.ensemble_size > 1 and until * self.ensemble_size >= 1.0:
            raise ConfigError(
                f"ensemble_size is {self.ensemble_size} and imitation.until {until:g}: no control "
                "steps are left for PPO; reduce one of them"
            )
        least = self.ensemble_size * self.ppo.n_envs * self.ppo.n_steps
        if self.steps < least:
            each = f" of each of {self.ensemble_size} members" if self.ensemble_size > 1 else ""
            raise ConfigError(
                f"steps is {self.steps}; it must be at least {least}, one update{each}"
            )
        check_least(0, {"jobs": self.jobs, "evaluation_seed": self.evaluation_seed})


REPLACED = (
    "imitation.until",
    "imitation.learning_rate",
    "imitation.aggregate",
    "ppo.net_arch",
    "ppo.learning_rate",
    "ppo.learning_rate_final",
    "ppo.log_std_init",
    "initial_states.share_first",
    "initial_states.share_last",
)
"""Keys that do not apply to training from the generalist policy."""
