"""The parent's side of a locked-up child process: lines of JSON with bounded sizes and time."""

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
"""Longest line that is taken from a child [bytes]."""
MAX_BYTES = 20_000_000
"""Most that is taken from a child in all [bytes]."""
WAIT_S = 0.005
"""Between two looks at whether a silent child has ended [s]."""
ENDS = {
    signal.SIGXCPU: "it took more time of the processor than it may",
    signal.SIGKILL: "it took more time or memory than it may",
    signal.SIGSYS: "it made a system call that is forbidden",
    signal.SIGSEGV: "the interpreter broke down on it",
}


@dataclass(frozen=True, kw_only=True)
class SandboxLimits:
    """What a run of a program may take."""

    seconds: float = 30.0
    """Time by the clock, answers of the parent included [s]."""
    cpu_s: int = 10
    """Time of the processor in the child [s]."""
    memory_bytes: int = 256_000_000
    """Address space of the child."""
    layers: tuple[str, ...] = LAYERS
    """Layers of the lockdown that are asked for; those that the kernel lacks are left out."""


class ChildEnded(Exception):  # noqa: N818  # the child ended; what that means, the caller knows
    """The child is gone, too late, or says what it may not; the sentence says which."""


class Sandbox:
    """A child process that runs a script; use it in a ``with``.

    Args:
        script: Python file; it gets the limits as JSON in its first argument.
        limits: What it may take.
    """

    def __init__(self, script: Path, limits: SandboxLimits) -> None:
        self.limits = limits
        self._rest = b""
        self._taken = 0
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
        """End the child and all of its group, and forget them."""
        if self.process.returncode is None:
            # Not yet waited for, so that the number of the group cannot be another's by now.
            with contextlib.suppress(ProcessLookupError, PermissionError):
                os.killpg(self.process.pid, signal.SIGKILL)
        self.process.wait()
        for stream in (self.process.stdin, self.process.stdout):
            if stream is not None:
                stream.close()

    def send(self, content: dict[str, Any]) -> None:
        """Write one line to the child.

        Raises:
            ChildEnded: It reads nothing in time, or is gone.
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
        """The next line of the child.

        Raises:
            ChildEnded: There is none in time, it is too long, or no JSON object.
        """
        while b"\n" not in self._rest:
            self._rest += self._more()
            if len(self._rest) > MAX_LINE or self._taken > MAX_BYTES:
                raise ChildEnded("it says too much")
        line, self._rest = self._rest.split(b"\n", 1)
        try:
            content = json.loads(line)
        except (ValueError, RecursionError):
            content = None
        if not isinstance(content, dict):
            raise ChildEnded("what it says is not understood")
        return content

    def _more(self) -> bytes:
        assert self.process.stdout is not None
        stream = self.process.stdout.fileno()
        if not select.select([stream], [], [], self._left())[0]:
            raise ChildEnded(f"it took more than {self.limits.seconds:g} s")
        data = os.read(stream, READ_BYTES)
        if not data:
            raise ChildEnded(self._end())
        self._taken += len(data)
        return data

    def check_time(self) -> None:
        """End what the parent computes for the child once its time is over.

        Raises:
            ChildEnded: It is.
        """
        self._left()

    def _left(self) -> float:
        left = self._deadline - time.monotonic()
        if left <= 0.0:
            raise ChildEnded(f"it took more than {self.limits.seconds:g} s")
        return left

    def _end(self) -> str:
        """How the child ended that says no more; whatever it has left of its group ends, too."""
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
