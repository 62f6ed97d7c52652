import pytest
from tests.scenes import closing_scene, door_scene, drawer_scene, lid_scene


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
