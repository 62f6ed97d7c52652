"""The batched engine for gymnasium: ``gymnasium.make_vec("articulate_envs:Articulate/…", 64, …)``.

Environments that end begin anew in the same step (``AutoresetMode.SAME_STEP``); what the last
observation and info were stands in ``final_obs`` and ``final_info``. What ends is a termination,
as in :mod:`articulate_envs.gym_env`; what ``starts`` cuts off is a truncation.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from articulate.errors import ConfigError, EngineError
from articulate.task.episode_monitor import REASONS
from articulate.task.observation import ACTION, OBSERVATION
from articulate.task.randomization import COLUMNS
from articulate_envs.episodes import Ended
from articulate_envs.gym_env import box
from articulate_envs.interface import checked_action, start_asked_for, told
from articulate_envs.make_scene import make_episodes, make_scene, read_config
from articulate_envs.scene import Scene
from articulate_envs.threaded_engine import ThreadEngine

Vectors = NDArray[np.float32]


class ArticulateVectorEnv(VectorEnv[Vectors, Vectors, NDArray[Any]]):
    """N environments on native threads; one generator decides all of them."""

    metadata: dict[str, Any] = {  # noqa: RUF012  gymnasium's name, never changed
        "render_modes": [],
        "autoreset_mode": AutoresetMode.SAME_STEP,
    }
    observation_layout = OBSERVATION
    action_layout = ACTION

    def __init__(
        self,
        *,
        num_envs: int = 1,
        threads: int = 1,
        render_mode: str | None = None,
        scene: Scene | None = None,
        **given: Any,
    ) -> None:
        """Make the environments.

        Args:
            num_envs: How many.
            threads: How many threads step them; results do not depend on it.
            render_mode: None; a single environment draws.
            scene: A scene that is there already, in place of ``asset``, ``task`` and ``joint``.
            **given: Fields of :class:`articulate_envs.make_scene.EnvConfig`; ``asset`` at least.

        Raises:
            UsageError: An argument is not accepted, or the object was refused or cannot be reached.
        """
        if render_mode is not None:
            raise ConfigError(
                f"render_mode is {render_mode!r}; gymnasium.make(...) draws, not many"
            )
        if num_envs < 1 or threads < 1:
            raise ConfigError(f"num_envs is {num_envs}, threads {threads}; both must be at least 1")
        self.config = read_config(given, "ArticulateVectorEnv", scene)
        self.num_envs = num_envs
        self.engine = ThreadEngine(scene or make_scene(self.config), num_envs, threads=threads)
        self.episodes = make_episodes(self.engine, self.config, renew=True)
        self.single_observation_space = box(OBSERVATION)
        self.single_action_space = box(ACTION)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._running = False

    def reset(
        self, *, seed: int | None = None, options: Mapping[str, Any] | None = None
    ) -> tuple[Vectors, dict[str, Any]]:
        """Begin all episodes; arguments as in :meth:`articulate_envs.gym_env.ArticulateEnv.reset`.

        Raises:
            EngineError: The seed is no single number, or an option is not accepted.
        """
        if seed is not None and not isinstance(seed, (int, np.integer)):
            raise EngineError(f"reset: seed is {seed!r}; one whole number decides all environments")
        super().reset(seed=seed)
        self.episodes.reseed(self.np_random)
        start = start_asked_for(options, self.episodes.draw_start(self.num_envs), self.engine.scene)
        observation = self.episodes.reset(start=start)
        self._running = True
        return observation.astype(np.float32), self._info()

    def step(
        self, actions: Vectors
    ) -> tuple[Vectors, NDArray[Any], NDArray[Any], NDArray[Any], dict[str, Any]]:
        """Run one tick in all environments.

        Raises:
            EngineError: The actions are not accepted, or nothing was begun.
        """
        if not self._running:
            raise EngineError("step before the first reset: call reset() first")
        tick = self.episodes.step(checked_action(actions, self.num_envs))
        cut = np.zeros(self.num_envs, dtype=bool)
        info = self._info()
        if tick.ended is not None:
            cut[tick.ended.rows] = tick.ended.cut
            info |= self._final(tick.ended)
        observation = tick.observation.astype(np.float32)
        return observation, tick.reward, tick.done & ~cut, cut, info

    def close_extras(self, **kwargs: Any) -> None:
        """Give back the engine's threads."""
        self.engine.close()

    def _info(self) -> dict[str, Any]:
        every = told(self.episodes.judgement, self.engine.scene.task, self.episodes.state)
        drawn = self.episodes.drawn
        every["draw"] = {name: drawn[name] for name in COLUMNS}  # type: ignore[assignment]
        return every

    def _final(self, ended: Ended) -> dict[str, Any]:
        """What gymnasium says of episodes that ended, in rows of all environments."""
        n, rows = self.num_envs, ended.rows
        mask = np.zeros(n, dtype=bool)
        mask[rows] = True
        last = np.full(n, None, dtype=object)
        for k, i in enumerate(rows):
            last[i] = ended.observation[k].astype(np.float32)

        def spread(values: NDArray[Any], empty: Any) -> NDArray[Any]:
            out = np.full(n, empty, dtype=values.dtype)
            out[rows] = values
            return out

        reasons = np.array([REASONS[int(code)] for code in ended.code], dtype=object)
        final: dict[str, Any] = {
            "success": spread(ended.code == 0, False),
            "reason": spread(reasons, None),
            "opened": spread(ended.opened, False),
        }
        final |= {f"_{name}": mask.copy() for name in list(final)}
        return {"final_obs": last, "_final_obs": mask, "final_info": final, "_final_info": mask}
