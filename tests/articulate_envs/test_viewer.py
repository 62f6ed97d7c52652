import sys
import time
import types

import numpy as np
import pytest

from articulate.simulator import mujoco
from articulate_envs.viewer import SceneViewer, has_display


def test_display_is_what_the_environment_names(monkeypatch):
    monkeypatch.setattr(sys, "platform", "linux")
    assert not has_display({})
    assert not has_display({"DISPLAY": ""})
    assert has_display({"DISPLAY": ":0"})
    assert has_display({"WAYLAND_DISPLAY": "wayland-0"})
    monkeypatch.setattr(sys, "platform", "darwin")
    assert has_display({})


def answering(monkeypatch, *, init, launch=None):
    """GLFW and MuJoCo's viewer as they would be with a display of that kind."""
    monkeypatch.setenv("DISPLAY", ":99")
    glfw = types.SimpleNamespace(init=lambda: init)
    viewer = types.SimpleNamespace(launch_passive=launch)
    monkeypatch.setitem(sys.modules, "glfw", glfw)
    monkeypatch.setitem(sys.modules, "mujoco.viewer", viewer)
    monkeypatch.setattr(mujoco, "viewer", viewer, raising=False)


def test_display_that_does_not_answer_is_told_in_one_line(drawer, monkeypatch, error_line):
    """MuJoCo's own call would wait for ever."""
    answering(monkeypatch, init=False)
    T_wo = drawer.placement.T_wo()
    error_line("SceneViewer(DISPLAY=:99)", lambda: SceneViewer(drawer, scale=1.0, T_wo=T_wo))

    def refuse(*_, **__):
        raise RuntimeError("`launch_passive` requires that the script be run under `mjpython`")

    answering(monkeypatch, init=True, launch=refuse)
    error_line("SceneViewer(macOS, python)", lambda: SceneViewer(drawer, scale=1.0, T_wo=T_wo))


def test_window_shows_positions_at_their_pace(drawer, monkeypatch):
    shown = []

    class Viewer:
        def __init__(self, model, data, **_):
            self.data = data

        def is_running(self):
            return True

        def lock(self):
            return memoryview(b"")

        def sync(self):
            shown.append(self.data.qpos.copy())

        def close(self):
            shown.append(None)

    answering(monkeypatch, init=True, launch=Viewer)
    slept: list[float] = []
    monkeypatch.setattr(time, "sleep", slept.append)
    monkeypatch.setattr(time, "monotonic", lambda: 5.0)
    opened = SceneViewer(drawer, scale=1.1, T_wo=drawer.placement.T_wo())
    q = drawer.nominal.qpos0 + 0.01
    for _ in range(2):
        opened.show(q, 0.05)
    opened.close()
    np.testing.assert_array_equal(shown[0], q)
    assert shown[-1] is None
    assert slept == pytest.approx([0.05, 0.1])
