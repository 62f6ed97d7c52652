"""Measure the time that a request to a model takes in this process.

    python benchmarks/model_overhead.py

A loopback server in another process replies at once; the time of a bare request is subtracted.
Each request has eight images of 640 x 480 px, as one with a video; every answer is decoded and
stored. Processor time is printed beside wall-clock time, which grows on a busy machine.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import tempfile
import time
import urllib.request
from dataclasses import replace
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import numpy as np

from articulate.reconstruct.actors.vlm.answers import MovingParts
from articulate.reconstruct.actors.vlm.model import CaptionedImage, Request, Turn
from articulate.reconstruct.actors.vlm.model_session import ModelSession
from articulate.reconstruct.actors.vlm.providers import FORMATS, create_model
from articulate.reconstruct.actors.vlm.schema import schema_of
from articulate.render.image import png

REQUESTS = 30
TEXT = json.dumps({"observation": "a door", "movers": []})
REPLIES: dict[str, dict[str, Any]] = {
    "gemini": {"candidates": [{"content": {"parts": [{"text": TEXT}]}}]},
    "openai": {"choices": [{"message": {"content": TEXT}, "finish_reason": "stop"}]},
    "anthropic": {"content": [{"type": "text", "text": TEXT}], "stop_reason": "tool_use"},
}


def serve(provider: str, port: Connection) -> None:
    """Send the port of a server that replies at once, and serve."""
    content = json.dumps(REPLIES[provider]).encode()

    class Handler(BaseHTTPRequestHandler):
        protocol_version = "HTTP/1.1"
        disable_nagle_algorithm = True

        def do_POST(self) -> None:
            """Reply with the scripted answer."""
            self.rfile.read(int(self.headers["Content-Length"]))
            self.send_response(200)
            self.send_header("Content-Length", str(len(content)))
            self.end_headers()
            self.wfile.write(content)

        def log_message(self, *_: Any) -> None:
            """Print nothing."""

    server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    port.send(server.server_port)
    server.serve_forever()


def clocks() -> np.ndarray:
    """Return wall-clock and processor time [ms]."""
    return 1e3 * np.array([time.perf_counter(), time.process_time()])


def request_of(k: int, images: list[bytes]) -> Request:
    """Return a request that differs from all others."""
    captioned = tuple(CaptionedImage(f"frame {j}", image) for j, image in enumerate(images))
    return Request(
        title="overhead",
        system="Look.",
        turns=(Turn("user", (f"Request {k}", *captioned)),),
        schema=schema_of(MovingParts),
    )


def main() -> None:
    """Print the overhead for each provider, and the time of a stored answer."""
    argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    ).parse_args()
    rng = np.random.default_rng(0)
    images = [png(rng.integers(0, 256, (480, 640, 3), dtype=np.uint8) // 64 * 64) for _ in range(8)]
    for provider, wire_format in FORMATS.items():
        here, there = multiprocessing.Pipe()
        process = multiprocessing.Process(target=serve, args=(provider, there), daemon=True)
        process.start()
        url = f"http://127.0.0.1:{here.recv()}"
        os.environ[wire_format.key_variables[0]] = "key"
        model = replace(create_model(f"{provider}:scripted@{url}"), timeout_s=60.0)
        body = json.dumps(wire_format.body("scripted", request_of(0, images), 100)).encode()
        rows = []
        with tempfile.TemporaryDirectory() as folder:
            session = ModelSession(model=model, cache=Path(folder))
            session.generate(request_of(-1, images), MovingParts)  # imports and connects
            for k in range(REQUESTS):
                times = [clocks()]
                urllib.request.urlopen(urllib.request.Request(url, data=body)).read()
                times.append(clocks())
                session.generate(request_of(k, images), MovingParts)
                times.append(clocks())
                session.generate(request_of(k, images), MovingParts)
                times.append(clocks())
                rows.append(np.diff(times, axis=0))
        process.kill()
        bare, sent, stored = np.median(rows, axis=0)
        wall, processor = sent - bare
        print(
            f"{provider:<10} {len(body) / 1e6:.1f} MB; median overhead of {REQUESTS} requests: "
            f"{wall:.1f} ms, processor {processor:.1f} ms; stored answer: {stored[0]:.1f} ms"
        )


if __name__ == "__main__":
    main()
