"""Stable-Baselines3 ``VecEnv`` over :class:`articulate_envs.episodes.Episodes`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray
from stable_baselines3.common.vec_env import VecEnv

from articulate.task.episode_monitor import REASONS
from articulate.task.observation import ACTION, OBSERVATION, expert_action
from articulate.transforms import Array, Ints, Mask
from articulate_envs.episodes import Episodes
from articulate_envs.privileged_observation import PRIVILEGED
from articulate_train.action_scaling import corrected_action, correction_to
from articulate_train.config import ActionScalingConfig

Singles = NDArray[np.float32]
FINISHED = ("code", "opened", "from_home", "terms")
"""Fields of :class:`Finished`."""


@dataclass(frozen=True)
class Finished:
    """Outcome of M ended episodes; see :class:`articulate_envs.episodes.Ended`."""

    code: Ints
    opened: Mask
    from_home: Mask
    terms: Array


class EpisodesVecEnv(VecEnv):
    """N environments with the interface of Stable-Baselines3.

    Observations are those of the policy, followed by the privileged ones of the value function
    (:data:`articulate_envs.privileged_observation.PRIVILEGED`). Episodes have a fixed length and
    the observation holds the time left, so their end is a termination; an early end while the part
    is at rest at the target is a truncation. Actions are those of the policy before action scaling
    (:mod:`articulate_train.action_scaling`).
    """

    def __init__(self, episodes: Episodes, action_scaling: ActionScalingConfig) -> None:
        """Wrap ``episodes`` and take ownership of them."""
        self.episodes = episodes
        self.action_scaling = action_scaling
        """Action scaling of the task."""
        self.finished: list[Finished] = []
        """Episodes that ended since the list was last cleared."""
        self.imitates = False
        """True in the imitation phase, in which :attr:`wanted` is filled."""
        self.wanted: list[Array] = []
        """Corrections (N, 8) to imitate, of each control step since the list was last cleared."""
        self._action = np.zeros((episodes.engine.n_envs, ACTION.size))
        self._seen: Singles = np.zeros((episodes.engine.n_envs, OBSERVATION.size), np.float32)
        self._stagger = True
        super().__init__(
            episodes.engine.n_envs,
            gymnasium.spaces.Box(
                np.concatenate([OBSERVATION.low, PRIVILEGED.low]).astype(np.float32),
                np.concatenate([OBSERVATION.high, PRIVILEGED.high]).astype(np.float32),
            ),
            gymnasium.spaces.Box(ACTION.low.astype(np.float32), ACTION.high.astype(np.float32)),
        )
        self._infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]

    def reset(self) -> Singles:
        """Begin all episodes, the first ones staggered; return observations (N, size)."""
        return self._with_privileged(self.episodes.reset(stagger=self._stagger))

    def _with_privileged(self, observation: Array) -> Singles:
        both = (observation, self.episodes.privileged())
        joined: Singles = np.concatenate(both, axis=1).astype(np.float32)
        self._seen = joined[:, : OBSERVATION.size]
        return joined

    def step_async(self, actions: Array) -> None:
        """Store the actions that corrections (N, 8) in [-1, 1] give at the last observation."""
        corrections = np.clip(actions, -1.0, 1.0)
        if self.imitates:
            target = expert_action(self.episodes.observe_again())
            self.wanted.append(correction_to(self.action_scaling, self._seen, target))
        self._action = corrected_action(self.action_scaling, self._seen, corrections)

    def step_wait(self) -> tuple[Singles, Singles, Mask, list[dict[str, Any]]]:
        """Run one control step."""
        step = self.episodes.step(self._action)
        infos: list[dict[str, Any]] = self._infos
        if step.ended is not None:
            infos = [{} for _ in range(self.num_envs)]
            both = (step.ended.observation, step.ended.privileged)
            last = np.concatenate(both, axis=1).astype(np.float32)
            self.finished.append(Finished(**{n: getattr(step.ended, n) for n in FINISHED}))
            for k, i in enumerate(step.ended.rows):
                infos[i] = {
                    "terminal_observation": last[k],
                    "TimeLimit.truncated": bool(step.ended.truncated[k]),
                    "reason": REASONS[int(step.ended.code[k])],
                    "is_success": bool(step.ended.code[k] == 0),
                }
        return (
            self._with_privileged(step.observation),
            step.reward.astype(np.float32),
            step.done,
            infos,
        )

    def pending(self) -> dict[str, Any]:
        """Return :attr:`finished` as arrays by name, for a checkpoint; empty if there are none."""
        if not self.finished:
            return {}
        return {n: np.concatenate([getattr(one, n) for one in self.finished]) for n in FINISHED}

    def restore(self, seen: Singles, pending: dict[str, Any]) -> None:
        """Continue from the last observations (N, size) and the result of :meth:`pending`."""
        self._seen = seen[:, : OBSERVATION.size].copy()
        self.finished[:] = [Finished(**pending)] if pending else []

    def close(self) -> None:
        """Release the engine."""
        self.episodes.engine.close()

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """Return the attribute of this object, once per environment."""
        return [getattr(self, attr_name, None)] * len(list(self._get_indices(indices)))

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Set an attribute of this object."""
        setattr(self, attr_name, value)

    def env_method(
        self, method_name: str, *args: Any, indices: Any = None, **kwargs: Any
    ) -> list[Any]:
        """Call a method of the episodes, one object for all environments."""
        return [getattr(self.episodes, method_name)(*args, **kwargs)]

    def env_is_wrapped(self, wrapper_class: type, indices: Any = None) -> list[bool]:
        """Return False for each environment: none is wrapped."""
        return [False] * len(list(self._get_indices(indices)))

    def seed(self, seed: int | None = None) -> Sequence[int | None]:
        """Keep the seeds, which are set at construction."""
        return [None] * self.num_envs
