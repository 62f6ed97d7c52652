"""Stable-Baselines3's VecEnv over our episodes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray
from stable_baselines3.common.vec_env import VecEnv

from articulate.task.episode_monitor import REASONS
from articulate.task.observation import ACTION, OBSERVATION
from articulate.transforms import Array, Ints, Mask
from articulate_envs.episodes import Episodes
from articulate_envs.privileged_observation import PRIVILEGED
from articulate_envs.scripted_expert import ScriptedExpert
from articulate_train.action_scaling import ELBOW, MOTIONS, shares, taken_back
from articulate_train.config import ActionScalingConfig
from articulate_train.imitation import said

Singles = NDArray[np.float32]
FINISHED = ("code", "opened", "from_home", "terms")
"""Fields of :class:`Finished`."""


@dataclass(frozen=True)
class Finished:
    """What progress tells of M episodes that ended; see :class:`articulate_envs.episodes.Ended`."""

    code: Ints
    opened: Mask
    from_home: Mask
    terms: Array


class EpisodesVecEnv(VecEnv):
    """N environments as Stable-Baselines3 wants them.

    Observations are those of the policy followed by those of the value function alone
    (:data:`articulate_envs.privileged_observation.PRIVILEGED`). Episodes have a fixed length and the observation
    holds the time left, so that their end is a termination; being cut off while the part rests at
    the target is a truncation. Actions are what a policy says; what the arm is asked for is finer
    near the handle (:mod:`articulate_train.action_scaling`).
    """

    def __init__(self, episodes: Episodes, fine: ActionScalingConfig) -> None:
        """Wrap ``episodes``, which this then owns."""
        self.episodes = episodes
        self.fine = fine
        """How much finer motions are; training moves it."""
        self.finished: list[Finished] = []
        """Episodes that ended since the list was last cleared."""
        self.guide: ScriptedExpert | None = None
        """Who shows what to do; None shows nothing."""
        self.led = 0
        """In so many environments the guide acts, and not the policy."""
        self.shown: list[Array] = []
        """What it would have said at each tick since the list was last cleared (N, 8)."""
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
        """Begin all episodes, the first ones staggered."""
        return self._with_privileged(self.episodes.reset(stagger=self._stagger))

    def _with_privileged(self, observation: Array) -> Singles:
        both = (observation, self.episodes.privileged())
        whole: Singles = np.concatenate(both, axis=1).astype(np.float32)
        self._seen = whole[:, : OBSERVATION.size]
        return whole

    def step_async(self, actions: Array) -> None:
        """Keep the actions (N, 8), made finer by the last observation."""
        words, left = np.clip(actions, -1.0, 1.0), shares(self.fine, self._seen)
        back = taken_back(self.fine, self._seen)
        if self.guide is not None:
            asked = self.guide.act(self.episodes.state, self.episodes.drawn)
            self.shown.append(said(asked, left, back))
            words[: self.led] = self.shown[-1][: self.led]
        motions = words[:, :MOTIONS] * left
        motions[:, :ELBOW] = np.clip(motions[:, :ELBOW] - back, -1.0, 1.0)
        self._action = np.concatenate([motions, words[:, MOTIONS:]], axis=1)

    def step_wait(self) -> tuple[Singles, Singles, Mask, list[dict[str, Any]]]:
        """Run one tick."""
        tick = self.episodes.step(self._action)
        infos: list[dict[str, Any]] = self._infos
        if tick.ended is not None:
            infos = [{} for _ in range(self.num_envs)]
            both = (tick.ended.observation, tick.ended.privileged)
            last = np.concatenate(both, axis=1).astype(np.float32)
            self.finished.append(Finished(**{n: getattr(tick.ended, n) for n in FINISHED}))
            for k, i in enumerate(tick.ended.rows):
                infos[i] = {
                    "terminal_observation": last[k],
                    "TimeLimit.truncated": bool(tick.ended.cut[k]),
                    "reason": REASONS[int(tick.ended.code[k])],
                    "is_success": bool(tick.ended.code[k] == 0),
                }
        return (
            self._with_privileged(tick.observation),
            tick.reward.astype(np.float32),
            tick.done,
            infos,
        )

    def pending(self) -> dict[str, Any]:
        """All of :attr:`finished` as arrays by name, for a checkpoint; empty if there are none."""
        if not self.finished:
            return {}
        return {n: np.concatenate([getattr(one, n) for one in self.finished]) for n in FINISHED}

    def restore(self, seen: Singles, pending: dict[str, Any]) -> None:
        """Go on from the last observations ``seen`` and from what :meth:`pending` gave."""
        self._seen = seen[:, : OBSERVATION.size].copy()
        self.finished[:] = [Finished(**pending)] if pending else []

    def close(self) -> None:
        """Give back the engine."""
        self.episodes.engine.close()

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """The attribute of this object, once per environment."""
        return [getattr(self, attr_name, None)] * len(list(self._get_indices(indices)))

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Set an attribute of this object."""
        setattr(self, attr_name, value)

    def env_method(
        self, method_name: str, *args: Any, indices: Any = None, **kwargs: Any
    ) -> list[Any]:
        """Call a method of the episodes; they are one object for all environments."""
        return [getattr(self.episodes, method_name)(*args, **kwargs)]

    def env_is_wrapped(self, wrapper_class: type, indices: Any = None) -> list[bool]:
        """No environment is wrapped."""
        return [False] * len(list(self._get_indices(indices)))

    def seed(self, seed: int | None = None) -> Sequence[int | None]:
        """Seeds are decided when the episodes are made; this keeps what they are."""
        return [None] * self.num_envs
