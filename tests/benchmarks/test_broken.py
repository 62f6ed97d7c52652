"""Each broken file gets a verdict or one line of error; a crash is neither."""

import json
import subprocess
import sys

import pytest

import broken
from articulate.library.procedural.cabinet import embedded_cabinet


def test_each_file_gets_a_row(tmp_path, monkeypatch, capsys):
    data = tmp_path / "data"
    urdf = embedded_cabinet(data / "cabinet")
    (data / "text.urdf").write_text("no XML")
    items = [
        {"id": "good", "file": str(urdf.relative_to(data)), "expected": "repairable"},
        {"id": "text", "file": "text.urdf", "expected": "refuse"},
    ]
    (data / "broken.json").write_text(json.dumps({"items": items}))
    out = str(tmp_path / "out")
    monkeypatch.setattr(sys, "argv", ["broken.py", "--data", str(data), "--out", out, "--json"])
    assert broken.main() == 0
    found = json.loads(capsys.readouterr().out)
    assert (found["files"], found["clear"], found["rejected"]) == (2, 2, 1)
    assert found["rows"][0]["exit"] == 0
    assert found["rows"][1]["exit"] == 3


@pytest.mark.parametrize(
    ("code", "report", "stderr"),
    [
        (3, {"verdict": "rejected", "reasons": ["a.urdf: its process ended with 1: KeyError"]}, ""),
        (2, None, "one\ntwo"),
        (1, None, "a bug"),
    ],
)
def test_crashes_and_long_errors_are_not_clear(tmp_path, monkeypatch, code, report, stderr):
    out = json.dumps(report) if report else ""
    done = subprocess.CompletedProcess([], code, stdout=out, stderr=stderr)
    monkeypatch.setattr(subprocess, "run", lambda *_, **__: done)
    row = broken.check_file(
        {"id": "a", "expected": "refuse"}, tmp_path / "a.urdf", tmp_path / "out"
    )
    assert not row["clear"]
