import pytest
from tests.scenes import drawer_scene


@pytest.fixture(scope="session")
def drawer(tmp_path_factory):
    return drawer_scene(tmp_path_factory.mktemp("drawer"))
