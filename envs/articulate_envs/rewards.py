"""Reward: a sum of terms over a batch of states, the same for every asset."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from articulate.asset import Handle
from articulate.task import Task
from articulate.transforms import Array, Mask
from articulate_envs.compiled.reward import view_of, way_of, weights_of, write_terms
from articulate_envs.engine import State
from articulate_envs.settings import RewardConfig

TERMS = (
    "approach", "reach", "align", "grip", "early", "aside", "open", "progress", "rest",
    "force", "speed", "action", "violation", "success",
)  # fmt: skip
"""Names of the terms, in the order of :func:`reward_terms`; the last is :func:`at_end`'s."""


FINGER_M = 0.022
"""Width of a finger along the handle that it holds [m]: 21 mm in franka's finger.stl, and one."""
MOST_ALONG_M = 0.05
"""Largest distance from a handle's middle that counts as its middle [m]."""


@dataclass(frozen=True, kw_only=True)
class Grasp:
    """What a handle asks of a hand."""

    along_m: float = 0.0
    """Distance from the handle's middle along its long axis at which fingers hold it [m]."""
    thick_m: float = 0.0
    """What has to fit between the fingers [m]."""


NO_GRASP = Grasp()
"""Of a part without a handle: its point is to be reached."""


def grasp_of(handle: Handle | None) -> Grasp:
    """What ``handle`` asks of a hand; None asks for a point."""
    if handle is None:
        return NO_GRASP
    along_m = min(max(0.0, 0.9 * (handle.extent[0] - FINGER_M) / 2.0), MOST_ALONG_M)
    return Grasp(along_m=along_m, thick_m=handle.extent[1])


def reward_terms(
    config: RewardConfig,
    task: Task,
    before: State,
    after: State,
    action: Array,
    progress: float = 0.0,
    grasp: Grasp = NO_GRASP,
) -> Array:
    """Weighted terms (N, len(TERMS)) of one tick, all but those of :func:`at_end`, finite ones.

    Args:
        config: Weights.
        task: Target and speeds.
        before: State before the tick.
        after: State after it.
        action: What the policy said (N, 8).
        progress: Share of the training that is done, in [0, 1].
        grasp: What the handle asks of a hand.
    """
    out = np.zeros((len(after.opened), len(TERMS)))
    write_terms(
        weights_of(config),
        way_of(config, task),
        grasp.along_m,
        grasp.thick_m,
        min(progress / config.until, 1.0),
        view_of(before),
        view_of(after),
        action,
        out,
    )
    return out


def at_end(config: RewardConfig, succeeded: Mask) -> Array:
    """Weighted terms (M, len(TERMS)) of how M episodes ended that ran their full length."""
    terms = np.zeros((len(succeeded), len(TERMS)))
    terms[:, TERMS.index("success")] = config.success * succeeded
    return terms
