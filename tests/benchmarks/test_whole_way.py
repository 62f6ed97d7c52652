"""The way from a clip to a policy that is judged goes on where it was stopped."""

import argparse
import json

import pytest

import whole_way
from articulate.errors import UsageError


@pytest.fixture
def calls(monkeypatch):
    made = []

    def articulate(*words):
        made.append([str(word) for word in words])
        return json.dumps({"success_rate": 0.5})

    monkeypatch.setattr(whole_way, "articulate", articulate)
    return made


@pytest.fixture
def flags():
    return argparse.Namespace(steps=100, seeds=[0, 2], episodes=7)


def test_a_run_is_begun_gone_on_with_and_left_when_it_is_done(calls, flags, tmp_path):
    run = tmp_path / "run"
    whole_way.trained(tmp_path / "a.urdf", run, flags, "--task", "open_door")
    assert calls[-1] == [
        *("train", "--asset", str(tmp_path / "a.urdf"), "--out", str(run), "--no-evaluate"),
        *("--steps", "100", "--seeds", "0", "2", "--task", "open_door"),
    ]
    run.mkdir()
    whole_way.trained(tmp_path / "a.urdf", run, flags)
    assert calls[-1] == ["train", "--resume", "--out", str(run), "--no-evaluate"]
    (run / "summary.json").write_text("{}")
    whole_way.trained(tmp_path / "a.urdf", run, flags)
    assert len(calls) == 2


def test_policies_are_judged_on_the_true_object(calls, flags, tmp_path):
    report = whole_way.judged(tmp_path / "run", tmp_path / "a.urdf", "joint_0", flags)
    assert report["success_rate"] == 0.5
    assert calls == [
        [
            *("evaluate", str(tmp_path / "run"), "--asset", str(tmp_path / "a.urdf")),
            *("--joint", "joint_0", "--episodes", "7", "--json"),
        ]
    ]


def test_a_command_that_fails_ends_the_way():
    with pytest.raises(UsageError, match="articulate mak: exit 2"):
        whole_way.articulate("mak")


SUMMARY = {
    "asset": "partnet_1",
    "task": "open_door",
    "joint": "joint_0",
    "steps": 100,
    "seeds": [{"seed": seed, "success": {"value": 0.9, "episodes": 7}} for seed in (0, 2)],
    "success_rate": 0.9,
}


def test_a_summary_may_stand_for_the_truth(calls, flags, tmp_path):
    file = tmp_path / "open_door.json"
    file.write_text(json.dumps(SUMMARY))
    report = whole_way.kept_report(file, "partnet_1", "open_door", "joint_0", flags)
    assert report["success_rate"] == 0.9
    assert calls == []


@pytest.mark.parametrize(
    "other",
    [
        {"asset": "partnet_2"},
        {"joint": "joint_1"},
        {"steps": 200},
        {"seeds": [{"seed": 0, "success": {"value": 0.9, "episodes": 7}}]},
        {"seeds": [{"seed": seed, "success": {"value": 0.9, "episodes": 9}} for seed in (0, 2)]},
    ],
)
def test_a_summary_of_something_else_does_not(flags, tmp_path, other):
    file = tmp_path / "open_door.json"
    file.write_text(json.dumps(SUMMARY | other))
    with pytest.raises(UsageError, match="is of"):
        whole_way.kept_report(file, "partnet_1", "open_door", "joint_0", flags)
