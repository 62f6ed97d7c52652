"""That a driver is missing is told without one; drawing itself needs EGL (marked render)."""

import subprocess
import sys
from types import ModuleType

import numpy as np
import pytest

from articulate.errors import MissingError
from articulate.render.canvas import DRIVER, Canvas
from articulate.simulator import mujoco

BALL = """
<mujoco><visual><global offwidth="64" offheight="48"/></visual><worldbody>
  <light pos="0 0 3"/><geom type="sphere" size="0.3" rgba="1 0 0 1" pos="0 0 0.5"/>
  <geom type="sphere" size="0.3" rgba="0 0 1 1" group="3"/>
</worldbody></mujoco>"""


def _canvas():
    return Canvas(mujoco.MjModel.from_xml_string(BALL), (64, 48), shadows=False)


@pytest.mark.parametrize("error", [AttributeError, ImportError, RuntimeError, mujoco.FatalError])
def test_without_a_driver_one_line_says_what_to_install(monkeypatch, error):
    class Refusing:
        def __init__(self, width, height):
            raise error("no eglQueryString\nsecond line")

    module = ModuleType("mujoco.egl")
    module.GLContext = Refusing  # type: ignore[attr-defined]  # a stand-in
    monkeypatch.setitem(sys.modules, "mujoco.egl", module)
    monkeypatch.setenv(DRIVER, "egl")
    with pytest.raises(MissingError, match="libegl1") as caught:
        _canvas()
    assert "\n" not in str(caught.value)
    assert "(MUJOCO_GL egl: no eglQueryString)" in str(caught.value)


def test_an_unknown_driver_is_told_in_the_same_line(monkeypatch):
    monkeypatch.setenv(DRIVER, "crayons")
    with pytest.raises(MissingError, match="MUJOCO_GL crayons"):
        _canvas()


@pytest.mark.render
def test_what_is_high_is_drawn_high_and_what_is_hidden_is_not_drawn():
    model = mujoco.MjModel.from_xml_string(BALL)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    camera = mujoco.MjvCamera()
    camera.distance, camera.elevation = 3.0, 0.0
    canvas = Canvas(model, (64, 48), shadows=False)
    pixels = canvas.render(data, camera).astype(int)
    canvas.close()
    assert pixels.shape == (48, 64, 3)
    red = np.argwhere(pixels[..., 0] > pixels[..., 2] + 50)
    assert len(red) > 50
    assert red[:, 0].mean() < 24  # rows count from above
    assert not np.any(pixels[..., 2] > pixels[..., 0] + 50)


@pytest.mark.render
@pytest.mark.parametrize("closings", [0, 1, 2])
def test_canvas_ends_in_silence_however_often_it_was_closed(closings):
    """One that nobody closed must go before its driver does, at the end of the process."""
    code = (
        "import mujoco; from articulate.render.canvas import Canvas; "
        f"canvas = Canvas(mujoco.MjModel.from_xml_string({BALL!r}), (64, 48), shadows=False); "
        f"[canvas.close() for _ in range({closings})]"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert (done.stdout, done.stderr, done.returncode) == ("", "", 0)
