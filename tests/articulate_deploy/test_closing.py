"""A run that closes a part, its bundle, the stand-in: one start, one plant, one failure_reason."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from tests.articulate_deploy.test_mujoco import compare
from tests.assets import make_box, make_cabinet
from tests.runs import make_run, tiny_run

from articulate.task.episode_monitor import REASONS
from articulate.task.randomization import EpisodeParams, nominal_params, sample_episode_params
from articulate_deploy.bundle import load_bundle
from articulate_deploy.deploy import deploy
from articulate_deploy.plan import one_size
from articulate_deploy.robots.mujoco import MujocoRobot
from articulate_envs.initial_states import home_start
from articulate_envs.threaded_engine import ThreadEngine
from articulate_train.export import export_policy
from articulate_train.run import open_run
from articulate_train.seed_runner import train_seeds

TASKS = {"close_drawer": "drawer_2_slide", "close_lid": "lid_hinge", "open_lid": "lid_hinge"}
TICKS = 40


@pytest.fixture(scope="module", params=TASKS)
def made(request, tmp_path_factory):
    """A run whose policy learned nothing, and its bundle."""
    name, folder = request.param, tmp_path_factory.mktemp("runs")
    asset = (make_box if name.endswith("lid") else make_cabinet)(folder / "object")
    path = make_run(folder / "run", asset, joint=TASKS[name], task=name, episode_s=2.0)
    run = open_run(path)
    return run, load_bundle(export_policy(run.folder, folder / "bundle").path)


def test_task_and_place_are_in_the_bundle_as_they_were_trained(made):
    run, bundle = made
    assert bundle.manifest.task == run.task
    assert bundle.manifest.placement == run.placement


def test_the_stand_in_of_a_closing_or_turning_part_is_the_plant_of_training(made):
    run, bundle = made
    manifest, rng = bundle.manifest, np.random.default_rng(0)
    engine = ThreadEngine(run.scene((1.0,)), 1)
    drawn = sample_episode_params(one_size(manifest), rng, begin=run.task.begin)
    actions = rng.uniform(-1.0, 1.0, (TICKS, 8))
    with MujocoRobot(bundle) as robot:
        compare(engine, robot, manifest, home_start(engine.scene, drawn), actions, atol=1e-6)
    engine.close()


def test_the_stand_in_begins_where_the_part_was_drawn_and_stays_there(made):
    run, bundle = made
    with MujocoRobot(bundle) as robot:
        middle = np.mean(run.task.begin)
        assert_allclose(robot.object_state().opened, middle, atol=1e-12)
        for share in (0.0, 1.0):
            row: EpisodeParams = nominal_params(begin=run.task.begin)
            row.values[:, -1] = run.task.begin[0] + share * np.ptp(run.task.begin)
            robot.set_episode_params(row)
            robot.reset_to(np.asarray(bundle.manifest.start.q), 0.08)
            assert_allclose(robot.object_state().opened, row["part_open"], atol=1e-12)


def test_what_trains_is_exported_and_deployed_and_judged_as_closed_or_not(tmp_path):
    """The chain with a run of a few updates; its policy has learned nothing."""
    asset = make_box(tmp_path / "object")
    run = tiny_run(tmp_path / "run", asset, updates=2, task="close_lid", joint="lid_hinge")
    assert train_seeds(run, lambda _: None)
    path = export_policy(run.folder, tmp_path / "bundle.zip").path
    report = deploy(path, episodes=3, seed=1, out=tmp_path / "out")
    low, high = run.task.begin
    for k, (drawn, result) in enumerate(zip(report.episode_params, report.results, strict=True)):
        assert low <= drawn["part_open"][0] <= high
        with np.load(tmp_path / "out" / f"episode_{k:04d}.npz") as arrays:
            assert abs(arrays["part_open"][0] - drawn["part_open"][0]) < 0.1
        assert result.reason in REASONS
    assert "closed " in report.text()
    again = deploy(path, episodes=3, seed=1)
    assert [r.reason for r in again.results] == [r.reason for r in report.results]
