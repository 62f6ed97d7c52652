"""A policy is judged at finer steps on the draws that it had at its own."""

import pytest
from tests.assets import make_cabinet
from tests.runs import make_run

from articulate.errors import ConfigError
from finer import line, rows


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("finer")
    return make_run(folder / "run", make_cabinet(folder / "cabinet"), episode_s=1.0)


def test_each_step_has_a_row_and_the_own_step_changes_nothing(run):
    own, same, half = rows(run, 0, episodes=4, draws=5, timesteps_s=[0.005, 0.0025])
    assert own == same
    assert [own["timestep_ms"], half["timestep_ms"]] == [5.0, 2.5]
    assert own["success"] == 0.0
    assert sum(own["reasons"].values()) == sum(half["reasons"].values()) == 4
    assert line(half).startswith("  2.5 ms  success   0.0 %")


def test_a_step_that_does_not_fit_into_a_tick_is_refused(run):
    with pytest.raises(ConfigError, match=r"timestep_s is 0\.003"):
        rows(run, 0, episodes=1, draws=5, timesteps_s=[0.003])
