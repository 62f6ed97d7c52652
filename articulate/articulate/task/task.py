"""Tasks: what is asked of which joint, and what counts.

The eight names are data over the same functions. Progress is measured as a fraction of the
joint's way from closed (0) to open (1); a task says between which fractions the part begins, at
which it counts as done, and where it hits its stop.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from articulate.assets.asset import Asset, Joint
from articulate.errors import AssetError, ConfigError, nearest
from articulate.task.part_kinds import PartKind, part_kind
from articulate.transforms import Array, Mask

QUARTER_TURN = np.pi / 2
OPEN_SHARE, CLOSED_SHARE = 0.8, 0.05
"""A part is open from the first share of its range on, closed up to the second."""
BEGIN_SHARE = 0.5
"""To be closed, a part begins between this share of its open target and that target."""


@dataclass(frozen=True, kw_only=True)
class TaskRule:
    """What a task's name says about joints."""

    verb: Literal["open", "close"]
    """Towards the open or the closed end."""
    part: PartKind | Literal["joint"]
    """Kind of part that it is asked of; ``joint`` is every one."""


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
"""Names that can be asked for."""


@dataclass(frozen=True, kw_only=True)
class Limits:
    """What a deployable episode may ask of the arm; going beyond fails it with that reason."""

    speed_share: float = 0.7
    """Share of the table's joint speed allowed, in (0, 1]."""
    torque_share: float = 1.0
    """Share of the table's joint torque that is never to be asked for, gravity included, in (0, 1].

    Simulated arms are given the table's torque at most: one that reaches it has asked for more."""
    force_n: float = 40.0
    """Largest filtered net force of the surroundings on the hand [N]."""
    moment_nm: float = 40.0
    """Largest filtered net moment on the hand about the tool frame [Nm]."""
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
    """Signed way from closed to open [m or rad]."""
    target: float
    """Fraction of the span at which the part must rest, or beyond it."""
    begin: tuple[float, float] = (0.0, 0.0)
    """Fractions of the span between which the part is when an episode begins."""
    stop: float | None = 1.0
    """Fraction beyond the target at which the part hits its stop; None if it has none."""
    episode_s: float = 10.0
    """Length of every episode [s]."""
    hold_s: float = 0.5
    """Time at the end during which the part must be at or beyond the target [s]."""
    slow: float = 0.02
    """Speed below which the part counts as resting [m/s or rad/s]."""
    limits: Limits = Limits()
    """What a deployable episode may ask of the arm."""

    def __post_init__(self) -> None:
        if not 0.0 < self.episode_s <= 10.0:
            raise ConfigError(f"task.episode_s is {self.episode_s}; it must be in (0, 10] s")
        if self.name not in TASK_RULES:
            raise ConfigError(f"unknown task {self.name!r}{nearest(self.name, TASK_RULES)}")
        if not 0.0 < self.hold_s <= self.episode_s:
            raise ConfigError(
                f"task.hold_s is {self.hold_s}; it must be in (0, {self.episode_s}] s"
            )
        if self.span == 0.0 or not math.isfinite(self.span):
            raise ConfigError(f"task.span is {self.span}; it must be finite and not 0")

    @property
    def closes(self) -> bool:
        """Whether the part is moved towards its closed end."""
        return self.target < self.begin[1]

    @property
    def far(self) -> float:
        """The fraction that is farthest open of all that the task asks for."""
        return max(self.target, self.begin[1])


def done_word(name: str) -> str:
    """What a part is when the task ``name`` is done, for texts: opened or closed."""
    return {"open": "opened", "close": "closed"}[TASK_RULES[name].verb]


def matching_joints(name: str, asset: Asset) -> tuple[Joint, ...]:
    """Joints of ``asset`` that the task ``name`` can be asked of; ConfigError if it is unknown."""
    if name not in TASK_RULES:
        raise ConfigError(f"unknown task {name!r}{nearest(name, TASK_RULES)}")
    part = TASK_RULES[name].part
    return tuple(j for j in asset.joints if part in ("joint", part_kind(asset, j)))


def matching_tasks(asset: Asset, joint: Joint) -> tuple[str, ...]:
    """Names of the tasks that can be asked of ``joint``."""
    kind = part_kind(asset, joint)
    return tuple(name for name, rule in TASK_RULES.items() if rule.part in ("joint", kind))


def make_task(name: str, asset: Asset, joint_name: str, **overrides: float) -> Task:
    """The task ``name`` for one joint of ``asset``.

    A part is open at 0.8 of its range, of at most 90 degrees for hinges; a joint without limits
    at 90 degrees. It is closed within 0.05 of its range from its closed end (of the quarter turn
    of a joint without limits; at most half of where it may begin, for joints of many turns). To
    be closed, it begins between half of its open target and that target.

    Raises:
        AssetError: No such joint, or not one that the task can be asked of.
        ConfigError: Unknown task.
    """
    matching = matching_joints(name, asset)
    joint = asset.joint(joint_name)
    if joint not in matching:
        names = ", ".join(j.name for j in matching)
        raise AssetError(
            f"{asset.name}: {name} cannot be asked of joint {joint_name}; it matches: {names}"
            if names
            else f"{asset.name}: {name} matches no joint; {joint_name} can be asked for "
            + ", ".join(matching_tasks(asset, joint))
        )
    reach = abs(joint.span)
    way = reach if joint.kind == "slide" else min(reach, QUARTER_TURN)
    free = joint.lower is None
    open_target = (1.0 if free else OPEN_SHARE) * way / reach
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


def fraction(q: Array, closed: Array, span: Array) -> Array:
    """How far parts are open: 0 closed, 1 at the open end, not clipped. Shape (N,).

    Args:
        q: Joint positions (N,) [m or rad].
        closed: Closed positions (N,) [m or rad].
        span: Signed ways from closed to open (N,) [m or rad].
    """
    return np.asarray((q - closed) / span)


def at_target(task: Task, opened: Array, speed: Array) -> Mask:
    """Whether the part rests at or beyond the target (N,).

    Args:
        task: Target and speed bound.
        opened: Fraction open (N,).
        speed: Speed of the part (N,) [m/s or rad/s].
    """
    return beyond_target(task, opened) & (np.abs(speed) < task.slow)


def beyond(opened: Array, target: float, *, closes: bool) -> Array:
    """By how much parts are beyond ``target`` (N,), in fractions open; below 0 short of it.

    A part is closed on either side of its closed end: one that turns without end can pass it.
    """
    return np.asarray(target - np.abs(opened) if closes else opened - target)


def beyond_target(task: Task, opened: Array) -> Mask:
    """Whether the part is at or beyond the target (N,)."""
    return beyond(opened, task.target, closes=task.closes) >= 0.0


def no_joint_error(name: str, asset: Asset) -> AssetError:
    """What to say when ``asset`` has no joint for the task ``name``."""
    have = ", ".join(f"{j.name} ({part_kind(asset, j)})" for j in asset.joints)
    return AssetError(f"{asset.name}: no joint for {name}; it has {have or 'no movable joint'}")
