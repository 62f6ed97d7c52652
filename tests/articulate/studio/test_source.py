"""Folders and files that the studio opens, and one line for each that it does not."""

from __future__ import annotations

import base64
import json
import shutil

import pytest
from tests.articulate.studio.objects import write_cupboard

from articulate.commands import main
from articulate.errors import UsageError
from articulate.studio.source import read_studio_source

PNG = base64.b64encode(b"\x89PNG").decode()
MADE = {
    "schema": "articulate.made",
    "verdict": "rejected",
    "reasons": ["the door collides"],
    "joints": [{"part": "door", "confidence": 0.3, "evidence": "video"}],
}


@pytest.fixture
def made(tmp_path):
    """Folder of a rejected object: it has a program, and no asset."""
    folder = tmp_path / "made"
    urdf = write_cupboard(folder / "program")
    shutil.move(urdf, urdf.with_name("object.urdf"))
    (folder / "made.json").write_text(json.dumps(MADE))
    image = f'<img alt="The image" src="data:image/png;base64,{PNG}">'
    (folder / "trace.html").write_text(f"<h2>Input</h2>{image}<h2>Joints</h2>{image}")
    return folder


def test_a_rejected_object_is_opened_with_its_reasons(made):
    source = read_studio_source(made)
    assert source.verdict == "rejected"
    assert source.reasons == ("the door collides",)
    assert source.evidence["door"] == {"confidence": 0.3, "evidence": "video"}
    assert [entry.content for entry in source.inputs] == [b"\x89PNG"]
    assert [link.name for link in source.model.links] == ["body", "door"]


@pytest.mark.parametrize(
    ("file", "content"),
    [
        ("made.json", "{"),
        ("made.json", "[]"),
        ("made.json", '{"schema": "articulate.made", "joints": 3}'),
        ("made.json", '{"schema": "other", "joints": []}'),
        ("edits.json", '{"schema": "articulate.edits", "edits": [3]}'),
        ("program/object.urdf", "<robot"),
    ],
)
def test_a_damaged_file_is_one_line(made, file, content):
    (made / file).write_text(content)
    with pytest.raises(UsageError) as error:
        read_studio_source(made)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (["none"], "does not exist"),
        (["none", "--port", "70000"], "--port is 70000"),
        (["none", "--limit", "0"], "--limit is 0 s"),
    ],
)
def test_a_wrong_command_is_one_line(tmp_path, monkeypatch, capfd, words, text):
    monkeypatch.chdir(tmp_path)
    assert main(["studio", *words]) == 2
    error = capfd.readouterr().err
    assert text in error
    assert error.count("\n") == 1


def test_a_folder_without_an_object_is_one_line(tmp_path):
    with pytest.raises(UsageError):
        read_studio_source(tmp_path)
