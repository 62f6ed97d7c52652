"""Tasks: a joint, its target, and the success criteria of an episode.

The eight names are data over the same functions. Progress is the fraction of the joint's travel
from closed (0) to open (1); a task defines the fractions at which the part begins, the target, and
the mechanical stop.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import numpy as np

from articulate.assets.asset import Asset, Joint
from articulate.errors import AssetError, ConfigError, nearest, quote
from articulate.jit import row_function
from articulate.task.part_kinds import PartKind, part_kind

QUARTER_TURN = np.pi / 2
OPEN_SHARE, CLOSED_SHARE = 0.8, 0.05
"""A part counts as open from the first share of its range on, and as closed up to the second."""
MIN_TARGET_OPEN = 0.1
"""Smallest target of an opening task, as a share of the range."""
BEGIN_SHARE = 0.5
"""Closing tasks begin between this share of the open target and that target."""


@dataclass(frozen=True, kw_only=True)
class TaskRule:
    """Direction and kind of part of a task's name."""

    verb: Literal["open", "close"]
    """Towards the open or the closed end."""
    part: PartKind | Literal["joint"]
    """Kind of part that it applies to; ``joint`` is any."""


TASK_RULES = {
    "open_drawer": TaskRule(verb="open", part="drawer"),
    "close_drawer": TaskRule(verb="close", part="drawer"),
    "open_door": TaskRule(verb="open", part="door"),
    "close_door": TaskRule(verb="close", part="door"),
    "open_lid": TaskRule(verb="open", part="lid"),
    "close_lid": TaskRule(verb="close", part="lid"),
    "open_joint": TaskRule(verb="open", part="joint"),
    "close_joint": TaskRule(verb="close", part="joint"),
}
"""Known names of tasks."""


@dataclass(frozen=True, kw_only=True)
class Limits:
    """Limits of a deployable episode; a violation ends it as failed with that reason."""

    speed_share: float = 0.7
    """Share of the table's joint speed allowed, in (0, 1]."""
    torque_share: float = 1.0
    """Share of the table's joint torque that must not be reached, gravity included, in (0, 1].

    Simulated arms saturate at the table's torque, so reaching it means a larger request."""
    force_n: float = 40.0
    """Largest filtered net force of the surroundings on the gripper [N]."""
    moment_nm: float = 40.0
    """Largest filtered net moment on the gripper about the tool frame [Nm]."""
    filter_s: float = 0.05
    """Time constant of the first-order filter on that wrench [s]."""
    short_filter_s: float = 0.01
    """Time constant of the second filter, reported beside it [s]."""

    def __post_init__(self) -> None:
        if not 0.0 < self.speed_share <= 1.0:
            raise ConfigError(f"limits.speed_share is {self.speed_share}; it must be in (0, 1]")
        if not 0.0 < self.torque_share <= 1.0:
            raise ConfigError(f"limits.torque_share is {self.torque_share}; it must be in (0, 1]")
        for name in ("force_n", "moment_nm", "short_filter_s"):
            if not getattr(self, name) > 0.0:
                raise ConfigError(f"limits.{name} is {getattr(self, name)}; it must be above 0")
        if not 0.0 < self.filter_s <= 0.05:
            raise ConfigError(f"limits.filter_s is {self.filter_s}; it must be in (0, 0.05] s")


@dataclass(frozen=True, kw_only=True)
class Task:
    """One joint, its target, and the rules of an episode."""

    name: str
    """One of :data:`TASK_RULES`."""
    joint: str
    """Joint of the asset."""
    kind: Literal["slide", "hinge"]
    """Kind of that joint."""
    span: float
    """Signed travel from closed to open [m or rad]."""
    target: float
    """Fraction of the span at or beyond which the part must come to rest."""
    begin: tuple[float, float] = (0.0, 0.0)
    """Range of the fraction of the span at which an episode begins."""
    stop: float | None = 1.0
    """Fraction beyond the target at which the part hits its stop; None if it has none."""
    episode_s: float = 10.0
    """Length of every episode [s]."""
    hold_s: float = 0.5
    """Time at the end during which the part must be at or beyond the target [s]."""
    slow: float = 0.02
    """Speed below which the part counts as at rest [m/s or rad/s]."""
    limits: Limits = Limits()
    """Limits of a deployable episode."""

    def __post_init__(self) -> None:
        if not 0.0 < self.episode_s <= 10.0:
            raise ConfigError(f"task.episode_s is {self.episode_s}; it must be in (0, 10] s")
        if self.name not in TASK_RULES:
            raise ConfigError(f"unknown task {quote(self.name)}{nearest(self.name, TASK_RULES)}")
        if not 0.0 < self.hold_s <= self.episode_s:
            raise ConfigError(
                f"task.hold_s is {self.hold_s}; it must be in (0, {self.episode_s}] s"
            )
        if self.span == 0.0 or not math.isfinite(self.span):
            raise ConfigError(f"task.span is {self.span}; it must be finite and not 0")

    @property
    def closes(self) -> bool:
        """True if the part is moved towards its closed end."""
        return self.target < self.begin[1]

    @property
    def far(self) -> float:
        """Largest fraction open that the task needs: the target or the beginning."""
        return max(self.target, self.begin[1])


def done_word(name: str) -> str:
    """Return the participle of the task ``name`` for texts: opened or closed."""
    return {"open": "opened", "close": "closed"}[TASK_RULES[name].verb]


def closes(name: str) -> bool:
    """Return True if the task ``name`` closes a part."""
    return TASK_RULES[name].verb == "close"


def matching_joints(name: str, asset: Asset) -> tuple[Joint, ...]:
    """Return the joints of ``asset`` that the task ``name`` fits; ConfigError if it is unknown."""
    if name not in TASK_RULES:
        raise ConfigError(f"unknown task {name!r}{nearest(name, TASK_RULES)}")
    part = TASK_RULES[name].part
    return tuple(j for j in asset.joints if part in ("joint", part_kind(asset, j)))


def matching_tasks(asset: Asset, joint: Joint) -> tuple[str, ...]:
    """Return the names of the tasks that fit ``joint``."""
    kind = part_kind(asset, joint)
    return tuple(name for name, rule in TASK_RULES.items() if rule.part in ("joint", kind))


def make_task(
    name: str,
    asset: Asset,
    joint_name: str,
    *,
    target_open: float | None = None,
    **overrides: float,
) -> Task:
    """Return the task ``name`` for one joint of ``asset``.

    A part is open at 0.8 of its range, of at most 90 degrees for hinges; a joint without limits
    at 90 degrees. It is closed within 0.05 of its range from its closed end (of the quarter turn
    of a joint without limits; at most half of its smallest beginning, for joints of many turns).
    Closing tasks begin between half of its open target and that target.

    Args:
        name: One of :data:`TASK_RULES`.
        asset: Object.
        joint_name: Joint of the object.
        target_open: Share of that range at which a part counts as open, in [0.1, 1); 0.8 if None.
        overrides: Other fields of :class:`Task`.

    Raises:
        AssetError: No such joint, or the task does not fit it.
        ConfigError: Unknown task.
    """
    matching = matching_joints(name, asset)
    joint = asset.joint(joint_name)
    if joint not in matching:
        names = ", ".join(j.name for j in matching)
        raise AssetError(
            f"{asset.name}: {name} does not fit joint {joint_name}; it fits: {names}"
            if names
            else f"{asset.name}: {name} fits no joint; tasks of {joint_name}: "
            + ", ".join(matching_tasks(asset, joint))
        )
    reach = abs(joint.span)
    usable = reach if joint.kind == "slide" else min(reach, QUARTER_TURN)
    free = joint.lower is None
    share = (1.0 if free else OPEN_SHARE) if target_open is None else target_open
    if not MIN_TARGET_OPEN <= share <= 1.0 - 0.01 * (not free):
        raise ConfigError(f"target_open is {share:g}; it must be in [{MIN_TARGET_OPEN}, 0.99]")
    open_target = share * usable / reach
    begin, target, stop = (0.0, 0.0), open_target, 1.0
    if TASK_RULES[name].verb == "close":
        begin = (BEGIN_SHARE * open_target, open_target)
        target, stop = min(CLOSED_SHARE, 0.5 * begin[0]), 0.0
    return Task(
        name=name,
        joint=joint.name,
        kind=joint.kind,
        span=joint.span,
        target=target,
        begin=begin,
        stop=None if free else stop,
        slow=0.02 if joint.kind == "slide" else 0.1,
        **overrides,  # type: ignore[arg-type]  # numbers only, checked by the dataclass
    )


class GoalParams(NamedTuple):
    """Success criteria of a task, as numbers for row functions."""

    closes: bool
    target: float
    slow: float


def goal_params(task: Task) -> GoalParams:
    """Return the target and speed bound of ``task``."""
    return GoalParams(task.closes, float(task.target), float(task.slow))


@row_function
def fraction_open(q: Any, closed: Any, span: Any) -> Any:
    """Return the fraction open of parts: 0 closed, 1 at the open end, not clipped.

    Args:
        q: Joint positions, numbers or arrays [m or rad].
        closed: Closed positions [m or rad].
        span: Signed travel from closed to open [m or rad].
    """
    return (q - closed) / span


@row_function
def goal_error(opened: Any, target: float, closes: bool) -> Any:
    """Return the distance of parts beyond ``target`` in fractions open; below 0 short of it.

    A part is closed on either side of its closed end: one that turns without limit can pass it.

    Args:
        opened: Fractions open, a number or an array.
        target: Target [fraction open].
        closes: True if the task closes the part.
    """
    return target - np.abs(opened) if closes else opened - target


@row_function
def is_at_goal(goal: GoalParams, opened: float) -> bool:
    """Return True if a part is at or beyond the target."""
    return bool(goal_error(opened, goal.target, goal.closes) >= 0.0)


@row_function
def is_at_rest(goal: GoalParams, opened: float, speed: float) -> bool:
    """Return True if a part with ``speed`` [m/s or rad/s] is at rest at or beyond the target."""
    return bool(is_at_goal(goal, opened) and abs(speed) < goal.slow)


def no_joint_error(name: str, asset: Asset) -> AssetError:
    """Return the error for an ``asset`` without a joint for the task ``name``."""
    have = ", ".join(f"{j.name} ({part_kind(asset, j)})" for j in asset.joints)
    return AssetError(f"{asset.name}: no joint for {name}; it has {have or 'no movable joint'}")
