"""``train --list-tasks`` and ``train --list-joints``."""

import json

import pytest
from tests.assets import make_box, make_cabinet

from articulate.commands import main
from articulate.task.task import TASK_RULES
from articulate_train.commands import listing
from articulate_train.list_joints import joint_rows, task_rows


@pytest.fixture
def proven(monkeypatch, tmp_path):
    """Objects are taken as they are, without conversion."""
    asset = make_box(tmp_path / "box")
    monkeypatch.setattr("articulate_train.run.prepare_asset", lambda *_: asset)
    return asset


def test_tasks_are_listed_a_line_each(capsys):
    assert main(["train", "--list-tasks"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [text.split()[0] for text in lines] == list(TASK_RULES)
    assert lines[5].split()[:2] == ["close_lid", "close"]


def test_lists_as_json_are_the_rows_themselves(capsys, proven):
    assert main(["train", "--list-tasks", "--list-joints", "box", "--json"]) == 0
    content = json.loads(capsys.readouterr().out)
    assert content["tasks"] == task_rows()
    assert content["asset"] == "box"
    assert content["joints"] == json.loads(json.dumps([joint_rows(proven)[0].as_dict()]))


def test_joints_are_listed_with_kind_range_handle_and_tasks(capsys, proven):
    assert main(["train", "--list-joints=box"]) == 0
    (text,) = capsys.readouterr().out.splitlines()
    assert text == (
        "lid_hinge  hinge, lid  0 to 0.873 rad  handle: bar  open_lid close_lid open_joint "
        "close_joint"
    )


def test_joint_without_limits_or_handle_says_so(tmp_path):
    asset = make_cabinet(tmp_path / "cabinet", drawers=1)
    row = joint_rows(asset)[0]
    free = listing.line(type(row)(**{**vars(row), "lower": None, "upper": None, "handle": None}))
    assert "without end  no handle" in free


def test_help_is_not_a_list():
    assert listing.asks_for_a_list(["--list_tasks"])
    assert not listing.asks_for_a_list(["--list-tasks", "--help"])
    assert not listing.asks_for_a_list(["--task", "open_door"])


def test_object_that_is_not_there_is_answered_in_one_line(capsys, tmp_path):
    assert main(["train", "--list-joints", str(tmp_path / "none")]) == 2
    assert len(capsys.readouterr().err.splitlines()) == 1
