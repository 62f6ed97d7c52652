"""Typed answers: what does not fit goes back once, what fits is kept."""

from __future__ import annotations

import json

import pytest
from tests.articulate.reconstruct.actors.vlm.conftest import KEY
from tests.articulate.reconstruct.actors.vlm.server import saying

from articulate.cache import KINDS
from articulate.reconstruct.actors.vlm.answers import Movers
from articulate.reconstruct.actors.vlm.model import Request, Turn
from articulate.reconstruct.actors.vlm.model_session import ANSWERS, ModelSession
from articulate.reconstruct.actors.vlm.schema import Unfit, schema_of

REQUEST = Request(
    title="which parts move",
    system="You look.",
    turns=(Turn("user", ("Which?",)),),
    schema=schema_of(Movers),
)
GOOD = {"seen": "a door opens", "movers": [{"part": "door", "kind": "revolute", "why": "it does"}]}


@pytest.fixture
def interview(gemini, tmp_path):
    return ModelSession(model=gemini, cache=tmp_path / "cache")


def kept(tmp_path):
    return list((tmp_path / "cache" / ANSWERS).glob("*.json"))


def test_an_answer_that_fits_is_a_value(serve, interview):
    serve(saying(GOOD))
    answer = interview.ask(REQUEST, Movers)
    assert [(m.part, m.kind) for m in answer.movers] == [("door", "revolute")]
    [step] = interview.steps
    assert step.text.startswith("You look.\n\nWhich?")
    assert "a door opens" in step.text
    assert step.title == "which parts move: gemini-scripted-7"
    assert step.figures == {"tokens in": 1200.0, "tokens out": 60.0}


@pytest.mark.parametrize(
    ("bad", "complaint"),
    [
        ('{"seen": "a door', "not JSON"),
        ('{"seen": "x", "movers": [{"part": "door", "kind": "screw", "why": ""}]}', "one of rev"),
        ('{"seen": "x"}', "movers is missing"),
        ('{"seen": "x", "movers": [], "joints": []}', "unknown key joints"),
        ('[{"seen": "x"}]', "must be a JSON object"),
        ('{"seen": NaN, "movers": []}', "NaN is no number"),
    ],
)
def test_an_answer_that_does_not_fit_goes_back_once_with_what_is_wrong(
    serve, interview, bad, complaint, tmp_path
):
    server = serve(saying(bad), saying(GOOD))
    assert interview.ask(REQUEST, Movers).seen == "a door opens"
    assert interview.calls == 2
    again = server.heard[1].body["contents"]
    assert [turn["role"] for turn in again] == ["user", "model", "user"]
    assert again[1]["parts"][0]["text"] == bad
    assert complaint in again[2]["parts"][0]["text"]
    assert complaint in interview.steps[0].text
    assert len(kept(tmp_path)) == 1  # only the answer that fits


def test_a_second_answer_that_does_not_fit_ends_it(serve, interview, tmp_path):
    server = serve(saying("hello"))
    with pytest.raises(Unfit, match="2 answers in a row do not fit"):
        interview.ask(REQUEST, Movers)
    assert len(server.heard) == 2
    assert kept(tmp_path) == []


def test_what_a_check_says_is_wrong_goes_back_too(serve, interview):
    other = {**GOOD, "movers": [{"part": "lid", "kind": "revolute", "why": ""}]}
    server = serve(saying(other), saying(GOOD))
    interview.ask(REQUEST, Movers, lambda a: "no lid" if a.movers[0].part == "lid" else "")
    assert "no lid" in server.heard[1].text


def test_the_same_question_is_asked_once(serve, interview, gemini, tmp_path):
    server = serve(saying(GOOD))
    first = interview.ask(REQUEST, Movers)
    later = ModelSession(model=gemini, cache=tmp_path / "cache")
    assert later.ask(REQUEST, Movers) == first
    assert (len(server.heard), later.calls) == (1, 0)
    assert "kept from an earlier run" in later.steps[0].title
    assert later.steps[0].seconds == 0.0


def test_a_kept_answer_is_used_without_key_and_network(serve, interview, gemini, monkeypatch):
    serve(saying(GOOD))
    first = interview.ask(REQUEST, Movers)
    monkeypatch.delenv("GEMINI_API_KEY")
    assert ModelSession(model=gemini, cache=interview.cache).ask(REQUEST, Movers) == first


@pytest.mark.parametrize("content", ["", "{", "[]", '{"text": "x"}', '{"words": "x"}'])
def test_a_kept_file_that_is_broken_is_asked_for_again(serve, interview, content, tmp_path):
    server = serve(saying(GOOD))
    interview.ask(REQUEST, Movers)
    [path] = kept(tmp_path)
    path.write_text(content)
    interview.ask(REQUEST, Movers)
    assert len(server.heard) == 2
    assert json.loads(path.read_text())["model"] == "gemini-scripted-7"


def test_without_a_cache_every_question_is_asked(serve, gemini):
    server = serve(saying(GOOD))
    interview = ModelSession(model=gemini, cache=None)
    interview.ask(REQUEST, Movers)
    interview.ask(REQUEST, Movers)
    assert len(server.heard) == 2


def test_the_key_is_in_no_file_and_no_step_even_if_the_server_repeats_it(
    serve, interview, tmp_path
):
    serve(saying({**GOOD, "seen": f"the key is {KEY}"}, modelVersion=f"m-{KEY}"))
    answer = interview.ask(REQUEST, Movers)
    files = [path for path in tmp_path.rglob("*") if path.is_file()]
    assert files
    assert all(KEY.encode() not in path.read_bytes() for path in files)
    assert KEY not in answer.seen + str(interview.steps)


def test_the_cache_command_knows_answers():
    assert ANSWERS in KINDS
