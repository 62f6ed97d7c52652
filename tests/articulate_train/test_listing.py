"""``train --list-tasks`` and ``train --list-joints``."""

import json

import pytest
from tests.assets import make_box, make_cabinet

from articulate.commands import main
from articulate.task.task import TASK_RULES
from articulate_envs.feasibility import Feasibility
from articulate_train import list_joints
from articulate_train.commands import listing
from articulate_train.config import TrainConfig
from articulate_train.list_joints import joint_rows, task_rows

FEASIBLE = Feasibility(success=0.75, n_episodes=64, dominant_failure="forbidden_contact")
CONFIG = TrainConfig(asset="box")


@pytest.fixture
def checked(monkeypatch, tmp_path):
    """Asset without conversion, and a feasibility that costs no time."""
    asset = make_box(tmp_path / "box")
    monkeypatch.setattr("articulate_train.run.prepare_asset", lambda *_: asset)
    monkeypatch.setattr(list_joints, "_feasibility", lambda *_: (FEASIBLE, ""))
    return asset


def test_tasks_are_listed_a_line_each(capsys):
    assert main(["train", "--list-tasks"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [text.split()[0] for text in lines] == list(TASK_RULES)
    assert lines[5].split()[:2] == ["close_lid", "close"]


def test_lists_as_json_are_the_rows_themselves(capsys, checked):
    assert main(["train", "--list-tasks", "--list-joints", "box", "--json"]) == 0
    content = json.loads(capsys.readouterr().out)
    assert content["tasks"] == task_rows()
    assert content["asset"] == "box"
    assert content["joints"] == json.loads(json.dumps([joint_rows(checked, CONFIG)[0].as_dict()]))


def test_joints_are_listed_with_kind_range_handle_and_tasks(capsys, checked):
    assert main(["train", "--list-joints=box"]) == 0
    (text,) = capsys.readouterr().out.splitlines()
    assert text == (
        "lid_hinge  hinge, lid  0 to 0.873 rad  handle: bar  open_lid close_lid open_joint "
        "close_joint  the scripted expert succeeds in 75% of 64 episodes (most failures: "
        "forbidden_contact)"
    )


def test_joint_without_limits_or_handle_is_listed(tmp_path, monkeypatch):
    monkeypatch.setattr(list_joints, "_feasibility", lambda *_: (FEASIBLE, ""))
    asset = make_cabinet(tmp_path / "cabinet", drawers=1)
    row = joint_rows(asset, CONFIG)[0]
    free = listing.line(type(row)(**{**vars(row), "lower": None, "upper": None, "handle": None}))
    assert "continuous  no handle" in free


def test_joints_of_the_asset_flag_are_listed(capsys, checked):
    assert main(["train", "--list-joints", "box"]) == 0
    first = capsys.readouterr().out
    for words in (["--asset", "box", "--list-joints"], ["--list-joints", "--asset", "box"]):
        assert main(["train", *words]) == 0
        assert capsys.readouterr().out == first
    assert main(["train", "--asset", "box", "--list-joints", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["asset"] == "box"


def test_help_is_not_a_list():
    assert listing.requests_list(["--list_tasks"])
    assert not listing.requests_list(["--list-tasks", "--help"])
    assert not listing.requests_list(["--task", "open_door"])


def test_missing_object_is_one_line(capsys, tmp_path):
    assert main(["train", "--list-joints", str(tmp_path / "none")]) == 2
    assert len(capsys.readouterr().err.splitlines()) == 1


@pytest.mark.usefixtures("short_search")
def test_joint_that_the_arm_cannot_reach_has_a_reason_instead_of_a_feasibility(tmp_path):
    far = make_cabinet(tmp_path / "far", drawers=1, travel_m=2.0)
    row = joint_rows(far, CONFIG)[0]
    assert row.feasibility is None
    assert "not trainable: " in listing.line(row)
