"""The estimate separates objects that the scripted expert opens from those that nobody opens."""

from dataclasses import replace

import pytest
from tests.assets import make_cabinet
from tests.scenes import make_scene

from articulate.errors import ConfigError
from articulate.task.episode_monitor import REASONS
from articulate.task.randomization_config import NO_RANDOMIZATION
from articulate_envs.feasibility import Feasibility, estimate_feasibility


@pytest.fixture(scope="module")
def cabinet(drawer):
    """The cabinet in episodes that are long enough to open a drawer."""
    return replace(drawer, task=replace(drawer.task, episode_s=10.0))


def test_expert_opens_the_small_cabinet(cabinet):
    estimate = estimate_feasibility(cabinet, n_episodes=32)
    assert estimate.success >= 0.8
    assert estimate.n_episodes == 32


def test_drawer_that_is_too_heavy_is_not_feasible(tmp_path):
    asset = make_cabinet(tmp_path, slab_kg=2000.0)
    scene = make_scene(asset, "drawer_2_slide", episode_s=4.0)
    estimate = estimate_feasibility(scene, n_episodes=16)
    assert estimate.success == 0.0
    assert estimate.dominant_failure in REASONS[1:]


def test_drawer_without_enough_time_is_not_feasible(drawer):
    estimate = estimate_feasibility(drawer, n_episodes=16, n_threads=1)
    assert estimate == Feasibility(success=0.0, n_episodes=16, dominant_failure="goal_not_reached")
    assert estimate.to_dict() == {
        "success": 0.0,
        "n_episodes": 16,
        "dominant_failure": "goal_not_reached",
    }


def test_handle_that_is_estimated_wrong_by_centimetres_is_not_feasible(cabinet):
    config = replace(NO_RANDOMIZATION, estimate_bias_m=0.05)
    exact = estimate_feasibility(cabinet, n_episodes=16, randomization=NO_RANDOMIZATION)
    wrong = estimate_feasibility(cabinet, n_episodes=16, randomization=config)
    assert exact.success == 1.0
    assert wrong.success < 0.5


def test_result_depends_on_the_seed_and_not_on_the_number_of_threads(drawer):
    task = replace(drawer.task, episode_s=4.0, target=0.1)
    scene = replace(drawer, task=task)
    one, two = (
        estimate_feasibility(scene, n_episodes=16, seed=3, n_threads=n_threads)
        for n_threads in (1, 2)
    )
    assert one == two


def test_no_episodes_are_rejected(drawer):
    with pytest.raises(ConfigError, match="n_episodes is 0; it must be at least 1"):
        estimate_feasibility(drawer, n_episodes=0)
