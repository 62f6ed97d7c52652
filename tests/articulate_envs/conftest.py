import pytest
from tests.scenes import door_scene, drawer_scene


@pytest.fixture(scope="session")
def drawer(tmp_path_factory):
    return drawer_scene(tmp_path_factory.mktemp("drawer"))


@pytest.fixture(scope="session")
def door(tmp_path_factory):
    return door_scene(tmp_path_factory.mktemp("door"))
