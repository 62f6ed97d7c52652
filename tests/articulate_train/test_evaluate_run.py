import dataclasses
import json
import shlex
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import pytest
import yaml
from tests.runs import write_checkpoint

from articulate.commands.flags import parse
from articulate.errors import MissingError, RunError, UsageError
from articulate.library.procedural.cabinet import embedded_cabinet
from articulate.task.task import Task
from articulate_envs.rewards import TERMS
from articulate_train import evaluate_run as evaluation
from articulate_train.commands.evaluate import EvaluateFlags
from articulate_train.evaluate_run import (
    commit,
    describe_target,
    evaluate_run_folder,
    report_folder,
)
from articulate_train.policy import checkpoint_sha256
from articulate_train.run import DONE, with_object
from articulate_train.train_seed import PROGRESS


@pytest.fixture
def videos(monkeypatch):
    """Names of the requested videos; nothing is rendered."""
    calls = []

    def write(path, *_, **__):
        calls.append(path.name)
        path.write_bytes(b"video")
        return path

    monkeypatch.setattr(evaluation, "write_episode_video", write)
    monkeypatch.setattr(evaluation, "render_png", lambda *_, **__: b"\x89PNG\r\n\x1a\n")
    return calls


@pytest.fixture
def trained(tiny):
    write_checkpoint(tiny.seed_folder(0), 0)
    rows = [
        {
            "steps": steps,
            "seconds": steps / 100,
            "success": 0.25,
            "opened": 0.5,
            "terms": dict.fromkeys(TERMS, 1.0),
        }
        for steps in (96, 192)
    ]
    text = "".join(json.dumps(row) + "\n" for row in rows)
    (tiny.seed_folder(0) / PROGRESS).write_text(text)
    return tiny


def test_report_holds_the_evaluation_the_curves_and_how_it_was_made(trained, videos):
    done = evaluate_run_folder(trained, episodes=3)
    content = json.loads(done.json_path.read_text())
    assert content == done.report.content()
    assert done.json_path.parent == done.html_path.parent == trained.folder
    assert content["success_rate"] == done.report.success_rate
    info = done.report.info
    assert (info.joint, info.steps, info.steps_per_s) == (trained.task.joint, 192, 100.0)
    assert f"--joint {trained.task.joint} --seeds 0 --steps 192" in info.command
    assert videos == ["failure.mp4"]


def test_video_of_an_earlier_evaluation_does_not_stay_beside_a_report_without_it(trained, videos):
    (trained.folder / "videos").mkdir()
    for name in ("success.mp4", "failure.mp4"):
        (trained.folder / "videos" / name).write_bytes(b"earlier")
    evaluate_run_folder(trained, episodes=2)
    assert videos == ["failure.mp4"]
    assert [p.name for p in (trained.folder / "videos").iterdir()] == ["failure.mp4"]


def test_another_number_of_episodes_is_in_the_command_that_repeats_it(trained, videos):
    own = evaluate_run_folder(trained, episodes=trained.config.episodes).report.info.command
    assert "evaluate" not in own
    other = evaluate_run_folder(trained, episodes=trained.config.episodes + 1).report.info.command
    name, episodes = trained.folder.name, trained.config.episodes + 1
    assert other == f"{own} --out {name}\nevaluate {name} --episodes {episodes}"


def test_the_report_of_the_generalist_repeats_its_evaluation_and_not_a_training(trained, videos):
    """Nothing was trained for this object: its steps are those of the weights."""
    done = {"steps": 192, "policy": "generalist", "control_steps": 7}
    (trained.seed_folder(0) / DONE).write_text(json.dumps(done))
    info = evaluate_run_folder(trained, episodes=2).report.info
    assert info.steps == 7
    make, again = info.command.split("\n")
    words = shlex.split(make)
    assert words[0] == "evaluate"
    flags = parse(EvaluateFlags, words[1:], prog="evaluate")
    assert (flags.policy, flags.asset) == ("generalist", trained.config.asset)
    assert (flags.task, flags.joint) == (trained.config.task, trained.task.joint)
    assert flags.out == Path(trained.folder.name)
    assert again == f"evaluate {trained.folder.name} --episodes 2"


def test_a_training_that_is_not_over_is_reported(trained, videos):
    printed: list[str] = []
    done = evaluate_run_folder(trained, episodes=2, show_progress=printed.append)
    reports = "seed 0 has 0.000192 of 0.000192M control steps"
    assert done.report.info.unfinished == reports
    command = f"train --resume --out {trained.folder}"
    assert f"training incomplete ({reports}); continue with {command}" in printed
    assert f"Training incomplete: {reports}." in done.html_path.read_text()
    (trained.seed_folder(0) / DONE).write_text(json.dumps({"steps": 192}))
    done = evaluate_run_folder(trained, episodes=2)
    assert done.report.info.unfinished == ""
    assert "not over" not in done.html_path.read_text()


def test_wider_ranges_are_reported_and_leave_the_report_of_the_run_only(trained, videos):
    evaluate_run_folder(trained, episodes=2)
    before = (trained.folder / "report.json").read_bytes()
    done = evaluate_run_folder(trained, episodes=3, ranges=1.5)
    assert (trained.folder / "report.json").read_bytes() == before
    assert done.json_path.parent == trained.folder / "ranges_1.5"
    info = done.report.info
    assert info.command.endswith(f"\nevaluate {trained.folder.name} --episodes 3 --ranges 1.5")
    wide = trained.config.randomization.widened(1.5)
    assert yaml.safe_load(info.config)["randomization"]["push_n"] == list(wide.push_n)
    assert [seed.success.n for seed in done.report.seeds] == [3]


def test_another_object_is_evaluated_in_a_folder_of_its_own(trained, videos, tmp_path):
    other = embedded_cabinet(tmp_path / "other")
    on = with_object(trained, str(other), "drawer_1_slide", tmp_path / "cache")
    assert (on.folder, on.arm) == (trained.folder, trained.arm)
    done = evaluate_run_folder(trained, episodes=2, on=on)
    name = f"on_{on.asset.name}_drawer_1_slide_{on.asset.content_id()[:6]}"
    assert done.json_path.parent == trained.folder / name
    assert not (trained.folder / "report.json").exists()
    info = done.report.info
    assert (info.asset, info.joint) == (on.asset.name, "drawer_1_slide")
    assert info.target_text == describe_target(on.task) != describe_target(trained.task)
    train, again = info.command.split("\n")
    assert f"--joint {trained.task.joint}" in train
    assert again == (
        f"evaluate {trained.folder.name} --episodes 2 --asset {other} --joint drawer_1_slide"
    )


def test_objects_of_one_name_and_joints_of_one_object_are_kept_apart(trained, tmp_path):
    other = embedded_cabinet(tmp_path / "other")
    on = with_object(trained, str(other), "drawer_1_slide", tmp_path / "cache")
    folders = {report_folder(trained, on=on)}
    folders.add(
        report_folder(trained, on=replace(on, task=replace(on.task, joint="drawer_0_slide")))
    )
    changed = tmp_path / "changed"
    shutil.copytree(on.asset.folder, changed)
    (changed / "object.urdf").write_text("<robot name='another'/>")
    folders.add(report_folder(trained, on=replace(on, asset=replace(on.asset, folder=changed))))
    assert len(folders) == 3


def test_another_object_without_that_joint_is_rejected(trained, tmp_path):
    with pytest.raises(UsageError, match="no joint 'nothing'"):
        with_object(
            trained, str(embedded_cabinet(tmp_path / "other")), "nothing", tmp_path / "cache"
        )


@pytest.mark.parametrize(
    ("files", "seconds"),
    [
        ({}, 30.0),  # seeds run side by side: the longest of them, and not their sum
        ({"summary.json": {"seconds": 2.0}}, 30.0),  # of the last call of several
        ({"summary.json": {"seconds": 2.0}, "sessions.json": {"seconds": [40.0, 5.0]}}, 45.0),
        ({"summary.json": ["of", "another", "kind"]}, 30.0),
    ],
)
def test_training_took_what_its_calls_took_and_not_the_sum_over_seeds(tiny, files, seconds):
    run = dataclasses.replace(tiny, config=dataclasses.replace(tiny.config, seeds=(0, 1)))
    for seed in run.config.seeds:
        run.seed_folder(seed).mkdir()
        row = json.dumps({"steps": 192, "seconds": 30.0 - seed, "success": 0.0, "opened": 0.0})
        (run.seed_folder(seed) / PROGRESS).write_text(row + "\n")
    for name, content in files.items():
        (run.folder / name).write_text(json.dumps(content))
    info = evaluation._info(run, run)
    assert info.seconds == seconds
    assert info.steps_per_s == pytest.approx(2 * 192 / seconds)


def test_report_reports_of_which_checkpoints_it_is(trained, videos):
    done = evaluate_run_folder(trained, episodes=2)
    (row,) = json.loads(done.json_path.read_text())["seeds"]
    assert row["checkpoint_sha256"] == checkpoint_sha256(trained.seed_folder(0))
    assert len(row["checkpoint_sha256"]) == 64


def test_text_reports_success_opened_and_reasons(trained, videos):
    done = evaluate_run_folder(trained, episodes=3)
    text = done.text().splitlines()
    assert text[0].startswith("success ")
    assert text[0].endswith("of 3 episodes")
    assert text[-1] == f"report: {done.html_path}"


def test_where_nothing_can_be_sampled_the_report_is_made_without(trained, monkeypatch, caplog):
    def missing(*_, **__):
        raise MissingError("no renderer")

    monkeypatch.setattr(evaluation, "write_episode_video", missing)
    assert evaluate_run_folder(trained, episodes=2).html_path.is_file()
    assert "no videos: no renderer" in caplog.text


def test_seed_without_a_checkpoint_leaves_no_report(tiny, videos):
    with pytest.raises(RunError, match="no checkpoint"):
        evaluate_run_folder(tiny, episodes=2)
    assert not (tiny.folder / "report.json").exists()


def test_target_is_an_error_in_the_units_of_the_joint():
    slide = Task(name="open_drawer", joint="j", kind="slide", span=-0.3, target=0.8)
    assert describe_target(slide).startswith("0.240 m from closed for the last 0.5 s, slower than")
    hinge = dataclasses.replace(slide, kind="hinge", span=2.0, target=0.5)
    assert describe_target(hinge).startswith("1.000 rad")


def test_code_that_is_in_the_checkout_of_another_project_has_no_commit(tmp_path, monkeypatch):
    subprocess.run(["git", "init", "-q", tmp_path], check=True)
    who = ["-c", "user.name=a", "-c", "user.email=a@b"]
    empty = ["commit", "-q", "--allow-empty", "-m", "theirs"]
    subprocess.run(["git", "-C", tmp_path, *who, *empty], check=True)
    monkeypatch.setattr(evaluation, "__file__", str(tmp_path / "judge_run.py"))
    assert commit() == "unknown"


def test_code_that_is_no_checkout_has_no_commit(monkeypatch):
    def missing(*_, **__):
        raise FileNotFoundError("git")

    monkeypatch.setattr(subprocess, "run", missing)
    assert commit() == "unknown"
