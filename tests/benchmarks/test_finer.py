"""A policy is judged at finer steps on the draws that it had at its own."""

import importlib.util
import sys
from pathlib import Path

import pytest
from tests.assets import make_cabinet
from tests.runs import make_run

from articulate.errors import ConfigError


@pytest.fixture(scope="module")
def finer():
    path = Path(__file__).parents[2] / "benchmarks" / "finer.py"
    spec = importlib.util.spec_from_file_location("finer", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["finer"] = module
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("finer")
    return make_run(folder / "run", make_cabinet(folder / "cabinet"), episode_s=1.0)


def test_each_step_has_a_row_and_the_own_step_changes_nothing(finer, run):
    own, same, half = finer.rows(run, 0, episodes=4, draws=5, timesteps_s=[0.005, 0.0025])
    assert own == same
    assert [own["timestep_ms"], half["timestep_ms"]] == [5.0, 2.5]
    assert own["success"] == 0.0
    assert sum(own["reasons"].values()) == sum(half["reasons"].values()) == 4
    assert finer.line(half).startswith("  2.5 ms  success   0.0 %")


def test_a_step_that_does_not_fit_into_a_tick_is_refused(finer, run):
    with pytest.raises(ConfigError, match=r"timestep_s is 0\.003"):
        finer.rows(run, 0, episodes=1, draws=5, timesteps_s=[0.003])
