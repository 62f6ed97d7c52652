"""A server on this machine that speaks Gemini's wire format and answers from a script."""

from __future__ import annotations

import base64
import json
import threading
from collections.abc import Callable
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
    def fields(self) -> set[str]:
        """Names of the fields of the answer that is asked for."""
        config = self.body["generationConfig"]
        return set(config["responseJsonSchema"]["properties"])

    @property
    def text(self) -> str:
        """All words of all turns."""
        return "\n".join(
            p["text"] for t in self.body["contents"] for p in t["parts"] if "text" in p
        )

    @property
    def system(self) -> str:
        return "\n".join(p["text"] for p in self.body["systemInstruction"]["parts"])

    @property
    def pictures(self) -> list[bytes]:
        found = []
        for turn in self.body["contents"]:
            for part in turn["parts"]:
                data = part.get("inlineData") or part.get("inline_data")
                if data:
                    found.append(base64.b64decode(data["data"], altchars=b"-_"))
        return found


Answer = tuple[int, Any]
"""Status, and the JSON body."""


def saying(content: Any, **more: Any) -> Answer:
    """An answer of a model: text, or what is written as JSON."""
    text = content if isinstance(content, str) else json.dumps(content)
    candidate = {"content": {"role": "model", "parts": [{"text": text}]}, "finishReason": "STOP"}
    usage = {"promptTokenCount": 1200, "candidatesTokenCount": 60, "totalTokenCount": 1260}
    body = {"candidates": [candidate], "usageMetadata": usage, "modelVersion": "gemini-scripted-7"}
    return 200, {**body, **more}


def failing(code: int, message: str) -> Answer:
    return code, {"error": {"code": code, "message": message, "status": "X"}}


@dataclass
class Server:
    """Answers requests with what ``answer`` says of them."""

    answer: Callable[[Heard], Answer]
    heard: list[Heard] = field(default_factory=list)
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def __enter__(self) -> Server:
        outer = self

        class Handler(BaseHTTPRequestHandler):
            protocol_version = "HTTP/1.1"
            disable_nagle_algorithm = True  # else every answer waits 40 ms for an acknowledgement

            def do_POST(self) -> None:
                size = int(self.headers["Content-Length"])
                heard = Heard(self.path, dict(self.headers), json.loads(self.rfile.read(size)))
                with outer._lock:
                    outer.heard.append(heard)
                    status, body = outer.answer(heard)
                content = body if isinstance(body, bytes) else json.dumps(body).encode()
                self.send_response(status)
                self.send_header("Content-Type", "application/json")
                self.send_header("Content-Length", str(len(content)))
                self.end_headers()
                self.wfile.write(content)

            def log_message(self, *_: Any) -> None:
                pass

        self._server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self._server.daemon_threads = True
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


def in_turn(*answers: Answer) -> Callable[[Heard], Answer]:
    """Answers one after the other; the last again and again."""
    left = list(answers)

    def answer(_: Heard) -> Answer:
        return left.pop(0) if len(left) > 1 else left[0]

    return answer
