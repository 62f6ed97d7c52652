import json
from dataclasses import replace

import numpy as np
import pytest
from tests.test_bad_input import load_unchecked

from articulate.commands import main
from articulate.errors import MissingError
from articulate_envs.feasibility import Feasibility
from articulate_envs.joint_selection import choose_joint
from articulate_train import dry_run as dry
from articulate_train import run as runs

FEASIBLE = Feasibility(success=0.75, n_episodes=64, dominant_failure="forbidden_contact")


@pytest.fixture(autouse=True)
def feasible(monkeypatch):
    monkeypatch.setattr(dry, "feasibility_of", lambda *_: FEASIBLE)


@pytest.fixture
def config(fresh, monkeypatch):
    """The configuration of a tiny run, whose asset is not checked."""
    monkeypatch.setattr(runs, "load_checked_asset", load_unchecked)
    return replace(fresh.config, seeds=(0, 1, 2), jobs=2, steps=6400)


def test_a_dry_run_reports_scene_reach_time_and_disk(config, tmp_path, monkeypatch):
    # On any machine, the evaluation of this tiny run is not rounded to zero.
    monkeypatch.setattr(dry, "_evaluation_steps_per_s", lambda *_, **__: 50.0)
    found = dry.dry_run(config, tmp_path / "cache", tmp_path / "a.png")
    task, placement = choose_joint(config, runs.prepare_asset(config, tmp_path))
    assert (found.joint, found.reachable_share) == (task.joint, placement.reachable_share)
    assert found.overlap_m <= 0.003
    # Two rounds of seeds at the measured rate; selection and evaluation are counted too.
    training = 2 * 6400 / found.steps_per_s / 60.0
    rest = found.selection_minutes + found.evaluation_minutes
    assert rest > 0.0
    assert found.minutes == pytest.approx(training + rest, rel=0.02, abs=0.02)
    assert found.feasibility == FEASIBLE
    assert "succeeds in 75% of 64 episodes" in found.text()
    assert found.disk_bytes > 20e6
    assert "joint drawer_2_slide" in found.text()
    assert "overlaps the object by 0.0 mm" in replace(found, overlap_m=-1e-6).text()


@pytest.mark.render
def test_its_image_shows_the_scene_and_nothing_is_overwritten(config, tmp_path, error_line):
    found = dry.dry_run(config, tmp_path / "cache", tmp_path / "a.png")
    content = (tmp_path / "a.png").read_bytes()
    assert content[:8] == b"\x89PNG\r\n\x1a\n"
    assert found.image == tmp_path / "a.png"
    error_line(
        "dry_run(image that exists)",
        lambda: dry.dry_run(config, tmp_path / "cache", tmp_path / "a.png"),
    )


def test_without_a_driver_it_gives_the_reason(config, tmp_path, monkeypatch):
    def missing(*_, **__):
        raise MissingError("no images here")

    monkeypatch.setattr(dry, "render_png", missing)
    found = dry.dry_run(config, tmp_path / "cache", tmp_path / "a.png")
    assert found.image is None
    assert "image    no images here" in found.text()
    assert not (tmp_path / "a.png").exists()


def test_the_scene_is_rendered_in_its_initial_state(fresh):
    scene = fresh.scene((1.0,))
    qpos = dry.start_qpos(scene)
    assert np.allclose(qpos[scene.at.arm_q : scene.at.arm_q + 7], fresh.placement.start_q)
    assert qpos.shape == (scene.nominal.nq,)


def test_train_dry_run_trains_nothing(cabinet, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(runs, "load_checked_asset", load_unchecked)
    monkeypatch.setattr(dry, "_write_image", lambda *_: (None, "not rendered"))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.chdir(tmp_path)
    (tmp_path / "tiny.yaml").write_text(
        "ppo: {n_envs: 4, n_steps: 8, batch_size: 16, n_epochs: 2, net_arch: [8, 8]}\n"
        "randomization: {scales: 3}\ninitial_states: {n_precomputed: 16}\nseeds: [0]\nsteps: 64\n"
        "initial_policy: random\n"
    )
    argv = ["train", "--asset", str(cabinet.folder), "--config", "tiny.yaml", "--dry-run"]
    assert main([*argv, "--json"]) == 0
    content = json.loads(capsys.readouterr().out)
    assert content["task"] == "open_drawer"
    assert content["minutes"] >= 0
    assert not (tmp_path / "runs").exists()
