"""Parent's side of a restricted child process: lines of JSON with limits of size and time."""

from __future__ import annotations

import contextlib
import json
import os
import select
import signal
import subprocess
import sys
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from articulate.reconstruct.program.process_limits import LAYERS

READ_BYTES = 65_536
MAX_LINE = 1_000_000
"""Longest line of a child [bytes]."""
MAX_BYTES = 20_000_000
"""Longest output of a child in all [bytes]."""
WAIT_S = 0.005
"""Interval at which a child without output is polled [s]."""
ENDS = {
    signal.SIGXCPU: "it exceeded its processor time",
    signal.SIGKILL: "it exceeded its time or memory",
    signal.SIGSYS: "it made a forbidden system call",
    signal.SIGSEGV: "the interpreter crashed",
}


@dataclass(frozen=True, kw_only=True)
class SandboxLimits:
    """Limits of a run of a program."""

    seconds: float = 30.0
    """Wall-clock time, including answers of the parent [s]."""
    cpu_s: int = 10
    """Processor time of the child [s]."""
    memory_bytes: int = 256_000_000
    """Address space of the child [bytes]."""
    layers: tuple[str, ...] = LAYERS
    """Requested layers of restrictions; those that the kernel lacks are omitted."""


class ChildEnded(Exception):  # noqa: N818  # an end is not always an error
    """The child has ended, exceeded its time, or sent invalid output."""


class Sandbox:
    """A child process that runs a script; use it in a ``with``.

    Args:
        script: Python file; it gets the limits as JSON in its first argument.
        limits: Limits of the run.
    """

    def __init__(self, script: Path, limits: SandboxLimits) -> None:
        self.limits = limits
        self._rest = b""
        self._received = 0
        self._deadline = time.monotonic() + limits.seconds
        settings = asdict(limits)
        del settings["seconds"]
        self.process = subprocess.Popen(
            [sys.executable, "-I", "-S", "-B", str(script), json.dumps(settings)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env={},
            cwd="/",
            close_fds=True,
            start_new_session=True,
            bufsize=0,
        )

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def close(self) -> None:
        """End the child with its process group, and close its streams."""
        if self.process.returncode is None:
            # The child was not waited for yet, so that its process id cannot be reused.
            with contextlib.suppress(ProcessLookupError, PermissionError):
                os.killpg(self.process.pid, signal.SIGKILL)
        self.process.wait()
        for stream in (self.process.stdin, self.process.stdout):
            if stream is not None:
                stream.close()

    def send(self, content: dict[str, Any]) -> None:
        """Write one line to the child.

        Raises:
            ChildEnded: It does not read in time, or has ended.
        """
        assert self.process.stdin is not None
        data = memoryview(json.dumps(content, allow_nan=False).encode() + b"\n")
        stream = self.process.stdin.fileno()
        os.set_blocking(stream, False)
        while data:
            if not select.select([], [stream], [], self._left())[1]:
                raise ChildEnded(f"it took more than {self.limits.seconds:g} s")
            try:
                data = data[os.write(stream, data) :]
            except BrokenPipeError:
                raise ChildEnded(self._end()) from None

    def receive(self) -> dict[str, Any]:
        """Return the next line of the child.

        Raises:
            ChildEnded: There is none in time, it is too long, or not a JSON object.
        """
        while b"\n" not in self._rest:
            self._rest += self._more()
            if len(self._rest) > MAX_LINE or self._received > MAX_BYTES:
                raise ChildEnded("its output is too long")
        line, self._rest = self._rest.split(b"\n", 1)
        try:
            content = json.loads(line)
        except (ValueError, RecursionError):
            content = None
        if not isinstance(content, dict):
            raise ChildEnded("its output is not JSON")
        return content

    def _more(self) -> bytes:
        assert self.process.stdout is not None
        stream = self.process.stdout.fileno()
        if not select.select([stream], [], [], self._left())[0]:
            raise ChildEnded(f"it took more than {self.limits.seconds:g} s")
        data = os.read(stream, READ_BYTES)
        if not data:
            raise ChildEnded(self._end())
        self._received += len(data)
        return data

    def check_time(self) -> None:
        """Check the time limit, also while the parent computes for the child.

        Raises:
            ChildEnded: The time is over.
        """
        self._left()

    def _left(self) -> float:
        left = self._deadline - time.monotonic()
        if left <= 0.0:
            raise ChildEnded(f"it took more than {self.limits.seconds:g} s")
        return left

    def _end(self) -> str:
        """Return how a child without output has ended, and end its process group."""
        options = os.WEXITED | os.WNOHANG | os.WNOWAIT
        late = f"it took more than {self.limits.seconds:g} s"
        while os.waitid(os.P_PID, self.process.pid, options) is None:
            if time.monotonic() > self._deadline:
                return late
            time.sleep(WAIT_S)
        self.close()
        code = self.process.returncode
        if code < 0:
            return ENDS.get(signal.Signals(-code), f"it was ended by signal {-code}")
        return f"its process ended with code {code}"
