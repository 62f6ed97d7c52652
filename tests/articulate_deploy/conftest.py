import shutil

import pytest
from tests.assets import make_cabinet
from tests.runs import make_run

from articulate_deploy.bundle import load_bundle
from articulate_train.export import export_policy
from articulate_train.run import open_run


@pytest.fixture(scope="session")
def run(tmp_path_factory):
    """A run whose policy learned nothing, in episodes of two seconds."""
    folder = tmp_path_factory.mktemp("runs")
    return open_run(make_run(folder / "run", make_cabinet(folder / "cabinet"), episode_s=2.0))


@pytest.fixture(scope="session")
def exported(run, tmp_path_factory):
    """Its bundle as a folder; not to be changed."""
    return export_policy(run.folder, tmp_path_factory.mktemp("bundles") / "bundle").path


@pytest.fixture
def folder(exported, tmp_path):
    """A copy of the bundle that a test may change."""
    return shutil.copytree(exported, tmp_path / "bundle")


@pytest.fixture(scope="session")
def bundle(exported):
    return load_bundle(exported)
