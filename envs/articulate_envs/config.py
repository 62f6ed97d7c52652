"""Configuration of engines and initial states, without arrays: `--help` does not load numpy."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from articulate.config import check_bounds
from articulate.errors import ConfigError

EngineName = Literal["cpu", "warp"]
"""Names of the batched engines: MuJoCo on threads, or MuJoCo Warp on a GPU."""


@dataclass(frozen=True, kw_only=True)
class WarpConfig:
    """Memory of the engine on MuJoCo Warp; too little of it ends the training with a message."""

    contacts: int = 32
    """Contacts for which memory is allocated, in the mean over environments. Of six scenes, the one
    with the most has 7."""
    constraints: int = 260
    """Constraint rows of one environment for which memory is allocated; those scenes have up to
    78."""

    def __post_init__(self) -> None:
        check_bounds("warp", self, 1, math.inf, "contacts", "constraints")


def check_until(name: str, until: float) -> None:
    """Check a share of a training.

    Raises:
        ConfigError: ``until`` is not in (0, 1].
    """
    if not 0.0 < until <= 1.0:
        raise ConfigError(f"{name}.until is {until}; it must be above 0 and at most 1")


@dataclass(frozen=True, kw_only=True)
class InitialStatesConfig:
    """Initial states of training episodes along the task, and their truncation."""

    share_first: float = 0.8
    """Share of starts along the task at the beginning of training, in [0, 1]."""
    share_last: float = 0.2
    """Share at the end of the curriculum, in [0, 1]."""
    until: float = 0.6
    """Share of the training after which ``share_last`` applies, linear between."""
    grip_share: float = 0.45
    """Share of these starts with the gripper closed on the handle of a partly moved part."""
    standoff_m: float = 0.12
    """Largest distance before the handle of the other starts [m]; their part is not moved yet."""
    empty_grasp_share: float = 0.3
    """Share of starts before the handle with a gripper that has closed on nothing, which learns to
    open again."""
    empty_grasp_m: float = 0.016
    """Least distance of such a gripper before the handle [m]."""
    closing_share: float = 0.4
    """Share of starts before the handle that are at it, with an open gripper and a new close
    command: the result of closing there is seen before the policy has learned to close."""
    off_target_share: float = 0.15
    """Share of starts before the handle with a lateral offset, which learn not to push a finger
    against its front."""
    off_target_m: tuple[float, float] = (0.04, 0.06)
    """Least distance before the handle and largest lateral offset of such a gripper [m]."""
    n_precomputed: int = 512
    """Number of precomputed initial states."""
    truncation_probability: float = 0.04
    """Probability in each control step that an episode of training is truncated after its part has
    been at rest at the target for the hold time. The time is spent on the next episode; otherwise
    most control steps would have a part at rest."""
    truncation_env_share: float = 0.5
    """Share of the environments with such truncations, in [0, 1). In the others the part is held to
    the end, which has to be learned too; the success of training counts these."""

    def __post_init__(self) -> None:
        check_until("initial_states", self.until)
        check_bounds(
            "initial_states", self, 0.0, 1.0,
            "share_first", "share_last", "grip_share", "empty_grasp_share", "closing_share",
            "off_target_share", "truncation_probability",
        )  # fmt: skip
        lengths = ("standoff_m", "empty_grasp_m", "off_target_m")
        check_bounds("initial_states", self, 0.0, math.inf, *lengths)
        check_bounds("initial_states", self, 1, math.inf, "n_precomputed")
        if not 0.0 <= self.truncation_env_share < 1.0:
            raise ConfigError(
                f"initial_states.truncation_env_share is {self.truncation_env_share}; it must be "
                "at least 0 and below 1"
            )

    def share(self, progress: float) -> float:
        """Return the share of starts along the task at ``progress`` in [0, 1] of the training."""
        done = min(max(progress / self.until, 0.0), 1.0)
        return self.share_first + done * (self.share_last - self.share_first)
