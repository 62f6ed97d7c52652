"""The full pipeline from a video to an evaluated policy skips the steps that are done."""

import argparse
import json
import sys

import pytest

import full_pipeline
from articulate.errors import UsageError


@pytest.fixture
def calls(monkeypatch):
    commands = []

    def articulate(*arguments):
        commands.append([str(argument) for argument in arguments])
        return json.dumps({"success_rate": 0.5})

    monkeypatch.setattr(full_pipeline, "articulate", articulate)
    return commands


@pytest.fixture
def flags():
    return argparse.Namespace(steps=100, seeds=[0, 2], episodes=7)


def test_a_run_is_started_resumed_and_skipped_when_it_is_finished(calls, flags, tmp_path):
    run = tmp_path / "run"
    full_pipeline.train(tmp_path / "a.urdf", run, flags, "--task", "open_door")
    assert calls[-1] == [
        *("train", "--asset", str(tmp_path / "a.urdf"), "--out", str(run), "--no-evaluate"),
        *("--steps", "100", "--seeds", "0", "2", "--task", "open_door"),
    ]
    run.mkdir()
    full_pipeline.train(tmp_path / "a.urdf", run, flags)
    assert calls[-1] == ["train", "--resume", "--out", str(run), "--no-evaluate"]
    (run / "summary.json").write_text("{}")
    full_pipeline.train(tmp_path / "a.urdf", run, flags)
    assert len(calls) == 2


def test_policies_are_evaluated_on_the_true_object(calls, flags, tmp_path):
    report = full_pipeline.evaluate(tmp_path / "run", tmp_path / "a.urdf", "joint_0", flags)
    assert report["success_rate"] == 0.5
    assert calls == [
        [
            *("evaluate", str(tmp_path / "run"), "--asset", str(tmp_path / "a.urdf")),
            *("--joint", "joint_0", "--episodes", "7", "--json"),
        ]
    ]


def test_a_command_that_fails_is_an_error():
    with pytest.raises(UsageError, match="articulate mak: exit 2"):
        full_pipeline.articulate("mak")


SUMMARY = {
    "asset": "partnet_1",
    "task": "open_door",
    "joint": "joint_0",
    "steps": 100,
    "seeds": [{"seed": seed, "success": {"value": 0.9, "n": 7}} for seed in (0, 2)],
    "success_rate": 0.9,
}


def test_a_summary_replaces_the_run_on_the_true_object(calls, flags, tmp_path):
    file = tmp_path / "open_door.json"
    file.write_text(json.dumps(SUMMARY))
    report = full_pipeline.read_summary(file, "partnet_1", "open_door", "joint_0", flags)
    assert report["success_rate"] == 0.9
    assert calls == []


@pytest.mark.parametrize(
    "other",
    [
        {"asset": "partnet_2"},
        {"joint": "joint_1"},
        {"steps": 200},
        {"seeds": [{"seed": 0, "success": {"value": 0.9, "n": 7}}]},
        {"seeds": [{"seed": seed, "success": {"value": 0.9, "n": 9}} for seed in (0, 2)]},
    ],
)
def test_a_summary_of_another_run_is_rejected(flags, tmp_path, other):
    file = tmp_path / "open_door.json"
    file.write_text(json.dumps(SUMMARY | other))
    with pytest.raises(UsageError, match="is required"):
        full_pipeline.read_summary(file, "partnet_1", "open_door", "joint_0", flags)


ROW = {"object": "partnet_1", "task": "open_door", "joint": "joint_0"}


@pytest.mark.parametrize(
    ("found", "text"),
    [
        (
            {
                "reconstruction": {"verdict": "passed"},
                "success_reconstruction": 0.9,
                "success_truth": 1.0,
                "ratio": 0.9,
            },
            "open_door partnet_1 joint_0: 90.0% trained on the reconstruction (passed), 100.0% "
            "trained on the true object: ratio 0.90\n",
        ),
        (
            {"reconstruction": {"verdict": "rejected"}, "ratio": 0.0},
            "open_door partnet_1 joint_0: 0.0% trained on the reconstruction (rejected), 0.0% "
            "trained on the true object: ratio 0.00\n",
        ),
    ],
)
def test_each_object_is_printed_on_one_line(monkeypatch, capsys, found, text):
    monkeypatch.setattr(full_pipeline, "run_pipeline", lambda *_: ROW | found)
    arguments = "full_pipeline.py --data data --out out --objects open_door=partnet_1"
    monkeypatch.setattr(sys, "argv", arguments.split())
    assert full_pipeline.main() == 0
    assert capsys.readouterr().out == text
