"""Run a function in child processes, several in parallel, each with a limit on processor time.

A child that crashes or hangs costs only its own request. It is killed with all processes that it
started, and it ends when its parent ends, for whatever reason.
"""

from __future__ import annotations

import json
import os
import queue
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Generator, Hashable, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, TypeVar

from articulate.errors import UsageError
from articulate.jobs.child import REQUEST_EXIT, USAGE_EXIT
from articulate.jobs.process_identity import processor_time_s

THREADS = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
"""Environment of every child: more threads compete with the children beside it."""
MAX_LINE = 300
"""Characters of a child's last line of standard error that are kept."""
POLL_S = 0.2
"""Time between measurements of processor time [s]."""
MIN_IDLE_S = 5.0
"""Least time without any processor time after which a child counts as stuck [s]."""

Key = TypeVar("Key", bound=Hashable)


@dataclass(frozen=True, kw_only=True)
class ChildResult:
    """Result of a child process."""

    code: int | None
    """Exit status; negative for a signal; None if the time limit ended it."""
    stdout: str = ""
    stderr: str = ""
    processor_s: float = 0.0
    """Processor time that it had used when the time limit ended it [s]."""
    idle: bool = False
    """True if it was ended because it used no processor time any more."""

    @property
    def value(self) -> str:
        """Last line of standard output."""
        return (self.stdout.strip().splitlines() or [""])[-1]

    @property
    def last_line(self) -> str:
        """Last line of standard error, shortened."""
        return (self.stderr.strip().splitlines() or ["no message"])[-1][:MAX_LINE]

    @property
    def is_undecided(self) -> bool:
        """True if it ended for a reason outside its request: time, memory or a bug."""
        known = (0, USAGE_EXIT, REQUEST_EXIT)
        return self.code in (None, -signal.SIGKILL) or (self.code > 0 and self.code not in known)

    def failure(self, limit_s: float) -> str:
        """Return the reason why there is no result, one sentence; empty if there is one.

        Args:
            limit_s: Limit on processor time [s], for the sentence.

        Raises:
            UsageError: The settings are wrong for every request.
        """
        if self.code is None and self.idle:
            return f"got stuck after {self.processor_s:.1f} s of processor time"
        if self.code is None:
            return (
                f"took {self.processor_s:.1f} s of processor time, more than the limit of "
                f"{limit_s:g} s"
            )
        if self.code == USAGE_EXIT:
            raise UsageError(self.last_line)
        if self.code == REQUEST_EXIT:
            return self.last_line
        if self.code > 0:
            return f"its process ended with {self.code}: {self.last_line}"
        if self.code == -signal.SIGKILL:
            return "its process was killed; was there enough memory?"
        if self.code < 0:
            name = signal.Signals(-self.code).name
            return f"a library crashed on it ({name}); look for a damaged file in it"
        return ""


def run_isolated(
    module: str, items: Sequence[tuple[Key, Mapping[str, Any]]], jobs: int, limit_s: float
) -> Generator[tuple[Key, ChildResult], None, None]:
    """Handle requests in child processes and yield the results in the order in which they end.

    All children are killed when the loop over the results is left, also by an error.

    Args:
        module: Module whose function ``run`` handles a request; see :mod:`articulate.jobs.child`.
        items: Key and request, a JSON object, of each item.
        jobs: Number of children in parallel.
        limit_s: Processor time of one child with all that it starts [s].
    """
    children = _Children(module, limit_s)
    done: queue.SimpleQueue[tuple[Key, Future[ChildResult]]] = queue.SimpleQueue()
    with ThreadPoolExecutor(jobs) as threads:
        try:
            for key, request in items:
                future = threads.submit(children.handle, request)
                future.add_done_callback(lambda f, key=key: done.put((key, f)))  # type: ignore[misc]
            for _ in items:
                key, future = done.get()
                yield key, future.result()
        finally:
            children.stop()
            threads.shutdown(wait=True, cancel_futures=True)


class _Children:
    """Running child processes of one module, used by several threads."""

    def __init__(self, module: str, limit_s: float) -> None:
        self.module = module
        self.limit_s = limit_s
        self._running: set[subprocess.Popen[str]] = set()
        self._lock = threading.Lock()
        self._stopped = False

    def handle(self, request: Mapping[str, Any]) -> ChildResult:
        """Start a child for ``request`` and wait for its result."""
        with self._lock:
            if self._stopped:
                raise KeyboardInterrupt
            process = subprocess.Popen(
                [sys.executable, "-m", "articulate.jobs.child", self.module, str(os.getpid())],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                text=True,
                errors="replace",
                env={**os.environ, **THREADS},
                start_new_session=True,
            )
            self._running.add(process)
        try:
            return self._result(process, json.dumps(request))
        finally:
            _kill(process)
            with self._lock:
                self._running.discard(process)

    def _result(self, process: subprocess.Popen[str], request: str | None) -> ChildResult:
        """Wait for a child, and give up when its time limit is reached or it is stuck.

        On systems without ``/proc`` wall-clock time is used.
        """
        begun = progress = time.monotonic()
        used_s = 0.0
        while True:
            try:
                stdout, stderr = process.communicate(request, timeout=POLL_S)
            except subprocess.TimeoutExpired:
                request = None  # it was sent
            else:
                return ChildResult(code=process.returncode, stdout=stdout, stderr=stderr)
            now = time.monotonic()
            measured_s = processor_time_s(process.pid)
            measured_s = now - begun if measured_s is None else measured_s
            if measured_s > used_s:
                used_s, progress = measured_s, now
            idle = now - progress > max(self.limit_s, MIN_IDLE_S)
            if idle or used_s > self.limit_s:
                return ChildResult(code=None, processor_s=used_s, idle=idle)

    def stop(self) -> None:
        """Kill all children; no further one is started."""
        with self._lock:
            self._stopped = True
            for process in self._running:
                _kill(process)


def _kill(process: subprocess.Popen[str]) -> None:
    """Kill a child and everything in its process group."""
    with suppress(ProcessLookupError, PermissionError):
        os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    for stream in (process.stdin, process.stdout, process.stderr):
        if stream is not None:
            with suppress(OSError, ValueError):
                stream.close()
