import time

import gymnasium
import pytest
from tests.assets import make_cabinet
from tests.scenes import closing_scene, door_scene, drawer_scene, lid_scene

from articulate.assets.asset import load_asset
from articulate_envs import viewer

ID = "articulate_envs:Articulate/OpenDrawer-v0"


@pytest.fixture(scope="session")
def drawer(tmp_path_factory):
    return drawer_scene(tmp_path_factory.mktemp("drawer"))


@pytest.fixture(scope="session")
def door(tmp_path_factory):
    return door_scene(tmp_path_factory.mktemp("door"))


@pytest.fixture(scope="session")
def lid(tmp_path_factory):
    return lid_scene(tmp_path_factory.mktemp("lid"), "open")


@pytest.fixture(scope="session")
def closing_drawer(tmp_path_factory):
    return closing_scene(tmp_path_factory.mktemp("closing_drawer"), "drawer")


@pytest.fixture(scope="session")
def closing_door(tmp_path_factory):
    return closing_scene(tmp_path_factory.mktemp("closing_door"), "door")


@pytest.fixture(scope="session")
def closing_lid(tmp_path_factory):
    return closing_scene(tmp_path_factory.mktemp("closing_lid"), "lid")


@pytest.fixture(scope="session")
def cabinet_folder(tmp_path_factory):
    return make_cabinet(tmp_path_factory.mktemp("cabinet")).folder


@pytest.fixture
def named(cabinet_folder, monkeypatch):
    """Arguments of an environment on a small cabinet, without its checks."""
    monkeypatch.setattr(
        "articulate_envs.make_scene.load_checked_asset", lambda path, *_: load_asset(path)
    )
    return {
        "asset": str(cabinet_folder),
        "joint": "drawer_2_slide",
        "randomization": {"scales": 3},
    }


@pytest.fixture
def made(named):
    """``made(**changes)``: an environment of gymnasium.make, closed after the test."""
    envs = []

    def make(**changes):
        envs.append(gymnasium.make(ID, **{**named, **changes}))
        return envs[-1]

    yield make
    for env in envs:
        env.close()


@pytest.fixture
def opened(monkeypatch):
    """Viewers that were opened, with a display and without delays."""
    viewers = []

    def open_one(model, data):
        viewers.append(Viewer(model, data))
        return viewers[-1]

    monkeypatch.setenv("DISPLAY", ":0")
    monkeypatch.setattr(viewer, "_open", open_one)
    monkeypatch.setattr(time, "sleep", lambda s: None)
    return viewers


class Viewer:
    """Substitute of MuJoCo's viewer."""

    def __init__(self, model, data):
        self.model, self.data, self.seen, self.open = model, data, [], True

    def is_running(self):
        return self.open

    def lock(self):
        return memoryview(b"")  # any context manager

    def sync(self):
        self.seen.append(self.data.qpos.copy())

    def close(self):
        self.open = False
