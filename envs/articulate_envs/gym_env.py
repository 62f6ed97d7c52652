"""One environment for gymnasium: ``gymnasium.make("articulate_envs:Articulate/OpenDrawer-v0", …)``.

Episodes have the task's length, and the observation holds the time that is left: the end of an
episode is a *termination*, as it is in training, and so is a state that diverged. The environment
itself truncates nothing unless its ``initial_states`` say to cut episodes off;
``gymnasium.make(..., max_episode_steps=N)`` does, and gymnasium tells the two apart.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from articulate.errors import ConfigError, EngineError, nearest
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
MOST_PIXELS = 4096
"""Most pixels of a side of a picture."""


def box(layout: Layout) -> gymnasium.spaces.Space[Vector]:
    """The space of a layout, float32 within its bounds."""
    low, high = (np.asarray(side, dtype=np.float32) for side in (layout.low, layout.high))
    space: gymnasium.spaces.Space[Any] = gymnasium.spaces.Box(low, high)
    return space


class ArticulateEnv(gymnasium.Env[Vector, Vector]):
    """A Panda before an articulated object, stepped at 20 Hz.

    ``observation_layout`` and ``action_layout`` name the numbers of the two vectors.
    """

    metadata: Info = {"render_modes": list(RENDER_MODES), "render_fps": 20}  # noqa: RUF012  its own
    observation_layout = OBSERVATION
    action_layout = ACTION

    def __init__(
        self,
        *,
        render_mode: str | None = None,
        width: int = SIZE[0],
        height: int = SIZE[1],
        scene: Scene | None = None,
        **given: Any,
    ) -> None:
        """Make the environment.

        Args:
            render_mode: ``rgb_array``, ``human`` (MuJoCo's viewer), or None.
            width: Width of pictures [px].
            height: Their height [px].
            scene: A scene that is there already, in place of ``asset``, ``task`` and ``joint``.
            **given: Fields of :class:`articulate_envs.make_scene.EnvConfig`; ``asset`` at least.

        Raises:
            UsageError: An argument is not accepted, the object was refused or cannot be reached,
                or ``human`` is asked for where there is no display.
        """
        self.render_mode = checked_render_mode(render_mode)
        if not (1 <= width <= MOST_PIXELS and 1 <= height <= MOST_PIXELS):
            raise ConfigError(
                f"width is {width} and height {height}; they must be 1 to {MOST_PIXELS} px"
            )
        self.config = read_config(given, "ArticulateEnv", scene)
        self._size = (width, height)
        self.engine = SingleEngine(scene or make_scene(self.config))
        self.episodes = make_episodes(self.engine, self.config, renew=False)
        self.observation_space = box(OBSERVATION)
        self.action_space = box(ACTION)
        # On this machine: what it cannot do need not be tried.
        modes = [m for m in RENDER_MODES if m != "human" or has_display()]
        rate = self.engine.scene.control.rate_hz
        self.metadata = {"render_modes": modes, "render_fps": round(rate)}
        self._running = False
        self._shown: tuple[float, bytes] | None = None
        self._film: SceneRenderer | None = None
        self._window: SceneViewer | None = None

    def reset(
        self, *, seed: int | None = None, options: Mapping[str, Any] | None = None
    ) -> tuple[Vector, Info]:
        """Begin an episode and return its first observation.

        Args:
            seed: Decides everything from here on; None goes on from where the last one led.
            options: See :data:`articulate_envs.interface.OPTIONS`.

        Raises:
            EngineError: An option is not accepted.
        """
        super().reset(seed=seed)
        self.episodes.reseed(self.np_random)
        start = apply_options(options, self.episodes.draw_start(1), self.engine.scene)
        observation = self.episodes.reset(start=start)
        self._running = True
        self._show()
        return self._vector(observation), self._info() | {
            "episode_params": params_dict(start.params)
        }

    def step(self, action: Vector) -> tuple[Vector, float, bool, bool, Info]:
        """Run one tick: observation, reward, terminated, truncated (cut off, by ``initial_states``), info.

        Raises:
            EngineError: The action is not accepted, or no episode is running.
        """
        if not self._running:
            raise EngineError("step without a running episode: call reset() first")
        tick = self.episodes.step(checked_action(action)[None])
        self._running = not bool(tick.done[0])
        self._show()
        reward = float(tick.reward[0])
        cut = tick.ended is not None and bool(tick.ended.cut[0])
        ended = not self._running and not cut
        return self._vector(tick.observation), reward, ended, cut, self._info()

    def render(self) -> Pixels | None:
        """The picture of now (height, width, 3); None in a window, which shows it by itself.

        Raises:
            EngineError: There is no ``render_mode``, or nothing was begun.
            MissingError: Nothing can be drawn here.
        """
        if self.render_mode is None:
            raise EngineError("render without a render_mode: make it with render_mode='rgb_array'")
        if not self.episodes.begun:
            raise EngineError("render before the first reset: call reset() first")
        if self.render_mode == "human":
            return None
        scale, T_wo = self._object()
        if self._film is None:
            self._film = SceneRenderer(self.engine.scene, scale=scale, T_wo=T_wo, size=self._size)
        return np.ascontiguousarray(self._film.frame(self.engine.data.qpos.copy()))

    def snapshot(self) -> dict[str, Any]:
        """All that continuing bit-identically needs, the generator's state included."""
        return self.episodes.snapshot() | {"running": self._running}

    def restore(self, snapshot: dict[str, Any]) -> None:
        """Continue from :meth:`snapshot`, of this environment or another of the same scene."""
        self.episodes.reseed(self.np_random)  # whose state is among what is restored
        self.episodes.restore(snapshot)
        self._running = bool(snapshot["running"])
        self._show()

    def close(self) -> None:
        """Give back pictures, window and engine; closing twice is no harm."""
        self._close_pictures()
        self.engine.close()

    def _vector(self, observation: Array) -> Vector:
        return np.asarray(observation[0], dtype=np.float32)

    def _info(self) -> Info:
        every = episode_info(self.episodes.judgement, self.engine.scene.task, self.episodes.state)
        return {name: values.tolist()[0] for name, values in every.items()}

    def _object(self) -> tuple[float, Array]:
        """Size and pose of the object; pictures of another one are given back."""
        scale, T_wo = self.engine.object_pose(0)
        if self._shown != (scale, T_wo.tobytes()):
            self._close_pictures()
            self._shown = (scale, T_wo.tobytes())
        return scale, T_wo

    def _show(self) -> None:
        if self.render_mode != "human":
            return
        scale, T_wo = self._object()
        scene = self.engine.scene
        if self._window is None:
            self._window = SceneViewer(scene, scale=scale, T_wo=T_wo)
        self._window.show(self.engine.data.qpos, scene.control.step_s)

    def _close_pictures(self) -> None:
        for shown in (self._film, self._window):
            if shown is not None:
                shown.close()
        self._film = self._window = None


def checked_render_mode(mode: str | None) -> str | None:
    """``mode`` if it is one that this machine can.

    Raises:
        ConfigError: There is no such mode.
        MissingError: It is ``human`` and there is no display.
    """
    if mode is not None and mode not in RENDER_MODES:
        raise ConfigError(f"render_mode is {mode!r}{nearest(mode, RENDER_MODES)}")
    if mode == "human":
        require_display()
    return mode
