"""A scene in MuJoCo's interactive viewer; it requires a display."""

from __future__ import annotations

import time

from articulate.render.viewer import DISPLAYS, has_display, require_display
from articulate.render.viewer import open_viewer as _open
from articulate.simulator import mujoco
from articulate.transforms import Array
from articulate_envs.scene import Scene
from articulate_envs.video import set_positions, visual_model

__all__ = ["DISPLAYS", "SceneViewer", "has_display", "require_display"]


class SceneViewer:
    """Interactive window of a scene at given positions of its model."""

    def __init__(self, scene: Scene, *, scale: float, T_wo: Array) -> None:
        """Open the window.

        Args:
            scene: Scene to show.
            scale: Size factor of the object.
            T_wo: Pose of the object in the world (4, 4).

        Raises:
            MissingError: There is no display.
        """
        self._model = visual_model(scene, scale=scale, T_wo=T_wo)
        self._data = mujoco.MjData(self._model)
        self._viewer = _open(self._model, self._data)
        self._next_s = time.monotonic()

    def show(self, qpos: Array, step_s: float = 0.0) -> None:
        """Show positions (nq,), ``step_s`` [s] after the previous ones, unless it was closed."""
        if self._viewer.is_running():
            with self._viewer.lock():
                set_positions(self._model, self._data, qpos)
            self._viewer.sync()
        now = time.monotonic()
        self._next_s = max(self._next_s + step_s, now)
        time.sleep(self._next_s - now)

    def close(self) -> None:
        """Close the window."""
        self._viewer.close()
