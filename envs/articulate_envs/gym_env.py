"""One environment for gymnasium: ``gymnasium.make("articulate_envs:Articulate/OpenDrawer-v0", …)``.

Episodes have the length of the task and observations contain the remaining time, so the end of an
episode is a *termination*, as in training; so is a diverged state. Truncations come from
``gymnasium.make(..., max_episode_steps=N)`` and from ``initial_states`` that cut episodes off.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from articulate.errors import ConfigError, EngineError, nearest, quote
from articulate.render.canvas import Pixels
from articulate.task.layout import Layout
from articulate.task.observation import ACTION, OBSERVATION
from articulate.transforms import Array
from articulate_envs.interface import apply_options, checked_action, episode_info, params_dict
from articulate_envs.make_scene import make_episodes, make_scene, read_config
from articulate_envs.scene import Scene
from articulate_envs.single_engine import SingleEngine
from articulate_envs.video import SIZE, SceneRenderer
from articulate_envs.viewer import SceneViewer, has_display, require_display

Vector = NDArray[np.float32]
Info = dict[str, Any]
RENDER_MODES = ("rgb_array", "human")
MAX_PIXELS = 4096
"""Largest width and height of an image [px]."""


def box(layout: Layout) -> gymnasium.spaces.Space[Vector]:
    """Return the float32 space of a layout with its bounds."""
    low, high = (np.asarray(side, dtype=np.float32) for side in (layout.low, layout.high))
    space: gymnasium.spaces.Space[Any] = gymnasium.spaces.Box(low, high)
    return space


class ArticulateEnv(gymnasium.Env[Vector, Vector]):
    """A Panda in front of an articulated object, stepped at 20 Hz.

    ``observation_layout`` and ``action_layout`` name the fields of the two vectors.
    """

    metadata: Info = {"render_modes": list(RENDER_MODES), "render_fps": 20}  # noqa: RUF012
    observation_layout = OBSERVATION
    action_layout = ACTION

    def __init__(
        self,
        *,
        render_mode: str | None = None,
        width: int = SIZE[0],
        height: int = SIZE[1],
        scene: Scene | None = None,
        **env_fields: Any,
    ) -> None:
        """Make the environment.

        Args:
            render_mode: ``rgb_array``, ``human`` (MuJoCo's viewer), or None.
            width: Width of images [px].
            height: Height of images [px].
            scene: Existing scene, in place of ``asset``, ``task`` and ``joint``.
            **env_fields: Fields of :class:`articulate_envs.make_scene.EnvConfig`, ``asset`` at
                least.

        Raises:
            UsageError: An argument is not accepted, the object is rejected or out of reach, or
                ``human`` is requested without a display.
        """
        self.render_mode = checked_render_mode(render_mode)
        if not (1 <= width <= MAX_PIXELS and 1 <= height <= MAX_PIXELS):
            raise ConfigError(
                f"width is {width} and height {height}; they must be 1 to {MAX_PIXELS} px"
            )
        self.config = read_config(env_fields, "ArticulateEnv", scene)
        self._size = (width, height)
        self.engine = SingleEngine(scene or make_scene(self.config))
        self.episodes = make_episodes(self.engine, self.config, renew=False)
        self.observation_space = box(OBSERVATION)
        self.action_space = box(ACTION)
        modes = [m for m in RENDER_MODES if m != "human" or has_display()]
        rate = self.engine.scene.control.rate_hz
        self.metadata = {"render_modes": modes, "render_fps": round(rate)}
        self._running = False
        self._rendered_pose: tuple[float, bytes] | None = None
        self._renderer: SceneRenderer | None = None
        self._viewer: SceneViewer | None = None

    def reset(
        self, *, seed: int | None = None, options: Mapping[str, Any] | None = None
    ) -> tuple[Vector, Info]:
        """Begin an episode and return its first observation (size,) and info.

        Args:
            seed: Seed of this and the following episodes; None continues with the generator.
            options: See :data:`articulate_envs.interface.OPTIONS`.

        Raises:
            EngineError: An option is not accepted.
        """
        super().reset(seed=seed)
        self.episodes.reseed(self.np_random)
        start = apply_options(options, self.episodes.sample_start(1), self.engine.scene)
        observation = self.episodes.reset(start=start)
        self._running = True
        self._update_viewer()
        info = self._info() | {"episode_params": params_dict(start.params)}
        return self._vector(observation), info

    def step(self, action: Vector) -> tuple[Vector, float, bool, bool, Info]:
        """Run one control step with an action (8,) in [-1, 1].

        Returns:
            Observation (size,), reward, terminated, truncated (by ``initial_states``), info.

        Raises:
            EngineError: The action is not accepted, or no episode is running.
        """
        if not self._running:
            raise EngineError("step without a running episode: call reset() first")
        result = self.episodes.step(checked_action(action)[None])
        self._running = not bool(result.done[0])
        self._update_viewer()
        reward = float(result.reward[0])
        cut = result.ended is not None and bool(result.ended.truncated[0])
        ended = not self._running and not cut
        return self._vector(result.observation), reward, ended, cut, self._info()

    def render(self) -> Pixels | None:
        """Return an image of the state (height, width, 3) [0 to 255]; None in mode ``human``.

        Raises:
            EngineError: There is no ``render_mode``, or no episode has begun.
            MissingError: This machine cannot render.
        """
        if self.render_mode is None:
            raise EngineError("render without a render_mode: make it with render_mode='rgb_array'")
        if not self.episodes.begun:
            raise EngineError("render before the first reset: call reset() first")
        if self.render_mode == "human":
            return None
        scale, T_wo = self._object_pose()
        if self._renderer is None:
            self._renderer = SceneRenderer(
                self.engine.scene, scale=scale, T_wo=T_wo, size=self._size
            )
        return np.ascontiguousarray(self._renderer.frame(self.engine.data.qpos.copy()))

    def snapshot(self) -> dict[str, Any]:
        """Return the state that a bit-identical continuation needs, with the generator's."""
        return self.episodes.snapshot() | {"running": self._running}

    def restore(self, snapshot: dict[str, Any]) -> None:
        """Continue from :meth:`snapshot`, of this environment or another of the same scene."""
        self.episodes.reseed(self.np_random)  # its state is part of the snapshot
        self.episodes.restore(snapshot)
        self._running = bool(snapshot["running"])
        self._update_viewer()

    def close(self) -> None:
        """Close renderer, viewer and engine; closing twice does nothing."""
        self._close_views()
        self.engine.close()

    def _vector(self, observation: Array) -> Vector:
        return np.asarray(observation[0], dtype=np.float32)

    def _info(self) -> Info:
        info = episode_info(self.episodes.monitor, self.engine.scene.task, self.episodes.state)
        return {name: values.tolist()[0] for name, values in info.items()}

    def _object_pose(self) -> tuple[float, Array]:
        """Return size and pose of the object; close the views of another size or pose."""
        scale, T_wo = self.engine.object_pose(0)
        if self._rendered_pose != (scale, T_wo.tobytes()):
            self._close_views()
            self._rendered_pose = (scale, T_wo.tobytes())
        return scale, T_wo

    def _update_viewer(self) -> None:
        if self.render_mode != "human":
            return
        scale, T_wo = self._object_pose()
        scene = self.engine.scene
        if self._viewer is None:
            self._viewer = SceneViewer(scene, scale=scale, T_wo=T_wo)
        self._viewer.show(self.engine.data.qpos, scene.control.step_s)

    def _close_views(self) -> None:
        for view in (self._renderer, self._viewer):
            if view is not None:
                view.close()
        self._renderer = self._viewer = None


def checked_render_mode(mode: str | None) -> str | None:
    """Return ``mode`` if it is supported on this machine.

    Raises:
        ConfigError: The mode is unknown.
        MissingError: It is ``human`` and there is no display.
    """
    if mode is not None and mode not in RENDER_MODES:
        raise ConfigError(f"render_mode is {quote(mode)}{nearest(mode, RENDER_MODES)}")
    if mode == "human":
        require_display()
    return mode
