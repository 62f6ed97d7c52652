"""``train`` and ``evaluate`` from the command line, on a run that takes seconds."""

import dataclasses
import json
import shutil

import pytest
from tests.runs import write_checkpoint

from articulate.commands import main
from articulate.errors import DivergedError, MissingError
from articulate.library.procedural.cabinet import embedded_cabinet
from articulate_envs.feasibility import Feasibility
from articulate_train import evaluate_run, feasibility_check, seed_runner
from articulate_train.run import DONE, open_run

FEASIBLE = Feasibility(success=0.9, n_episodes=64, dominant_failure="force")
TINY = """
ppo: {n_envs: 4, n_steps: 8, batch_size: 16, n_epochs: 2, net_arch: [8, 8]}
randomization: {scales: 3}
initial_states: {n_precomputed: 16}
checkpoint_selection: {n_checkpoints: 1, member_episodes: 0}
initial_policy: random
ensemble_size: 1
seeds: [0]
steps: 64
jobs: 1
episodes: 2
"""


@pytest.fixture(autouse=True)
def no_videos(monkeypatch):
    def missing(*_, **__):
        raise MissingError("no renderer")

    monkeypatch.setattr(evaluate_run, "render_png", missing)
    monkeypatch.setattr(evaluate_run, "write_episode_video", missing)
    monkeypatch.setattr(feasibility_check, "feasibility_of", lambda *_: FEASIBLE)


@pytest.fixture
def done(tiny):
    """A tiny run that is trained."""
    write_checkpoint(tiny.seed_folder(0), 0)
    (tiny.seed_folder(0) / DONE).write_text(json.dumps({"steps": tiny.config.steps}))
    return tiny


def test_train_makes_a_run_its_policy_and_its_report(tmp_path, capsys, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    source = embedded_cabinet(tmp_path / "cabinet")
    (tmp_path / "tiny.yaml").write_text(TINY)
    out = tmp_path / "runs" / "one"
    argv = ["--asset", str(source), "--joint", "drawer_0_slide", "--out", str(out), "--json"]
    assert main(["train", *argv, "--config", str(tmp_path / "tiny.yaml")]) == 0
    printed = capsys.readouterr()
    report = json.loads(printed.out)
    assert report == json.loads((out / "report.json").read_text())
    assert 0 <= report["success_rate"] <= 1
    assert "joint drawer_0_slide" in printed.err
    assert (out / "report.html").is_file()
    assert json.loads((out / "seed_0" / DONE).read_text())["selected_step"] == 64
    assert [p.name for p in out.parent.iterdir()] == ["one"]


def test_resuming_a_run_that_is_done_goes_straight_to_its_evaluation(done, capsys, monkeypatch):
    monkeypatch.setattr(seed_runner, "_start", lambda *_: pytest.fail("trained again"))
    checkpoint = (done.seed_folder(0) / "checkpoint.pt").read_bytes()
    assert main(["train", "--resume", "--out", str(done.folder), "--episodes", "3"]) == 0
    assert "of 3 episodes" in capsys.readouterr().out
    assert (done.seed_folder(0) / "checkpoint.pt").read_bytes() == checkpoint
    assert open_run(done.folder).config.episodes == 3


def test_resuming_without_an_evaluation_prints_the_folder_only(done, capsys):
    argv = ["train", "--resume", f"--out={done.folder}", "--no-evaluate"]
    assert main(argv) == 0
    assert capsys.readouterr().out == f"{done.folder}\n"
    assert main([*argv, "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == {"run": str(done.folder)}
    assert not (done.folder / "report.json").exists()


def test_interrupted_training_names_the_command_that_continues(done, capsys, monkeypatch):
    monkeypatch.setattr(seed_runner, "train_seeds", lambda *_: False)
    assert main(["train", "--resume", "--out", str(done.folder)]) == 130
    printed = capsys.readouterr()
    assert printed.out == ""
    assert printed.err.endswith(f"interrupted; continue with: train --resume --out {done.folder}\n")


def test_training_that_diverges_is_one_line_and_exit_1(done, capsys, monkeypatch, tmp_path):
    def diverged(*_):
        raise DivergedError("seed 0 diverged: weights are not finite after 64 steps")

    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    monkeypatch.setattr(seed_runner, "train_seeds", diverged)
    assert main(["train", "--resume", "--out", str(done.folder)]) == 1
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 2  # the first names the run
    assert "seed 0 diverged: weights are not finite after 64 steps" in lines[1]


def test_evaluation_prints_its_report_and_nothing_else(done, capsys):
    assert main(["evaluate", str(done.folder), "--json"]) == 0
    report = json.loads(capsys.readouterr().out)
    assert report == json.loads((done.folder / "report.json").read_text())
    assert main(["evaluate", str(done.folder), "--episodes", "3"]) == 0
    text = capsys.readouterr().out
    assert text.startswith("success ")
    assert f"report: {done.folder / 'report.html'}" in text
    assert json.loads((done.folder / "report.json").read_text()) != report


def test_success_below_the_required_one_is_exit_3_with_the_report_all_the_same(done, capsys):
    argv = ["evaluate", str(done.folder), "--require-success"]
    assert main([*argv, "1"]) == 3
    printed = capsys.readouterr()
    assert "below the required 100.0%" in printed.err
    assert "report: " in printed.out
    assert main([*argv, "0"]) == 0


def test_same_evaluation_again_gives_the_same_report(done, tmp_path):
    copy = shutil.copytree(done.folder, tmp_path / "again" / done.folder.name)
    for folder in (done.folder, copy):
        assert main(["evaluate", str(folder)]) == 0
    assert (done.folder / "report.json").read_bytes() == (copy / "report.json").read_bytes()


@pytest.mark.parametrize(
    ("success", "flags", "code", "text"),
    [
        (0.1, [], 2, "succeeds in 10% of 64 episodes (most failures: force); training is unlikely"),
        (0.1, ["--force"], 0, "warning: cabinet"),
        (0.5, [], 0, "a trained policy will rarely be better"),
    ],
)
def test_an_object_that_the_expert_cannot_operate_is_not_trained_on(
    tmp_path, cabinet, capsys, monkeypatch, success, flags, code, text
):
    found = dataclasses.replace(FEASIBLE, success=success)
    monkeypatch.setattr(feasibility_check, "feasibility_of", lambda *_: found)
    monkeypatch.setattr("articulate_train.run.prepare_asset", lambda *_: cabinet)
    monkeypatch.setattr(seed_runner, "train_seeds", lambda *_: True)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    out = tmp_path / "run"
    argv = ["train", "--asset", "cabinet", "--out", str(out), "--no-evaluate", *flags]
    assert main(argv) == code
    printed = capsys.readouterr().err
    assert text in printed
    assert out.exists() == (code == 0)
    assert printed.count("\n") == (1 if code else 2)
