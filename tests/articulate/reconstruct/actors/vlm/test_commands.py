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
from articulate.render.image import png

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


def joints_answer(heard):
    """Reply to the requests for joints, whatever the parts are."""
    names = [line.split()[1] for line in heard.text.splitlines() if line.startswith("- ")]
    if "failure" in heard.fields:
        texts = {"observed": "a door", "predicted": "it turns", "reason": "no difference"}
        return saying({**texts, "failure": "success", "rating": 9})
    if "correction" in heard.fields:
        return saying({"differences": "none", "correction": "", "rating": 9})
    *_, first, second = names
    if "taken apart" in heard.system:
        places = [f'place("{n}", vec({0.3 * k}, 0, 0.5))' for k, n in enumerate(names[-2:])]
        return saying({"observation": "", "program": "\n".join(places)})
    source = f'revolute("{second}", "{first}", axis=vec(0, 0, 1), pivot=box("{second}").low, '
    return saying({"observation": "", "program": source + "lower=0.0, upper=1.0)"})


@pytest.mark.slow
def test_a_benchmark_is_recorded_once_and_replayed_without_key(
    serve, tmp_path, monkeypatch, capsys
):
    index = write_index(tmp_path, ("a",))
    server = serve(joints_answer)
    argv = [str(index), "--modality", "text", "--actor", "vlm", "--record", "record", "-q"]
    assert benchmark.main([*argv, "--out", "first"]) == 0
    n_calls = len(server.heard)
    assert n_calls >= 2
    assert f"{n_calls} calls" in capsys.readouterr().out
    first = json.loads((tmp_path / "first" / "results.json").read_text())
    monkeypatch.delenv("GEMINI_API_KEY")
    assert benchmark.main([*argv, "--out", "second"]) == 0
    second = json.loads((tmp_path / "second" / "results.json").read_text())
    assert len(server.heard) == n_calls
    assert second["protocols"] == first["protocols"]
    assert second["model"] == first["model"]
    files = [path for path in tmp_path.rglob("*") if path.is_file()]
    assert [path for path in files if KEY.encode() in path.read_bytes()] == []
    capsys.readouterr()
    used = ["--budget", "calls=0", "--rerun"]
    monkeypatch.setenv("GEMINI_API_KEY", KEY)
    new = [*argv[:-3], "--record", "other", *used, "--out", "third"]
    assert commands.main(["benchmark", *new]) == 2
    assert "--budget calls=0" in capsys.readouterr().err


@pytest.mark.slow
def test_an_object_for_a_text_is_assembled_from_a_library(serve, tmp_path, monkeypatch):
    def answer(heard):
        if "captions" in heard.fields:
            listed = heard.system.partition("The parts.")[2].splitlines()
            names = [line.split()[1] for line in listed if line[:2] == "- "]
            return saying({"captions": [{"part": n, "caption": f"a {n}"} for n in names]})
        if "parts" in heard.fields:
            body = {"name": "body", "description": "a body", "size": [0.3, 0.6, 0.9]}
            door = {"name": "door", "description": "a door", "size": [0.02, 0.6, 0.9]}
            return saying({"parts": [body, door]})
        if "categories" in heard.fields:
            return saying({"reason": "", "categories": ["Safe"]})
        if "description" in heard.fields:
            return saying({"reason": "", "description": "a safe with a door"})
        return joints_answer(heard)

    monkeypatch.setattr("articulate.reconstruct.library_choice.SEEDS", 1)
    server = serve(answer)
    argv = ["--text", "a safe", "--library", "procedural", "--actor", "vlm", "--out", "asset", "-q"]
    assert make.main(argv) == 3  # doubtful: parts of other objects
    made = json.loads((tmp_path / "asset" / "made.json").read_text())
    assert [joint["part"] for joint in made["joints"]] == ["door"]
    assert any("similar object" in reason for reason in made["reasons"])
    assert "layout of 2 parts" in (tmp_path / "asset" / "trace.html").read_text()
    assert len(server.heard) == 7


@pytest.mark.slow
def test_an_object_for_an_image_is_retrieved_from_a_library(serve, tmp_path, monkeypatch, image):
    def answer(heard):
        if "affordance" in heard.fields:
            return saying({"description": "a safe", "kind": "safe", "affordance": "its door"})
        if "categories" in heard.fields:
            return saying({"reason": "", "categories": ["Safe"]})
        if "candidate" in heard.fields:
            return saying({"reason": "", "candidate": 2})
        return joints_answer(heard)

    monkeypatch.setattr("articulate.reconstruct.library_choice.SEEDS", 2)
    serve(answer)
    (tmp_path / "photo.png").write_bytes(png(image.image))
    argv = ["--image", "photo.png", "--library", "procedural", "--actor", "vlm", "--out", "asset"]
    assert make.main([*argv, "-q"]) == 3
    made = json.loads((tmp_path / "asset" / "made.json").read_text())
    assert any("safe-0001" in reason for reason in made["reasons"])


def test_a_library_of_many_objects_needs_a_model_and_has_no_dry_run(error_line):
    argv = ["--text", "a safe", "--library", "procedural", "--actor", "vlm", "--dry-run"]
    error_line("make --library procedural --dry-run", lambda: make.main(argv))


def test_a_model_for_an_actor_without_one_is_one_line(error_line):
    argv = [*TEXT, "--actor", "geometric-text", "--model", "openai:m"]
    error_line("make --actor geometric-text --model openai:m", lambda: make.main(argv))
