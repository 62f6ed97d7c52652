"""Off-screen rendering with MuJoCo.

``mujoco.Renderer`` uses the driver that ``MUJOCO_GL`` names when MuJoCo is first imported, and that
import fails if its library is missing. A canvas loads the driver when it is created, so that
everything except images works without one.
"""

from __future__ import annotations

import atexit
import functools
import importlib
import os
import sys
import warnings
import weakref
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from articulate.errors import MissingError
from articulate.simulator import mujoco

Pixels = NDArray[np.uint8]
DRIVER = "MUJOCO_GL"
"""Environment variable with the driver: egl (default on Linux), osmesa or glfw."""
GEOM_GROUPS = (0, 1, 2)
"""Groups of geoms that are rendered by default."""


class Canvas:
    """Off-screen buffer for one model; call ``close`` when it is no longer needed."""

    def __init__(self, model: mujoco.MjModel, size: tuple[int, int], *, shadows: bool) -> None:
        """Create a buffer.

        Args:
            model: Model to render; its off-screen buffer must be large enough.
            size: Width and height [px].
            shadows: Render shadows; a frame then takes about five times as long.

        Raises:
            MissingError: This machine cannot render.
        """
        self._model = model
        self._size = size
        self._gl, self._context = open_context(model, size)
        # Close a forgotten canvas before its driver: handlers run in reverse order of registration.
        self._at_exit = functools.partial(_close_late, weakref.ref(self))
        atexit.register(self._at_exit)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, self._context)
        self._scene = mujoco.MjvScene(model, maxgeom=model.ngeom + 100)
        self._option = mujoco.MjvOption()
        self._option.sitegroup[:] = 0
        flags = self._scene.flags
        flags[mujoco.mjtRndFlag.mjRND_SHADOW] = int(shadows)
        flags[mujoco.mjtRndFlag.mjRND_REFLECTION] = 0
        flags[mujoco.mjtRndFlag.mjRND_HAZE] = 1

    def render(
        self,
        data: mujoco.MjData,
        camera: mujoco.MjvCamera,
        groups: Sequence[int] = GEOM_GROUPS,
    ) -> Pixels:
        """Render the geoms in ``groups`` as an image (height, width, 3)."""
        width, height = self._size
        self._option.geomgroup[:] = [int(g in groups) for g in range(mujoco.mjNGROUP)]
        self._gl.make_current()
        every = mujoco.mjtCatBit.mjCAT_ALL
        mujoco.mjv_updateScene(self._model, data, self._option, None, camera, every, self._scene)
        area = mujoco.MjrRect(0, 0, width, height)
        mujoco.mjr_render(area, self._scene, self._context)
        pixels = np.zeros((height, width, 3), dtype=np.uint8)
        mujoco.mjr_readPixels(pixels, None, area, self._context)
        return pixels[::-1]  # OpenGL counts rows from below

    def close(self) -> None:
        """Free the buffer; it may be called twice."""
        atexit.unregister(self._at_exit)
        self._context.free()
        self._gl.free()


def _close_late(canvas: weakref.ref[Canvas]) -> None:
    """Close a canvas that is still open at the end of the process."""
    left = canvas()
    if left is not None:
        left.close()


def open_context(model: mujoco.MjModel, size: tuple[int, int]) -> tuple[Any, mujoco.MjrContext]:
    """Return a current OpenGL context with the model loaded.

    Raises:
        MissingError: There is no driver.
    """
    name = os.environ.get(DRIVER, "").lower() or ("egl" if sys.platform == "linux" else "glfw")
    try:
        kind = importlib.import_module(f"mujoco.{name}").GLContext
        gl = kind.__new__(kind)
        gl._context = None  # its __del__ reads it even if __init__ failed
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # GLFW warns where there is no display
            gl.__init__(*size)
        if not gl._context:  # MuJoCo must not be called: it ends the process the second time
            raise RuntimeError("no display")
        gl.make_current()
        return gl, mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_100)
    except Exception as error:  # noqa: BLE001  drivers raise anything, and images are optional
        what = (str(error).strip().splitlines() or [type(error).__name__])[0]
        raise MissingError(
            f"cannot render here ({DRIVER} {name}: {what}); install Debian's libegl1, libegl-mesa0 "
            f"and libgl1-mesa-dri, and leave {DRIVER} unset or set it to egl"
        ) from None
