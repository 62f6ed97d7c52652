"""Tasks: what is asked of which joint, and what counts.

The eight names are data over the same functions. Progress is measured as a fraction of the
joint's way from closed (0) to open (1).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from articulate.asset import Asset, Joint
from articulate.errors import AssetError, ConfigError, nearest
from articulate.transforms import Array, Mask

QUARTER_TURN = np.pi / 2


@dataclass(frozen=True, kw_only=True)
class TaskRule:
    """What a task's name says about joints."""

    verb: Literal["open", "close"]
    """Towards the open or the closed end."""
    part: Literal["drawer", "door", "lid", "joint"]
    """Kind of part: a drawer slides level, a door turns about a steep axis, a lid does neither."""


TASK_RULES = {
    "open_drawer": TaskRule(verb="open", part="drawer"),
    "open_joint": TaskRule(verb="open", part="joint"),
}
"""Names that can be asked for."""


@dataclass(frozen=True, kw_only=True)
class Limits:
    """What a deployable episode may ask of the arm; going beyond fails it with that reason."""

    speed_share: float = 0.7
    """Share of the table's joint speed allowed, in (0, 1]."""
    torque_share: float = 1.0
    """Share of the table's joint torque allowed, gravity included, in (0, 1]."""
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
    """Fraction of the span at which the part must rest."""
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


def matching_joints(name: str, asset: Asset) -> tuple[Joint, ...]:
    """Joints of ``asset`` that the task ``name`` can be asked of; ConfigError if it is unknown."""
    if name not in TASK_RULES:
        raise ConfigError(f"unknown task {name!r}{nearest(name, TASK_RULES)}")
    part = TASK_RULES[name].part
    return tuple(j for j in asset.joints if part in ("joint", part_kind(j)))


def part_kind(joint: Joint) -> Literal["drawer", "door", "lid"]:
    """What a person would call the part: a level slide is a drawer, a steep hinge a door."""
    steep = abs(joint.axis_o[2]) > np.cos(np.pi / 4)
    if joint.kind == "slide":
        return "lid" if steep else "drawer"
    return "door" if steep else "lid"


def make_task(name: str, asset: Asset, joint_name: str, **overrides: float) -> Task:
    """The task ``name`` for one joint of ``asset``.

    The target is 0.8 of the range, of at most 90 degrees for hinges; a joint without limits is
    turned by 90 degrees.

    Raises:
        AssetError: No such joint, or not one that the task can be asked of.
        ConfigError: Unknown task.
    """
    matching = matching_joints(name, asset)
    joint = asset.joint(joint_name)
    if joint not in matching:
        names = ", ".join(j.name for j in matching) or "none"
        raise AssetError(
            f"{asset.name}: {name} cannot be asked of joint {joint_name}; it matches: {names}"
        )
    reach = abs(joint.span)
    way = reach if joint.kind == "slide" else min(reach, QUARTER_TURN)
    share = 1.0 if joint.lower is None else 0.8
    return Task(
        name=name,
        joint=joint.name,
        kind=joint.kind,
        span=joint.span,
        target=share * way / reach,
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


def beyond_target(task: Task, opened: Array) -> Mask:
    """Whether the part is at or beyond the target (N,)."""
    return np.asarray(opened >= task.target)


def no_joint_error(name: str, asset: Asset) -> AssetError:
    """What to say when ``asset`` has no joint for the task ``name``."""
    have = ", ".join(f"{j.name} ({part_kind(j)})" for j in asset.joints) or "no movable joint"
    return AssetError(f"{asset.name}: no joint for {name}; it has {have}")
