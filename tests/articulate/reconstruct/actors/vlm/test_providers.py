"""All providers against a loopback server that speaks their formats."""

from __future__ import annotations

import base64
import time
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from email.utils import format_datetime

import pytest
from tests.articulate.reconstruct.actors.vlm.conftest import KEY, QUICK
from tests.articulate.reconstruct.actors.vlm.server import Answer, failing, saying

from articulate.errors import ConfigError, UsageError
from articulate.reconstruct.actors.vlm import http_model
from articulate.reconstruct.actors.vlm.http_model import requested_delay_s
from articulate.reconstruct.actors.vlm.model import CaptionedImage, CaptionedVideo, Request, Turn
from articulate.reconstruct.actors.vlm.providers import FORMATS, create_model

PNG = b"\x89PNG\r\n\x1a\n not a real one"
SCHEMA = {
    "type": "object",
    "description": "A number.",
    "properties": {"n": {"type": "integer"}},
    "required": ["n"],
}
REQUEST = Request(
    title="number",
    system="Count.",
    turns=(
        Turn("user", ("How many?", CaptionedImage("frame 1 of 2", PNG))),
        Turn("model", ("many",)),
        Turn("user", ("A number, please.",)),
    ),
    schema=SCHEMA,
)
PATHS = {
    "gemini": "/v1beta/models/scripted:generateContent",
    "openai": "/v1/chat/completions",
    "anthropic": "/v1/messages",
}
KEY_HEADERS = {"gemini": "x-goog-api-key", "openai": "authorization", "anthropic": "x-api-key"}


def test_the_payload_has_texts_images_turns_and_schema(serve, model):
    server = serve(saying({"n": 3}))
    reply = model.generate(REQUEST)
    provider = model.wire_format.provider
    assert (reply.text, reply.model) == ('{"n": 3}', f"{provider}-scripted-7")
    assert (reply.tokens_in, reply.tokens_out, reply.is_cut) == (1200, 60, False)
    [heard] = server.heard
    assert heard.path == PATHS[provider]
    assert heard.system == "Count."
    assert heard.text == "How many?\nframe 1 of 2:\nmany\nA number, please."
    assert heard.pictures == [PNG]
    assert heard.schema == SCHEMA
    roles = [role for role, _ in heard.turns]
    assert roles == ["user", "model" if provider == "gemini" else "assistant", "user"]


def test_the_key_is_in_one_header_and_nowhere_else(serve, model):
    server = serve(saying({"n": KEY}))
    reply = model.generate(REQUEST)
    [heard] = server.heard
    names = [name.lower() for name, value in heard.headers.items() if KEY in value]
    assert names == [KEY_HEADERS[model.wire_format.provider]]
    assert KEY not in heard.path + str(heard.body) + str(reply) + repr(model)


def test_a_video_is_sent_as_file_or_as_frames(serve, model):
    server = serve(saying({"n": 3}))
    video = CaptionedVideo("the video", b"mp4", 5.0, (CaptionedImage("frame 1", PNG),))
    model.generate(replace(REQUEST, turns=(Turn("user", (video,)),)))
    [heard] = server.heard
    if model.wire_format.provider == "gemini":
        part = heard.body["contents"][0]["parts"][1]
        assert part["inlineData"]["mimeType"] == "video/mp4"
        assert base64.b64decode(part["inlineData"]["data"]) == b"mp4"
        assert part["videoMetadata"] == {"fps": 5.0}
    else:
        assert heard.pictures == [PNG]


def test_an_answer_at_the_token_limit_is_recognised(serve, model):
    serve(saying('{"n": ', finish="length"))
    reply = model.generate(REQUEST)
    assert (reply.is_cut, reply.block_reason) == (True, "")


def test_a_blocked_answer_has_a_reason(serve, model):
    serve(saying("", finish="refusal"))
    reply = model.generate(REQUEST)
    assert (reply.text, reply.is_cut) == ("", False)
    assert reply.block_reason


DETAILS = [{"@type": "type.googleapis.com/google.rpc.RetryInfo", "retryDelay": "0.3s"}]


@pytest.mark.parametrize(
    "busy",
    [
        failing(429, "quota", {"Retry-After": "0.3"}),
        failing(503, "overloaded", {"retry-after-ms": "300"}),
        failing(429, "quota", details=DETAILS),
    ],
)
def test_a_retry_waits_as_long_as_the_server_requests(serve, model, busy):
    server = serve(busy, saying({"n": 1}))
    start = time.monotonic()
    assert model.generate(REQUEST).text == '{"n": 1}'
    assert time.monotonic() - start >= 0.3
    assert len(server.heard) == 2


def test_a_delay_may_be_a_date():
    date = format_datetime(datetime.now(UTC) + timedelta(seconds=60), usegmt=True)
    delay = requested_delay_s({"Retry-After": date}, b"")
    assert delay is not None
    assert 50.0 < delay <= 60.0
    assert requested_delay_s({"retry-after": "soon"}, b"") is None
    assert requested_delay_s({}, b"[1]") is None


def test_a_delay_that_is_too_long_ends_it(serve, gemini, error_line):
    server = serve(failing(429, "quota", {"Retry-After": "3600"}))
    error_line("HttpModel.generate(delay of an hour)", lambda: gemini.generate(REQUEST))
    assert len(server.heard) == 1


def test_a_server_that_fails_is_sent_the_request_three_times(serve, model):
    server = serve(failing(500, "broken"))
    with pytest.raises(UsageError, match="status 500 on each of 3 attempts"):
        model.generate(REQUEST)
    assert len(server.heard) == 3
    assert model.budget.used.calls == 3


def test_a_slow_server_ends_it(serve, model):
    serve(replace(saying({"n": 1}), delay_s=1.0))
    with pytest.raises(UsageError, match=r"no reply within 0\.2 s"):
        replace(model, timeout_s=0.2).generate(REQUEST)


def test_a_reply_that_is_too_long_is_not_read(serve, model, monkeypatch):
    monkeypatch.setattr(http_model, "MAX_REPLY_BYTES", 1000)
    serve(saying("x" * 5000))
    with pytest.raises(UsageError, match="the reply is longer than"):
        model.generate(REQUEST)


@pytest.mark.parametrize("body", [b"\xff\xfe", b"", b"[" * 100_000, [], 7, {"choices": [3]}, "x"])
def test_a_malformed_reply_is_one_line(serve, model, body):
    serve(Answer(200, body))
    with pytest.raises(UsageError, match="the reply is") as caught:
        model.generate(REQUEST)
    assert "\n" not in str(caught.value)


def test_a_local_server_needs_no_key(serve, monkeypatch):
    server = serve(saying({"n": 1}))
    monkeypatch.delenv("OPENAI_API_KEY")
    model = replace(create_model(f"openai:llava:7b@{server.url}/v1"), **QUICK)
    assert model.generate(REQUEST).text == '{"n": 1}'
    [heard] = server.heard
    assert heard.body["model"] == "llava:7b"
    assert "authorization" not in {name.lower() for name in heard.headers}
    assert model.source == f"openai:llava:7b at {server.url}/v1"
    assert create_model(model.spec).source == model.source


def test_a_password_in_the_url_is_in_no_name():
    model = create_model("openai:m@http://user:secret@localhost:9/v1")
    assert "secret" not in model.source + model.spec + model.name


@pytest.mark.parametrize(
    "name", ["opnai:m", "gemini:", "openai:m@ftp://x", "openai:m@http://", "a b"]
)
def test_a_name_that_is_invalid_is_one_line(name, error_line):
    error_line(f"create_model({name})", lambda: create_model(name))
    with pytest.raises(ConfigError):
        create_model(name)


def test_tokens_of_images_and_texts_are_estimated():
    png = b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR" + (640).to_bytes(4, "big") + (480).to_bytes(4, "big")
    request = replace(REQUEST, turns=(Turn("user", (CaptionedImage("", png),)),))
    without = replace(REQUEST, turns=(Turn("user", ("",)),))
    found = {
        name: create_model(f"{name}:m").estimate_tokens(request)
        - create_model(f"{name}:m").estimate_tokens(without)
        for name in FORMATS
    }
    assert found == {"gemini": 258, "openai": 85 + 2 * 170, "anthropic": 410}
