"""MuJoCo's interactive viewer; it requires a display."""

from __future__ import annotations

import os
import sys
from collections.abc import Mapping
from typing import Any

from articulate.errors import MissingError
from articulate.simulator import mujoco

DISPLAYS = ("DISPLAY", "WAYLAND_DISPLAY")
"""Environment variables that name the display on Linux."""
_NO_WINDOW = "cannot open a window: {}; use images (rgb_array) instead, or set DISPLAY"


def has_display(environment: Mapping[str, str] = os.environ) -> bool:
    """Return whether a window can be opened on this machine."""
    return sys.platform != "linux" or any(environment.get(name) for name in DISPLAYS)


def require_display() -> None:
    """Check that a display is configured.

    Raises:
        MissingError: There is no display.
    """
    if not has_display():
        raise MissingError(_NO_WINDOW.format(f"neither {' nor '.join(DISPLAYS)} is set"))


def open_viewer(model: mujoco.MjModel, data: mujoco.MjData) -> Any:
    """Open MuJoCo's passive viewer in another thread and return its handle.

    GLFW is checked first: without a display the thread of the viewer would end and its caller
    would block forever.

    Raises:
        MissingError: There is no display.
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
