"""The Gemini format against a loopback server."""

from __future__ import annotations

import json
import sys
from dataclasses import replace

import pytest
from tests.articulate.reconstruct.actors.vlm.conftest import KEY
from tests.articulate.reconstruct.actors.vlm.server import failing, saying

from articulate.errors import UsageError
from articulate.reconstruct.actors.vlm.gemini import GeminiFormat
from articulate.reconstruct.actors.vlm.hide_key import HIDDEN
from articulate.reconstruct.actors.vlm.model import CaptionedImage, Request, Turn
from articulate.reconstruct.actors.vlm.providers import create_model

KEY_VARIABLES = GeminiFormat().key_variables
URL_VARIABLE = GeminiFormat().url_variable
PNG = b"\x89PNG\r\n\x1a\n not a real one"
REQUEST = Request(
    title="a question",
    system="You answer.",
    turns=(
        Turn("user", ("How many?", CaptionedImage("frame 1 of 2", PNG))),
        Turn("model", ("many",)),
        Turn("user", ("A number, please.",)),
    ),
    schema={"type": "object", "properties": {"n": {"type": "integer"}}, "required": ["n"]},
)


def test_words_pictures_turns_and_schema_go_over_the_wire(serve, gemini):
    server = serve(saying({"n": 3}))
    reply = gemini.generate(REQUEST)
    assert (reply.text, reply.model) == ('{"n": 3}', "gemini-scripted-7")
    assert (reply.tokens_in, reply.tokens_out, reply.cached) == (1200, 60, False)
    [heard] = server.heard
    assert heard.path.endswith("/models/gemini-3.8-flash:generateContent")
    assert heard.system == "You answer."
    assert heard.text == "How many?\nframe 1 of 2:\nmany\nA number, please."
    assert heard.pictures == [PNG]
    assert [turn["role"] for turn in heard.body["contents"]] == ["user", "model", "user"]
    config = heard.body["generationConfig"]
    assert config["responseMimeType"] == "application/json"
    assert config["responseJsonSchema"] == REQUEST.schema
    assert "temperature" not in config


def test_the_key_goes_into_one_header_and_nowhere_else(serve, gemini):
    server = serve(saying({"n": 3}))
    gemini.generate(REQUEST)
    [heard] = server.heard
    assert [name for name, value in heard.headers.items() if KEY in value] == ["x-goog-api-key"]
    assert KEY not in heard.path
    assert KEY not in str(heard.body)


def test_a_busy_server_is_asked_again(serve, gemini):
    server = serve(failing(429, "slow down"), failing(503, "overloaded"), saying({"n": 1}))
    assert gemini.generate(REQUEST).text == '{"n": 1}'
    assert len(server.heard) == 3


def test_a_server_that_stays_busy_is_given_up_in_one_line(serve, gemini, error_line):
    server = serve(failing(429, "quota of free requests is used up"))
    error_line("Gemini(attempts=3).generate(busy)", lambda: gemini.generate(REQUEST))
    assert len(server.heard) == 3


def test_thoughts_are_no_part_of_the_answer(serve, gemini):
    parts = [{"text": "hm, let me see", "thought": True}, {"text": '{"n": '}, {"text": "2}"}]
    serve(saying("", candidates=[{"content": {"role": "model", "parts": parts}}]))
    assert gemini.generate(REQUEST).text == '{"n": 2}'


@pytest.mark.parametrize(
    ("call", "answer"),
    [
        ("a key that is refused", failing(400, "API key not valid. Please pass a valid API key.")),
        ("no such model", failing(404, "models/gemini-3.8-flash is not found")),
        ("a bad request", failing(400, "too many images")),
        ("a page that is no JSON", (200, b"<html>log in first</html>")),
    ],
)
def test_what_a_server_refuses_is_said_in_one_line(serve, gemini, error_line, call, answer):
    serve(answer)
    error_line(f"Gemini().generate({call})", lambda: gemini.generate(REQUEST))


def test_a_key_that_a_server_sends_back_is_hidden(serve, gemini):
    serve(failing(403, f"the key {KEY} may not do this"), saying({"n": KEY}))
    with pytest.raises(UsageError) as caught:
        gemini.generate(REQUEST)
    assert KEY not in str(caught.value)
    assert HIDDEN in str(caught.value)
    assert caught.value.__cause__ is None
    assert caught.value.__context__ is None
    assert gemini.generate(REQUEST).text == f'{{"n": "{HIDDEN}"}}'


ESCAPED = "".join(f"\\u{ord(letter):04X}" for letter in KEY)
HALF = "".join(f"\\u{ord(letter):04x}" if k % 2 else letter for k, letter in enumerate(KEY))


@pytest.mark.parametrize(
    ("text", "kept"),
    [
        (f'{{"n": "{ESCAPED}"}}', f'{{"n": "{HIDDEN}"}}'),
        (f'{{"{HALF}": ["a {ESCAPED} b", 1]}}', f'{{"{HIDDEN}": ["a {HIDDEN} b", 1]}}'),
        (json.dumps({"n": f'name = "{ESCAPED}"'}), json.dumps({"n": f'name = "{HIDDEN}"'})),
        (f'{{"n": {HALF}', f'{{"n": {HIDDEN}'),
        ('{"n": "\\u00e9"}', '{"n": "\\u00e9"}'),
    ],
)
def test_a_key_that_is_sent_back_with_escapes_is_hidden(serve, gemini, text, kept):
    serve(saying(text))
    assert gemini.generate(REQUEST).text == kept


@pytest.mark.parametrize("body", [[], 5, {"candidates": 5}, {"candidates": [None]}, "hello"])
def test_what_answers_in_another_shape_is_said_in_one_line(serve, gemini, body):
    serve((200, body))
    with pytest.raises(UsageError, match="the reply is not one of gemini"):
        gemini.generate(REQUEST)


def test_half_a_character_becomes_a_question_mark(serve, gemini):
    serve(saying("a \ud800 b"))
    assert gemini.generate(REQUEST).text == "a ? b"


def test_no_network_is_said_in_one_line(client, monkeypatch, gemini, error_line):
    monkeypatch.setenv("GEMINI_API_KEY", KEY)
    monkeypatch.setenv(URL_VARIABLE, "http://127.0.0.1:9")  # nobody listens there
    error_line("Gemini().generate(no network)", lambda: gemini.generate(REQUEST))


def test_without_a_key_nothing_is_asked(serve, gemini, monkeypatch, error_line):
    server = serve(saying({"n": 3}))
    for name in KEY_VARIABLES:
        monkeypatch.setenv(name, " ")
    error_line("Gemini().generate(no key)", lambda: gemini.generate(REQUEST))
    assert server.heard == []


def test_what_cannot_be_a_key_is_not_shown_and_not_sent(serve, gemini, monkeypatch, error_line):
    server = serve(saying({"n": 3}))
    monkeypatch.setenv("GEMINI_API_KEY", f"{KEY}\n{KEY}")
    line = error_line("Gemini().generate(two lines as a key)", lambda: gemini.generate(REQUEST))
    assert KEY not in line
    assert server.heard == []


def test_googles_name_of_the_key_comes_before_the_other(serve, gemini, monkeypatch):
    server = serve(saying({"n": 3}))
    monkeypatch.setenv("GOOGLE_API_KEY", "the-first")
    gemini.generate(REQUEST)
    assert server.heard[0].headers["x-goog-api-key"] == "the-first"


def test_without_the_package_one_line_says_what_to_install(monkeypatch, gemini, error_line):
    monkeypatch.setenv("GEMINI_API_KEY", KEY)
    monkeypatch.setitem(sys.modules, "httpx", None)
    error_line("Gemini().generate(no httpx)", lambda: gemini.generate(REQUEST))


def test_the_model_is_named_by_the_environment(monkeypatch):
    monkeypatch.setenv("ARTICULATE_MODEL", "gemini-pro-latest")
    assert create_model("").name == "gemini-pro-latest"


def test_whatever_decides_an_answer_is_in_the_hash_of_the_question(monkeypatch, gemini):
    other_words = replace(
        REQUEST, turns=(Turn("user", ("How few?", CaptionedImage("frame 1 of 2", PNG))),)
    )
    first = REQUEST.turns[0]
    changed = Turn("user", (first.content[0], CaptionedImage("frame 1 of 2", PNG + b"!")))
    found = {
        REQUEST.key(gemini.source),
        REQUEST.key("another model"),
        other_words.key(gemini.source),
        replace(REQUEST, turns=(changed, *REQUEST.turns[1:])).key(gemini.source),
        replace(REQUEST, system="You do not.").key(gemini.source),
        replace(REQUEST, schema={"type": "object"}).key(gemini.source),
    }
    assert len(found) == 6
    assert replace(REQUEST, title="the same by another title").key(gemini.source) in found
    monkeypatch.setenv(URL_VARIABLE, "http://127.0.0.1:9")
    assert REQUEST.key(gemini.source) not in found
