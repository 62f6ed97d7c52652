"""The batched engine for Gymnasium: ``gymnasium.make_vec("articulate_envs:Articulate/…", 64, …)``.

An episode that ends is a termination, as in :mod:`articulate_envs.gym_env`. Episodes that
``initial_states`` or ``max_episode_steps`` cut off are truncations.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from articulate.errors import ConfigError, EngineError, nearest, quote
from articulate.task.observation import ACTION, OBSERVATION
from articulate.task.randomization import COLUMNS
from articulate.transforms import Ints, Mask
from articulate_envs.episodes import StepResult
from articulate_envs.gym_env import box
from articulate_envs.interface import apply_options, checked_action, episode_info
from articulate_envs.make_scene import make_scene, read_config
from articulate_envs.row_episodes import RowEpisodes
from articulate_envs.scene import Scene
from articulate_envs.threaded_engine import ThreadEngine

Vectors = NDArray[np.float32]
RESET_MASK = "reset_mask"
"""Option of a reset: a boolean mask (N,) of the environments that are reset."""


class ArticulateVectorEnv(VectorEnv[Vectors, Vectors, NDArray[Any]]):
    """N environments on native threads."""

    observation_layout = OBSERVATION
    action_layout = ACTION

    def __init__(
        self,
        *,
        num_envs: int = 1,
        threads: int = 1,
        autoreset_mode: str | AutoresetMode = AutoresetMode.SAME_STEP,
        max_episode_steps: int | None = None,
        render_mode: str | None = None,
        scene: Scene | None = None,
        **env_fields: Any,
    ) -> None:
        """Make the environments.

        Args:
            num_envs: Number of environments.
            threads: Number of threads that step them; results do not depend on it.
            autoreset_mode: Gymnasium's mode, as member, value or name. ``SAME_STEP`` begins the
                next episode in the step that ends one and puts the last observation and info
                into ``final_obs`` and ``final_info``; ``NEXT_STEP`` begins it in the step after;
                ``DISABLED`` leaves it to ``reset(options={"reset_mask": mask})``.
            max_episode_steps: Control steps after which an episode is truncated.
            render_mode: None; only a single environment renders.
            scene: Existing scene, in place of ``asset``, ``task`` and ``joint``.
            **env_fields: Fields of :class:`articulate_envs.make_scene.EnvConfig`, ``asset`` at
                least.

        Raises:
            UsageError: An argument is not accepted, or the object is rejected or out of reach.
        """
        if render_mode is not None:
            raise ConfigError(
                f"render_mode is {quote(render_mode)}; only gymnasium.make(...) renders"
            )
        if num_envs < 1 or threads < 1:
            raise ConfigError(f"num_envs is {num_envs}, threads {threads}; both must be at least 1")
        if max_episode_steps is not None and max_episode_steps < 1:
            raise ConfigError(f"max_episode_steps is {max_episode_steps}; it must be at least 1")
        self.autoreset_mode = _autoreset_mode(autoreset_mode)
        self.metadata: dict[str, Any] = {
            "render_modes": [],
            "autoreset_mode": self.autoreset_mode,
        }
        self.config = read_config(env_fields, "ArticulateVectorEnv", scene)
        self.num_envs = num_envs
        self.engine = ThreadEngine(scene or make_scene(self.config), num_envs, threads=threads)
        self.episodes = RowEpisodes(
            self.engine,
            randomization=self.config.active_randomization,
            reward=self.config.reward,
            initial_states=self.config.initial_states,
            seed=0,
        )
        self.single_observation_space = box(OBSERVATION)
        self.single_action_space = box(ACTION)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._max_steps = max_episode_steps
        self._elapsed = np.zeros(num_envs, dtype=np.int64)
        self._ended = np.zeros(num_envs, dtype=bool)
        self._observation = np.zeros((num_envs, OBSERVATION.size), dtype=np.float32)

    def reset(
        self,
        *,
        seed: int | Sequence[int | None] | None = None,
        options: Mapping[str, Any] | None = None,
    ) -> tuple[Vectors, dict[str, Any]]:
        """Begin episodes and return the observations (N, size) and infos.

        Args:
            seed: One seed for all environments together, or N seeds (None keeps a generator).
                With N seeds environment i repeats the episodes of a single environment with its
                seed, whatever the others do.
            options: :data:`articulate_envs.interface.OPTIONS`, and ``reset_mask``: a boolean mask
                (N,) of the environments to reset.

        Raises:
            EngineError: The seed or an option is not accepted.
        """
        remaining = dict(options or {})
        mask = self._reset_mask(remaining.pop(RESET_MASK, None))
        self._reseed(seed, mask)
        rows = np.flatnonzero(mask)
        start = self.episodes.sample_starts(rows)
        start = apply_options(remaining, start, self.engine.scene)
        if mask.all():
            self.episodes.activate(rows)
            self._observation = self.episodes.reset(start=start).astype(np.float32)
        else:
            self._restart(rows, self.episodes.restart(rows, start))
        self._elapsed[rows], self._ended[rows] = 0, False
        return self._observation.copy(), self._info()

    def _reset_mask(self, mask: Any) -> Mask:
        if mask is None:
            return np.ones(self.num_envs, dtype=bool)
        values = np.asarray(mask)
        if values.shape != (self.num_envs,) or values.dtype != np.bool_ or not values.any():
            raise EngineError(
                f"reset: reset_mask is {quote(mask)}; it must be {self.num_envs} booleans, at "
                "least one of them true"
            )
        if not self.episodes.begun and not values.all():
            raise EngineError("reset: reset_mask at the first reset; begin all environments first")
        return values

    def _reseed(self, seed: Any, mask: Mask) -> None:
        """Set the generators: one for all environments, or one for each with a seed."""
        if seed is None or (isinstance(seed, (int, np.integer)) and mask.all()):
            super().reset(seed=None if seed is None else int(seed))
            self.episodes.reseed(self.np_random)
            if seed is not None:
                self.episodes.reseed_rows(None)
            return
        if isinstance(seed, (int, np.integer)):
            seed = [int(seed) + i for i in range(self.num_envs)]
        try:
            seeds = [None if value is None else int(value) for value in seed]
        except (TypeError, ValueError):
            seeds = []
        if len(seeds) != self.num_envs or any(value is not None and value < 0 for value in seeds):
            raise EngineError(
                f"reset: seed is {quote(seed)}; it must be an integer from 0 on, or one for each "
                f"of {self.num_envs} environments"
            )
        super().reset(seed=None)
        self.episodes.reseed(self.np_random)
        self.episodes.reseed_rows([s if m else None for s, m in zip(seeds, mask, strict=True)])

    def step(
        self, actions: Vectors
    ) -> tuple[Vectors, NDArray[Any], NDArray[Any], NDArray[Any], dict[str, Any]]:
        """Run one control step with actions (N, 8) in all environments.

        Returns:
            Observations (N, size), rewards (N,), terminations and truncations (N,), infos.

        Raises:
            EngineError: The actions are not accepted, or an environment must be reset first.
        """
        if not self.episodes.begun:
            raise EngineError("step before the first reset: call reset() first")
        due = self._ended.copy()
        if due.any() and self.autoreset_mode is AutoresetMode.DISABLED:
            raise EngineError(
                f"step after the end of environments {quote(np.flatnonzero(due).tolist())}: call "
                "reset(options={'reset_mask': mask}) first"
            )
        self.episodes.activate(np.flatnonzero(~due))
        result = self.episodes.step(checked_action(actions, self.num_envs))
        self._observation = result.observation.astype(np.float32)
        reward, terminated, truncated = self._ends(result)
        self._ended = terminated | truncated
        final: dict[str, Any] = {}
        if due.any():
            rows = np.flatnonzero(due)
            reward[rows], terminated[rows], truncated[rows] = 0.0, False, False
            self._ended[rows] = False
            self._restart(rows, self.episodes.restart(rows))
        if self._ended.any() and self.autoreset_mode is AutoresetMode.SAME_STEP:
            rows = np.flatnonzero(self._ended)
            final = self._final(rows)
            self._restart(rows, self.episodes.restart(rows))
            self._ended[rows] = False
        return self._observation.copy(), reward, terminated, truncated, self._info() | final

    def _ends(self, result: StepResult) -> tuple[NDArray[Any], Mask, Mask]:
        """Return rewards, terminations and truncations (N,) of a control step."""
        self._elapsed += 1
        truncated = np.zeros(self.num_envs, dtype=bool)
        if result.ended is not None:
            truncated[result.ended.rows] = result.ended.truncated
        terminated = result.done & ~truncated
        if self._max_steps is not None:
            truncated |= (self._elapsed >= self._max_steps) & ~terminated
        return result.reward.copy(), terminated, truncated

    def _restart(self, rows: Ints, observation: NDArray[Any]) -> None:
        self._observation[rows] = observation.astype(np.float32)
        self._elapsed[rows] = 0

    def close_extras(self, **kwargs: Any) -> None:
        """End the threads of the engine."""
        self.engine.close()

    def _info(self) -> dict[str, Any]:
        params = self.episodes.params
        info: dict[str, Any] = dict(
            episode_info(self.episodes.monitor, self.engine.scene.task, self.episodes.state)
        )
        return info | {"episode_params": {name: params[name] for name in COLUMNS}}

    def _final(self, rows: Ints) -> dict[str, Any]:
        """Return Gymnasium's ``final_obs`` and ``final_info`` of episodes that end, by masks."""
        n = self.num_envs
        mask = np.zeros(n, dtype=bool)
        mask[rows] = True
        last = np.full(n, None, dtype=object)
        for i in rows:
            last[i] = self._observation[i].copy()
        info = episode_info(self.episodes.monitor, self.engine.scene.task, self.episodes.state)
        final: dict[str, Any] = {}
        for name, values in info.items():
            final[name] = np.where(mask, values, np.zeros(1, dtype=values.dtype))
            if values.dtype == object:
                final[name][~mask] = None
            final[f"_{name}"] = mask.copy()
        return {"final_obs": last, "_final_obs": mask, "final_info": final, "_final_info": mask}


def _autoreset_mode(mode: Any) -> AutoresetMode:
    """Return Gymnasium's mode by its member, value or name."""
    for known in AutoresetMode:
        if mode in (known, known.value) or str(mode).upper() == known.name:
            return known
    names = [known.name for known in AutoresetMode]
    raise ConfigError(f"autoreset_mode is {quote(mode)}{nearest(str(mode).upper(), names)}")
