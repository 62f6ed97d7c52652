"""The model actors from the command line."""

from __future__ import annotations

import json

import pytest
from tests.articulate.benchmark.objects import write_index
from tests.articulate.reconstruct.actors.vlm.conftest import KEY
from tests.articulate.reconstruct.actors.vlm.server import saying

from articulate import commands
from articulate.commands import benchmark, make
from articulate.commands.console import NORMAL, set_level

TEXT = ["--text", "a cabinet with one drawer", "--library", "cabinet:3"]


@pytest.fixture(autouse=True)
def _here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    yield
    set_level(NORMAL)


def test_make_asks_the_model_proves_what_it_says_and_keeps_the_key_to_itself(serve, tmp_path):
    def answer(heard):
        if "failure" in heard.fields:
            seen = {"observed": f"a cabinet {KEY}", "predicted": "its drawer slides out"}
            return saying({**seen, "failure": "success", "rating": 9, "reason": "as it should"})
        names = [line.split()[1] for line in heard.text.splitlines() if line.startswith("- ")]
        drawer = next(name for name in names if name.startswith("drawer"))
        body = next(name for name in names if name != drawer)
        said = f'prismatic("{drawer}", "{body}", axis=vec(1, 0, 0), lower=0.0, upper=0.2)\n'
        return saying({"observation": "a cabinet", "program": said})

    server = serve(answer)
    assert make.main([*TEXT, "--actor", "vlm", "--out", "asset", "-q"]) == 0
    assert len(server.heard) == 2
    made = json.loads((tmp_path / "asset" / "made.json").read_text())
    assert (made["verdict"], made["rating"]) == ("passed", 9.0)
    assert [joint["upper"] for joint in made["joints"]] == [0.2]
    assert (tmp_path / "asset" / "program" / "program.py").read_text().startswith("prismatic(")
    trace = (tmp_path / "asset" / "trace.html").read_text()
    assert "a program with all joints: gemini-scripted-7" in trace
    assert "You see one object" in trace
    files = [path for path in tmp_path.rglob("*") if path.is_file()]
    assert any(path.parent.name == "answers" for path in files)
    assert [path for path in files if KEY.encode() in path.read_bytes()] == []


def test_make_without_a_key_is_one_line_and_exit_2(capsys, tmp_path):
    assert commands.main(["make", *TEXT, "--actor", "hybrid", "--out", "asset", "-q"]) == 2
    err = capsys.readouterr().err.strip()
    assert err.count("\n") == 0
    assert "GOOGLE_API_KEY or GEMINI_API_KEY" in err
    assert not (tmp_path / "asset").exists()


def test_make_writes_prompts_and_asks_nobody(capsys, tmp_path):
    said = [*TEXT, "--actor", "hybrid", "--dry-run", "--out", "asset", "--json", "-q"]
    assert commands.main(["make", *said]) == 0
    printed = json.loads(capsys.readouterr().out)
    assert (printed["requests"], printed["page"]) == (3, "asset.prompts.html")
    assert printed["tokens_in"] > 1000
    assert [path.name for path in tmp_path.iterdir() if path.name != "cache"] == [printed["page"]]


def test_a_benchmark_writes_a_page_of_prompts_for_each_object(tmp_path, capsys):
    index = write_index(tmp_path, ("a", "b"))
    said = [str(index), "--modality", "text", "--actor", "vlm", "--out", "out", "--dry-run"]
    assert benchmark.main(said) == 0
    pages = sorted((tmp_path / "out" / "prompts").iterdir())
    assert [page.name for page in pages] == ["prompts_0000.html", "prompts_0001.html"]
    assert "2 pages; dry run" in capsys.readouterr().out


def test_a_benchmark_without_a_key_ends_at_once_instead_of_scoring_nothing(tmp_path, capsys):
    index = write_index(tmp_path, ("a",))
    said = [str(index), "--modality", "text", "--actor", "vlm", "--out", "out"]
    assert commands.main(["benchmark", *said]) == 2
    assert "no API key" in capsys.readouterr().err
    assert not (tmp_path / "out" / "results.json").exists()
