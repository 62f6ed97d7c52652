"""Protocol of engines: N environments that advance by control steps."""

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
    """True state of N environments after a control step."""

    q: Array
    """Joint angles (N, 7) [rad]."""
    dq: Array
    """Joint speeds (N, 7) [rad/s]."""
    target: Array
    """Targets of the set-point filter (N, 7) [rad]."""
    gripper: GripperState
    """Commands and motion of the grippers."""
    gripper_width: Array
    """Opening between the fingers (N,) [m]."""
    T_wt: Array
    """Pose of the tool in the world, from the joint angles (N, 4, 4)."""
    T_wt_target: Array
    """Pose of the tool with the joints at their targets (N, 4, 4)."""
    T_wh: Array
    """Pose of the handle in the world (N, 4, 4)."""
    opened: Array
    """Fraction open (N,)."""
    speed: Array
    """Speed of the part, positive opening (N,) [m/s or rad/s]."""
    samples: Array
    """Rows of the episode monitor (N, WIDTH)."""
    pending_actions: Array
    """Sum of the motions that were requested and have not acted yet (N, 7)."""


@dataclass(frozen=True)
class Start:
    """Initial states of episodes, one row per environment of a reset."""

    params: EpisodeParams
    """Episode parameters (M rows)."""
    q: Array
    """Angles of the arm (M, 7) [rad]."""
    opened: Array
    """Fraction open of the task's part (M,)."""
    width: Array
    """Opening between the fingers (M,) [m]."""
    closing: Array
    """+1 where the gripper has the command to close, whether it holds the handle, has closed on
    nothing or is still open; -1 where it has the command to open (M,)."""
    home: Mask
    """True for the initial state of the task, False for one along it (M,)."""


class Engine(Protocol):
    """N environments; results do not depend on the number of threads."""

    scene: Scene
    """First of :attr:`scenes`; arm, control, physics, limits and duration are common to all."""
    scenes: tuple[Scene, ...]
    n_envs: int
    scene_of: Ints
    """Index of the scene of each environment (N,)."""

    def reset(self, rows: Ints, start: Start) -> None:
        """Begin new episodes in environments ``rows`` (M,) of int."""

    def step(self, action: Array) -> State:
        """Run one control step with actions (N, 8) and return the state after it.

        The arrays of the state are new; later steps do not change them.
        """

    def state(self) -> State:
        """Return the present state."""

    def snapshot(self) -> dict[str, Array]:
        """Return all that bit-identical continuation needs."""

    def restore(self, snapshot: dict[str, Array]) -> None:
        """Continue from :meth:`snapshot`."""

    def close(self) -> None:
        """Release threads and memory."""
