"""Reward: a sum of named terms, each a function with its weight and parameters.

To add a term, write its parameters, its function marked with :func:`reward_term`, and its field of
:class:`RewardConfig`, all in this module. The engine compiles the functions into its loop
(:mod:`articulate_envs.compiled`). The module loads no numpy, for the sake of ``--help``.
"""

from __future__ import annotations

import math
from collections import namedtuple
from collections.abc import Callable
from dataclasses import dataclass, field, fields
from typing import TYPE_CHECKING, Any, NamedTuple

from articulate.config import check_above_0, check_bounds
from articulate.errors import ConfigError
from articulate.jit import row_function
from articulate.task.grasp import HELD_SHARE, Grasp

if TYPE_CHECKING:
    from articulate.task.task import Task

TOUCH_M = 0.008
"""Fingers further apart than a handle's thickness and this do not both touch it [m]."""


class RewardTask(NamedTuple):
    """Constants of a task and its handle."""

    closes: bool = False
    """True if the part is moved towards its closed end."""
    first: float = 0.0
    """Fraction open at which the part may begin furthest from its target."""
    target: float = 0.8
    """Fraction open at which the task counts as done."""
    stop: float = 1.0
    """Fraction at which the part hits its stop; NaN without a stop."""
    length_m: float = 1.0
    """Length for a unit of the part's speed [m]."""
    along_m: float = 0.0
    """Distance from the handle's middle along its long axis that still counts as its middle [m]."""
    thick_m: float = 0.0
    """Thickness of the handle between the fingers [m]."""
    beside_m: float = 0.0
    """Position of the handle's middle along the closing axis of the gripper [m]; all places from 0
    to it count as its middle."""
    pad_m: float = 0.008
    """Extent of the finger pads along the approach [m]."""


@dataclass(frozen=True, kw_only=True)
class Travel:
    """Shape of the reward over the travel of the part, for ``open``, ``progress`` and ``rest``."""

    margin: float = 0.12
    """Margin beyond the target up to which travel is rewarded, as a share of the travel to the
    target, at most half the room to the stop. The estimate of the part is noisy, and a policy that
    aims at the target itself stops short of it."""
    overshoot: float = 0.5
    """Share of the reward that is lost between that margin and the part's stop, which jerks the
    gripper."""
    overshoot_room: float = 0.1
    """Least fraction of travel on which that share is lost: if the stop is nearer (closing tasks),
    reaching it costs in proportion less."""
    violated_share: float = 0.3
    """Share of the reward after a violation, at the end of training; all of it at the beginning,
    linear between (otherwise too little is learned of opening)."""


class RewardState(NamedTuple):
    """Quantities of one control step of one environment that terms are made of."""

    task: RewardTask = RewardTask()
    travel: Travel = Travel()
    progress: float = 0.0
    """Progress of the annealed weights, in [0, 1]."""
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Tool in the axes of the handle: along, across, approach [m]."""
    angle: float = 0.0
    """Angle between tool and handle [rad]."""
    last_offset: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """The same one control step earlier."""
    last_angle: float = 0.0
    across: float = 0.0
    """Handle across the fingers, in the axes of the tool [m]."""
    ahead: float = 0.0
    """Handle ahead of the fingers, in the axes of the tool [m]."""
    width: float = 0.08
    """Opening between the fingers [m]."""
    command: float = -1.0
    """Number of the policy for the gripper, in [-1, 1]."""
    smooth: float = -1.0
    """Smoothed command."""
    closing: float = -1.0
    """Motion of the fingers, +1 close, -1 open."""
    opened: float = 0.0
    """Fraction open."""
    last_opened: float = 0.0
    speed: float = 0.0
    """Speed of the part [m/s or rad/s]."""
    at_rest: bool = False
    """True if the part is at rest at or beyond its target."""
    force: float = 0.0
    """Filtered net force on the gripper [N]."""
    motion: float = 0.0
    """Mean square of the requested motion."""
    violated: bool = False
    """True after a limit has been violated."""
    last_violated: bool = False
    succeeded: bool = False
    """True at the end of a successful episode, False otherwise."""


TERM_FUNCTIONS: dict[str, Callable[[Any, RewardState], float]] = {}
"""Functions of the terms by name, in the order in which they are recorded."""


def reward_term(function: Callable[[Any, RewardState], float]) -> Callable[..., float]:
    """Register a term under the name of its function, which is its field of the configuration."""
    TERM_FUNCTIONS[function.__name__.removesuffix("_term")] = function
    return row_function(function)


@row_function
def anneal(first: float, last: float, progress: float) -> float:
    """Return the value between ``first`` and ``last`` at ``progress`` in [0, 1]."""
    return first + progress * (last - first)


@row_function
def distance(offset: tuple[float, float, float]) -> float:
    """Return the length [m] of an offset."""
    return math.sqrt(offset[0] ** 2 + offset[1] ** 2 + offset[2] ** 2)


@row_function
def clip(value: float, low: float, high: float) -> float:
    """Return ``value`` within ``low`` and ``high``."""
    return min(max(value, low), high)


@dataclass(frozen=True, kw_only=True)
class Approach:
    """Potential for the distance between tool and handle."""

    weight: float = 100.0
    """Reward per metre of approach in a control step; a retreat takes it back, as for a potential
    (Ng, Harada and Russell 1999)."""
    across: float = 2.0
    """Factor on the distance across the fingers, which must straddle the handle first."""
    turn_m: float = 0.1
    """Weight of the angle between gripper and handle in the distance [m/rad]."""


@row_function
def _approach_distance(p: Approach, offset: tuple[float, float, float], angle: float) -> float:
    return distance((offset[0], p.across * offset[1], offset[2])) + p.turn_m * angle


@reward_term
def approach(p: Approach, s: RewardState) -> float:
    """Reward the decrease of distance and angle between tool and handle."""
    before = _approach_distance(p, s.last_offset, s.last_angle)
    return p.weight * (before - _approach_distance(p, s.offset, s.angle))


@dataclass(frozen=True, kw_only=True)
class Reach:
    """Reward for a tool near the handle."""

    weight: float = 0.8
    """Weight of the mean of 1 / (1 + (d / scale)^2) over two scales."""
    scales_m: tuple[float, float] = (0.08, 0.015)
    """Scales [m]: one pulls the tool near, the other onto the handle."""


@row_function
def nearness(d: float, scale_m: float) -> float:
    """Return 1 at the handle, and 1/2 at the distance ``scale_m`` [m]."""
    return 1.0 / (1.0 + (d / scale_m) ** 2)


@reward_term
def reach(p: Reach, s: RewardState) -> float:
    """Reward a tool near the handle."""
    d = distance(s.offset)
    return p.weight * 0.5 * (nearness(d, p.scales_m[0]) + nearness(d, p.scales_m[1]))


@dataclass(frozen=True, kw_only=True)
class Align:
    """Reward for a gripper that is aligned with the handle."""

    weight: float = 0.4
    """Weight, scaled by the nearness of the handle."""
    scale_rad: float = 0.35
    """Angle at which the reward is 1/e of its maximum [rad]."""
    scale_m: float = 0.08
    """Distance at which it is half of its maximum [m]."""


@reward_term
def align(p: Align, s: RewardState) -> float:
    """Reward the orientation of a gripper near the handle."""
    return (
        p.weight
        * nearness(distance(s.offset), p.scale_m)
        * math.exp(-((s.angle / p.scale_rad) ** 2))
    )


@row_function
def closing_share(s: RewardState) -> float:
    """Return how far the gripper is closed, in [0, 1]: a quarter each for command and its average.

    Both count from -1 on, not from 0: otherwise nothing moves a policy away from the middle, where
    exploration noise opens and closes the gripper and the deployed mean action does neither.
    """
    share = 0.125 * (1.0 + clip(s.command, -1.0, 1.0)) + 0.125 * (1.0 + s.smooth)
    return share + 0.5 if s.closing > 0.0 else share


@row_function
def may_hold(width: float, thick_m: float) -> bool:
    """Return True if a handle can be between fingers that are ``width`` [m] apart."""
    return width >= HELD_SHARE * thick_m or thick_m <= 0.0


@dataclass(frozen=True, kw_only=True)
class Grip:
    """Reward for a gripper that closes at the handle."""

    weight: float = 0.5
    """Weight; a gripper that has closed on nothing gets none, as it must open again."""
    scale_m: float = 0.018
    """Distance at which the reward is 1/e of its maximum, at the beginning of training [m]."""
    final_scale_m: float = 0.010
    """The same at the end; linear between. A handle that is held off its middle slips out while it
    is pulled, and a narrow optimum is found only from near it."""


@reward_term
def grip(p: Grip, s: RewardState) -> float:
    """Reward a command to close, and closed fingers, at the handle."""
    if not may_hold(s.width, s.task.thick_m):
        return 0.0
    scale_m = anneal(p.scale_m, p.final_scale_m, s.progress)
    return p.weight * math.exp(-((distance(s.offset) / scale_m) ** 2)) * closing_share(s)


@dataclass(frozen=True, kw_only=True)
class PrematureClose:
    """Penalty for a gripper that closes away from the handle, or has closed on nothing."""

    weight: float = -0.25
    """Weight at the beginning of training."""
    final_weight: float = -0.75
    """Weight at the end; linear between. A high penalty at first would suppress closing before its
    use has been learned."""
    scale_m: float = 0.0396
    """Distance at which 63 % of the penalty applies, at the beginning of training [m]."""
    final_scale_m: float = 0.022
    """The same at the end; linear between."""


@reward_term
def premature_close(p: PrematureClose, s: RewardState) -> float:
    """Penalize a command to close, and closed fingers, away from the handle."""
    away = 1.0
    if may_hold(s.width, s.task.thick_m) or not s.closing > 0.0:
        scale_m = anneal(p.scale_m, p.final_scale_m, s.progress)
        away = 1.0 - math.exp(-((distance(s.offset) / scale_m) ** 2))
    return anneal(p.weight, p.final_weight, s.progress) * away * closing_share(s)


@dataclass(frozen=True, kw_only=True)
class LateralOffset:
    """Penalty for leaving the corridor between the fingers.

    ``approach`` is equal for every path. This term bends the path: across first, then ahead, so
    that no finger lands on the handle.
    """

    weight: float = -150.0
    """Penalty per metre at the end of training; in proportion before."""
    free_share: float = 0.45
    """Half width of the corridor at the handle, as a share of the room between the fingers."""
    free_from_m: float = 0.07
    """Distance before the handle from which the corridor widens as fast as the distance [m]."""
    max_m: float = 0.02
    """Largest offset that counts [m]: an episode that begins 12 cm beside the handle of a lid would
    lose ten times the reward of its success."""
    overreach_m: float = 0.003
    """Free distance of the gripper beyond the handle [m]: the fingertips have 5 mm there. A gripper
    that holds the handle cannot change it and does not pay for it."""


@reward_term
def lateral_offset(p: LateralOffset, s: RewardState) -> float:
    """Penalize a handle beside the corridor, and a gripper beyond a handle that it does not hold.

    A handle that may be between the fingers costs from halfway through training on, until both
    fingers can touch it: a gripper that closes on a knob from one side pushes it out.
    """
    thick_m = s.task.thick_m
    room = max(s.width - thick_m, 0.0) / 2.0
    allowed = p.free_share * room + max(s.ahead - p.free_from_m, 0.0)
    beside = clip(abs(s.across) - allowed, 0.0, p.max_m)
    holds, touched = may_hold(s.width, thick_m), s.width <= thick_m + TOUCH_M
    if holds and s.ahead <= s.task.pad_m and abs(s.across) <= thick_m / 2.0:
        beside *= 0.0 if touched else max(2.0 * s.progress - 1.0, 0.0)
    if not (holds and touched and thick_m > 0.0):
        beside += max(-s.ahead - p.overreach_m, 0.0)
    return p.weight * s.progress * beside


@row_function
def goal_fraction(travel: Travel, task: RewardTask) -> float:
    """Return the fraction open up to which travel is rewarded: the target and a margin beyond."""
    goal = task.first + (task.target - task.first) * (1.0 + travel.margin)
    if task.closes:
        return max(goal, task.target / 5.0)
    if task.stop == task.stop:  # not NaN
        return min(goal, (task.target + task.stop) / 2.0)
    return goal


@row_function
def travel_share(travel: Travel, task: RewardTask, opened: float) -> float:
    """Return the rewarded share of the travel to the target, at most 1.

    A closing part counts from either side: without a stop it can pass its closed end.
    """
    goal, sign = goal_fraction(travel, task), -1.0 if task.closes else 1.0
    opened = abs(opened) if task.closes else opened
    share = clip((opened - task.first) / (goal - task.first), 0.0, 1.0)
    if task.stop != task.stop:  # NaN: no stop
        return share
    room = max(sign * (task.stop - goal), travel.overshoot_room)
    return share - travel.overshoot * clip(sign * (opened - goal) / room, 0.0, 1.0)


@row_function
def violation_share(s: RewardState) -> float:
    """Return the share of the travel reward that is left after a violation."""
    return anneal(1.0, s.travel.violated_share, s.progress) if s.violated else 1.0


@dataclass(frozen=True, kw_only=True)
class Open:
    """Reward for the travel of the part so far, in every control step."""

    weight: float = 0.6
    """Weight. A higher one makes a policy impatient: it closes the gripper on the way and pulls
    before it has closed."""


@reward_term
def open_term(p: Open, s: RewardState) -> float:
    """Reward the share of the travel to the target."""
    return p.weight * violation_share(s) * travel_share(s.travel, s.task, s.opened)


@dataclass(frozen=True, kw_only=True)
class Progress:
    """Reward for a change of the travel of the part."""

    weight: float = 60.0
    """Reward for the complete travel; moving back takes it back."""


@reward_term
def progress(p: Progress, s: RewardState) -> float:
    """Reward the change of the share of travel."""
    change = travel_share(s.travel, s.task, s.opened)
    change -= travel_share(s.travel, s.task, s.last_opened)
    return p.weight * violation_share(s) * change


@dataclass(frozen=True, kw_only=True)
class Rest:
    """Reward for a part at rest beyond its target."""

    weight: float = 0.6
    """Weight at the end of the margin; none at the target itself, where a policy's mean action
    would stop short at 0.79."""


@reward_term
def rest(p: Rest, s: RewardState) -> float:
    """Reward a part at rest, by its distance beyond the target."""
    if not s.at_rest:
        return 0.0
    opened = abs(s.opened) if s.task.closes else s.opened
    margin = goal_fraction(s.travel, s.task) - s.task.target
    share = 1.0  # the target is the end of the travel
    if margin != 0.0:
        share = clip((opened - s.task.target) / margin, 0.0, 1.0)
    return p.weight * violation_share(s) * share


@dataclass(frozen=True, kw_only=True)
class Force:
    """Penalty for contact force."""

    weight: float = -0.02
    """Penalty per newton at the beginning of training."""
    final_weight: float = -0.16
    """The same at the end; linear between (a high penalty at first keeps the gripper off)."""
    free_n: float = 15.0
    """Force without penalty [N]."""


@reward_term
def force(p: Force, s: RewardState) -> float:
    """Penalize the filtered force on the gripper."""
    return anneal(p.weight, p.final_weight, s.progress) * max(s.force - p.free_n, 0.0)


@dataclass(frozen=True, kw_only=True)
class Speed:
    """Penalty for a fast part."""

    weight: float = -2.0
    """Penalty per m/s, or per 0.2 rad/s."""
    free_m_s: float = 0.15
    """Speed without penalty [m/s]."""


@reward_term
def speed(p: Speed, s: RewardState) -> float:
    """Penalize the speed of the part."""
    return p.weight * max(abs(s.speed) * s.task.length_m - p.free_m_s, 0.0)


@dataclass(frozen=True, kw_only=True)
class Action:
    """Penalty for large actions."""

    weight: float = -0.01
    """Weight of the mean square of the motion."""


@reward_term
def action(p: Action, s: RewardState) -> float:
    """Penalize the requested motion."""
    return p.weight * s.motion


@dataclass(frozen=True, kw_only=True)
class Violation:
    """Penalty for the first violation of a limit."""

    weight: float = -40.0
    """Penalty at the end of training; in proportion before. With half of it a policy pushed too
    hard on a closed door in one of six episodes."""


@reward_term
def violation(p: Violation, s: RewardState) -> float:
    """Penalize the control step in which a limit is violated first."""
    return p.weight * s.progress if s.violated and not s.last_violated else 0.0


@dataclass(frozen=True, kw_only=True)
class Success:
    """Reward at the end of a successful episode."""

    weight: float = 60.0
    """Reward, once. All other terms pay per control step, and a part that creeps back in the last
    second loses next to nothing by them."""


@reward_term
def success(p: Success, s: RewardState) -> float:
    """Reward the end of a successful episode."""
    return p.weight if s.succeeded else 0.0


TERMS = tuple(TERM_FUNCTIONS)
"""Names of the terms in that order."""


@dataclass(frozen=True, kw_only=True)
class RewardConfig:
    """Parameters of all terms; the reward of a control step is their sum."""

    approach: Approach = field(default_factory=Approach)
    """Distance between tool and handle, as a potential."""
    reach: Reach = field(default_factory=Reach)
    """Tool near the handle."""
    align: Align = field(default_factory=Align)
    """Gripper aligned with the handle."""
    grip: Grip = field(default_factory=Grip)
    """Gripper that closes at the handle."""
    premature_close: PrematureClose = field(default_factory=PrematureClose)
    """Gripper that closes elsewhere."""
    lateral_offset: LateralOffset = field(default_factory=LateralOffset)
    """Handle beside the corridor between the fingers."""
    open: Open = field(default_factory=Open)
    """Travel of the part."""
    progress: Progress = field(default_factory=Progress)
    """Change of that travel."""
    rest: Rest = field(default_factory=Rest)
    """Part at rest beyond its target."""
    force: Force = field(default_factory=Force)
    """Contact force."""
    speed: Speed = field(default_factory=Speed)
    """Speed of the part."""
    action: Action = field(default_factory=Action)
    """Size of the actions."""
    violation: Violation = field(default_factory=Violation)
    """First violation of a limit."""
    success: Success = field(default_factory=Success)
    """Success at the end of an episode."""
    travel: Travel = field(default_factory=Travel)
    """Shape of ``open``, ``progress`` and ``rest`` over the travel of the part."""
    until: float = 0.6
    """Share of the training after which annealed parameters have their last values."""

    def __post_init__(self) -> None:
        if not 0.0 < self.until <= 1.0:
            raise ConfigError(f"reward.until is {self.until}; it must be above 0 and at most 1")
        for name in (*TERMS, "travel"):
            term = getattr(self, name)
            names = [f.name for f in fields(term)]
            check_bounds(f"reward.{name}", term, -math.inf, math.inf, *names)
            check_above_0(f"reward.{name}", term, *(n for n in names if "scale" in n))  # divisors


def _number_types() -> dict[type, Any]:
    """Return a named tuple type for each dataclass of parameters, as a name of this module.

    Compiled functions that are cached on disk find their types by name.
    """
    kinds = [type(getattr(RewardConfig(), f.name)) for f in fields(RewardConfig)]
    out = {}
    for kind in (k for k in kinds if k is not float):
        name = f"{kind.__name__}Numbers"
        out[kind] = namedtuple(name, [f.name for f in fields(kind)], module=__name__)
        globals()[name] = out[kind]
    return out


_NUMBER_TYPES = _number_types()


def as_numbers(params: Any) -> Any:
    """Return a dataclass of parameters as a named tuple of floats, for compiled functions."""
    values = (getattr(params, f.name) for f in fields(params))
    kind = _NUMBER_TYPES[type(params)]
    return kind(*(v if isinstance(v, tuple) else float(v) for v in values))


def term_params(config: RewardConfig) -> tuple[Any, ...]:
    """Return the parameters of all :data:`TERMS` in their order, for compiled functions."""
    return tuple(as_numbers(getattr(config, name)) for name in TERMS)


def reward_task(task: Task, grasp: Grasp) -> RewardTask:
    """Return the constants of ``task`` and of the grasp of its handle."""
    from articulate.robot.arm import PAD_M  # imports numpy

    return RewardTask(
        closes=task.closes,
        first=float(task.begin[1]),
        target=float(task.target),
        stop=math.nan if task.stop is None else float(task.stop),
        length_m=1.0 if task.kind == "slide" else 0.2,
        along_m=float(grasp.along_m),
        thick_m=float(grasp.thick_m),
        beside_m=float(grasp.beside_m),
        pad_m=PAD_M,
    )
