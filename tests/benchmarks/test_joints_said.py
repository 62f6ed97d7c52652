"""What is kept of a run of the benchmark tells as much as the run of what was said."""

import importlib
import json
from typing import Any

import pytest

import joints_said as said

RECORD: dict[str, Any] = {
    "category": "Box",
    "error": "",
    "fingerprint": "0",
    "cases": [
        {
            "case": "lid",
            "moved_px": 12.3456789,
            "seconds": 3.0,
            "spurious": 0,
            "joints": [
                {
                    "status": "plain",
                    "truth": {"kind": "revolute"},
                    "failures": {"paper": "success", "strict": "success"},
                    "errors": {"axis_rad": 0.00123456789, "kind_equal": True},
                    "predicted": {
                        "part": "lid",
                        "parent": "body",
                        "kind": "revolute",
                        "axis_o": [0.0, 1.0, 0.0],
                        "pivot_o": [0.1234567891, 0.0, 0.2],
                        "lower": 0.0,
                        "upper": 1.5,
                    },
                },
                {
                    "status": "plain",
                    "truth": {"kind": "prismatic"},
                    "failures": {"paper": "joint_type", "strict": "joint_type"},
                    "errors": None,
                    "predicted": None,
                },
            ],
        }
    ],
}


@pytest.fixture
def run(tmp_path):
    (tmp_path / "objects").mkdir()
    (tmp_path / "objects" / "box_1.json").write_text(json.dumps(RECORD))
    return tmp_path


def test_what_is_kept_is_read_as_the_run_is(run, capsys, monkeypatch):
    monkeypatch.setattr("sys.argv", ["joints_said", str(run)])
    assert said.main() == 0
    file = run / "kept.json"
    file.write_text(capsys.readouterr().out)
    ((name, record),) = said.records_of(file)
    assert name == "box_1"
    right, wrong = record["cases"][0]["joints"]
    assert right["predicted"] == RECORD["cases"][0]["joints"][0]["predicted"] | {
        "pivot_o": [0.123457, 0.0, 0.2]
    }
    assert right["errors"] == {"axis_rad": 0.001235}
    assert right["kind"] == "revolute"
    assert wrong["predicted"] is None
    assert wrong["failures"]["paper"] == "joint_type"
    made = importlib.import_module("made_assets")
    assert made.found_joints(record, "paper") == []
    record["cases"][0]["joints"].pop()
    (joint,) = made.found_joints(record, "paper")
    assert (joint.part, joint.pivot_o) == ("lid", (0.123457, 0.0, 0.2))


def test_what_holds_no_records_is_told(tmp_path, capsys, monkeypatch):
    (tmp_path / "kept.json").write_text("{}")
    for place in (tmp_path, tmp_path / "kept.json"):
        monkeypatch.setattr("sys.argv", ["joints_said", str(place)])
        assert said.main() == 2
        assert "no records" in capsys.readouterr().err
