"""Typed answers: what does not fit goes back once, what fits is kept."""

from __future__ import annotations

import json

import pytest
from tests.articulate.reconstruct.actors.vlm.conftest import KEY
from tests.articulate.reconstruct.actors.vlm.server import saying

from articulate.cache import KINDS
from articulate.errors import UsageError
from articulate.reconstruct.actors.vlm.answer_store import ANSWERS
from articulate.reconstruct.actors.vlm.answers import MovingParts
from articulate.reconstruct.actors.vlm.model import Request, Turn
from articulate.reconstruct.actors.vlm.model_session import ModelSession
from articulate.reconstruct.actors.vlm.schema import AnswerError, schema_of

REQUEST = Request(
    title="which parts move",
    system="You look.",
    turns=(Turn("user", ("Which?",)),),
    schema=schema_of(MovingParts),
)
GOOD = {
    "observation": "a door opens",
    "movers": [{"part": "door", "kind": "revolute", "why": "it does"}],
}


@pytest.fixture
def session(gemini, tmp_path):
    return ModelSession(model=gemini, cache=tmp_path / "cache")


def kept(tmp_path):
    return list((tmp_path / "cache" / ANSWERS).glob("*.json"))


def test_an_answer_that_fits_is_a_value(serve, session):
    serve(saying(GOOD))
    answer = session.generate(REQUEST, MovingParts)
    assert [(m.part, m.kind) for m in answer.movers] == [("door", "revolute")]
    [step] = session.steps
    assert step.text.startswith("You look.\n\nWhich?")
    assert "a door opens" in step.text
    assert step.title == "which parts move: gemini-scripted-7"
    assert step.figures == {"tokens in": 1200.0, "tokens out": 60.0}


@pytest.mark.parametrize(
    ("bad", "complaint"),
    [
        ('{"observation": "a door', "not JSON"),
        (
            '{"observation": "x", "movers": [{"part": "door", "kind": "screw", "why": ""}]}',
            "one of rev",
        ),
        ('{"observation": "x"}', "movers is missing"),
        ('{"observation": "x", "movers": [], "joints": []}', "unknown key joints"),
        ('[{"observation": "x"}]', "must be a JSON object"),
        ('{"observation": NaN, "movers": []}', "NaN is not a number"),
    ],
)
def test_an_answer_that_does_not_fit_goes_back_once_with_what_is_wrong(
    serve, session, bad, complaint, tmp_path
):
    server = serve(saying(bad), saying(GOOD))
    assert session.generate(REQUEST, MovingParts).observation == "a door opens"
    assert session.calls == 2
    again = server.heard[1].body["contents"]
    assert [turn["role"] for turn in again] == ["user", "model", "user"]
    assert again[1]["parts"][0]["text"] == bad
    assert complaint in again[2]["parts"][0]["text"]
    assert complaint in session.steps[0].text
    assert len(kept(tmp_path)) == 2  # both, so that the conversation can be repeated


def test_a_second_answer_that_does_not_fit_ends_it(serve, session, tmp_path):
    server = serve(saying("hello"))
    with pytest.raises(AnswerError, match="2 invalid answers in a row"):
        session.generate(REQUEST, MovingParts)
    assert len(server.heard) == 2
    assert kept(tmp_path) == []


@pytest.mark.parametrize(
    "text",
    [
        "[" * 200_000,
        '{"observation": "' + "x" * 1_100_000 + '", "movers": []}',
        '{"observation": "x", "movers": [], "' + "k" * 5_000 + '": 1}',
        '{"observation": 1e999, "movers": []}',
        json.dumps({**GOOD, "movers": [{"part": "door", "kind": "k" * 5_000, "why": ""}]}),
    ],
)
def test_a_hostile_answer_ends_with_a_short_line(serve, session, text):
    serve(saying(text))
    with pytest.raises((AnswerError, UsageError)) as caught:
        session.generate(REQUEST, MovingParts)
    assert len(str(caught.value)) < 500
    assert "\n" not in str(caught.value)


def test_what_a_check_says_is_wrong_goes_back_too(serve, session):
    other = {**GOOD, "movers": [{"part": "lid", "kind": "revolute", "why": ""}]}
    server = serve(saying(other), saying(GOOD))
    session.generate(REQUEST, MovingParts, lambda a: "no lid" if a.movers[0].part == "lid" else "")
    assert "no lid" in server.heard[1].text


def test_the_same_question_is_asked_once(serve, session, gemini, tmp_path):
    server = serve(saying(GOOD))
    first = session.generate(REQUEST, MovingParts)
    later = ModelSession(model=gemini, cache=tmp_path / "cache")
    assert later.generate(REQUEST, MovingParts) == first
    assert (len(server.heard), later.calls) == (1, 0)
    assert "cached" in later.steps[0].title
    assert later.steps[0].seconds == 0.0


def test_a_kept_answer_is_used_without_key_and_network(serve, session, gemini, monkeypatch):
    serve(saying(GOOD))
    first = session.generate(REQUEST, MovingParts)
    monkeypatch.delenv("GEMINI_API_KEY")
    assert ModelSession(model=gemini, cache=session.cache).generate(REQUEST, MovingParts) == first


@pytest.mark.parametrize("content", ["", "{", "[]", '{"text": "x"}', '{"words": "x"}'])
def test_a_kept_file_that_is_broken_is_asked_for_again(serve, session, content, tmp_path):
    server = serve(saying(GOOD))
    session.generate(REQUEST, MovingParts)
    [path] = kept(tmp_path)
    path.write_text(content)
    session.generate(REQUEST, MovingParts)
    assert len(server.heard) == 2
    assert json.loads(path.read_text())["model"] == "gemini-scripted-7"


def test_without_a_cache_every_question_is_asked(serve, gemini):
    server = serve(saying(GOOD))
    session = ModelSession(model=gemini, cache=None)
    session.generate(REQUEST, MovingParts)
    session.generate(REQUEST, MovingParts)
    assert len(server.heard) == 2


def test_the_key_is_in_no_file_and_no_step_even_if_the_server_repeats_it(serve, session, tmp_path):
    serve(saying({**GOOD, "observation": f"the key is {KEY}"}, modelVersion=f"m-{KEY}"))
    answer = session.generate(REQUEST, MovingParts)
    files = [path for path in tmp_path.rglob("*") if path.is_file()]
    assert files
    assert all(KEY.encode() not in path.read_bytes() for path in files)
    assert KEY not in answer.observation + str(session.steps)


def test_the_cache_command_knows_answers():
    assert ANSWERS in KINDS
