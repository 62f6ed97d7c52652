import shutil

import pytest
from tests.assets import make_cabinet
from tests.runs import tiny_run
from tests.scenes import drawer_scene

from articulate_train.run import open_run


@pytest.fixture(scope="session")
def drawer(tmp_path_factory):
    return drawer_scene(tmp_path_factory.mktemp("drawer"))


@pytest.fixture(scope="session")
def cabinet(tmp_path_factory):
    return make_cabinet(tmp_path_factory.mktemp("cabinet"))


@pytest.fixture(scope="session")
def fresh(cabinet, tmp_path_factory):
    """A tiny run that was not begun; not to be changed."""
    return tiny_run(tmp_path_factory.mktemp("fresh") / "run", cabinet)


@pytest.fixture
def tiny(fresh, tmp_path):
    """A tiny run that was not begun, for one test."""
    shutil.copytree(fresh.folder, tmp_path / "run")
    return open_run(tmp_path / "run")
