"""Loopback server that speaks the wire formats of all providers and replies from a script."""

from __future__ import annotations

import base64
import json
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any


@dataclass(frozen=True)
class Heard:
    """One request, as it came over the wire."""

    path: str
    headers: dict[str, str]
    body: dict[str, Any]

    @property
    def provider(self) -> str:
        if self.path.endswith(":generateContent"):
            return "gemini"
        return "openai" if self.path.endswith("/chat/completions") else "anthropic"

    @property
    def schema(self) -> Any:
        """JSON schema of the requested answer."""
        if self.provider == "gemini":
            return self.body["generationConfig"]["responseJsonSchema"]
        if self.provider == "openai":
            return self.body["response_format"]["json_schema"]["schema"]
        return self.body["tools"][0]["input_schema"]

    @property
    def fields(self) -> set[str]:
        """Names of the fields of the requested answer."""
        return set(self.schema["properties"])

    @property
    def turns(self) -> list[tuple[str, list[dict[str, Any]]]]:
        """Role and parts of each message, without the system prompt."""
        if self.provider == "gemini":
            return [(turn["role"], turn["parts"]) for turn in self.body["contents"]]
        found = []
        for turn in self.body["messages"]:
            content = turn["content"]
            parts = [{"type": "text", "text": content}] if isinstance(content, str) else content
            if turn["role"] != "system":
                found.append((turn["role"], parts))
        return found

    @property
    def text(self) -> str:
        """Text of all messages."""
        return "\n".join(p["text"] for _, parts in self.turns for p in parts if "text" in p)

    @property
    def system(self) -> Any:
        if self.provider == "gemini":
            return "\n".join(p["text"] for p in self.body["systemInstruction"]["parts"])
        if self.provider == "anthropic":
            return self.body["system"]
        return self.body["messages"][0]["content"]

    @property
    def pictures(self) -> list[bytes]:
        found = []
        for _, parts in self.turns:
            for part in parts:
                data = part.get("inlineData", {}).get("data")
                if part.get("type") == "image_url":
                    data = part["image_url"]["url"].removeprefix("data:image/png;base64,")
                elif part.get("type") == "image":
                    data = part["source"]["data"]
                if data:
                    found.append(base64.b64decode(data))
        return found


@dataclass(frozen=True)
class ScriptedReply:
    """Content of a model's reply, in no format yet."""

    text: str
    finish: str = "stop"
    """``stop``, ``length`` or ``refusal``."""
    more: Mapping[str, Any] = field(default_factory=dict)

    def body(self, provider: str) -> dict[str, Any]:
        """Return the JSON of one provider."""
        if provider == "gemini":
            finish = {"stop": "STOP", "length": "MAX_TOKENS", "refusal": "SAFETY"}[self.finish]
            parts = [{"text": self.text}] if self.text else []
            candidate = {"content": {"role": "model", "parts": parts}, "finishReason": finish}
            usage = {"promptTokenCount": 1200, "candidatesTokenCount": 60}
            body = {"candidates": [candidate], "usageMetadata": usage}
            return {**body, "modelVersion": "gemini-scripted-7", **self.more}
        if provider == "openai":
            finish = {"refusal": "content_filter"}.get(self.finish, self.finish)
            message = {"role": "assistant", "content": self.text}
            usage = {"prompt_tokens": 1200, "completion_tokens": 60}
            body = {"choices": [{"message": message, "finish_reason": finish}], "usage": usage}
            return {**body, "model": "openai-scripted-7", **self.more}
        stop = {"stop": "tool_use", "length": "max_tokens", "refusal": "refusal"}[self.finish]
        block: dict[str, Any] = {"type": "text", "text": self.text}
        try:
            content = json.loads(self.text)
            if isinstance(content, dict):
                block = {"type": "tool_use", "id": "t1", "name": "answer", "input": content}
        except (ValueError, RecursionError):
            pass
        usage = {"input_tokens": 1200, "output_tokens": 60}
        body = {"content": [block] if self.text else [], "stop_reason": stop, "usage": usage}
        return {**body, "model": "anthropic-scripted-7", **self.more}


@dataclass(frozen=True)
class Answer:
    """One reply of the server."""

    status: int
    body: Any
    """:class:`ScriptedReply`, JSON or bytes."""
    headers: Mapping[str, str] = field(default_factory=dict)
    delay_s: float = 0.0
    """Wait between the first and the second half of the reply [s]."""


def saying(content: Any, finish: str = "stop", **more: Any) -> Answer:
    """A reply of a model: text, or what is written as JSON."""
    text = content if isinstance(content, str) else json.dumps(content)
    return Answer(200, ScriptedReply(text, finish, more))


def failing(code: int, message: str, headers: Any = None, **more: Any) -> Answer:
    """A rejection; all formats have ``error.message``."""
    error = {"code": code, "message": message, "status": "X", **more}
    return Answer(code, {"error": error}, headers or {})


@dataclass
class Server:
    """Replies to requests with what ``answer`` returns for them."""

    answer: Callable[[Heard], Any]
    heard: list[Heard] = field(default_factory=list)
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def __enter__(self) -> Server:
        outer = self

        class Handler(BaseHTTPRequestHandler):
            protocol_version = "HTTP/1.1"
            disable_nagle_algorithm = True  # otherwise every reply waits 40 ms

            def do_POST(self) -> None:
                size = int(self.headers["Content-Length"])
                heard = Heard(self.path, dict(self.headers), json.loads(self.rfile.read(size)))
                with outer._lock:
                    outer.heard.append(heard)
                    found = outer.answer(heard)
                reply = found if isinstance(found, Answer) else Answer(*found)
                body = reply.body
                if isinstance(body, ScriptedReply):
                    body = body.body(heard.provider)
                content = body if isinstance(body, bytes) else json.dumps(body).encode()
                self.send_response(reply.status)
                self.send_header("Content-Type", "application/json")
                self.send_header("Content-Length", str(len(content)))
                for name, value in reply.headers.items():
                    self.send_header(name, value)
                self.end_headers()
                half = len(content) // 2 if reply.delay_s else len(content)
                try:
                    self.wfile.write(content[:half])
                    time.sleep(reply.delay_s)
                    self.wfile.write(content[half:])
                except OSError:  # the client has closed the connection
                    self.close_connection = True

            def log_message(self, *_: Any) -> None:
                pass

        self._server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self._server.daemon_threads = True
        self._server.block_on_close = False
        self._thread = threading.Thread(target=self._server.serve_forever, args=(0.02,))
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._server.shutdown()
        self._thread.join()
        self._server.server_close()

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self._server.server_port}"


def in_turn(*answers: Any) -> Callable[[Heard], Any]:
    """Replies one after the other; the last again and again."""
    left = list(answers)

    def answer(_: Heard) -> Any:
        return left.pop(0) if len(left) > 1 else left[0]

    return answer
