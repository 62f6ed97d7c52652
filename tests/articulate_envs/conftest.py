import gymnasium
import pytest
from tests.assets import make_cabinet
from tests.scenes import door_scene, drawer_scene

from articulate.asset import load_asset

ID = "articulate_envs:Articulate/OpenDrawer-v0"


@pytest.fixture(scope="session")
def drawer(tmp_path_factory):
    return drawer_scene(tmp_path_factory.mktemp("drawer"))


@pytest.fixture(scope="session")
def door(tmp_path_factory):
    return door_scene(tmp_path_factory.mktemp("door"))


@pytest.fixture(scope="session")
def cabinet_folder(tmp_path_factory):
    return make_cabinet(tmp_path_factory.mktemp("cabinet")).folder


@pytest.fixture
def named(cabinet_folder, monkeypatch):
    """Arguments of an environment on a cabinet of ours, which is taken as it is, unproven."""
    monkeypatch.setattr("articulate_envs.make.proven_asset", lambda path, *_: load_asset(path))
    return {
        "asset": str(cabinet_folder),
        "joint": "drawer_2_slide",
        "draw": {"scales": 3},
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
