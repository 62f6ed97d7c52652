"""A headless Chromium that tests drive through a pipe, without any package for it."""

from __future__ import annotations

import base64
import json
import os
import select
import shutil
import subprocess
import tempfile
import time
from pathlib import Path
from types import TracebackType
from typing import Any

import pytest

NAMES = ("chromium", "chromium-browser", "google-chrome", "chrome")
FLAGS = (
    "--headless=new",
    "--no-sandbox",  # the pages are our own, and containers have no other
    "--disable-gpu-sandbox",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--hide-scrollbars",
    "--disable-background-networking",
    "--disable-component-update",
    "--no-first-run",
    "--remote-debugging-pipe",
)


class Browser:
    """One page; messages go over pipes 3 and 4, each JSON ended by a zero byte."""

    def __init__(
        self, *, width: int = 1200, height: int = 900, phone: bool = False, dots: int = 1
    ) -> None:
        program = next((path for name in NAMES if (path := shutil.which(name))), None)
        if program is None:
            pytest.skip(f"no browser: none of {', '.join(NAMES)} is installed")
        self._profile = tempfile.mkdtemp(prefix="browser-")
        read_there, self._write = os.pipe()
        self._read, write_there = os.pipe()
        ends = [
            os.dup2(read_there, 200, inheritable=True),
            os.dup2(write_there, 201, inheritable=True),
        ]
        self._process = subprocess.Popen(
            ["bash", "-c", 'exec "$0" "$@" 3<&200 4>&201', program, *FLAGS,
             f"--user-data-dir={self._profile}", "about:blank"],
            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, pass_fds=(200, 201),
        )  # fmt: skip
        for end in (read_there, write_there, *ends):
            os.close(end)
        self._buffer = b""
        self._count = 0
        self.problems: list[str] = []
        """Exceptions and errors that pages threw or wrote."""
        self._session = ""
        targets = self.send("Target.getTargets")["targetInfos"]
        page = next(target for target in targets if target["type"] == "page")
        attached = self.send("Target.attachToTarget", targetId=page["targetId"], flatten=True)
        self._session = attached["sessionId"]
        for domain in ("Page", "Runtime", "Log"):
            self.send(f"{domain}.enable")
        self.send("Emulation.setDeviceMetricsOverride", width=width, height=height,
                  deviceScaleFactor=dots, mobile=phone)  # fmt: skip
        if phone:
            self.send("Emulation.setTouchEmulationEnabled", enabled=True, maxTouchPoints=2)

    def send(self, method: str, **params: Any) -> dict[str, Any]:
        """Call ``method`` of the browser's protocol and return its result."""
        self._count += 1
        message = {"id": self._count, "method": method, "params": params}
        if self._session:
            message["sessionId"] = self._session
        os.write(self._write, json.dumps(message).encode() + b"\0")
        while (answer := self._next()).get("id") != self._count:
            self._note(answer)
        assert "error" not in answer, (method, answer["error"])
        result: dict[str, Any] = answer["result"]
        return result

    def open(self, path: Path) -> None:
        """Open a file and wait until it is loaded and drawn."""
        self.send("Page.navigate", url=path.resolve().as_uri())
        self.wait("document.readyState === 'complete'")

    def wait(self, expression: str, seconds: float = 240.0) -> None:
        """Wait until ``expression`` is true."""
        end = time.monotonic() + seconds
        while not self.run(expression):
            assert time.monotonic() < end, f"never true: {expression}"
            time.sleep(0.05)

    def run(self, expression: str) -> Any:
        """Value of a JavaScript expression in the page."""
        out = self.send(
            "Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True
        )
        assert "exceptionDetails" not in out, out["exceptionDetails"]
        return out["result"].get("value")

    def drag(self, start: tuple[float, float], end: tuple[float, float], steps: int = 4) -> None:
        """Drag with the left mouse button between two points of the window [px]."""

        def mouse(kind: str, x: float, y: float) -> None:
            self.send("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left",
                      buttons=int(kind != "mouseReleased"), clickCount=1)  # fmt: skip

        mouse("mousePressed", *start)
        for k in range(1, steps + 1):
            mouse("mouseMoved", *(a + (b - a) * k / steps for a, b in zip(start, end, strict=True)))
        mouse("mouseReleased", *end)

    def touch(self, start: tuple[float, float], end: tuple[float, float], steps: int = 4) -> None:
        """Drag with one finger between two points of the window [px]."""

        def finger(kind: str, *points: dict[str, float]) -> None:
            self.send("Input.dispatchTouchEvent", type=kind, touchPoints=list(points))

        finger("touchStart", {"x": start[0], "y": start[1]})
        for k in range(1, steps + 1):
            x, y = (a + (b - a) * k / steps for a, b in zip(start, end, strict=True))
            finger("touchMove", {"x": x, "y": y})
        finger("touchEnd")

    def screenshot(self, *, whole: bool = False) -> bytes:
        """PNG of the window, or of the whole page."""
        out = self.send("Page.captureScreenshot", format="png", captureBeyondViewport=whole)
        return base64.b64decode(out["data"])

    def close(self) -> None:
        self._process.kill()
        self._process.wait()
        os.close(self._read)
        os.close(self._write)
        shutil.rmtree(self._profile, ignore_errors=True)

    def __enter__(self) -> Browser:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def _next(self, seconds: float = 240.0) -> dict[str, Any]:
        end = time.monotonic() + seconds
        while b"\0" not in self._buffer:
            ready, _, _ = select.select([self._read], [], [], max(0.0, end - time.monotonic()))
            assert ready, f"the browser said nothing for {seconds} s"
            got = os.read(self._read, 1 << 16)
            assert got, "the browser ended"
            self._buffer += got
        line, self._buffer = self._buffer.split(b"\0", 1)
        message: dict[str, Any] = json.loads(line)
        return message

    def _note(self, event: dict[str, Any]) -> None:
        params = event.get("params", {})
        if event.get("method") == "Runtime.exceptionThrown":
            details = params["exceptionDetails"]
            self.problems.append(details.get("exception", {}).get("description", details["text"]))
        elif event.get("method") == "Log.entryAdded" and params["entry"]["level"] == "error":
            self.problems.append(params["entry"]["text"])
        elif event.get("method") == "Runtime.consoleAPICalled" and params["type"] in {
            "error",
            "warning",
        }:
            self.problems.append(" ".join(str(a.get("value", "")) for a in params["args"]))
