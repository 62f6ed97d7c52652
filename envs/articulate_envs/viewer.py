"""A scene in MuJoCo's interactive viewer; it requires a display."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Mapping
from typing import Any

from articulate.errors import MissingError
from articulate.simulator import mujoco
from articulate.transforms import Array
from articulate_envs.scene import Scene
from articulate_envs.video import set_positions, visual_model

DISPLAYS = ("DISPLAY", "WAYLAND_DISPLAY")
"""Environment variables that name the display on Linux."""


def has_display(environment: Mapping[str, str] = os.environ) -> bool:
    """Return whether a window can be opened on this machine."""
    return sys.platform != "linux" or any(environment.get(name) for name in DISPLAYS)


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


def require_display() -> None:
    """Check that a display is configured.

    Raises:
        MissingError: There is no display.
    """
    if not has_display():
        raise MissingError(_NO_WINDOW.format(f"neither {' nor '.join(DISPLAYS)} is set"))


_NO_WINDOW = "cannot open a window: {}; use images (rgb_array) instead, or set DISPLAY"


def _open(model: mujoco.MjModel, data: mujoco.MjData) -> Any:
    """Open MuJoCo's viewer in another thread.

    GLFW is checked first: without a display the thread of the viewer would end and its caller
    would block forever.
    """
    require_display()
    try:
        # They load OpenGL, which off-screen rendering does not need.
        import glfw
        import mujoco.viewer  # noqa: TID251

        if not glfw.init():
            raise MissingError(_NO_WINDOW.format("the display does not answer"))
        return mujoco.viewer.launch_passive(model, data, show_left_ui=False, show_right_ui=False)
    except (ImportError, RuntimeError, mujoco.FatalError) as error:
        raise MissingError(_NO_WINDOW.format(str(error).splitlines()[0])) from None
