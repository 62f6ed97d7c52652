"""The protocol of engines: N environments stepped by whole ticks."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

from articulate.robot.control import GripperState
from articulate.task.randomization import EpisodeParams
from articulate.transforms import Array, Ints, Mask

if TYPE_CHECKING:  # the arrays are light to import, scenes are not
    from articulate_envs.scene import Scene


@dataclass(frozen=True)
class State:
    """What is true of N environments at a tick."""

    q: Array
    """Joint angles (N, 7) [rad]."""
    dq: Array
    """Joint speeds (N, 7) [rad/s]."""
    target: Array
    """Targets that the follower runs to (N, 7) [rad]."""
    gripper: GripperState
    """What the hand was told and does."""
    gripper_width: Array
    """Opening between the fingers (N,) [m]."""
    T_wt: Array
    """Pose of the tool in the world, by the joint angles (N, 4, 4)."""
    T_wt_target: Array
    """Where the tool would be with the joints at their targets (N, 4, 4)."""
    T_wh: Array
    """Pose of the handle in the world (N, 4, 4)."""
    opened: Array
    """Fraction open (N,)."""
    speed: Array
    """Speed of the part, positive opening (N,) [m/s or rad/s]."""
    samples: Array
    """Rows of the judgement (N, WIDTH)."""
    pending_actions: Array
    """Sum of the motions that were said but have not been used yet, as they come late (N, 7)."""


@dataclass(frozen=True)
class Start:
    """How episodes begin, one row per environment of a reset."""

    params: EpisodeParams
    """What was drawn (M rows)."""
    q: Array
    """Angles of the arm (M, 7) [rad]."""
    opened: Array
    """Fraction open of the task's part (M,)."""
    width: Array
    """Opening between the fingers (M,) [m]."""
    closing: Array
    """+1 where the hand is told to close, whether it holds the handle, has closed on nothing or is
    still open; -1 where it is told to open (M,)."""
    home: Mask
    """Whether it is the start the task asks for, not one along the way (M,)."""


class Engine(Protocol):
    """N environments; results do not depend on the number of threads."""

    scene: Scene
    n_envs: int

    def reset(self, rows: Ints, start: Start) -> None:
        """Begin new episodes in environments ``rows`` (M,) of int."""

    def step(self, action: Array) -> State:
        """Run one tick with actions (N, 8) and return what is then true.

        The state's arrays are new; they stay as they are when the engine goes on.
        """

    def state(self) -> State:
        """What is true now."""

    def snapshot(self) -> dict[str, Array]:
        """All that resuming bit-identically needs."""

    def restore(self, snapshot: dict[str, Array]) -> None:
        """Continue from :meth:`snapshot`."""

    def close(self) -> None:
        """Give back threads and memory."""
